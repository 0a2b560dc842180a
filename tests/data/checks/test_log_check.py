"""Hostile logs: each is recognised, with the likely cause; honest ones pass."""

from __future__ import annotations

import numpy as np
import pytest
from copter_logs import copter
from sensor_logs import IMU, INCREMENTS, POSITION, VELOCITY, described, tables, write, write_csv

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.missions import MissionError


@pytest.fixture(scope="module", params=["montreal", "comma2k19"])
def source(request, tmp_path_factory):
    """Return a log and its description, to be corrupted."""
    if request.param == "montreal":
        return tables(30, 200), "", (*POSITION, *VELOCITY)
    folder = request.getfixturevalue("recordings") / "comma2k19"
    lines = (described(tmp_path_factory.mktemp("log"), folder) / "log.toml").read_text().splitlines()
    # As it was stamped: the speed of a car that tilts tells an offset to about half a second only.
    toml = "\n".join(line for line in lines if not line.startswith("latency_s"))
    read = (np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1) for name in ("imu", "gnss"))
    imu, gnss = read
    return tables(30, 40)._replace(imu=imu, gnss=gnss), toml, (*POSITION, *VELOCITY[:2])


def corrupted(folder, source, imu=None, gnss=None, names=IMU):
    log, toml, columns = source
    write(folder, log._replace(imu=log.imu if imu is None else imu), toml, names)
    (folder / "ref.csv").unlink()
    write_csv(folder / "gnss.csv", columns, (log.gnss if gnss is None else gnss)[:, : len(columns)])
    return folder


def test_the_log_itself_passes(tmp_path, source):
    read_sensor_log(corrupted(tmp_path, source))


def recognised(folder, pattern):
    with pytest.raises(MissionError, match=pattern):
        read_sensor_log(folder)


def scaled(source, columns, factor):
    imu = source[0].imu.copy()
    imu[:, columns] *= factor
    return imu


def test_g_for_metres(tmp_path, source):
    imu = scaled(source, slice(4, 7), 1 / STANDARD_GRAVITY)
    recognised(corrupted(tmp_path, source, imu), "look like g where m/s² are declared")


def test_degrees_for_radians(tmp_path, source):
    imu = scaled(source, slice(1, 4), 180 / np.pi)
    recognised(corrupted(tmp_path, source, imu), "look like degrees where radians are declared")


def test_radians_for_degrees(tmp_path):
    source = tables(30, 200), "", (*POSITION, *VELOCITY)
    names = tuple(name.replace("rad", "deg") for name in IMU)
    recognised(corrupted(tmp_path, source, names=names), "look like radians where degrees are declared")


def test_rates_for_increments(tmp_path, source):
    recognised(corrupted(tmp_path, source, names=INCREMENTS), "rates where increments are declared")


def test_increments_for_rates(tmp_path, source):
    dt = np.median(np.diff(source[0].imu[:, 0]))
    imu = scaled(source, slice(1, 7), dt)
    recognised(corrupted(tmp_path, source, imu), "increments where rates are declared")


@pytest.mark.parametrize("offset", [-1.0, 1.0])
def test_clock_of_the_receiver(tmp_path, source, offset):
    gnss = source[0].gnss.copy()
    gnss[:, 0] += offset
    side = "late" if offset > 0 else "early"
    # Without turns, as on the real drive, only the speed tells, and its accelerometer tilts with the car.
    about = r"(0\.[6-9]|1\.[0-4])" if source[1] else r"(0\.9|1\.[01])"
    recognised(corrupted(tmp_path, source, gnss=gnss), rf"about {about} s {side}.*two clocks")


@pytest.mark.parametrize(
    "order",
    [
        pytest.param((2, 1, 0), id="x and z swapped"),
        pytest.param((0, 2, 1), id="y and z swapped"),
        pytest.param((1, 0, 2), id="x and y swapped"),
    ],
)
def test_swapped_axes(tmp_path, source, order):
    imu = source[0].imu.copy()
    imu[:, 1:4], imu[:, 4:] = imu[:, 1:4][:, order], imu[:, 4:][:, order]
    recognised(corrupted(tmp_path, source, imu), "swapped axes")


