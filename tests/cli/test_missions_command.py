"""``ins-lab missions`` and ``ins-lab fly``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from asking import ask, refused

from lab.missions import mission


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
