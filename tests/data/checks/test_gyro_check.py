"""Gyros with a wrong sign or order on vehicles that nobody named, or that go where they like."""

from __future__ import annotations

import re

import numpy as np
import pytest
from copter_logs import copter
from sensor_logs import IMU, described, tables, write, write_csv

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.gyro_check import GyroError
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.sheets.sensor_csv import read_logs
from lab.flying.waypoints import Waypoint, WaypointPlan, travel
from lab.missions import MissionError, mission
from lab.motion.truth.trajectory import Trajectory


@pytest.mark.proof
@pytest.mark.parametrize(
    ("order", "signs"),
    [((0, 1, 2), (1, 1, -1)), ((0, 1, 2), (-1, 1, 1)), ((0, 2, 1), (1, 1, 1)),
     ((1, 2, 0), (1, -1, 1)), ((0, 1, 2), (-1, -1, -1))],
)  # fmt: skip
def test_a_copters_wrong_gyros_are_found_and_what_is_advised_makes_them_right(tmp_path, order, signs):
    """Which way it points is unknown, but what it feels and how its course turns is not."""
    log = copter(60, nose=0.7, aside=1.0)
    gyros = log.imu[:, 1:4][:, order] * signs
    for attempt in range(3):  # the first advice may be for the vertical gyro alone
        imu = np.column_stack((log.imu[:, 0], gyros, log.imu[:, 4:]))
        folder = write(tmp_path / f"{attempt}", log._replace(imu=imu), 'vehicle = "copter"')
        try:
            read_sensor_log(folder)
        except GyroError as error:
            gyros = as_advised(gyros, str(error))
        else:
            assert attempt
            np.testing.assert_array_equal(gyros, log.imu[:, 1:4])
            return
    pytest.fail("the advice does not help")


def as_advised(gyros, message):
    """Return the columns, called otherwise as a message says."""
    right, said = gyros.copy(), re.findall(r"rate_(\w) is (-?)rate_(\w)", message)
    assert said
    for called, minus, real in said:
        right[:, "xyz".index(real)] = (-1 if minus else 1) * gyros[:, "xyz".index(called)]
        assert f'--column "RATE_{called.upper()}={minus}rate_{real}[rad/s]"' in message
    return right


def test_a_copter_that_looks_against_its_turns_passes(tmp_path):
    """Its course turns against its gyros, but what it feels shows that they are right."""
    read_sensor_log(write(tmp_path, copter(60, nose=0.7, aside=-1.0), 'vehicle = "copter"'))


@pytest.mark.proof
@pytest.mark.parametrize("signs", [(1, 1, -1), (-1, 1, 1), (1, -1, 1), (-1, 1, -1)])
def test_a_walkers_wrong_gyros_are_found(recordings, tmp_path, signs):
    folder = described(tmp_path / "walk", recordings / "rtkx_walk")
    imu = np.loadtxt(folder / "imu.csv", delimiter=",", skiprows=1)
    imu[:, 1:4] *= signs
    write_csv(folder / "imu.csv", IMU, imu)
    with pytest.raises(GyroError, match=r"wrong sign|swapped axes"):
        read_sensor_log(folder)


ROUTE = WaypointPlan(
    tuple(
        Waypoint(47.0 + north / 111_200, 8.0 + east / 76_000, 400.0 + up, speed)
        for north, east, up, speed in (
            (0, 0, 0, 12), (150, 40, 2, 8), (200, 200, 6, 14), (420, 160, 3, 9), (430, 380, 0, 13),
            (250, 450, 4, 8), (200, 650, 8, 14), (420, 760, 5, 12), (700, 700, 2, 12),
        )
    )
)  # fmt: skip
"""The way of a car that turns to both sides and changes its speed."""
MIRROR = np.diag([1.0, -1.0, 1.0])
TRIADS = {
    "forward accelerometer": (np.eye(3), np.diag([-1.0, 1.0, 1.0])),
    "right accelerometer": (np.eye(3), MIRROR),
    "left-handed": (MIRROR, MIRROR),
    "exchanged accelerometers": (np.eye(3), np.eye(3)[[1, 0, 2]]),
}


