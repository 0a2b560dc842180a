"""Logs whose motion does not show which axis of the IMU points forward: a device mounted askew in a car."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from foreign_tables import table
from phone_drive import Drive, drive, trajectory
from scipy.spatial.transform import Rotation

from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.log.sensor_log import SensorLog
from lab.missions import LogMission, read_sensor_log
from lab.missions.flight_import import read_log
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.navigation.log_navigation import RecordedRun, navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

ROLL, PITCH = 8.0, -15.0
"""How the device leans in the car [°]."""


def mounted(one: Drive, yaw: float) -> Drive:
    """Return what a device measures that is turned in the car by a yaw [°]."""
    mount = Rotation.from_euler("ZYX", (yaw, PITCH, ROLL), degrees=True)
    turned = (mount.apply(vectors, inverse=True) for vectors in (one.rate, one.force))
    return one._replace(**dict(zip(("rate", "force"), turned, strict=True)))


def imported(folder, one: Drive, velocity: bool = True, axes=()) -> SensorLog:
    """Return the log of two tables, as the importer of a stranger's tables reads them."""
    samples = np.column_stack((one.time, one.rate, one.force))
    names = [
        f"{sensor}_{axis}[{unit}]"
        for sensor, unit in (("gyro", "rad/s"), ("accel", "m/s^2"))
        for axis in "xyz"
    ]
    imu = table(folder / "device.csv", ",".join(("time[s]", *names)), samples)
    fixes = np.column_stack((one.at, one.position, one.speed, one.course, np.full(one.at.size, 0.2)))
    header = "time[s],latitude[°],longitude[°],altitude[m],speed[m/s],bearing[°],speed accuracy[m/s]"
    if not velocity:
        fixes, header = fixes[:, :4], header[: header.index(",speed[")]
    return read_log([imu, table(folder / "places.csv", header, fixes)], axes=axes, vehicle="car")


def again(folder, log: SensorLog) -> SensorLog:
    """Return a log after it was written to a folder and read."""
    write_sensor_log(folder, log, title="Drive")
    return read_sensor_log(folder)


def navigated(log: SensorLog) -> RecordedRun:
    return navigate_log(log, SensorSuite(), NavigatorSettings())


def heading_error(log: SensorLog, made: RecordedRun, yaw: float) -> float:
    """Return the error of the heading of the device at the start [°]."""
    car = Rotation.from_quat(
        trajectory().at(np.array([made.imu.time[0] + log.epoch])).q_nb, scalar_first=True
    )
    device = car * Rotation.from_euler("ZYX", (yaw, PITCH, ROLL), degrees=True)
    found = euler_from_quaternion(made.alignment.start.q_nb)[2]
    return float(np.degrees(wrap(found - device.as_euler("ZYX")[0, 0])))


@pytest.mark.proof
@pytest.mark.parametrize("yaw", [40.0, 130.0, 300.0])
def test_the_motion_shows_the_heading_where_forward_is_assumed(tmp_path, yaw):
    """The course of the car is not the heading of a device that lies askew in it."""
    log = again(tmp_path / "drive", imported(tmp_path, mounted(drive(), yaw)))
    assert "does not show forward, which is assumed" in (tmp_path / "drive" / "log.toml").read_text()
    made = navigated(log)
    sigma = np.degrees(made.alignment.attitude_sigma[2])
    assert sigma < 5.0
    assert abs(heading_error(log, made, yaw)) < 3 * sigma


def test_the_remark_tells_the_angle_that_turns_the_axes(tmp_path):
    """Turned by it, the axes are those of the car: the course is the heading again."""
    folder, yaw = tmp_path / "drive", 130.0
    log = again(folder, imported(tmp_path, mounted(drive(), yaw)))
    made = navigated(log)
    angle = np.degrees(made.alignment.heading.course_apart)
    assert abs(wrap(np.radians(angle - yaw))) < np.radians(12)
    assert f"mounting_deg = [0, 0, {angle:.0f}]" in made.remarks[-1]
    toml = (folder / "log.toml").read_text()
    (folder / "log.toml").write_text(f"mounting_deg = [0, 0, {angle:.0f}]\n{toml}")
    turned = navigated(read_sensor_log(folder))
    assert "mounting_deg" not in turned.remarks[-1]
    error = heading_error(log, turned, 0.0)
    assert abs(error) < 12


@pytest.mark.parametrize("seed", range(1, 3))
def test_the_course_of_a_device_that_points_forward_is_not_contradicted(tmp_path, seed):
    log = imported(tmp_path, mounted(drive(seed), 3.0))
    log = replace(log, auxiliary=replace(log.auxiliary, forward_assumed=True))
    made = navigated(log)
    assert "mounting_deg" not in made.remarks[-1]
    assert abs(heading_error(log, made, 3.0)) < 3 * np.degrees(made.alignment.attitude_sigma[2])


def test_positions_alone_leave_the_course(tmp_path):
    """Velocities of their differences are too poor to contradict it."""
    log = imported(tmp_path, mounted(drive(), 130.0), velocity=False)
    assert log.auxiliary.forward_assumed
    assert navigated(log).alignment.heading.is_course


def test_axes_that_are_given_or_shown_are_not_assumed(tmp_path):
    one = mounted(drive(), 0.0)
    assert not imported(tmp_path, one).auxiliary.forward_assumed
    assert not imported(tmp_path, one, axes=("x", "y", "z")).auxiliary.forward_assumed


def test_the_assumption_is_part_of_what_a_navigation_is_kept_by(tmp_path):
    """Else, a change of it in the TOML would show the navigation of before."""
    folder = tmp_path / "drive"
    again(folder, imported(tmp_path, mounted(drive(), 130.0)))
    before = LogMission.at(folder).content_hash
    toml = (folder / "log.toml").read_text()
    assert toml.count("forward_assumed = true") == 1
    (folder / "log.toml").write_text(toml.replace("forward_assumed = true", "forward_assumed = false"))
    assert LogMission.at(folder).content_hash != before
