"""Wheels: whether a run moves as a vehicle on wheels does, by its own estimate.

A vehicle on wheels or rails moves along its forward axis, in turns too, and does not bank into them: the
specific force to the right is the acceleration of the turn. An aeroplane banks, so that it feels no force to
the right; copters move in all directions, and boats drift in turns and in currents.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.verdicts import limits
from lab.base.arrays import FloatArray
from lab.data.log.vehicle import UNKNOWN, vehicle_of
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_quaternion
from lab.run.run import Run

STEP = 1.0
"""Time over which rates and specific forces are averaged [s]: vibration is gone, and turns are not."""
LONGEST = 20_000
"""Most steps that are looked at: five hours; longer runs are looked at in part."""


class _Motion(NamedTuple):
    """Velocity [m/s], angular rate [rad/s], specific force [m/s²] in b at speeds that count, (m, 3) each."""

    velocity: FloatArray
    rate: FloatArray
    force: FloatArray


def rolls(run: Run) -> bool:
    """Return whether a run moves as a vehicle on wheels does."""
    if run.recorded is not None:
        navigator = run.experiment.navigator
        said = run.recorded.log.auxiliary.vehicle if navigator.vehicle == "auto" else str(navigator.vehicle)
        if vehicle_of(said).name not in (UNKNOWN, "car"):
            return False
    motion = _motion(run)
    if motion is None:
        return False
    velocity, rate, force = motion
    aside = np.arctan2(velocity[:, 1:], np.abs(velocity[:, :1]))
    if (np.sqrt(np.mean(aside**2, axis=0)) > limits.VERDICT.slip).any():
        return False
    turn = velocity[:, 0] * rate[:, 2]
    if np.sqrt(np.mean(turn**2)) < limits.VERDICT.turn_acceleration:
        return False
    apart = turn - turn.mean()
    return bool(apart @ force[:, 1] > limits.VERDICT.upright_part * (apart @ apart))


def ahead_of_axle(run: Run) -> float:
    """Return how far the IMU is ahead of the place that does not move sideways in turns [m].

    In a car, this place is on the rear axle: an IMU ahead of it by l moves to the right by l ω.
    """
    motion = _motion(run)
    if motion is None:
        return 0.0
    rate = motion.rate[:, 2] - motion.rate[:, 2].mean()
    return float(rate @ motion.velocity[:, 1] / max(float(rate @ rate), 1e-12))


def _motion(run: Run) -> _Motion | None:
    """Return the motion at speeds that count; None if it is too short, or without turns."""
    time, solution = run.time, run.solution_arrays
    edges = np.searchsorted(time, np.arange(time[0], time[-1], STEP))[: LONGEST + 1]
    edges = np.unique(np.minimum(edges, time.size - 1))
    if edges.size < limits.VERDICT.rolling_time / STEP:
        return None
    middle = (edges[1:] + edges[:-1]) // 2
    C_nb = C_nb_from_euler(euler_from_quaternion(solution.q_nb[middle]))
    velocity = np.einsum("mji,mj->mi", C_nb, solution.velocity_n[middle])
    dt = np.diff(time[edges])
    rate, force = (_mean(values, edges, dt) for values in (run.gyro.increments, run.accelerometer.increments))
    fast = np.linalg.norm(velocity, axis=1) > limits.VERDICT.rolling_speed
    if (
        dt[fast].sum() < limits.VERDICT.rolling_time
        or np.abs(rate[fast, 2] * dt[fast]).sum() < limits.VERDICT.turned
    ):
        return None
    return _Motion(velocity[fast], rate[fast], force[fast])


def _mean(increments: FloatArray, edges: NDArray[np.intp], dt: FloatArray) -> FloatArray:
    """Return the mean rates (m, 3) between samples (m + 1,), `dt` (m,) apart [s]."""
    sums = np.add.reduceat(increments[: edges[-1]], edges[:-1], axis=0)
    return np.asarray(sums / dt[:, None], dtype=np.float64)
