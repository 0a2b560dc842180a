"""A plan that is flown again: its mission changes as the flight did, whole, and in nothing else."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path

import pytest

from lab.base.files.locks import LOCK_FILE
from lab.missions import Flight, MissionError, add_mission, describe_mission, fly, fly_mission, mission
from lab.missions import flown_mission as writer
from lab.missions import library as shelf
from lab.missions.catalogue import OWN_FOLDER_VARIABLE

# Carried out by the lab itself: JSBSim is not needed.
PLAN = """\
# how it begins
title = "Plan"
recording = "plan.csv.gz"
{words}
[flight]  # of commands
commands = [
    {{ type = 1, seconds = 4 }},  # stand
    {{ type = 1, seconds = 3, forward = 2 }},
]

[flight.start]
latitude_deg = 48.0
longitude_deg = 11.0
height_m = 500.0
yaw_deg = 30.0
"""
LISTED = 'description = """\nThe film:\nending = happy\nthe end\n"""\n'


@pytest.fixture
def plan(tmp_path) -> Path:
    """Return a plan whose description has a line that looks like a key of the file."""
    return written(tmp_path, LISTED)


def written(folder: Path, words: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(PLAN.format(words=words), encoding="utf-8")
    return path


def values(path: Path) -> dict:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {LOCK_FILE}


def ended_early(monkeypatch, ending: str) -> None:
    """Have the next flights end early, for a reason."""
    monkeypatch.setattr(writer, "fly", lambda *given: Flight(fly(*given).recording, ending))


def test_a_line_of_the_description_that_looks_like_the_ending_stays(plan, monkeypatch):
    before = values(plan)
    text = plan.read_text(encoding="utf-8")
    with monkeypatch.context() as patch:
        ended_early(patch, "it rained")
        flown = fly_mission(plan)
    assert (flown.ending, flown.description) == ("it rained", "The film:\nending = happy\nthe end\n")
    assert plan.read_text(encoding="utf-8") == f'ending = "it rained"\n{text}'
    again = fly_mission(plan, overwrite=True)
    assert again.ending == ""
    assert values(plan) == before | {"recording": again.recording_path.name}
    assert plan.read_text(encoding="utf-8") == text.replace("plan.csv.gz", again.recording_path.name)


@pytest.mark.parametrize(
    "words",
    ['ending="tight"', "'ending' = 'quoted'", 'ending = """over\nlines\n"""', "ending = 'plain' # why"],
)
def test_the_ending_goes_however_it_is_written(tmp_path, words):
    plan = written(tmp_path, f"{words}\n")
    assert mission(plan).ending
    before = values(plan)
    assert fly_mission(plan, overwrite=True).ending == ""
    del before["ending"]
    assert values(plan) == before
    assert "# how it begins" in plan.read_text(encoding="utf-8")
    assert "# stand" in plan.read_text(encoding="utf-8")


def test_an_ending_of_several_lines_is_told_and_read_again(plan, monkeypatch):
    ending = 'stalled:\n"ending = now" \\ \x7f ü'
    ended_early(monkeypatch, ending)
    assert fly_mission(plan).ending == ending
    assert mission(plan).ending == ending


def test_the_lock_is_held_from_the_reading_of_the_old_words_to_the_writing_of_the_new(plan, monkeypatch):
    fcntl = pytest.importorskip("fcntl")
    held = []

    def looking(step):
        def look(*given, **named):
            with (plan.parent / LOCK_FILE).open("ab") as file, pytest.raises(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held.append(step)
            return honest[step](*given, **named)

        return look

    honest = {step: getattr(shelf, step) for step in ("_recordings_named", "write_file", "_remove_unused")}
    for step in honest:
        monkeypatch.setattr(shelf, step, looking(step))
    ended_early(monkeypatch, "it rained")
    fly_mission(plan)
    assert list(dict.fromkeys(held)) == list(honest)


def test_words_changed_during_the_flight_stay(tmp_path, monkeypatch):
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    plan = written(tmp_path, LISTED)
    recording = fly_mission(plan).recording
    flown = mission("plan")
    describe_mission("plan", title="Renamed meanwhile")
    after = writer.add_flown(flown, recording, seed=None, ending="", folder=tmp_path, overwrite=True)
    assert after.title == "Renamed meanwhile"
    plan.write_text(plan.read_text(encoding="utf-8").replace("seconds = 4", "seconds = 5"), encoding="utf-8")
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}
    with pytest.raises(MissionError, match="changed while it was flown"):
        writer.add_flown(flown, recording, seed=None, ending="", folder=tmp_path, overwrite=True)
    assert {name: (tmp_path / name).read_bytes() for name in files(tmp_path)} == before


def test_the_first_flight_of_a_shipped_plan_makes_the_folder_of_own_missions(tmp_path):
    flown = fly_mission(written(tmp_path, ""))
    folder = tmp_path / "no" / "such" / "folder"
    found = writer.add_flown(flown, flown.recording, seed=None, ending="", folder=folder, overwrite=False)
    assert found.recording_path.parent == folder
    assert values(folder / "plan.toml")["flight"] == flown.flight


def test_a_crash_leaves_the_old_mission_or_the_new_one(plan, monkeypatch):
    class Crash(BaseException):
        """Power failure: nothing is cleared away."""

    def crash(*_given: object, **_named: object) -> None:
        raise Crash

    fly_mission(plan)
    before, duration = values(plan), mission(plan).duration
    steps = {"flown_text": writer, "write_file": shelf, "_remove_unused": shelf}
    for ending, step in itertools.product(("", "it rained"), steps):
        with monkeypatch.context() as patch:
            ended_early(patch, ending)
            patch.setattr(Path, "unlink", lambda *_given, **_named: None)
            patch.setattr(steps[step], step, crash)
            if (ending, step) in {("", "write_file"), ("", "_remove_unused")}:
                fly_mission(plan, overwrite=True)  # nothing changes in the words: not called
                continue
            with pytest.raises(Crash):
                fly_mission(plan, overwrite=True)
        found = mission(plan)
        assert found.duration == duration
        assert (found.ending == "it rained") == (step == "_remove_unused")
        if step != "_remove_unused":
            assert values(plan) == before


def test_a_recording_that_another_mission_names_stays_as_it_is(plan, tmp_path, monkeypatch):
    fly_mission(plan)
    shared = (tmp_path / "plan.csv.gz").read_bytes()
    (tmp_path / "other.toml").write_text('title = "Other"\nrecording = "plan.csv.gz"\n', encoding="utf-8")
    plan.write_text(plan.read_text(encoding="utf-8").replace("seconds = 3", "seconds = 6"), encoding="utf-8")
    flown = fly_mission(plan, overwrite=True)
    assert (tmp_path / "plan.csv.gz").read_bytes() == shared
    assert flown.recording_path.name == "plan.2.csv.gz"
    assert flown.duration > mission(tmp_path / "other.toml").duration


def test_a_name_with_a_number_is_counted_on_and_not_lengthened(tmp_path, monkeypatch):
    plan = written(tmp_path, "")
    names = []
    for ending in ("", "a", "b", "c"):
        with monkeypatch.context() as patch:
            ended_early(patch, ending)
            names.append(fly_mission(plan, overwrite=True).recording_path.name)
    assert names == ["plan.csv.gz", "plan.2.csv.gz", "plan.csv.gz", "plan.2.csv.gz"]
    assert files(tmp_path) == {"plan.toml", "plan.2.csv.gz"}


def test_a_plan_of_the_library_keeps_its_line_too(tmp_path, monkeypatch):
    """As `add_mission` writes it: the ending above a description of several lines."""
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path / "own"))
    plan = written(tmp_path, "")
    first = fly_mission(plan)
    told = "Notes\nending = open\n"
    add_mission(
        first.recording, "mine", title="Mine", description=told, flight=first.flight, ending="line\nline"
    )
    flown = fly_mission("mine", overwrite=True)
    assert (flown.description, flown.ending) == (told, "")
