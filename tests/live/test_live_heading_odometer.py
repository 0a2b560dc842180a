"""Two antennas and an odometer in a stream: the live navigator uses them as the batch does."""

from __future__ import annotations

import numpy as np
import pytest
from live_batch import assert_equal, navigator, random_pieces, suite
from live_rows import driven, feed, reading_rows

from lab.data.clock.timed_samples import TIMED_READING
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.streams.live_log import make_log
from lab.navigation import aids
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

HEADING_SIGMA, SPEED_SIGMA = np.radians(0.5), 0.05
"""σ of the readings: headings [rad], speeds [m/s]."""
SCALE = 1.01
"""Speed of the odometer in true ones."""


def fitted(*sensors: str) -> SensorSuite:
    """Return sensors with two antennas, an odometer, or both."""
    made = suite()
    for name in sensors:
        made.set(f"{name}.fitted", True)
    made.heading.noise, made.odometer.noise = float(np.degrees(HEADING_SIGMA)), SPEED_SIGMA
    return made


def readings(trajectory, seed: int, late: float = 0.15) -> np.ndarray:
    """Return headings at 5 Hz and speeds at 8 Hz of the drive, in the order of their arrival."""
    rng = np.random.default_rng(seed)
    of_heading, of_speed = np.arange(0.033, 88, 0.2), np.arange(0.071, 88, 0.125)
    heading = trajectory.at(of_heading).euler[:, 2] + HEADING_SIGMA * rng.normal(size=of_heading.size)
    level = np.linalg.norm(trajectory.at(of_speed).velocity_n, axis=1)
    speed = SCALE * level + SPEED_SIGMA * rng.normal(size=of_speed.size)
    rows = np.concatenate(
        (
            reading_rows("heading", of_heading, heading, late),
            reading_rows("speed", of_speed, speed, 0.01),
        )
    )
    return rows[np.argsort(rows["arrival"], kind="stable")]


@pytest.mark.proof
@pytest.mark.parametrize(
    ("sensors", "seed", "late", "settings"),
    [
        (("heading",), 1, 0.2, {}),
        (("heading", "odometer"), 3, 1.7, {"latency": 0.15, "aiding_scale": 4.0}),
        (("heading", "odometer"), 4, 0.2, {"correction": "feedforward", "zero_velocity": True}),
    ],
)
def test_they_equal_the_batch(sensors, seed: int, late: float, settings: dict, tmp_path) -> None:
    imu, fixes, trajectory = driven(late=late)
    rows = readings(trajectory, seed)
    given = np.radians([np.nan, 0.4, 1.5])[np.arange(rows.size) % 3]
    rows["heading_sigma"] = np.where(np.isfinite(rows["heading"]), given, np.nan)
    live = navigator(sensors=fitted(*sensors), **settings)
    feed(live, imu, fixes, random_pieces(seed), rows)
    log = make_log("replay", imu, fixes, vehicle="car", latency=settings.get("latency", 0.0), readings=rows)
    whole = NavigatorSettings(vehicle="car", **settings)
    run = navigate_log(log, fitted(*sensors), whole, start=live.alignment)
    assert run.solution.states == 15 + len(sensors)
    assert (run.solution.aid_sample >= 0).sum() > 400 * len(sensors)
    assert_equal(live, run)
    if "heading" in sensors:
        variance = run.aids.variance[run.aids.kind == aids.HEADING] / settings.get("aiding_scale", 1.0)
        sigma = log.auxiliary.headings.sigma
        wanted = np.where(np.isnan(sigma), HEADING_SIGMA, sigma)[-variance.size :]
        np.testing.assert_allclose(np.sqrt(variance), wanted, rtol=1e-12)
    without = navigate_log(log, suite(), whole, start=live.alignment)
    row = 8 if "heading" in sensors else 3
    assert run.solution.variance[2000:, row].mean() < 0.95 * without.solution.variance[2000:, row].mean()
    mine = live.log().auxiliary
    np.testing.assert_array_equal(mine.headings.heading, log.auxiliary.headings.heading)
    np.testing.assert_array_equal(mine.headings.sigma, log.auxiliary.headings.sigma)
    np.testing.assert_array_equal(mine.odometer.value, log.auxiliary.odometer.value)
    write_sensor_log(tmp_path / "drive", log, title="Drive")
    again = read_sensor_log(tmp_path / "drive").auxiliary
    np.testing.assert_allclose(again.headings.heading, log.auxiliary.headings.heading, atol=1e-6)
    np.testing.assert_allclose(again.headings.sigma, log.auxiliary.headings.sigma, rtol=1e-4)
    np.testing.assert_allclose(again.odometer.value, log.auxiliary.odometer.value, atol=1e-4)


