"""Files of lessons: a refusal names the step, the key, and what is accepted; a changed file is read anew."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from dashboards.drawn_pages import PAGES as TABS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.lessons import lesson_file
from lab.classroom.lessons.catalogue import Catalogue
from lab.classroom.lessons.fields import LessonError
from lab.classroom.lessons.lesson import PAGES, trials
from lab.classroom.lessons.lesson_file import OF_LESSON, OF_STEP, read_lesson
from lab.classroom.lessons.quantities import QUANTITIES

DOCUMENT = Path(__file__).parents[3] / "docs/lessons.md"

GOOD = """
title = "Mine"
settings = {{ mission = "los_angeles" }}
{top}
[[step]]
title = "First"
text = "Set $R$."
{step}
"""


def written(folder: Path, top: str = "", step: str = "", name: str = "mine.toml") -> Path:
    path = folder / name
    path.write_text(GOOD.format(top=top, step=step), encoding="utf-8")
    return path


def test_a_lesson_is_read_as_it_is_written(tmp_path: Path) -> None:
    step = """page = "Errors"
time = 12
question = "How large?"
answer = 3
tolerance = 0.5
check = "nis < 2 and navigator.states > 15"
settings = { navigator.r_scale = 2 }
solution = { navigator.states = 21 }
wrong = [ { navigator.q_scale = 2 } ]"""
    lesson = read_lesson(written(tmp_path, 'summary = "Of R."', step))
    (found,) = lesson.steps
    assert (lesson.name, lesson.title, lesson.summary, lesson.fault) == ("mine", "Mine", "Of R.", "")
    assert (found.page, found.time, found.answer, found.tolerance) == ("Errors", 12.0, 3.0, 0.5)
    experiment = lesson.experiment(found)
    assert (experiment.mission, experiment.navigator.r_scale) == ("los_angeles", 2.0)
    assert not isinstance(experiment, FaultyExperiment)
    assert found.judge("3,4", None).right is None  # the answer is right, but there is no result
    assert found.judge("4", None).right is False
    assert found.judge("three", None).right is None  # no number is no wrong answer
    assert found.judge("", None).right is None


@pytest.mark.parametrize(
    ("top", "step", "words"),
    [
        ("fault = 'typo'", "", ("fault = 'typo'", "gravity")),
        ("titel = 'x'", "", ("titel: is not known", "Did you mean title?")),
        ("", "texd = 'x'", ("step 1: texd", "Did you mean text?")),
        ("", "settings = { navigator.r_scal = 1 }", ("step 1: settings", "r_scale")),
        ("", "settings = { navigator.r_scale = -1 }", ("step 1: settings", "accepted is")),
        ("", "settings = { mission = '/etc/passwd' }", ("step 1: settings", "no mission", "montreal")),
        ("", "settings = 3", ("step 1: settings", "table")),
        ("", "hint = 'Try `navigator.r_scala`.'", ("step 1: hint", "Did you mean navigator.r_scale?")),
        ("", "page = 'Erors'", ("step 1: page = 'Erors'", "Innovations")),
        ("", "time = 'soon'", ("step 1: time", "number")),
        ("", "time = -1", ("step 1: time", "from 0")),
        ("", "time = nan", ("step 1: time", "number")),
        ("", f"time = 1{'0' * 400}", ("step 1: time", "number")),  # no float can hold it
        ("", f"question = 'x?'\nanswer = -1{'0' * 400}\ntolerance = 1", ("step 1: answer", "number")),
        ("", 'because = "\\u001b[31m"', ("step 1: because", "control character")),
        ("summary = 'a\u202eb'", "", ("summary", "control character")),
        ("", "question = 'x?'", ("step 1: question", "neither answer nor check")),
        ("", "answer = 3\ntolerance = 1", ("step 1: answer", "no question")),
        ("", "question = 'x?'\nanswer = 3", ("step 1: answer, tolerance", "both")),
        ("", "question = 'x?'\nchoices = ['a', 'b']\nanswer = 'c'", ("step 1: answer", "one of a, b")),
        ("", "question = 'x?'\nchoices = ['a', 'a']\nanswer = 'a'", ("step 1: choices", "different")),
        ("", "question = 'x?'\nchoices = ['a']\nanswer = 'a'", ("step 1: choices", "2 to")),
        ("", "question = 'x?'\nchoices = [' ', 'a']\nanswer = 'a'", ("step 1: choices", "2 to")),
        ("", "check = '1 < 2'", ("step 1: check", "numbers only", "nis < 1.5")),
        ("", "check = 'nis <'", ("step 1: check", "ends where")),
        ("", "check = 3", ("step 1: check", "condition")),
        ("", "check = 'nis < 1'\nsolution = { seed = -1 }", ("step 1: solution", "seed")),
        ("", "check = 'nis < 1'\nwrong = [ { seed = 'x' } ]", ("step 1: wrong", "seed")),
        ("", "solution = { seed = 2 }", ("step 1: solution", "no check")),
        ("", "hint = '$\\foo$'", ("step 1: hint", "foo is not known")),
        ("", "because = 3", ("step 1: because", "text")),
        ("", "[[step]]\ntitle = 'Second'", ("step 2: text", "missing")),
    ],
)
def test_what_is_wrong_is_said_with_its_place(
    tmp_path: Path, top: str, step: str, words: tuple[str, ...]
) -> None:
    with pytest.raises(LessonError) as caught:
        read_lesson(written(tmp_path, top, step))
    message = str(caught.value)
    assert message.startswith("mine.toml, line ")
    for word in words:
        assert word in message


LONG = """title = "Mine"
summary = "A text with check = 1 and
settings in it"
[settings]
mission = "los_angeles"

