"""Mounting of simulated drives: small angles with their σ, and drives that do not show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import lab
from lab.analysis.calibration.mounting import _Drive, _find_likely_angles, _score_covariance
from lab.base.files.mission_error import MissionError
from lab.data.log.calibration import Calibration
from lab.experiment.calibration import written
from lab.missions import mission as find_mission
from tests.calibration_logs import drive


def calibrated(folder: Path, seed: int, pitch: float, yaw: float, **of_road: float | bool):
    """Return the experiment of a drive, and its calibration."""
    folder.mkdir(exist_ok=True)
    log = drive(folder, seed, pitch, yaw, **of_road)
    return log, lab.calibrate_mounting(log)


def test_small_angles_are_found_and_wheels_help_with_them(tmp_path: Path) -> None:
    log, found = calibrated(tmp_path, 3, -0.4, 0.5)
    pitch, yaw, place = found.terms
    assert [(term.group, term.name, term.axis, term.unit) for term in found.terms] == [
        ("mounting", "angle", "pitch", "°"),
        ("mounting", "angle", "yaw", "°"),
        ("mounting", "place that does not slip", "forward", "m"),
    ]
    assert abs(pitch.value + 0.4) < 4 * pitch.sigma
    assert abs(yaw.value - 0.5) < 4 * yaw.sigma
    assert max(pitch.sigma, yaw.sigma) < 0.1
    assert abs(place.value) < 4 * place.sigma  # simulated where the IMU is
    assert found.judgements[0].gains
    none, wheels, turned = found.errors
    assert turned < wheels
    assert turned < none
    # Applied to the log, nothing is left to be found; half of it leaves the other half, which is added.
    path = tmp_path / "log" / "cal.toml"
    found.calibration.write(path)
    with (tmp_path / "log" / "log.toml").open("a") as file:
        file.write('calibration = "cal.toml"\n')
    again = lab.calibrate_mounting(log)
    assert again.calibration.is_empty
    Calibration(mounting=found.calibration.mounting / 2).write(path)
    rest = lab.calibrate_mounting(log)
    assert not rest.calibration.is_empty
    with pytest.raises(MissionError, match="has a mounting already"):
        written(rest, path)
    both = written(rest, path, path)
    np.testing.assert_allclose(both.mounting, found.calibration.mounting, atol=np.radians(0.02))
    assert max(abs(term.value) for term in again.terms[:2]) < 0.1
    heading = log.run().errors.attitude.isel(angle=2).values  # against the true attitude of the vehicle
    assert abs(np.mean(heading[len(heading) // 2 :])) < 0.3


def test_a_fifth_of_a_degree_is_found(tmp_path: Path) -> None:
    _, found = calibrated(tmp_path, 4, 0.2, 0.2, seconds=900.0)
    pitch, yaw, _ = found.terms
    assert abs(pitch.value - 0.2) < 3 * pitch.sigma
    assert abs(yaw.value - 0.2) < 3 * yaw.sigma
    assert yaw.sigma < 0.06
    assert not found.calibration.is_empty


@pytest.mark.proof
@pytest.mark.parametrize("sway", [0.0, 0.1], ids=["no slip", "as assumed"])
def test_sigma_of_the_angles_holds_over_drives(tmp_path: Path, sway: float) -> None:
    """Whether the car slips as the filter assumes (0.1 m/s), or not at all."""
    off = []
    for seed in range(60):
        angles = np.random.default_rng(seed).normal(scale=0.5, size=2)
        folder = tmp_path / str(seed)
        folder.mkdir()
        log = drive(folder, seed + 1, *angles, sway=sway)
        found, _ = _find_likely_angles(_Drive(find_mission(log.mission).log, log), None)
        off.append((found.values[:2] - np.radians(angles)) / found.sigma[:2])
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    print(f"slip of {sway:g} m/s: estimate/σ has rms {rms[0]:.2f} (pitch), {rms[1]:.2f} (yaw)")
    assert (rms > 0.85).all()
    assert (rms < 1.15).all()


@pytest.mark.parametrize("scores", [np.zeros((300, 3)), np.eye(3)[np.arange(300) % 2]], ids=["none", "two"])
def test_sigma_of_a_drive_that_shows_nothing_is_that_of_the_rest(scores: np.ndarray) -> None:
    found = _score_covariance(np.arange(300.0), scores, np.eye(3))
    assert np.isfinite(found).all()
    assert (np.linalg.eigvalsh(found) > 0).all()
    assert found[2, 2] < 1e-6


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_scores_that_are_alike_say_less(rho: float) -> None:
    """The sum of n values of a process of first order has the variance n/(1 - ρ)², here within a quarter."""
    rng, found = np.random.default_rng(5), []
    for _ in range(100):
        alike = lfilter([1.0], [1.0, -rho], rng.normal(size=(600, 2)), axis=0)
        found.append(np.trace(_score_covariance(np.arange(600.0), alike, 600 * np.eye(2))) / 2)
    assert np.mean(found) == pytest.approx(600 / (1 - rho) ** 2, rel=0.25)


def test_a_straight_mounting_gains_nothing(tmp_path: Path) -> None:
    refused = []
    for seed in (1, 2, 3):
        _, found = calibrated(tmp_path / str(seed), seed, 0.0, 0.0)
        refused.append(found.calibration.is_empty)
        if refused[-1]:
            assert found.stated == ()
    assert sum(refused) >= 2


def test_a_vehicle_that_slips_gets_no_angles_that_harm(tmp_path: Path) -> None:
    _, found = calibrated(tmp_path, 1, 0.0, 0.0, slip=15.0)
    none, _, turned = found.errors
    assert found.calibration.is_empty or turned <= 1.05 * none


@pytest.mark.parametrize(
    ("of_road", "words"),
    [({"seconds": 30.0}, "at least 120 s"), ({"straight": True}, "turns by 0°")],
)
def test_short_and_straight_drives_are_refused(
    tmp_path: Path, of_road: dict[str, float | bool], words: str
) -> None:
    log = drive(tmp_path, 1, 0.3, 0.3, **of_road)
    with pytest.raises(MissionError, match=words):
        lab.calibrate_mounting(log)


def test_other_vehicles_and_simulated_missions_are_refused(tmp_path: Path) -> None:
    log = drive(tmp_path, 1, 0.0, 0.0, seconds=30.0)
    (tmp_path / "log" / "log.toml").write_text('vehicle = "copter"\n')
    assert find_mission(log.mission).log.auxiliary.vehicle == "copter"
    with pytest.raises(MissionError, match="is of a copter, which slips"):
        lab.calibrate_mounting(log)
    with pytest.raises(MissionError, match="is a simulated mission"):
        lab.calibrate_mounting("montreal")
