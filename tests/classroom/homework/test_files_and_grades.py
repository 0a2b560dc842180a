"""Homework, key and hand-in files: what opens them, what is refused, and the table of the grades."""

from __future__ import annotations

import base64
import csv
import os
import random
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import toml_text
from lab.classroom.homework import grading
from lab.classroom.homework.grading import GRADED, REFUSED, Row, columns, csv_text, list_files, text_cell
from lab.classroom.homework.hand_in import (
    LARGEST,
    HandIn,
    HandInError,
    hand_in,
    hand_in_text,
    open_hand_in,
    write_hand_in,
)
from lab.classroom.homework.homework_file import (
    Keyed,
    homework_text,
    make_homework,
    read_homework,
    read_key,
    write_key,
)
from lab.classroom.homework.sealing import TeacherKey, cover, seal_for_teacher
from lab.classroom.lessons.fields import LessonError
from lab.experiment.experiment import Experiment

SOURCE = """title = "Find <it>"
text = "Something is *wrong*."
change = ["navigator"]
fault_points = 2
[settings]
mission = "los_angeles"
trajectory.imu_rate = 20
[hidden]
faults = ["latency", "r"]
settings = { sensors.gyro.bias = [0.04372, 0.0, 0.0] }
[[question]]
text = "How old are the fixes?"
answer = 0.12
tolerance = 0.02
[[question]]
text = "Which colour?"
choices = ["white", "coloured"]
answer = "coloured"
points = 3
[[goal]]
text = "NEES below 5."
condition = "nees < 5 and navigator.latency > 0.1"
points = 4
"""
LATE, R = "fixes that come late", "R ten times too small"
SOLVED = {"navigator.latency": 0.12, "navigator.r_scale": 10.0}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Keyed:
    path = tmp_path_factory.mktemp("source") / "find.toml"
    path.write_text(SOURCE, encoding="utf-8")
    return make_homework(path)


def solved(keyed: Keyed, name: str = "Ada", **changes: object) -> HandIn:
    homework = keyed.homework
    values = SOLVED | {path.replace("__", "."): value for path, value in changes.items()}
    return hand_in(homework, name, homework.experiment_with(values), (LATE, R), ("0,12", "coloured"))


def sealed(keyed: Keyed, **tables: object) -> bytes:
    """Return a hand-in that a student's own program has sealed, with any content."""
    inside = {"name": "Eve", "faults": [], "answers": ["", ""], "changes": [], "unset": []} | tables
    content = seal_for_teacher(
        keyed.homework.public, toml_text(inside).encode(), f"hand-in of the homework {keyed.homework.name}"
    )
    tops = {"format": "ins-lab hand-in 1", "homework": keyed.homework.name}
    return toml_text(tops | {"sealed": base64.b64encode(content).decode()}).encode()


def graded(keyed: Keyed, folder: Path) -> dict[str, Row]:
    return {row["file"]: row for row in grading.grade(list_files(folder), keyed)}


def test_the_student_gets_all_but_what_is_hidden(keyed: Keyed, tmp_path: Path) -> None:
    text = homework_text(keyed)
    for secret in (
        "latency",
        "0.04372",
        'coloured"\nanswer',
        "nees < 5",
        "0.12",
        str(keyed.seed),
        "\nfaults = ",
    ):
        assert secret not in text, secret
    path = tmp_path / "find.homework"
    path.write_text(text, encoding="utf-8", newline="\r\n")  # a mail program may change the ends of lines
    found = read_homework(path)
    assert found == keyed.homework
    assert found.scenario.hidden.settings == {"sensors": {"gyro": {"bias": [0.04372, 0.0, 0.0]}}}
    assert found.scenario.hidden.seed == keyed.seed
    assert found.best == 2 + 1 + 3 + 4


def test_the_key_is_for_its_owner_and_never_replaced(keyed: Keyed, tmp_path: Path) -> None:
    path = tmp_path / "find.key"
    write_key(path, keyed)
    before = path.read_bytes()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with pytest.raises(FileExistsError):
        write_key(path, keyed)
    assert path.read_bytes() == before
    again = read_key(path)
    assert again.homework == keyed.homework
    assert again.judge.solutions == keyed.judge.solutions


