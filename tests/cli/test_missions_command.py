"""``ins-lab missions`` and ``ins-lab fly``."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from asking import ask, refused

from lab.base.files import named_columns
from lab.flying.simulated_aircraft import SimulatedAircraft
from lab.missions import add_mission, mission


def test_missions_are_a_table() -> None:
    answer = ask("missions")
    header, *rows = answer.stdout.splitlines()
    assert header.split() == ["name", "title", "duration", "origin"]
    montreal = next(row for row in rows if row.startswith("montreal"))
    assert f"{mission('montreal').duration:.1f} s" in montreal
    assert montreal.index("Montréal") == header.index("title")


def test_missions_as_json() -> None:
    entries = {entry["name"]: entry for entry in json.loads(ask("missions", "--json").stdout)}
    assert {"montreal", "los_angeles"} <= entries.keys()
    assert entries["montreal"]["duration_s"] == mission("montreal").duration
    assert entries["montreal"]["can_fly"] is True


def test_only_what_is_printed_is_read(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of recordings take a while, and logs of hours each several seconds."""
    path, unread = mission("mine").recording_path, "read_columns was called"
    rows = gzip.decompress(path.read_bytes()).decode().splitlines()
    first, last = float(rows[1].split(",")[0]), float(rows[-1].split(",")[0])
    monkeypatch.setattr(named_columns, "_parse", lambda *_: pytest.fail(unread))
    (entry,) = [one for one in json.loads(ask("missions", "--json").stdout) if one["name"] == "mine"]
    assert entry["duration_s"] == last - first
    rows[-1] = "," + rows[-1]
    path.write_bytes(gzip.compress("\n".join(rows).encode()))
    answer = ask("missions")
    assert f"row {len(rows)}" in answer.stderr
    assert "Mine" not in answer.stdout


def test_a_broken_mission_of_ones_own_is_named_and_the_rest_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    (tmp_path / "cut.toml").write_text('title = "Cut"\nrecording = "cut.csv"\n')
    (tmp_path / "cut.csv").write_text("time_s\n0\n")
    (tmp_path / "odd.toml").write_text("title = 3\n")
    answer = ask("missions")
    assert answer.exit_code == 0
    assert "montreal" in answer.stdout
    assert "cut" not in answer.stdout
    assert "cut" in answer.stderr
    assert "odd.toml" in answer.stderr
    assert [entry["name"] for entry in json.loads(ask("missions", "--json").stdout)] == [
        "los_angeles",
        "montreal",
        "pacific",
    ]


def test_flying_writes_a_mission_and_replaces_none(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim")
    short = tmp_path / "short.toml"
    short.write_text(
        'title = "Short"\nrecording = "short.csv.gz"\n[flight]\naircraft = "c172p"\nduration_s = 30.0\n'
        "[flight.runway]\nlatitude_deg = 45.0\nlongitude_deg = 7.0\nheight_m = 300.0\nheading_deg = 90.0\n"
        '[[flight.manoeuvres]]\ndo = "take_off"\n'
    )
    answer = ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown"))
    assert answer.exit_code == 0, answer.stderr
    flown = mission(tmp_path / "flown" / "short.toml")
    assert flown.duration == pytest.approx(30, abs=0.06)
    refused(ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown")), "short.csv.gz")
    assert ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown"), "--force").exit_code == 0


def test_a_flight_that_ends_early_is_kept_and_answered_with_its_own_exit_code(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim")
    short = tmp_path / "short.toml"
    short.write_text(
        'title = "Short"\nrecording = "short.csv.gz"\n[flight]\nduration_s = 10.0\n'
        "[flight.runway]\nlatitude_deg = 45.0\nlongitude_deg = 7.0\nheight_m = 300.0\nheading_deg = 90.0\n"
        '[[flight.manoeuvres]]\ndo = "take_off"\n[[flight.manoeuvres]]\ndo = "hold"\nseconds = 5.0\n'
    )
    answer = ask("fly", str(short))
    assert answer.exit_code == 3
    assert "10.0 s flown" in answer.stdout
    assert "ended during manoeuvre 1 of 2 (take_off)" in answer.stderr
    assert mission(short).ending in answer.stderr


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the user's own missions, with one in it."""
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    add_mission(mission("montreal").recording, "mine", title="Mine")
    return tmp_path


def test_a_mission_is_renamed_and_deleted(own: Path) -> None:
    assert ask("rename", "mine", "yours").stdout == "mine is now called yours\n"
    assert mission("yours").title == "Mine"
    refused(ask("rename", "yours", "a/b"), "'/'", "accepted are")
    refused(ask("rename", "mine", "theirs"), "Accepted are your own: yours")
    refused(ask("delete", "yours"), "--yes")
    refused(ask("delete", "montreal", "--yes"), "ships with the lab")
    assert ask("delete", "yours", "--yes").stdout == "yours deleted\n"
    assert not list(own.glob("yours*"))


@pytest.mark.parametrize(("answer", "kept"), [("y", False), ("n", True)])
def test_a_person_is_asked_before_a_mission_is_deleted(own: Path, answer: str, kept: bool) -> None:
    pty = pytest.importorskip("pty")
    person, terminal = pty.openpty()
    os.write(person, f"{answer}\n".encode())
    asked = subprocess.run(
        [sys.executable, "-m", "dashboards", "delete", "mine"],
        stdin=terminal,
        capture_output=True,
        text=True,
        check=False,
    )
    os.close(person)
    os.close(terminal)
    assert f"Delete {own / 'mine.toml'} and its recording?" in asked.stderr
    assert asked.stdout == ("" if kept else "mine deleted\n")
    assert (own / "mine.toml").exists() == kept


def test_ctrl_c_ends_a_flight_and_keeps_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jsbsim")
    long = tmp_path / "long.toml"
    long.write_text(
        'title = "Long"\nrecording = "long.csv.gz"\n[flight]\nduration_s = 14400.0\n'
        "[flight.air_start]\nlatitude_deg = 45.0\nlongitude_deg = 7.0\nheight_m = 900.0\nheading_deg = 9.0\n"
        '[[flight.manoeuvres]]\ndo = "hold"\nseconds = 5.0\n'
    )
    steps, honest = itertools.count(), SimulatedAircraft.step

    def step(aircraft: SimulatedAircraft) -> None:
        if next(steps) == 5000:
            signal.raise_signal(signal.SIGINT)
        honest(aircraft)

    monkeypatch.setattr(SimulatedAircraft, "step", step)
    before = signal.getsignal(signal.SIGINT)
    answer = ask("fly", str(long))
    assert answer.exit_code == 3, answer.stderr
    assert "cancelled 5.00 s into the flight" in answer.stderr
    assert mission(long).duration == pytest.approx(4.95, abs=0.06)
    assert signal.getsignal(signal.SIGINT) is before