@pytest.mark.parametrize("signs", [(-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
def test_turned_axes(tmp_path, source, signs):
    imu = source[0].imu.copy()
    imu[:, 1:] *= (*signs, *signs)
    recognised(corrupted(tmp_path, source, imu), "swapped axes or signs")


def test_swapped_gyros(tmp_path):
    source = tables(30, 200), "", (*POSITION, *VELOCITY)
    imu = source[0].imu.copy()
    imu[:, 1:4] = imu[:, [3, 2, 1]]
    recognised(corrupted(tmp_path, source, imu), "with gyros about down, right, forward")


@pytest.mark.parametrize("name", ["vn310_static", "rtkx_walk"])
def test_other_real_recordings_pass(recordings, tmp_path, name):
    read_sensor_log(described(tmp_path / name, recordings / name))


@pytest.mark.parametrize("nose", [0.0, 1.6, 3.1])
@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_healthy_copter_passes_wherever_its_nose_points(tmp_path, nose, late):
    """It leans to gain speed: its accelerometers feel the drag, which lags, and its course is no heading."""
    read_sensor_log(write(tmp_path, copter(60, nose=nose, late=late), 'vehicle = "copter"'))


def test_who_accuses_the_axes_asks_for_the_vehicle(tmp_path):
    """A nose that keeps its angle to the course is one of a copter that looks aside, or of turned axes."""
    recognised(
        write(tmp_path, copter(60, nose=1.6, aside=True)),
        r'axes or signs.*name it, such as vehicle = "copter"',
    )


@pytest.mark.parametrize("nose", [0.0, 1.6, 3.1])
def test_a_nose_that_wanders_is_no_fault_of_axes(tmp_path, nose):
    """Nobody named the vehicle, but wrong axes would turn the nose by the same angle always."""
    read_sensor_log(write(tmp_path, copter(60, nose=nose)))


@pytest.mark.parametrize("late", [-1.3, 0.6, 2.2])
def test_the_clock_of_a_copter_is_judged_by_what_it_felt(tmp_path, late):
    folder = write(tmp_path, copter(80, nose=2.0, late=late), 'vehicle = "copter"')
    side = "late" if late > 0 else "early"
    recognised(folder, rf"about {abs(late):.1f} s {side}.*latency_s = {late:.1f} in the TOML")
    (folder / "log.toml").write_text(f'vehicle = "copter"\nlatency_s = {late}')
    read_sensor_log(folder)


FIXES = {
    "km/h": (slice(4, 7), 3.6, "look like km/h"),
    "knots": (slice(4, 7), 3600 / 1852, "look like knots"),
    "radians": (slice(1, 3), np.pi / 180, "look like radians where degrees"),
    "feet": (3, 1 / 0.3048, "heights look like feet"),
    "up": (6, -1.0, "positive up"),
    "west": (5, -1.0, "reversed signs"),
    "reversed": (slice(4, 6), -1.0, "but 180° beside"),
}


@pytest.mark.parametrize("fault", FIXES)
def test_positions_move_as_velocities_say(tmp_path, fault):
    columns, factor, pattern = FIXES[fault]
    source = tables(30, 200), "", (*POSITION, *VELOCITY)
    gnss = source[0].gnss.copy()
    gnss[:, columns] *= factor
    recognised(corrupted(tmp_path, source, gnss=gnss), pattern)


def test_swapped_velocities(tmp_path, source):
    gnss = source[0].gnss.copy()
    gnss[:, [4, 5]] = gnss[:, [5, 4]]
    recognised(corrupted(tmp_path, source, gnss=gnss), "swapped columns")


def test_milliseconds_for_seconds(tmp_path, source):
    begin = source[0].imu[0, 0]
    imu, gnss = (table[table[:, 0] < begin + 60].copy() for table in (source[0].imu, source[0].gnss))
    for table in (imu, gnss):
        table[:, 0] = 1000 * (table[:, 0] - begin)
    recognised(corrupted(tmp_path, source, imu, gnss), "often ms where s are declared")


def test_leap_seconds_between_gps_time_and_utc(tmp_path):
    long = tables(30, 200)
    for late in (18.1, -17.9):
        gnss = long.gnss.copy()
        gnss[:, 0] += late
        folder = corrupted(tmp_path / f"{late}", (long, "", (*POSITION, *VELOCITY)), gnss=gnss)
        recognised(folder, f"about 1[78].. s {'late' if late > 0 else 'early'}.*18 leap seconds apart")


def test_clocks_of_other_time_zones_and_epochs(tmp_path):
    short = tables(30, 60)
    for shift, words in (
        (7200.0, r"about -2 h apart: one of the clocks may be local time"),
        (1.7e9, "The clock of the GPS counts from 1970"),
    ):
        gnss = short.gnss.copy()
        gnss[:, 0] += shift
        recognised(corrupted(tmp_path / f"{shift}", (short, "", (*POSITION, *VELOCITY)), gnss=gnss), words)


@pytest.mark.parametrize("seed", range(12))
def test_noise_at_rest_shows_no_axis(tmp_path, seed):
    """Few velocities with much noise follow some axis at one of many offsets by chance."""
    rng = np.random.default_rng(seed)
    log = tables(30, 47)
    imu, gnss = log.imu.copy(), log.gnss[::2].copy()
    imu[:, 1:4] = 0.002 * rng.standard_normal((len(imu), 3))
    imu[:, 4:] = [0.0, 0.0, -STANDARD_GRAVITY] + 0.02 * rng.standard_normal((len(imu), 3))
    gnss[:, 1:4] = [45.0, -73.0, 100.0] + 2e-5 * rng.standard_normal((len(gnss), 3))
    gnss[:, 4:7] = 0.45 * rng.standard_normal((len(gnss), 3))
    names = (*POSITION, *VELOCITY)
    read_sensor_log(corrupted(tmp_path, (log, "", names), imu, gnss[:, : len(names)]))
