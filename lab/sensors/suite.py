"""Suite: the settings of all sensors of a vehicle together."""

from __future__ import annotations

from lab.sensors.gps import GpsErrors
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.settings import Settings, group


class SensorSuite(Settings):
    """The errors of all sensors. Defaults: MEMSense AccelRate3D and receiver of the classic experiment.

    Noise, range and receiver are those of the experiment, which states no biases: the turn-on biases' 0.1
    °/s and 2 mg (1σ) are this lab's choice, of the size that remains after a calibration at rest.
    """

    gyro = group(GyroErrors, "Gyro errors.")
    accelerometer = group(AccelerometerErrors, "Accelerometer errors.")
    gps = group(GpsErrors, "GPS errors.")


PRESETS = {"MEMSense AccelRate3D": SensorSuite}
"""Sensor suites by name."""
