"""Suite: the settings of all sensors of a vehicle together."""

from __future__ import annotations

import numpy as np

from lab.missions.sensor_noise import SensorNoise
from lab.sensors.gps import GpsErrors
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.temperature import TemperatureSettings
from lab.settings import Settings, group
from lab.units import si


class SensorSuite(Settings):
    """The errors of all sensors. Defaults: MEMSense AccelRate3D and receiver of the classic experiment.

    Noise, range and receiver are those of the experiment, which states no biases: the turn-on biases' 0.1
    °/s and 2 mg (1σ) are this lab's choice, of the size that remains after a calibration at rest.
    """

    gyro = group(GyroErrors, "Gyro errors.")
    accelerometer = group(AccelerometerErrors, "Accelerometer errors.")
    temperature = group(TemperatureSettings, "Temperature of the IMU.")
    gps = group(GpsErrors, "GPS errors.")

    def remarks(self) -> tuple[str, ...]:
        """Say which settings are set and yet change nothing, since others are not."""
        felt = [
            f"sensors.{sensor}.{name}"
            for sensor, errors in (("gyro", self.gyro), ("accelerometer", self.accelerometer))
            for name in ("bias_temperature", "scale_temperature")
            if any(getattr(errors, name))
        ]
        profile = self.temperature.profile
        if felt and profile == "none":
            return (
                f"There is no temperature profile (sensors.temperature.profile), so {felt[0]} does nothing.",
            )
        if profile != "none" and not felt:
            return (
                f"No sensor feels the temperature (sensors.temperature.profile is {profile}): all their "
                "coefficients, such as sensors.gyro.bias_temperature, are zero.",
            )
        return ()


def white_noise(sensors: SensorSuite, name: str) -> SensorNoise:
    """Return the white noise of an IMU, rms of its axes, to compare the noise of a recording with.

    Parameters
    ----------
    sensors
        The errors of the IMU.
    name
        What it is called.
    """
    gyro, accelerometer = (
        float(np.sqrt(np.mean(si(triad, "noise_density") ** 2)))
        for triad in (sensors.gyro, sensors.accelerometer)
    )
    return SensorNoise(name, gyro, accelerometer)
