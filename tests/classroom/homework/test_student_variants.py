"""Variants: hidden values that follow from a name and a secret, and hand-ins of another's variant."""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from scipy import stats

from lab.classroom.homework.bounded_runs import BoundedRuns, Examined
from lab.classroom.homework.exported_run import repeat
from lab.classroom.homework.grading import GRADED, REFUSED, Row, grade, list_files
from lab.classroom.homework.hand_in import HandIn, HandInError, hand_in, hand_in_text, write_hand_in
from lab.classroom.homework.hand_out import handed_out, links_text
from lab.classroom.homework.homework import Judge
from lab.classroom.homework.homework_file import (
    Keyed,
    homework_text,
    make_homework,
    read_homework,
    read_key,
    write_key,
)
from lab.classroom.homework.shelf import OWN_LINK, Shelf
from lab.classroom.homework.solutions_sheet import solutions_html
from lab.classroom.homework.variant import variant_tag
from lab.classroom.lessons.fields import LessonError

SOURCE = """title = "Find <it>"
text = "Something is *wrong*."
[settings]
mission = "los_angeles"
trajectory.imu_rate = 20
[hidden]
settings = { sensors.gyro.bias = [0.04372, 0.0, 0.0] }
[hidden.each]
sensors.gps.latency = { from = 0.06, to = 0.2, step = 0.02 }
sensors.accelerometer.bias = { from = [10.0, 0.0, 0.0], to = [90.0, 0.0, 0.0] }
faults = { choices = [["r"], ["axes", "earth_rate"]] }
[[question]]
text = "How old are the fixes, in ms?"
answer = { of = "sensors.gps.latency", times = 1000 }
tolerance = 5
[[question]]
text = "Which bias?"
answer = { of = "sensors.accelerometer.bias", axis = 1 }
tolerance = 1
[[question]]
text = "The same for all?"
choices = ["yes", "no"]
answer = "yes"
"""
NAMES = [f"Student {number}" for number in range(300)]


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Keyed:
    return made(tmp_path_factory.mktemp("source"), SOURCE)


def made(folder: Path, source: str) -> Keyed:
    path = folder / "find.toml"
    path.write_text(source, encoding="utf-8")
    return make_homework(path)


def latency(judge: Judge) -> float:
    return judge.homework.experiment().scenario.hidden.settings["sensors"]["gps"]["latency"]


def test_a_variant_is_the_hmac_of_the_name_with_a_key_derived_from_the_secret(keyed: Keyed) -> None:
    key = HKDF(SHA256(), 32, b"", b"ins-lab: variants of a homework").derive(keyed.key.secret)
    found = hmac.new(key, b"tag\0ada lovelace", hashlib.sha256).hexdigest()
    assert variant_tag(keyed.key, "Ada Lovelace") == found[:16]
    part = int.from_bytes(hmac.digest(key, b"sensors.gps.latency\0ada lovelace", "sha256")[:6], "big") / 2**48
    assert latency(keyed.judge_for("Ada Lovelace")) == pytest.approx(0.06 + 0.02 * int(8 * part))


def test_the_same_name_has_the_same_variant_and_another_secret_another(keyed: Keyed, tmp_path: Path) -> None:
    first, again = (keyed.judge_for(name) for name in ("Ada  Lovelace", " ada LOVELACE"))
    assert first.homework.scenario.hidden == again.homework.scenario.hidden
    other = made(tmp_path, SOURCE).judge_for("Ada Lovelace")
    assert other.homework.scenario.hidden.seed != first.homework.scenario.hidden.seed
    path = tmp_path / "kept.key"
    write_key(path, keyed)
    kept = read_key(path).judge_for("Ada Lovelace")
    assert kept.homework.scenario.hidden == first.homework.scenario.hidden


@pytest.mark.proof
def test_values_are_spread_evenly_and_do_not_depend_on_each_other(keyed: Keyed) -> None:
    hidden = [keyed.judge_for(name).homework.scenario.hidden for name in NAMES]
    assert len({one.seed for one in hidden}) == len(NAMES)
    late = [one.settings["sensors"]["gps"]["latency"] for one in hidden]
    bias = [one.settings["sensors"]["accelerometer"]["bias"][0] for one in hidden]
    counts = Counter(late)
    assert sorted(counts) == pytest.approx([0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2])
    assert stats.chisquare(list(counts.values())).pvalue > 1e-4
    assert stats.kstest(bias, stats.uniform(10, 80).cdf).pvalue > 1e-4
    assert abs(stats.spearmanr(late, bias).statistic) < 4 / len(NAMES) ** 0.5
    assert stats.binomtest(sum(one.faults == ("r",) for one in hidden), len(NAMES)).pvalue > 1e-4


