"""Experiment: all settings of one run, computed in cached stages into a `Result`."""

from __future__ import annotations

import param

from lab.navigation.settings import NavigatorSettings
from lab.sensors.gps import GpsErrors
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.settings import Quantity, Settings, group


class TrajectorySettings(Settings):
    """How the recording becomes a smooth true trajectory."""

    imu_rate = Quantity(
        200.0, unit="Hz", bounds=(10, 2000), softbounds=(50, 1000), step=10, label="IMU rate",
        doc="Rate of the IMU samples, and of the truth beside them.",
    )
    attitude_curve = param.Selector(
        default="rotation", objects=["rotation", "euler"], label="Attitude curve",
        doc="Rotation spline (no gimbal lock), or the classic cubic spline on the Euler angles.",
    )


class SensorSettings(Settings):
    """The errors of all sensors."""

    gyro = group(GyroErrors, "Gyro errors.")
    accelerometer = group(AccelerometerErrors, "Accelerometer errors.")
    gps = group(GpsErrors, "GPS errors.")


class Experiment(Settings):
    """One run: a mission, a seed, and all settings."""

    mission = param.String(default="montreal", label="Mission", doc="Name of a mission.")
    seed = param.Integer(default=1, bounds=(0, 2**32 - 1), label="Seed", doc="Seed of all random draws.")
    trajectory = group(TrajectorySettings, "Trajectory.")
    sensors = group(SensorSettings, "Sensors.")
    navigator = group(NavigatorSettings, "Navigator.")