@pytest.mark.proof
def test_with_barometer_and_gaps_they_equal_the_batch() -> None:
    imu, fixes, trajectory = driven(late=0.2)
    imu["pressure"] = 95_000.0 + np.random.default_rng(1).normal(size=imu.size)
    imu = np.delete(imu, np.s_[3000:3080])
    sensors = fitted("heading", "odometer")
    sensors.barometer.fitted = True
    rows = readings(trajectory, 5)
    live = navigator(sensors=sensors)
    feed(live, imu, fixes, random_pieces(5), rows)
    log = make_log("replay", imu, fixes, vehicle="car", readings=rows)
    run = navigate_log(log, sensors, NavigatorSettings(vehicle="car"), start=live.alignment)
    assert run.solution.states == 18
    assert_equal(live, run)


def test_two_antennas_start_a_vehicle_that_nobody_named_at_rest() -> None:
    """Without them, the heading is unknown until the vehicle moves."""
    imu, fixes, trajectory = driven(late=0.2)
    rows = readings(trajectory, 1)
    rest = imu["time"] - 5000.0 < 18.0
    found = []
    for given in (rows[rows["arrival"] < 5018.0], rows[:0]):
        live = navigator(sensors=fitted("heading"), vehicle="auto")
        feed(live, imu[rest], fixes[fixes["time"] < 5017.5], random_pieces(1), given)
        found.append(live)
    assert found[1].alignment is None
    assert found[0].alignment is not None
    assert "two antennas" in found[0].alignment.heading.source
    true = trajectory.at(np.array([17.99])).euler[0, 2]
    state = found[0].state
    assert abs(state.euler[2] - true) < 3 * state.euler_sigma[2] < np.radians(10)


@pytest.mark.proof
def test_the_sigma_covers_the_error_of_the_heading_over_seeds() -> None:
    """σ of the heading at the end of the second rest, against the truth."""
    off = []
    for seed in range(8):
        imu, fixes, trajectory = driven(seed=seed, late=0.2)
        live = navigator(sensors=fitted("heading", "odometer"))
        cut = imu["time"] - 5000.0 < 69.0
        rows = readings(trajectory, seed + 50)
        feed(live, imu[cut], fixes[fixes["time"] < 5068.5], random_pieces(seed), rows[rows["time"] < 5068.5])
        true = trajectory.at(imu["time"][cut][-1:] - 5000.0).euler[0, 2]
        off.append(float((live.state.euler[2] - true) / live.state.euler_sigma[2]))
    assert np.abs(off).max() < 3.5
    assert np.mean(np.square(off)) < 2.51  # chi-square of 8: 99 % below 20.1


@pytest.mark.proof
def test_headings_of_changing_quality_are_weighted_as_the_receiver_says() -> None:
    """Every third heading has ten times the error; the squares of the innovations show whose σ is right."""
    mean: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(3):
        imu, fixes, trajectory = driven(seed=seed, late=0.2)
        rows = readings(trajectory, seed + 80)
        rng = np.random.default_rng(seed)
        sigma = HEADING_SIGMA * np.where(np.arange(rows.size) % 3 == 0, 10.0, 1.0)
        rows["heading"] = trajectory.at(rows["time"] - 5000.0).euler[:, 2] + sigma * rng.normal(
            size=rows.size
        )
        rows["speed"] = np.nan
        for told, means in mean.items():
            rows["heading_sigma"] = sigma if told else np.nan
            live = navigator(sensors=fitted("heading"))
            feed(live, imu, fixes, random_pieces(seed), rows)
            kept = live._stream.readings["heading"]
            squares = kept.column("innovation") ** 2 / kept.column("variance")
            means.append(np.nanmean(squares))
    assert np.mean(mean[True]) == pytest.approx(1.0, abs=0.15)
    assert np.mean(mean[False]) > 5


@pytest.mark.proof
def test_readings_that_are_not_used_and_wanted_ones_that_are_missing_are_told() -> None:
    imu, fixes, trajectory = driven(late=0.2)
    rows = readings(trajectory, 1)
    unused = navigator()
    feed(unused, imu[:3000], fixes[:20], random_pieces(1), rows[:100])
    said = " ".join(unused.state.remarks)
    assert "sensors.odometer.fitted = true uses them" in said
    assert "used at the start only; sensors.heading.fitted = true" in said
    missing = navigator(sensors=fitted("heading", "odometer"))
    feed(missing, imu[:3000], fixes[:20], random_pieces(1), np.empty(0, TIMED_READING))
    said = " ".join(missing.state.remarks)
    assert "no speed for sensors.odometer.fitted" in said
    assert "no heading for sensors.heading.fitted" in said
