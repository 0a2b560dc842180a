"""Logs and tracks that nobody here made: each gives a flight, or its refusal names the cause.

They are too large to ship; the folder is named by ``INS_LAB_LOGS``.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from lab import Experiment
from lab.missions import ImportSettings, prepare_import
from lab.missions.flight_import import FlightImport, read_log
from lab.missions.library import add_log

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def logs() -> Path:
    """Return the folder of real logs."""
    named = os.environ.get("INS_LAB_LOGS")
    folder = Path(named) if named else ROOT.parent / "shared" / "logs"
    if named and not folder.is_dir():
        pytest.fail(f"INS_LAB_LOGS names {named}, which is not a folder")
    if not folder.is_dir():
        pytest.skip("no real logs here: name their folder in INS_LAB_LOGS")
    return folder


def told(made: FlightImport, name: str) -> str:
    return next(row.value for row in made.report.rows if row.name == name)


@pytest.mark.parametrize(
    ("name", "used"),
    [
        ("hemisphere.nmea", 21),
        ("ublox_8.nmea", 72),
        ("ublox_zed_f9p_mixed.log", 655),
        ("helicopter_06_53_11.px4log", 653),
        ("copter_delorean_1.bin", 1963),
        ("copter_delorean_92.bin", 772),
        ("rover_1.bin", 212),
        ("copter_61.ulg", 1314),
        ("px4_small.ulg", 1263),
    ],
)
def test_nothing_is_wrong_with_what_was_recorded(logs, name, used):
    made = prepare_import(logs / name)
    assert made.report.verdict == "plausible", made.report
    assert len(made.flight.raw.time) == used


@pytest.mark.parametrize("name", ["car.gpx", "smart_interval.gpx"])
def test_what_keeps_a_track_of_pauses_is_named_and_keeps_it(logs, name):
    made = prepare_import(logs / name)
    assert made.report.verdict == "questionable"
    most = made.flight.bridging[-1]
    assert f"--set longest_gap={most.gap:g}" in made.report.reasons[-1]
    kept = prepare_import(logs / name, ImportSettings(longest_gap=most.gap, vehicle="car"))
    assert len(kept.flight.raw.time) == round(most.share * len(kept.raw.time))
    assert kept.report.verdict == "plausible"


def test_the_rate_of_a_velocity_is_its_own(logs):
    made = prepare_import(logs / "px4_small.ulg")
    assert "the velocity (recorded at 5 Hz)" in told(made, "Rate")


def test_a_heading_that_was_set_anew_is_no_rotation(logs):
    made = prepare_import(logs / "copter_61.ulg")
    assert "the attitude by 3.39° at 1041.588 s" in told(made, "Resets")


def test_sdlog2_holds_an_imu_and_a_receiver(logs):
    log = read_log([logs / "helicopter_06_53_11.px4log"])
    assert len(log.gnss.time) == 359
    # It stands: gravity is felt, and nothing turns.
    turn, force = log.rates
    assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(9.8, abs=0.1)
    assert np.degrees(np.linalg.norm(turn.mean(axis=0))) < 0.5


def test_few_fixes_with_correlated_errors_are_not_taken_for_an_r_that_is_too_large(logs, tmp_path):
    """Followed, the advice to divide R by 46 made the errors across withheld outages 1.35 times as large."""
    log = add_log(read_log([logs / "px4_small.ulg"]), "small", title="Small", folder=tmp_path)
    verdict = Experiment(mission=str(log.path)).run().tried_verdict
    assert [finding.quantity for finding in verdict.findings] == ["GPS correlation"]