[[step]]
title = "First"
text = '''
page = "no page"
[[step]]
'''
settings = {}

[[step]]
title = "Second"
text = "Two."
page = "Errors"
question = "How large?"
answer = 1
tolerance = 0.1
check = "nis < 2"
solution = { navigator.r_scale = 1 }
[step.settings]
seed = 3
navigator.q_scale = 2
""".replace("and\n", "and ")


@pytest.mark.parametrize(
    ("good", "bad", "where"),
    [
        ('title = "Mine"', 'titel = "Mine"', "titel"),
        ('title = "Mine"', "title = 3", "title"),
        ("[settings]", "fault = 'typo'\n[settings]", "fault"),
        ('mission = "los_angeles"', 'mission = "nowhere"', "mission"),
        ('mission = "los_angeles"', 'mision = "los_angeles"', "mision"),
        ("settings = {}", "settings = 3", "settings = 3"),
        ("settings = {}", "settings = { seed = -1 }", "seed = -1"),
        ('title = "Second"', "", "SECOND STEP"),
        ('text = "Two."', 'text = "$\\\\foo$"', "text"),
        ('page = "Errors"', 'page = "Erors"', "page"),
        ('page = "Errors"', "time = 'soon'", "time"),
        ('question = "How large?"', "", "answer"),
        ("tolerance = 0.1", "tolerance = -1", "tolerance"),
        ("tolerance = 0.1", "", "answer"),
        ("answer = 1", "answer = 1\nchoices = ['a', 'a']", "choices"),
        ('check = "nis < 2"', 'check = "nis <"', "check"),
        ('check = "nis < 2"', "check = 3", "check = 3"),
        ("navigator.r_scale = 1", "navigator.r_scale = -1", "solution"),
        ("seed = 3", 'seed = "x"', "seed"),
        ("navigator.q_scale = 2", "navigator.q_scal = 2", "q_scal"),
    ],
)
def test_the_line_is_that_of_the_mistake(tmp_path: Path, good: str, bad: str, where: str) -> None:
    head, _, tail = LONG.rpartition(good)
    text = head + bad + tail
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LessonError) as caught:
        read_lesson(path)
    found = re.match(r"mine\.toml, line (\d+): ", str(caught.value))
    assert found is not None, str(caught.value)
    line = text.split("\n")[int(found[1]) - 1]
    if where == "SECOND STEP":
        assert int(found[1]) == 1 + text.count("\n", 0, text.rindex("[[step]]"))
    else:
        assert where in line
        assert "no page" not in line
    assert re.search("accepted|Accepted|expected", str(caught.value))


def test_files_that_are_none_are_refused(tmp_path: Path, make_pipe: Callable[[Path], None]) -> None:
    large = tmp_path / "large.toml"
    large.write_bytes(b"#" * (lesson_file.LARGEST + 1))
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(256)))
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    pipe = tmp_path / "pipe.toml"
    make_pipe(pipe)
    for path in (large, binary, folder, pipe, tmp_path / "none.toml"):
        with pytest.raises(LessonError, match=path.name):
            read_lesson(path)


def test_the_folder_is_read_again_when_a_file_changes(tmp_path: Path) -> None:
    path = written(tmp_path)
    catalogue = Catalogue(tmp_path)
    first = catalogue.find("own", "mine")
    version = catalogue.version
    catalogue.refresh()
    assert catalogue.version == version
    assert catalogue.find("own", "mine") is first
    path.write_text(path.read_text("utf-8").replace("Mine", "Changed"), encoding="utf-8")
    catalogue.refresh()
    assert catalogue.version > version
    changed = catalogue.find("own", "mine")
    assert changed is not None
    assert changed.title == "Changed"
    path.write_text("title = ", encoding="utf-8")
    catalogue.refresh()
    assert catalogue.find("own", "mine") is None
    assert "mine.toml" in catalogue.entries[0].problem
    path.unlink()
    catalogue.refresh()
    assert {entry.origin for entry in catalogue.entries} == {"shipped", "gallery"}


def test_the_pages_of_a_lesson_are_those_of_the_simulator() -> None:
    assert {*PAGES, "Lessons"} == {page.title for page in TABS}


def test_the_lesson_in_the_documentation_is_accepted_and_its_check_is_right(tmp_path: Path) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    path = tmp_path / "documented.toml"
    path.write_text(block, encoding="utf-8")
    tried = trials(read_lesson(path))
    assert len(tried) == 5
    assert all(trial.is_right for trial in tried)


def test_the_documentation_lists_the_keys_and_the_quantities() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|([^|]*)\| (.+) \|$", text, re.MULTILINE)
    listed = {name: (unit.strip(), meaning) for name, unit, meaning in rows}
    assert listed == {name: (one.unit, one.meaning) for name, one in QUANTITIES.items()}
    assert all(f"`{key}`" in text or key == "step" for key in (*OF_LESSON, *OF_STEP))


def test_a_step_in_single_brackets_is_said_to_be_one(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("title = 'Mine'\nsummary = 'It is short.'\n[step]\ntext = 'One.'\n", encoding="utf-8")
    with pytest.raises(LessonError, match=r"line 3: step: it is one table, \[step\]; accepted are 1 to"):
        read_lesson(path)