def test_answers_are_those_of_the_variant(keyed: Keyed) -> None:
    for name in NAMES[:10]:
        judge = keyed.judge_for(name)
        settings = judge.homework.scenario.hidden.settings["sensors"]
        first, second, third = judge.solutions
        assert first.answer == pytest.approx(1000 * settings["gps"]["latency"])
        assert second.answer == settings["accelerometer"]["bias"][0]
        assert third.answer == "yes"


def test_a_students_file_opens_as_the_variant_and_has_one_name(keyed: Keyed, tmp_path: Path) -> None:
    path = tmp_path / "ada.homework"
    path.write_text(homework_text(keyed, "Ada Lovelace"), encoding="utf-8")
    opened = read_homework(path)
    assert opened.student == "Ada Lovelace"
    assert opened.scenario.hidden == keyed.judge_for("Ada Lovelace").homework.scenario.hidden
    assert hand_in(opened, "ADA lovelace", opened.experiment()).variant == opened.variant
    with pytest.raises(HandInError, match="homework of Ada Lovelace"):
        hand_in(opened, "Bob", opened.experiment())


def test_a_changed_name_in_a_students_file_is_refused(keyed: Keyed, tmp_path: Path) -> None:
    path = tmp_path / "ada.homework"
    path.write_text(homework_text(keyed, "Ada").replace('student = "Ada"', 'student = "Bob"'))
    with pytest.raises(LessonError, match="changed since the teacher signed it"):
        read_homework(path)


def graded(keyed: Keyed, folder: Path) -> dict[str, Row]:
    rows = grade(list_files(folder), keyed, examining=lambda judge, _changes: Examined.failed(judge, ""))
    return {row["file"]: row for row in rows}


def test_the_grader_takes_the_values_of_the_name_and_refuses_anothers_variant(
    keyed: Keyed, tmp_path: Path
) -> None:
    """Ada solves her own; Bob, with a program of his own, puts his name on hers, or her answers on his."""
    ada, bob = (keyed.judge_for(name) for name in ("Ada", "Bob"))
    right = tuple(str(one.answer) for one in ada.solutions)
    assert [one.answer for one in bob.solutions][:2] != [one.answer for one in ada.solutions][:2]
    handed = hand_in(ada.homework, "Ada", ada.homework.experiment(), (), right)
    files = {
        "ada": handed,
        "stolen": HandIn("Bob", {}, (), right, ada.homework.variant),
        "copied": HandIn("Bob", {}, (), right, bob.homework.variant),
        "plain": HandIn("Bob", {}, (), right),
    }
    for name, one in files.items():
        write_hand_in(tmp_path / f"{name}.handin", keyed.homework, one)
    rows = graded(keyed, tmp_path)
    assert rows["ada.handin"]["status"] == GRADED
    assert [rows["ada.handin"][f"answer_points_{k}"] for k in (1, 2, 3)] == ["1", "1", "1"]
    assert rows["stolen.handin"]["status"] == REFUSED
    assert "variant of another student than Bob" in rows["stolen.handin"]["remark"]
    assert rows["plain.handin"]["status"] == REFUSED
    assert "file for Bob" in rows["plain.handin"]["remark"]
    won = [float(rows["copied.handin"][f"answer_points_{k}"]) for k in (1, 2, 3)]
    assert won == [float(one.accepts(answer)) for one, answer in zip(bob.solutions, right, strict=True)]
    assert sum(won) < 3


def test_a_variant_handed_in_for_a_homework_of_all_is_refused(keyed: Keyed, tmp_path: Path) -> None:
    common = made(tmp_path, SOURCE.partition("[hidden]")[0] + SOURCE.partition("=5\n")[2] + PLAIN)
    folder = tmp_path / "handed"
    folder.mkdir()
    handed = HandIn("Ada", {}, (), ("yes",), "0123456789abcdef")
    (folder / "ada.handin").write_text(hand_in_text(common.homework, handed), encoding="utf-8")
    assert "the same for all" in graded(common, folder)["ada.handin"]["remark"]


PLAIN = """[[question]]
text = "The same for all?"
choices = ["yes", "no"]
answer = "yes"
"""


def test_runs_are_those_of_the_variant_in_the_process_apart_too(keyed: Keyed) -> None:
    with BoundedRuns(keyed, examining=seed_of) as examining:
        for name in ("Ada", "Bob"):
            judge = keyed.judge_for(name)
            assert examining(judge, {}).figures == {"seed": judge.homework.scenario.hidden.seed}


def seed_of(judge: Judge, _changes: object) -> Examined:
    return Examined({"seed": float(judge.homework.scenario.hidden.seed)}, [])