def test_a_homework_that_was_changed_is_refused(keyed: Keyed, tmp_path: Path) -> None:
    text, path = homework_text(keyed), tmp_path / "find.homework"
    body = text.partition("\n")[2]
    forged = TeacherKey.new()
    for changed in (
        text.replace("imu_rate = 20", "imu_rate = 10"),
        text.replace("points = 3.0", "points = 9.0"),
        text[: len(text) // 2],
        body,
        "signature = 3\n" + body,
        f'signature = "{base64.b64encode(forged.sign(body.encode())).decode()}"\n{body}',
    ):
        path.write_text(changed, encoding="utf-8")
        with pytest.raises(LessonError, match=r"find\.homework: "):
            read_homework(path)
    # Whoever signs with another key makes another homework, for which nobody has handed in anything.
    body = body.replace(
        base64.b64encode(keyed.homework.public).decode(), base64.b64encode(forged.public).decode()
    )
    start = body.index('covered = "') + len('covered = "')
    new = base64.b64encode(cover(forged.public, b"seed = 1")).decode()
    body = body[:start] + new + body[body.index('"', start) :]
    path.write_text(
        f'signature = "{base64.b64encode(forged.sign(body.encode())).decode()}"\n{body}', encoding="utf-8"
    )
    assert read_homework(path).name != keyed.homework.name


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('change = ["navigator"]', 'change = ["trajectory"]', "change"),
        ('change = ["navigator"]', 'change = ["sensors.gps.outages"]', "cannot be given"),
        ('change = ["navigator"]', 'change = ["navigator.engine"]', "cannot be given"),
        ('change = ["navigator"]', 'change = ["navigator.none"]', "no such setting"),
        ("sensors.gyro.bias = ", "trajectory.imu_rate = ", "cannot be hidden"),
        ("sensors.gyro.bias = ", "navigator.r_scale = ", "cannot be hidden"),
        ("sensors.gyro.bias = ", "sensors.gyro.bais = ", "bias"),
        ('"latency", "r"', '"late"', "faults"),
        ('"latency", "r"', '"r", "r"', "each once"),
        ("nees < 5", "neeso < 5", "goal 1: condition"),
        ("points = 4", "points = -4", "goal 1: points"),
        ('answer = "coloured"', 'answer = "red"', "question 2: answer"),
        ("tolerance = 0.02", "", "question 1: answer, tolerance"),
        ("[hidden]", "[hiden]", "hidden"),
        ('"Something is *wrong*."', '"$\\\\frac{$"', "text"),
    ],
)
def test_a_source_says_what_is_wrong_and_where(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "find.toml"
    assert old in SOURCE
    path.write_text(SOURCE.replace(old, new), encoding="utf-8")
    with pytest.raises(LessonError) as caught:
        make_homework(path)
    assert "find.toml: " in str(caught.value)
    assert words in str(caught.value)


def test_a_hand_in_is_sealed_for_the_teacher(keyed: Keyed) -> None:
    handed = solved(keyed, "  Zoë \n Müller ")
    first, second = (hand_in_text(keyed.homework, handed) for _ in range(2))
    assert first != second
    for secret in ("Zoë", "Müller", "latency", "coloured"):  # shorter ones may be in its letters by chance
        assert secret not in first
    opened = open_hand_in(first.encode(), keyed.homework, keyed.key)
    assert opened == handed
    assert opened.name == "Zoë Müller"
    with pytest.raises(HandInError, match="sealed for another key"):
        open_hand_in(first.encode(), keyed.homework, TeacherKey.new())
    for place in range(len(first) - 200, len(first) - 5, 7):
        wrong = "A" if first[place] != "A" else "B"
        with pytest.raises(HandInError):
            open_hand_in((first[:place] + wrong + first[place + 1 :]).encode(), keyed.homework, keyed.key)


def test_what_the_student_may_not_change_cannot_be_handed_in(keyed: Keyed) -> None:
    homework = keyed.homework
    other = homework.experiment()
    other.set("sensors.gps.position_variance", 0.1)
    with pytest.raises(SettingError, match="position_variance"):
        hand_in(homework, "Ada", other)
    for name in ("", " ", "a" * 81, "a\x00b", "a\u202eb"):
        with pytest.raises(HandInError, match="name"):
            hand_in(homework, name, homework.experiment())
    with pytest.raises(HandInError, match="answer 2"):
        hand_in(homework, "Ada", homework.experiment(), answers=("", "red"))
    with pytest.raises(HandInError, match=r"fault.*fixes that come late"):
        hand_in(homework, "Ada", homework.experiment(), ("the weather",))
    for text in ("0.12 s", "nan", "1e400", "about 0.1"):
        with pytest.raises(HandInError, match=r"answer 1: .* is no number; accepted is one without a unit"):
            hand_in(homework, "Ada", homework.experiment(), answers=(text, ""))
    assert hand_in(homework, "Ada", homework.experiment(), answers=("0,12", "")).answers[0] == "0,12"


def test_grades_are_those_of_a_run_by_the_grader(keyed: Keyed, tmp_path: Path) -> None:
    homework = keyed.homework
    write_hand_in(tmp_path / "a.handin", homework, solved(keyed))
    nothing = hand_in(homework, "=cmd|' /C calc'!A0", homework.experiment(), (LATE, "two axes swapped"))
    write_hand_in(tmp_path / "b.handin", homework, nothing)
    rows = graded(keyed, tmp_path)
    ada, eve = rows["a.handin"], rows["b.handin"]
    real = homework.experiment_with(SOLVED).run()
    assert float(ada["nees"]) == pytest.approx(float(real.consistency.nees.mean()) / 15, rel=1e-4)
    assert float(ada["position_rms [m]"]) == pytest.approx(
        float((real.errors.position.values**2).sum(axis=1).mean() ** 0.5), rel=1e-4
    )
    assert (ada["points"], ada["of"], ada["status"]) == ("10", "10", GRADED)
    assert ada["settings"] == "navigator.latency=0.12; navigator.r_scale=10"
    assert (eve["points"], eve["faults_right"], eve["faults_wrong"], eve["faults_missed"]) == (
        "0",
        "1",
        "1",
        "1",
    )
    assert eve["name"] == "'=cmd|' /C calc'!A0"
    assert float(eve["nees"]) > 5
    assert list(csv.reader(csv_text(columns(keyed.judge), list(rows.values())).splitlines()))[1][1] == "Ada"


def test_points_of_faults(keyed: Keyed) -> None:
    judge = keyed.judge
    points = [judge.points_of_faults(named) for named in ((), (LATE,), (LATE, R), (LATE, R, "x"), ("x", "y"))]
    assert points == [0.0, 1.0, 2.0, 1.0, 0.0]


HOSTILE: dict[str, Callable[[Keyed], bytes]] = {
    "empty": lambda _keyed: b"",
    "bytes": lambda _keyed: bytes(range(256)),
    "latin-1": lambda keyed: sealed(keyed).replace(b"format", "förmat".encode("latin-1")),
    "zip": lambda _keyed: b"PK\x03\x04" + b"\0" * 1000,
    "deep": lambda _keyed: b"a = " + b"[" * 5000,
    "dotted": lambda _keyed: b"a" + b".a" * 20000 + b" = 1",
    "large": lambda _keyed: b"#" * (LARGEST + 1),
    "cut": lambda keyed: hand_in_text(keyed.homework, solved(keyed)).encode()[:-40],
    "truncated": lambda keyed: sealed(keyed)[:-40],
    "other": lambda keyed: sealed(keyed).replace(keyed.homework.name.encode(), b"0123456789abcdef"),
    "other-list": lambda keyed: sealed(keyed).replace(f'"{keyed.homework.name}"'.encode(), b"[1, 2]"),
    "short": lambda keyed: (
        f'format = "ins-lab hand-in 1"\nhomework = "{keyed.homework.name}"\nsealed = "AA=="'.encode()
    ),
    "version": lambda keyed: sealed(keyed).replace(b"ins-lab hand-in 1", b"ins-lab hand-in 27"),
    "number": lambda keyed: (
        f'format = "ins-lab hand-in 1"\nhomework = "{keyed.homework.name}"\nsealed = 3'.encode()
    ),
    "typed": lambda keyed: sealed(keyed, name=3),
    "listed": lambda keyed: sealed(keyed, faults="all", answers=3),
    "answers": lambda keyed: sealed(keyed, answers=["a"]),
    "rate": lambda keyed: sealed(keyed, changes=[{"path": "trajectory.imu_rate", "value": 2000}]),
    "mission": lambda keyed: sealed(keyed, changes=[{"path": "mission", "value": "/etc/passwd"}]),
    "group": lambda keyed: sealed(keyed, changes=[{"path": "navigator", "value": {"engine": "filterpy"}}]),
    "engine": lambda keyed: sealed(keyed, changes=[{"path": "navigator.engine", "value": "filterpy"}]),
    "no-setting": lambda keyed: sealed(keyed, changes=[{"path": "navigator.__class__", "value": 1}]),
    "no-value": lambda keyed: sealed(keyed, changes=[{"path": "navigator.r_scale", "value": "nan"}]),
    "nan": lambda keyed: sealed(keyed, changes=[{"path": "navigator.r_scale", "value": float("nan")}]),
    "many": lambda keyed: sealed(keyed, unset=["navigator.r"] * 400),
    "direction": lambda keyed: sealed(keyed, name="a\u202eb"),
    "seed": lambda keyed: sealed(keyed, changes=[{"path": "seed", "value": 9}]),
    "lone": lambda keyed: sealed(keyed, answers=["\x1b[31m", ""]),
}


def test_hostile_files_get_a_reason_and_stop_nothing(
    keyed: Keyed, tmp_path: Path, make_pipe: Callable[[Path], None]
) -> None:
    for name, content in HOSTILE.items():
        (tmp_path / f"{name}.handin").write_bytes(content(keyed))
    (tmp_path / "link.handin").symlink_to("/etc/passwd")
    (tmp_path / "round").symlink_to(tmp_path)
    make_pipe(tmp_path / "pipe.handin")
    (tmp_path / ".DS_Store").write_bytes(b"x")
    with (tmp_path / "huge.handin").open("wb") as file:
        file.truncate(10 * 2**30)  # as large as a zip bomb becomes; it takes no room on the disk
    inner = tmp_path / "Müller, A_12_file"
    inner.mkdir()
    write_hand_in(inner / "=1+1.handin", keyed.homework, solved(keyed))
    deep = tmp_path / "1" / "2" / "3" / "4" / "5"
    deep.mkdir(parents=True)
    write_hand_in(deep / "deep.handin", keyed.homework, solved(keyed))
    odd = os.fsencode(tmp_path) + b"/\xff\n.handin"
    Path(os.fsdecode(odd)).write_bytes(b"")
    rows = graded(keyed, tmp_path)
    assert rows.pop("Müller, A_12_file/=1+1.handin")["status"] == GRADED
    assert len(rows) == len(HOSTILE) + 6
    for name, row in rows.items():
        assert row["status"] == REFUSED, name
        assert row["remark"], name
        assert "\n" not in name + row["remark"]
        assert len(row["remark"]) < 1000
    assert "not followed" in rows["link.handin"]["remark"]
    assert "trajectory.imu_rate" in rows["rate.handin"]["remark"]
    assert "another homework" in rows["other.handin"]["remark"]
    assert "UTF-8" in rows["latin-1.handin"]["remark"]
    assert "damaged or cut off" in rows["cut.handin"]["remark"]
    assert "too deep" in rows["1/2/3/4"]["remark"]
    assert "ins-lab hand-in 27" in rows["version.handin"]["remark"]
    assert "takes the seed of the homework" in rows["seed.handin"]["remark"]
    assert "a name that is not accepted" in rows["direction.handin"]["remark"]


def test_settings_that_cannot_be_run_cost_no_other_points(keyed: Keyed, tmp_path: Path) -> None:
    impossible = solved(keyed, navigator__model="nonlinear", navigator__smoother=True)
    write_hand_in(tmp_path / "a.handin", keyed.homework, impossible)
    row = graded(keyed, tmp_path)["a.handin"]
    assert row["status"] == "not run"
    assert "smoother" in row["remark"]
    assert (row["points"], row["goal_1_points"], row["nees"]) == ("6", "0", "")


def test_the_same_folder_gives_the_same_bytes_in_any_order(
    keyed: Keyed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handed = solved(keyed)
    for name in ("b", "a", "C"):
        write_hand_in(tmp_path / f"{name}.handin", keyed.homework, handed)
    (tmp_path / "copy.handin").write_bytes((tmp_path / "b.handin").read_bytes())
    walk, tables = grading._walk, []
    for seed in range(3):

        def shuffled(folder: Path, depth: int, seed: int = seed) -> list[Path]:
            found = list(walk(folder, depth))
            random.Random(seed).shuffle(found)
            return found

        monkeypatch.setattr(grading, "_walk", shuffled)
        rows = grading.grade(list_files(tmp_path), keyed)
        tables.append(csv_text(columns(keyed.judge), rows))
    assert len(set(tables)) == 1
    assert [row["file"] for row in rows] == ["C.handin", "a.handin", "b.handin", "copy.handin"]
    assert [row["remark"] for row in rows][-2:] == [
        "this name is in several files",
        "the same file as b.handin",
    ]


@pytest.mark.parametrize("text", ["=1", "+1", "-1", "@a", " =1", "\t=1", "\r=1", "＝1", "＋1", "－1", "＠a"])
def test_no_cell_is_a_formula(text: str) -> None:
    # Where people write Chinese or Japanese, spreadsheets also take the wide signs.
    assert not text_cell(text).lstrip().startswith(("=", "+", "-", "@", "＝", "＋", "－", "＠"))
    assert text_cell("Ada -1") == "Ada -1"


def test_settings_of_another_experiment_are_taken_only_as_far_as_allowed(keyed: Keyed) -> None:
    other = Experiment(mission="montreal").update(
        {"navigator": {"r_scale": 3.0}, "sensors": {"gps": {"latency": 0.1}}}
    )
    taken = keyed.homework.taking(other)
    assert keyed.homework.scenario.changes(taken) == {"navigator.r_scale": 3.0}
