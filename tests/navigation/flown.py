"""The missions that ship, as the navigator's tests need them."""

from __future__ import annotations

import functools
from typing import NamedTuple

from lab.missions import mission
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.navigation.navigator import Imu


class Flown(NamedTuple):
    """A flight: its curve, and truth and ideal IMU on the grid."""

    trajectory: Trajectory
    truth: Truth
    imu: Imu


@functools.cache
def fly(name: str, rate: float = 200.0) -> Flown:
    """Return a mission at an IMU rate [Hz]; each is computed once."""
    trajectory = Trajectory.from_recording(mission(name).recording, rate)
    ideal = trajectory.increments()
    return Flown(trajectory, trajectory.at(ideal.time), Imu(ideal.time, ideal.dtheta, ideal.dvelocity))