@pytest.mark.parametrize(
    ("found", "replaced", "words"),
    [
        ("from = 0.06, to = 0.2, step = 0.02", "from = 0.3, to = 0.2", "a to that is at least from"),
        ("from = 0.06, to = 0.2, step = 0.02", "from = 0.06, to = [0.2]", "two lists"),
        ("from = 0.06, to = 0.2, step = 0.02", "from = 0.06, to = 1e9", "latency"),
        ("step = 0.02", "step = 0", "step"),
        ("step = 0.02", "stop = 0.02", "stop"),
        ('[["r"], ["axes", "earth_rate"]]', '[["r"], ["no such fault"]]', "faults"),
        ('[["r"], ["axes", "earth_rate"]]', '[["r"], ["latency"]]', "set by the fault latency too"),
        ("sensors.gps.latency =", "sensors.gps.no_such =", "no_such"),
        (
            "sensors.gps.latency = {",
            "navigator.r_scale = { from = 1, to = 2 }\nsensors.gps.latency = {",
            "cannot be hidden",
        ),
        ("sensors.gps.latency =", "sensors.gyro.bias =", "in settings and in each"),
        ("sensors.gps.latency = {", "sensors.gps.latency = 3 #", "accepted is { from"),
        ('of = "sensors.gps.latency"', 'of = "sensors.gps.noise"', "is not in hidden.each"),
        (", axis = 1", "", "has 3 values"),
        (", times = 1000", ", axis = 1", "is one value"),
        ("axis = 1", "axis = 4", "has 3 values"),
    ],
)
def test_a_table_of_what_differs_is_refused_with_the_reason(
    tmp_path: Path, found: str, replaced: str, words: str
) -> None:
    assert found in SOURCE
    with pytest.raises(LessonError, match=r"find\.toml") as refusal:
        made(tmp_path, SOURCE.replace(found, replaced))
    assert words in str(refusal.value)


def test_a_server_opens_a_variant_by_its_link_and_not_without_it(keyed: Keyed, tmp_path: Path) -> None:
    write_key(tmp_path / "find.key", keyed)
    shelf = Shelf(tmp_path)
    (entry,) = shelf.entries
    assert (entry.homework, entry.problem) == (None, OWN_LINK)
    (one, other) = handed_out(keyed, ["Ada Lovelace", "李 雷"])
    for handed in (one, other):
        link = handed.query.removeprefix("?homework=")
        opened = shelf.find(link)
        assert opened is not None
        assert (opened.student, opened.link) == (handed.name, link)
    name, tag, student = one.query.removeprefix("?homework=").split(".")
    _, _, another = other.query.removeprefix("?homework=").split(".")
    wrong = (
        *(name, f"{name}.", f"{name}.{tag}", f"{name}.{tag}.{another}", f"{name}.{tag[:-1]}.{student}"),
        *(f"{name}.{tag}.!", f"{name}.{tag}.{student}.x", f"{name}..", "", "…", f"{name}.é.{student}"),
    )
    assert [shelf.find(link) for link in wrong] == [None] * len(wrong)


def test_names_become_different_files_without_formulas(keyed: Keyed) -> None:
    names = ["../../etc/passwd", "=1+1", "a b", "A  B.", "-", "x" * 80]
    files = [one.file for one in handed_out(keyed, names)]
    assert len(set(files)) == len(names)
    assert all("/" not in file and not file.startswith((".", "-", "=")) and len(file) < 80 for file in files)
    table = links_text(handed_out(keyed, names))
    assert "\n'=1+1," in table
    with pytest.raises(LessonError, match="there twice"):
        handed_out(keyed, ["Ada", "ada "])


def test_the_sheet_has_every_value_and_no_markup_of_a_name(keyed: Keyed) -> None:
    sheet = solutions_html(keyed, ["Ada", "<b>Bob</b>"])
    for name in ("Ada", "<b>Bob</b>"):
        judge = keyed.judge_for(name)
        assert str(judge.homework.scenario.hidden.seed) in sheet
        assert f"{judge.solutions[0].answer:g} ± 5" in sheet
    assert "<b>" not in sheet
    assert "Find &lt;it&gt;" in sheet
    assert "<script" not in sheet
    assert "http" not in sheet


def test_an_export_of_a_variant_is_refused_in_words(keyed: Keyed, tmp_path: Path) -> None:
    """It names the homework, and not the student, so the grader does not know which values to run."""
    result = keyed.judge_for("Ada").homework.experiment().run()
    result.to_netcdf(tmp_path / "ada.nc")
    found = repeat(keyed, tmp_path / "ada.nc", ())
    assert found.status == REFUSED
    assert "an export names no student" in found.remark
