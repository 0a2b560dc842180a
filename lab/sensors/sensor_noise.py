"""Sensor noise: the white noise of an IMU in two numbers, for comparison with the noise of a recording."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SensorNoise:
    """White noise of an IMU.

    Attributes
    ----------
    name : str
        Name of the IMU.
    gyro : float
        Density of the angular rate's noise, root mean square of the three axes [rad/s/√Hz].
    accelerometer : float
        Density of the specific force's noise, likewise [m/s²/√Hz].
    """

    name: str
    gyro: float
    accelerometer: float
