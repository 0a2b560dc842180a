"""Suggestion: wheels that do not slip are tried where the motion is theirs, and said where that helps."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.analysis.verdicts import limits, suggestion
from lab.analysis.verdicts.finding import Suggestion
from lab.analysis.verdicts.suggestion import may_suggest
from lab.analysis.verdicts.trial import apply_changes
from lab.cli.run import verdict_text
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.live.live_verdict import run_batch
from lab.missions.flight_import import read_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite
from lab.views.ensemble_cards import verdict_html
from tests.aided_flights import winding_road
from tests.sensor_logs import described
from tests.simulated_logs import log_of

ROOT = Path(__file__).parents[2]
OUTAGES = [[45.0, 60.0], [85.0, 100.0], [125.0, 140.0], [165.0, 180.0]]
"""Outages of 15 s, other ones than those of the trial."""


def drive(folder: Path, seed: int, **path) -> Result:
    """Return a run of a drive at 50 Hz."""
    made = Experiment(mission=str(winding_road(folder, **path)), seed=seed)
    made.set("trajectory.imu_rate", 50.0)
    return made.run()


def suggested(result: Result) -> tuple[Suggestion, ...]:
    """Return the suggestions beside the verdict of a run."""
    return result.tried_verdict.suggestions


def at_the_ends(experiment: Experiment, epoch: float = 0.0) -> float:
    """Return the rms position error at the ends of outages, by the truth [m]."""
    made = experiment.copy()
    made.set("sensors.gps.outages", [[start + epoch, end + epoch] for start, end in OUTAGES])
    result = made.run()
    error = result.errors["position"].values
    rows = np.searchsorted(result.time, [end for _, end in OUTAGES]) - 1
    return float(np.sqrt(np.mean(np.sum(error[rows] ** 2, axis=1))))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_car_hears_of_no_slip_and_its_outages_end_closer(seed, tmp_path):
    result = drive(tmp_path, seed)
    assert result.verdict.consistent
    (one,) = suggested(result)
    assert result.tried_verdict.consistent
    assert result.tried_verdict.headline == result.verdict.headline
    assert [change.path for change in one.changes] == ["navigator.no_slip"]
    better = apply_changes(result, one.changes)
    before, after = at_the_ends(result.experiment), at_the_ends(better)
    print(f"\n{before:.1f} m, then {after:.1f} m")
    assert after < before / 1.5
    again = better.run()
    assert np.array_equal(again.gyro.increments, result.gyro.increments)
    assert np.array_equal(again.fixes.position, result.fixes.position)
    assert not may_suggest(again)


@pytest.mark.proof
def test_a_log_of_a_car_hears_of_it_too_unless_it_says_what_else_it_is(tmp_path):
    driven = drive(tmp_path, 2)
    made = log_of(driven, tmp_path / "log")
    result = made.run()
    (one,) = suggested(result)
    before, after = (at_the_ends(which, result.epoch) for which in (made, apply_changes(result, one.changes)))
    print(f"\n{before:.1f} m, then {after:.1f} m")
    assert after < before / 1.5
    for vehicle in ("boat", "aeroplane", "copter"):
        other = made.copy()
        other.set("navigator.vehicle", vehicle)
        assert not may_suggest(other.run())


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_imu_ahead_of_the_rear_axle_gets_the_place_that_does_not_slip(seed, tmp_path):
    """At 15 m/s, an IMU 1.95 m ahead of it moves aside as if the car pointed out of its turns for 0.13 s."""
    driven = drive(tmp_path, seed, drift=-0.13)
    assert not suggested(driven)
    made = log_of(driven, tmp_path / "log")
    result = made.run()
    (one,) = suggested(result)
    (place,) = (change.value for change in one.changes if change.path == "sensors.odometer.lever_arm")
    assert -3.0 < place[0] < -1.0
    better = apply_changes(result, one.changes)
    before, after = at_the_ends(made, result.epoch), at_the_ends(better, result.epoch)
    print(f"\n{place[0]} m; {before:.1f} m, then {after:.1f} m")
    assert after < before / 1.5
    followed = better.run()
    assert followed.verdict.consistent
    assert not [remark for remark in followed.remarks if "has no effect" in remark]


@pytest.mark.parametrize("mission", ["montreal", "los_angeles", "pacific"])
def test_an_aeroplane_never_hears_of_it(mission):
    for seed in range(1, 6):
        made = Experiment(mission=mission, seed=seed)
        made.set("trajectory.imu_rate", 50.0)
        assert not may_suggest(made.run()), seed


def test_an_aeroplane_that_goes_exactly_where_its_nose_points_banks(tmp_path):
    assert not may_suggest(drive(tmp_path, 1, banks=True))


@pytest.mark.proof
@pytest.mark.parametrize("path", [{"current": 0.3}, {"current": 0.5}, {"drift": 0.2}, {"drift": 0.6}])
def test_a_ship_never_hears_of_it(path, tmp_path):
    """It drifts in a current, or its nose points into its turns."""
    for seed in (1, 2):
        assert not suggested(drive(tmp_path, seed, **path)), seed


@pytest.mark.parametrize("name", ["copter_delorean_1.bin", "copter_delorean_92.bin", "copter_61.ulg"])
def test_a_real_copter_never_hears_of_it_even_as_an_unknown_vehicle(name, tmp_path):
    named = os.environ.get("INS_LAB_LOGS")
    folder = Path(named) if named else ROOT.parent / "shared" / "logs"
    if not (folder / name).is_file():
        pytest.skip("no real logs here: name their folder in INS_LAB_LOGS")
    log = read_log([folder / name])
    log = replace(log, auxiliary=replace(log.auxiliary, vehicle=""))
    assert not may_suggest(run_batch(log, SensorSuite(), NavigatorSettings()))


def test_wheels_without_a_gain_are_not_mentioned(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "VERDICT", replace(limits.VERDICT, closer_factor=100.0))
    assert not suggested(drive(tmp_path, 2))


@pytest.mark.proof
def test_of_a_long_log_a_part_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(suggestion, "MOST", 4000)
    result = log_of(drive(tmp_path, 2), tmp_path / "log").run()
    part = suggestion._section(result)
    assert part.time.size <= 4001
    assert part.time[-1] + part.epoch < result.time[-1] + result.epoch - 10


def test_a_suggestion_is_shown_beside_a_consistent_verdict(tmp_path):
    verdict = drive(tmp_path, 2).tried_verdict
    for text in (verdict_text(verdict), verdict_html(verdict), repr(verdict)):
        assert "Consistent" in text
        assert "navigator.no_slip" in text
        assert "error across outages of 15 s" in text


def test_a_real_car_on_a_straight_road_hears_nothing(recordings, tmp_path):
    """Its IMU is pitched by 4°: no slip makes 15 s without fixes worse, 27 m instead of 4."""
    folder = tmp_path / "comma2k19"
    described(folder, recordings / "comma2k19")
    result = Experiment(mission=str(folder)).run()
    assert not suggested(result)