@pytest.mark.parametrize("fault", TRIADS)
def test_columns_of_a_wrong_sign_or_order_are_named_with_what_mends_them(tmp_path, fault):
    """The strangers' csv has other axes than the body: the advice is about its own columns."""
    log = tables(5, 100, flight=Trajectory.from_recording(travel(ROUTE), 100.0))
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # forward is y, right is -x
    gyros, forces = TRIADS[fault]
    rate, force = log.imu[:, 1:4] @ gyros.T @ turned.T, log.imu[:, 4:] @ forces.T @ turned.T
    imu = np.column_stack((log.imu[:, 0], rate, force))
    paths = [tmp_path / "imu.csv", tmp_path / "gps.csv"]
    write_csv(paths[0], ("time", "rx", "ry", "rz", "fx", "fy", "fz"), imu)
    write_csv(paths[1], ("time", "lat", "lon", "alt", "vel_n", "vel_e", "vel_d"), log.gnss[:, :7])
    named = {f"r{axis}": f"rate_{axis}[rad/s]" for axis in "xyz"}
    named |= {f"f{axis}": f"force_{axis}[m/s²]" for axis in "xyz"}
    with pytest.raises(MissionError, match="do not belong together") as refused:
        read_logs(paths, named, vehicle="car")
    said = re.findall(r'--column "(\w+)=(-?\w+)\[(.*?)\]"', str(refused.value))
    assert said
    for column, real, unit in said:
        named[column[0].lower() + column[-1].lower()] = f"{real}[{unit}]"
    mended = read_logs(paths, named, vehicle="car")
    np.testing.assert_allclose(mended.rates[1].mean(axis=0), log.imu[1:, 4:].mean(axis=0), atol=0.01)


def test_a_strong_manoeuvre_accuses_no_axes(tmp_path):
    """In a turn of 2 g that lasts, the mean force is not up: the match of velocities begins elsewhere."""
    flight = Trajectory.from_recording(mission("pacific").recording, 100.0)
    read_sensor_log(write(tmp_path / "pacific", tables(5, 105, flight=flight)))


@pytest.fixture
def cases(recordings):
    folder = recordings.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


@pytest.mark.parametrize(
    ("case", "words"),
    [("02-left-handed-imu", "left-handed axes, which are forward, minus right, down"),
     ("21-forward-accelerometer-reversed", "accelerometers along minus forward, right, down")],
)  # fmt: skip
def test_cases_of_public_reports(cases, case, words):
    if case.startswith("02"):
        with pytest.raises(MissionError, match=words):
            read_logs([cases / case / name for name in ("imu.csv", "gps.csv")], vehicle="car")
    else:
        with pytest.raises(GyroError, match=words):
            read_sensor_log(cases / case)


def test_positions_alone_show_the_sign_of_the_vertical_gyro(recordings, tmp_path):
    folder = described(tmp_path / "walk", recordings / "rtkx_walk")
    gnss = (folder / "gnss.csv").read_text().splitlines()
    places = [",".join(line.split(",")[:4]) for line in gnss]
    (folder / "gnss.csv").write_text("\n".join(places) + "\n")
    read_sensor_log(folder)
    imu = np.loadtxt(folder / "imu.csv", delimiter=",", skiprows=1)
    imu[:, 3] *= -1
    write_csv(folder / "imu.csv", IMU, imu)
    with pytest.raises(GyroError, match="wrong sign"):
        read_sensor_log(folder)


def test_a_rocket_stands_on_its_tail_and_comes_down_on_its_nose(tmp_path):
    """Most of its log it hangs under its parachute, with gravity the other way round."""
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 60.0, 0.02)
    imu = np.column_stack((time, rng.normal(0, 1e-3, (time.size, 3)), rng.normal(0, 0.02, (time.size, 3))))
    imu[:, 6] += np.where(time < 10.0, STANDARD_GRAVITY, -STANDARD_GRAVITY)
    fixes = np.arange(0.0, 60.0, 0.5)
    place = np.tile((47.0, 8.0, 300.0), (fixes.size, 1)) + rng.normal(0, 1e-6, (fixes.size, 3))
    paths = [tmp_path / "imu.csv", tmp_path / "gps.csv"]
    write_csv(paths[0], ("time", "rx", "ry", "rz", "fx", "fy", "fz"), imu)
    write_csv(paths[1], ("time", "lat", "lon", "alt"), np.column_stack((fixes, place)))
    named = {f"r{axis}": f"rate_{axis}[rad/s]" for axis in "xyz"}
    named |= {f"f{axis}": f"force_{axis}[m/s²]" for axis in "xyz"}
    log = read_logs(paths, named, vehicle="rocket")
    assert log.rates[1][:100, 0].mean() == pytest.approx(STANDARD_GRAVITY, abs=0.01)
    assert any("the force at the start shows where the nose points" in one for one in log.repairs)
