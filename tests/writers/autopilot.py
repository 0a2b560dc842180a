"""What an autopilot knows and senses on a flight: its solution, and an IMU and a GPS with a little noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lab.missions import Recording
from lab.motion.frames import ecef
from lab.motion.truth.trajectory import Trajectory, Truth

IMU_RATE = 200.0
GYRO_BIAS = np.radians((0.1, -0.2, 0.15))
FORCE_BIAS = np.array((0.02, -0.01, 0.03))
LEVER_ARM = np.array((0.4, 0.0, -0.9))
GPS_DELAY = 0.11
GPS_SIGMA = (0.5, 0.1)


@dataclass(frozen=True)
class Sensed:
    """IMU and GPS of a flight.

    Attributes
    ----------
    imu_time, rates : arrays (n,), (n, 6)
        Ends of the intervals [s], mean angular rate [rad/s] and specific force [m/s²] over each.
    gps_time, gps_position, gps_velocity : arrays (m,), (m, 3), (m, 3)
        When a fix is given out [s], which is late; where the antenna was when it was taken, and how fast.
    """

    imu_time: np.ndarray
    rates: np.ndarray
    gps_time: np.ndarray
    gps_position: np.ndarray
    gps_velocity: np.ndarray


@cache
def trajectory(recording: Recording, rate: float = IMU_RATE) -> Trajectory:
    """Return the curve through a recording."""
    return Trajectory.from_recording(recording, rate)


def solution(recording: Recording, rate: float) -> Truth:
    """Return what a perfect estimator says at a rate [Hz]."""
    curve = trajectory(recording)
    return curve.at(np.arange(0.0, curve.duration, 1 / rate))


@cache
def sensed(recording: Recording, rate: float = IMU_RATE, gps_rate: float = 5.0, seed: int = 4) -> Sensed:
    """Return what the sensors of an autopilot give on a flight."""
    curve, rng = trajectory(recording, rate), np.random.default_rng(seed)
    ideal = curve.increments(rate)
    rates = np.concatenate((ideal.dtheta, ideal.dvelocity), axis=1) * rate
    rates[:, :3] += GYRO_BIAS + rng.normal(scale=2e-3, size=ideal.dtheta.shape)
    rates[:, 3:] += FORCE_BIAS + rng.normal(scale=0.03, size=ideal.dtheta.shape)
    taken = np.arange(0.5, curve.duration - 0.5, 1 / gps_rate)
    truth = curve.at(taken)
    turn, _ = curve.rates(taken)
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_quat(truth.q_nb, scalar_first=True)
    arm = attitude.apply(LEVER_ARM)
    position = ecef.displaced(truth.position, arm + rng.normal(scale=GPS_SIGMA[0], size=arm.shape))
    velocity = truth.velocity_n + attitude.apply(np.cross(turn, LEVER_ARM))
    velocity = velocity + rng.normal(scale=GPS_SIGMA[1], size=arm.shape)
    return Sensed(ideal.time[1:], rates, taken + GPS_DELAY, position, velocity)
