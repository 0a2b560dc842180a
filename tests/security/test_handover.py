"""What a server leaves for the next one: classes and secrets, for some minutes, and for nobody else."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dashboards.handover import MOST_LINKS, VALID, Handover, folder
from dashboards.notes import Note
from dashboards.query import with_settings_of
from dashboards.teaching.class_record import open_classes, written_classes
from dashboards.teaching.class_register import CLASSES
from dashboards.teaching.moment import Moment
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.lessons.catalogue import Catalogue
from lab.experiment.experiment import Experiment

PORT = 5006
PASSWORD = "open sesame"


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have a data folder for each test, and no class after it."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    yield
    for one in CLASSES.classes():
        CLASSES.close(one)


def left(password: str | None = PASSWORD, token: str = "token") -> Any:
    """Leave a handover, and return the secrets in it."""
    handover = Handover(PORT, password)
    known = handover.secrets(token)
    handover.leave(known, written_classes())
    return known


def test_browsers_stay_known_unless_the_password_is_another_one() -> None:
    before = left()
    after = Handover(PORT, PASSWORD).secrets("new")
    digests = tuple(hashlib.sha256(token.encode()).hexdigest() for token in ("new", "token"))
    assert (after.cookie, after.teachers) == (before.cookie, digests)
    for password in ("another one", None):
        assert Handover(PORT, password).secrets("new").cookie != before.cookie
    assert Handover(PORT + 1, PASSWORD).secrets("new").cookie != before.cookie
    assert Handover(PORT, PASSWORD).secrets("").teachers == ()  # this server admits no teachers


def test_only_the_last_links_of_teachers_stay_valid() -> None:
    for number in range(MOST_LINKS + 3):
        left(token=str(number))
    assert len(Handover(PORT, PASSWORD).secrets("x").teachers) == MOST_LINKS


def test_nobody_else_can_read_or_write_it() -> None:
    left()
    (path,) = folder().iterdir()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(folder().stat().st_mode) & 0o077 == 0
    assert "token" not in path.read_text().replace('"token"', "")
    assert PASSWORD not in path.read_text()
    path.chmod(0o640)
    assert Handover(PORT, PASSWORD)._before == {}


@pytest.mark.parametrize("age", [VALID + 5, -60.0])
def test_one_that_is_old_or_from_the_future_is_not_taken(age: float) -> None:
    left()
    (path,) = folder().iterdir()
    parts = json.loads(path.read_text()) | {"written": time.time() - age}
    path.write_text(json.dumps(parts))
    assert Handover(PORT, PASSWORD)._before == {}


HOSTILE = [
    b"",
    b"\xff\xfe",
    b"[" * 100_000,
    b"null",
    b'{"written": "now"}',
    json.dumps(
        {"written": time.time(), "cookie": 1, "teachers": [1, None, "x"], "classes": {"a": 1}}
    ).encode(),
]


@pytest.mark.parametrize("content", HOSTILE, ids=range(len(HOSTILE)))
def test_what_is_damaged_is_not_taken(content: bytes) -> None:
    left()
    (path,) = folder().iterdir()
    path.write_bytes(content)
    handover = Handover(PORT, PASSWORD)
    assert len(handover.secrets("x").teachers) == 1
    open_classes(handover.classes)
    assert CLASSES.classes() == []


def test_classes_come_back_with_what_their_teachers_show() -> None:
    lessons = Catalogue(None)
    faulty = next(one for one in lessons.entries if one.lesson is not None and one.lesson.fault)
    assert faulty.lesson is not None
    plain = Experiment().update({"mission": "los_angeles", "trajectory": {"imu_rate": 50}, "seed": 7})
    hiding = with_settings_of(FaultyExperiment(FAULTS[faulty.lesson.fault]), plain)
    note = Note(1.0, 2.0, "a turn", "los_angeles")
    place = (faulty.origin, faulty.name), 1
    shown = {
        CLASSES.open().code: Moment(plain, "Errors", 12.5, None, None, (note,)),
        CLASSES.open().code: Moment(hiding, "Flight", 0.0, place),
        CLASSES.open().code: None,
    }
    for code, moment in shown.items():
        found = CLASSES.find(code)
        assert found is not None
        found.moment = moment
    left()
    for one in CLASSES.classes():
        CLASSES.close(one)
    open_classes(Handover(PORT, PASSWORD).classes)
    assert [one.code for one in CLASSES.classes()] == list(shown)
    for code, moment in shown.items():
        found = CLASSES.find(code)
        assert found is not None
        again = found.moment
        if moment is None:
            assert again is None
            continue
        assert again is not None
        assert again.has_settings_of(moment.experiment)
        assert again._replace(experiment=moment.experiment) == moment


@pytest.mark.parametrize(
    "record",
    [
        {"code": "../../x", "age": 0, "moment": None},
        {"code": "ABCdef1", "age": 0},
        "abcdef",
        {"code": ["abcdef"]},
    ],
)
def test_what_is_no_class_is_not_opened(record: object) -> None:
    open_classes([record])
    assert CLASSES.classes() == []


@pytest.mark.parametrize(
    "moment",
    [
        {
            "settings": "mission=nowhere",
            "hides": False,
            "page": "Errors",
            "time": 0,
            "place": None,
            "notes": "",
        },
        {"settings": "", "hides": True, "page": "Errors", "time": 0, "place": None, "notes": ""},
        {"settings": "", "hides": False, "page": "Errors", "time": float("nan"), "place": None, "notes": ""},
        {"settings": 5},
        [],
    ],
)
def test_a_class_without_what_can_be_shown_waits_for_its_teacher(moment: object) -> None:
    open_classes([{"code": "abcdef", "age": 10.0, "moment": moment}])
    (found,) = CLASSES.classes()
    assert found.moment is None
    assert found.age >= 10


def test_a_folder_that_cannot_be_written_stops_nobody(tmp_path: Path) -> None:
    (tmp_path / "ins-lab").write_text("a file")
    left()
    assert not (tmp_path / "ins-lab").is_dir()


def test_it_belongs_to_whoever_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    left()
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert Handover(PORT, PASSWORD)._before == {}
