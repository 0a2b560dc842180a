"""Whether wrong units and signs of a log's other sensors are refused, and good ones never are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from sensor_logs import EPOCH, rotation_matrices, tables, trajectory, write, write_csv

from lab.base.arrays import FloatArray
from lab.data.checks.auxiliary_check import check_auxiliary
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Series
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.missions import MissionError, read_sensor_log
from lab.missions.log_mission import LogMission

FILES = {name: Path(f"{name}.csv") for name in ("barometer", "odometer", "airspeed", "heading")}
TIMES = np.arange(1.0, 199.0, 0.5)
FOOT = 0.3048


class Truth(NamedTuple):
    """What the sensors of the flight would measure without errors at `TIMES`; the heading in degrees."""

    height: FloatArray
    forward: FloatArray
    velocity_n: FloatArray
    heading: FloatArray


@pytest.fixture(scope="module")
def flown() -> Truth:
    """Return the motion of an aeroplane that climbs and turns."""
    truth = trajectory().at(TIMES)
    forward = np.einsum("nij,ni->nj", rotation_matrices(truth), truth.velocity_n)[:, 0]
    return Truth(truth.height, forward, truth.velocity_n, np.degrees(truth.euler[:, 2]))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> SensorLog:
    """Return its log without other sensors."""
    return read_sensor_log(write(tmp_path_factory.mktemp("plain"), tables(0.0, 200.0)))


def checked(log: SensorLog, vehicle: str = "", time: FloatArray = TIMES, **sensors: FloatArray) -> None:
    """Check a log with other readings, the headings in degrees as a file has them."""
    time = time + EPOCH - log.epoch
    made: dict[str, Series | Headings] = {
        name: Series(time, values) for name, values in sensors.items() if name != "heading"
    }
    if "heading" in sensors:
        made["headings"] = Headings(time, np.radians(sensors["heading"]), np.full(time.size, np.nan))
    check_auxiliary(replace(log, auxiliary=AuxiliaryData(vehicle=vehicle, **made)), FILES)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("readings", "cause"),
    [
        (lambda height: height / FOOT, "look like feet where m are declared"),
        (lambda height: 1.05 * height / FOOT + 300, "look like feet where m are declared"),
        (lambda height: -height, "look like depths, positive down"),
        (lambda height: 1013.25 * (1 - 2.25577e-5 * height) ** 5.25588, "look like pressures in hPa"),
    ],
)
def test_heights_in_another_unit_are_refused(log: SensorLog, flown: Truth, readings, cause: str) -> None:
    noise = np.random.default_rng(1).normal(0, 0.1, TIMES.size)
    with pytest.raises(MissionError, match=f"barometer.csv, column height_m: .*{cause}.*; accepted are"):
        checked(log, barometer=readings(flown.height + noise))


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (3.6, "like km/h where m/s"),
        (-3.6, "like km/h where m/s"),
        (3600 / 1609.344, "like mph where m/s"),
        (3600 / 1852, "like knots where m/s"),
        (1.07 * 3.6, "like km/h where m/s"),
        (2.09, "like mph or knots where m/s"),
    ],
)
def test_speeds_in_another_unit_are_refused(log: SensorLog, flown: Truth, factor: float, cause: str) -> None:
    noise = np.random.default_rng(1).normal(0, 0.1, TIMES.size)
    with pytest.raises(MissionError, match=f"odometer.csv, column speed_m_s: .*{cause}"):
        checked(log, odometer=factor * (flown.forward + noise))


def test_speeds_that_are_positive_backwards_are_refused_where_the_nose_is_known(
    log: SensorLog, flown: Truth
) -> None:
    for vehicle in ("aeroplane", ""):
        with pytest.raises(MissionError, match="they look positive backwards"):
            checked(log, vehicle, odometer=-flown.forward)
    # A copter may fly backwards all the time.
    checked(log, "copter", odometer=-flown.forward)


@pytest.mark.parametrize("vehicle", ["car", ""])
def test_a_car_that_drives_backwards_passes(log: SensorLog, flown: Truth, vehicle: str) -> None:
    """The same motion tail first: forces along and across are reversed, and so are the right speeds."""
    turned = replace(log, dvelocity=log.dvelocity * (-1.0, -1.0, 1.0))
    checked(turned, vehicle, odometer=-flown.forward)
    with pytest.raises(MissionError, match="they look positive backwards"):
        checked(log, vehicle, odometer=-flown.forward)


def test_slow_changes_of_geoid_and_weather_pass(log: SensorLog) -> None:
    """A ship of 20 h: the geoid falls by 40 m, and the air pressure by 5 hPa."""
    rng, time = np.random.default_rng(5), np.arange(0.0, 72_000.0, 2.0)
    part = time / time[-1]
    height = rng.normal(-40 * part, 1.5)
    position = np.column_stack((np.full((time.size, 2), 0.7), height))
    unknown = np.full((time.size, 3), np.nan)
    gnss = replace(log.gnss, time=time, position=position, velocity_n=unknown, latency=0.0)
    readings = rng.normal(40 * part, 0.3)
    sailed = replace(log, gnss=gnss)
    check_auxiliary(
        replace(sailed, auxiliary=AuxiliaryData(vehicle="boat", barometer=Series(time, readings))), FILES
    )


@pytest.mark.parametrize(
    ("readings", "cause"),
    [
        (np.radians, "like radians where degrees are declared"),
        (lambda heading: np.radians(heading % 360), "like radians where degrees are declared"),
        (lambda heading: -heading, "counter-clockwise where clockwise is declared"),
        (lambda heading: (90 - heading) % 360, "counter-clockwise where clockwise is declared"),
        (lambda heading: -np.radians(heading), "like radians, counter-clockwise"),
    ],
)
def test_headings_in_another_unit_or_direction_are_refused(
    log: SensorLog, flown: Truth, readings, cause: str
) -> None:
    noise = np.random.default_rng(1).normal(0, 2.0, TIMES.size)
    with pytest.raises(MissionError, match=f"heading.csv, column heading_deg: .*they look {cause}"):
        checked(log, heading=readings(flown.heading + noise))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [0.9, 1.0, 1.1])
def test_good_readings_pass(log: SensorLog, flown: Truth, seed: int, scale: float) -> None:
    """With noise, bias, drift, scale errors, latency, gaps and, of the seeds that are odd, wild readings."""
    rng = np.random.default_rng(seed)

    def noise(sigma: float) -> FloatArray:
        return rng.normal(0, sigma, TIMES.size)

    wild = np.where(rng.random(TIMES.size) < 0.02 * (seed % 2), 500.0, 0.0)
    wind = rng.normal(0, 10.0, 3) * (1, 1, 0)
    readings = {
        "barometer": scale * flown.height + 50.0 + 0.1 * TIMES + noise(1.0) + wild,
        "odometer": scale * flown.forward + noise(1.0) + wild,
        "airspeed": scale * np.linalg.norm(flown.velocity_n - wind, axis=1) + noise(1.0),
        "heading": (flown.heading + 170.0 + noise(5.0) + wild) % 360,
    }
    late = TIMES + rng.uniform(-0.5, 0.5)
    begin, end = rng.uniform(20, 80), rng.uniform(100, 180)
    kept = np.abs(TIMES - (begin + end) / 2) > (end - begin) / 2
    for vehicle in ("", "aeroplane", "car", "copter"):
        checked(log, vehicle, late, **readings)
        checked(log, vehicle, late[kept], **{name: values[kept] for name, values in readings.items()})
        checked(log, vehicle, late[::9], **{name: values[::9] for name, values in readings.items()})


def test_readings_that_show_nothing_pass(log: SensorLog) -> None:
    rng = np.random.default_rng(1)
    for value in (0.0, 300.0):
        stuck = np.full(TIMES.size, value)
        checked(log, "car", barometer=stuck, odometer=stuck, airspeed=stuck, heading=stuck)
        noise = stuck + rng.normal(0, 3.0, TIMES.size)
        checked(log, "car", barometer=noise, odometer=noise, airspeed=noise, heading=noise)
    checked(log, barometer=np.empty(0), odometer=np.empty(0), time=np.empty(0))
    checked(log, heading=np.ones(1), airspeed=np.ones(1), time=np.ones(1))


def circling(speed: float, rate: float, wind: float, duration: float = 200.0) -> SensorLog:
    """Return a level vehicle of constant airspeed [m/s] that turns to one side and then to the other."""
    time = np.arange(0.0, duration, 0.02)
    turning = np.where(time < duration / 2, rate, -0.7 * rate)
    heading = np.append(0.0, np.cumsum(turning[1:] * 0.02))
    dtheta = np.zeros((time.size - 1, 3))
    dtheta[:, 2] = np.diff(heading) + 0.02 * np.radians(2.0)
    rows = np.arange(0, time.size, 25)
    rng = np.random.default_rng(1)
    velocity = speed * np.stack((np.cos(heading), np.sin(heading), 0 * heading), -1)[rows] + (wind, 0, 0)
    velocity += rng.normal(0, 0.1, velocity.shape)
    position = np.tile((0.8, 0.2, 100.0), (rows.size, 1)) + rng.normal(0, (1e-9, 1e-9, 3.0), (rows.size, 3))
    none = np.full((rows.size, 3), np.nan)
    gnss = GnssLog(time[rows], position, velocity, none, none, np.zeros(3), 0.0)
    return SensorLog("circling", EPOCH, time, dtheta, np.zeros_like(dtheta), gnss, None, np.empty((0, 2)), ())


@pytest.mark.parametrize("wind", [0.0, 8.0, 15.0])
@pytest.mark.parametrize("unit", [3.6, 3600 / 1609.344, 3600 / 1852])
def test_airspeeds_in_another_unit_are_refused_in_wind_too(wind: float, unit: float) -> None:
    log = circling(25.0, np.radians(6.0), wind)
    readings = unit * np.random.default_rng(2).normal(25.0, 0.5, TIMES.size)
    with pytest.raises(MissionError, match=r"airspeed_m_s: .*look like km/h, mph or knots where m/s"):
        checked(log, airspeed=readings)


@pytest.mark.parametrize(
    ("speed", "wind"), [(25.0, 0.0), (25.0, 24.0), (25.0, 40.0), (5.0, 4.0), (16.0, 30.0)]
)
def test_airspeeds_in_any_wind_pass(speed: float, wind: float) -> None:
    log = circling(speed, np.radians(6.0), wind)
    checked(log, airspeed=np.random.default_rng(2).normal(1.1 * speed, 1.0, TIMES.size))


def test_a_copter_that_hovers_in_wind_and_looks_around_passes() -> None:
    """It turns by 360° with speeds of decimetres per second; its heights and headings are noisy."""
    log, rng = circling(0.3, np.radians(20.0), 0.0), np.random.default_rng(3)
    turned = np.interp(TIMES, log.time, np.append(0.0, np.cumsum(log.dtheta[:, 2])))
    readings = {
        "barometer": rng.normal(100, 1.0, TIMES.size),
        "odometer": rng.normal(0, 0.3, TIMES.size),
        "airspeed": rng.normal(8.0, 1.0, TIMES.size),
        "heading": (np.degrees(turned) + rng.normal(0, 5.0, TIMES.size)) % 360,
    }
    checked(log, "copter", **readings)
    with pytest.raises(MissionError, match="they look counter-clockwise"):
        checked(log, "copter", heading=-readings["heading"])


def test_headings_of_a_straight_road_to_the_north_pass() -> None:
    """Their numbers could be radians, but the gyro turns by nothing."""
    log = circling(20.0, np.radians(0.2), 0.0)
    checked(log, heading=np.random.default_rng(4).normal(3.0, 1.0, TIMES.size))


def test_a_log_is_refused_when_it_is_read_unless_it_says_otherwise(tmp_path: Path, flown: Truth) -> None:
    folder = write(tmp_path / "mine", tables(0.0, 200.0))
    write_csv(folder / "baro.csv", ("t_s", "height_m"), np.column_stack((TIMES + EPOCH, flown.height / FOOT)))
    with pytest.raises(
        MissionError, match=r"baro.csv, column height_m: .* check_sensors = false in log.toml"
    ):
        read_sensor_log(folder)
    (folder / "log.toml").write_text("check_sensors = false\n")
    assert read_sensor_log(folder).auxiliary.barometer is not None


def test_a_log_that_is_not_checked_is_another_one(tmp_path: Path) -> None:
    """Each key has a hash of its own: the results of one are not taken for those of another."""
    folder, hashes = write(tmp_path / "mine", tables(0.0, 20.0)), set()
    for text in ("", "check_sensors = false\n", "forward_assumed = true\n"):
        (folder / "log.toml").write_text(text)
        hashes.add(LogMission.at(folder, "mine").content_hash)
    assert len(hashes) == 3
