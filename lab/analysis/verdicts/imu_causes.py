"""IMU causes: errors of the inertial sensors without a filter state, and their effect on the error.

Between fixes, a sensor error, resolved in n, adds to attitude and velocity. The filter corrects a part of it
through its gains. The rest appears in the innovations, like the effect of fix causes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.imu_columns import write_imu_columns
from lab.base.arrays import FloatArray
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_quaternion
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.solution import Belief, Imu, Solution

CAUSES = {
    "gyro scale factor": ("gyro", "scale"),
    "gyro misalignment": ("gyro", "cross"),
    "gyro bias drift": ("gyro", "drift"),
    "gyro g-sensitivity": ("gyro", "force"),
    "gyro bandwidth": ("gyro", "slope"),
    "accelerometer scale factor": ("accelerometer", "scale"),
    "accelerometer misalignment": ("accelerometer", "cross"),
    "accelerometer bias drift": ("accelerometer", "drift"),
    "accelerometer bandwidth": ("accelerometer", "slope"),
}
"""Tested errors: the sensor, and the quantity on which the error depends."""
DRIFT_TIME = 60.0
"""Time in which a unit drift changes a bias by one unit [s]."""
NODES = ((-np.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (np.sqrt(0.6), 5 / 18))
"""Gauss-Legendre nodes and weights, exact for the powers in the short-term error."""
AT_ONCE = 64
"""Fixes whose steps are computed together, with some 100 kB each at 200 Hz and 21 states."""


class Steps(NamedTuple):
    """The propagation of a filter's error from fix to fix; the first step is from the start to the first fix.

    Attributes
    ----------
    transition : (m, n, n) array
        Transition from the previous fix, or the start, to each fix.
    noise : (m, 5, n, n) array
        Covariance added by gyro noise, accelerometer noise, gyro bias drive, accelerometer bias drive, and
        the unknown motion in gaps of the IMU.
    forced : (m, n, p) array
        Error added by the causes, per unit of their p regressors.
    """

    transition: FloatArray
    noise: FloatArray
    forced: FloatArray


def columns() -> dict[str, list[int]]:
    """Return the regressors of each cause."""
    found, first = {}, 0
    for name, (_, kind) in CAUSES.items():
        count = 6 if kind == "cross" else 3
        found[name] = list(range(first, first + count))
        first += count
    return found


def steps(
    solution: Solution, belief: Belief, imu: Imu, samples: NDArray[np.intp], names: tuple[str, ...]
) -> Steps:
    """Return the propagation of the error over a flight, with the short-term terms only.

    Parameters
    ----------
    solution, belief
        Solution and assumptions of the filter.
    imu
        Input of the filter.
    samples : (m,) array
        Samples of the fixes.
    names
        The further blocks of the filter.
    """
    n, regressors = solution.states, sum(len(own) for own in columns().values())
    shapes = (n, n), (5, n, n), (n, regressors)
    whole = Steps(*(np.empty((samples.size, *shape)) for shape in shapes))
    done = 0
    for part in steps_in_parts(solution, belief, imu, samples, names):
        here = slice(done, done + part.transition.shape[0])
        for all_of_them, values in zip(whole, part, strict=True):
            all_of_them[here] = values
        done = here.stop
    return whole


def steps_in_parts(
    solution: Solution,
    belief: Belief,
    imu: Imu,
    samples: NDArray[np.intp],
    names: tuple[str, ...],
    *,
    forced: bool = True,
) -> Iterator[Steps]:
    """Iterate over the propagation of the error over a flight, `AT_ONCE` fixes at a time.

    Parameters
    ----------
    solution, belief, imu, samples, names
        As of `steps`.
    forced
        Whether to compute the effects of the causes.
    """
    starts = np.append(0, samples[:-1])
    # A fix may share the sample of the previous one.
    ends = np.maximum(samples, starts + 1)
    last = min(int(ends.max(initial=1)), imu.dtheta.shape[0])
    cuts = np.minimum(starts, last - 1)
    duration = np.where(samples > starts, imu.time[np.minimum(ends, last)] - imu.time[cuts], 0.0)
    edges = np.append(cuts, last - 1)
    for first in range(0, samples.size, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        yield _steps(solution, belief, imu, names, edges[first : first + AT_ONCE + 1], duration[part], forced)


def _steps(
    solution: Solution,
    belief: Belief,
    imu: Imu,
    names: tuple[str, ...],
    edges: NDArray[np.intp],
    duration: FloatArray,
    forced: bool,
) -> Steps:
    """Return the propagation over the intervals (m,) between samples `edges` (m + 1,)."""
    begin, end = int(edges.min()), int(edges.max()) + 1
    here, count = slice(begin, end), duration.size
    C_nb = C_nb_from_euler(euler_from_quaternion(solution.q_nb[begin : end + 1]))
    C_mid = 0.5 * (C_nb[1:] + C_nb[:-1])
    del C_nb

    def gathered(values: FloatArray) -> FloatArray:
        sums = np.add.reduceat(values, edges - begin, axis=0)[:-1]
        return np.where((duration > 0).reshape(-1, *(1,) * (values.ndim - 1)), sums, 0.0)

    dt = np.diff(imu.time[begin : end + 1])[:, None]
    mean_C = gathered(C_mid * dt[..., None])
    safe = np.maximum(duration, 1e-9)[:, None]
    # Of a long flight, they are float32, which would not do for sums.
    dtheta, dvelocity = (
        values[here].astype(np.float64, copy=False) for values in (imu.dtheta, imu.dvelocity)
    )
    force_n = gathered(np.einsum("nij,nj->ni", C_mid, dvelocity)) / safe
    rate_b, force_b = gathered(dtheta) / safe, gathered(dvelocity) / safe
    F = _system_matrix(names, mean_C / safe[..., None], force_n, rate_b, force_b, belief)
    T = duration[:, None, None]
    n, unknown = solution.states, _in_gaps(belief, imu.time, edges, duration)
    noise = np.zeros((count, 5, n, n))
    blocks = [(ATT, 0, belief.noise[:3]), (VEL, 1, belief.noise[3:6])]
    blocks += [(ATT, 4, unknown[:, :3]), (VEL, 4, unknown[:, 3:])] if unknown.any() else []
    for node, weight in NODES:
        onwards = exponential(F, 0.5 * (1 - node) * T)
        for rows, block, density in blocks:
            G = onwards[:, :, rows] @ (mean_C / safe[..., None] * np.sqrt(density)[..., None, :])
            noise[:, block] += weight * T * (G @ G.transpose(0, 2, 1))
        for rows, block in ((GYRO_BIAS, 2), (ACCEL_BIAS, 3)):
            G = onwards[:, :, rows] * np.sqrt(belief.noise[3 * block : 3 * block + 3])
            noise[:, block] += weight * T * (G @ G.transpose(0, 2, 1))
    if not forced:
        return Steps(exponential(F, T), noise, np.zeros((count, n, 0)))
    direct = _forced(imu, C_mid, here, gathered)
    kick = np.zeros((count, n, direct[0].shape[2] + direct[1].shape[2]))
    gyros = direct[0].shape[2]
    kick[:, ATT, :gyros], kick[:, VEL, gyros:] = -direct[0], direct[1]
    return Steps(exponential(F, T), noise, exponential(F, 0.5 * T) @ kick)


def _in_gaps(belief: Belief, time: FloatArray, edges: NDArray[np.intp], duration: FloatArray) -> FloatArray:
    """Return the mean densities (m, 6) that gaps of the IMU add to the noise between samples (m + 1,)."""
    start, end = (belief.gaps[:, at] for at in (0, 1))
    first, last = (time[one, None] for one in (edges[:-1], edges[1:]))
    within = np.maximum(np.minimum(last, end) - np.maximum(first, start), 0.0)
    return np.asarray(within @ belief.gaps[:, 2:] / np.maximum(duration, 1e-9)[:, None])


def exponential(F: FloatArray, T: FloatArray) -> FloatArray:
    """Return exp(F T) (m, n, n) to third order, of system matrices (m, n, n) and times (m, 1, 1) [s]."""
    step = F * T
    square = step @ step
    return np.asarray(np.eye(F.shape[-1]) + step + square / 2 + square @ step / 6)


def _system_matrix(
    names: tuple[str, ...],
    C_nb: FloatArray,
    force_n: FloatArray,
    rate_b: FloatArray,
    force_b: FloatArray,
    belief: Belief,
) -> FloatArray:
    """Return the short-term terms of F (m, n, n): velocity, specific force, and the errors of the IMU.

    Those are biases, scale factors, misalignments and g-sensitivity.
    """
    n = blocks.count(names)
    F = np.zeros((C_nb.shape[0], n, n))
    F[:, POS, VEL] = np.eye(3)
    F[:, VEL, ATT] = np.cross(force_n[:, None, :], np.eye(3)).transpose(0, 2, 1)
    F[:, VEL, ACCEL_BIAS] = -C_nb
    F[:, ATT, GYRO_BIAS] = C_nb
    F[:, GYRO_BIAS, GYRO_BIAS] = -np.diag(belief.decay[:3])
    F[:, ACCEL_BIAS, ACCEL_BIAS] = -np.diag(belief.decay[3:6])  # those of further blocks follow
    write_imu_columns(F, names, C_nb, rate_b, force_b)
    return F


def _forced(
    imu: Imu, C_nb: FloatArray, here: slice, gathered: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the errors (m, 3, p) that the causes of gyros and accelerometers add, resolved in n."""
    dt = np.diff(imu.time[here.start : here.stop + 1])
    since = (imu.time[here.start + 1 : here.stop + 1] - imu.time[0]) / DRIFT_TIME * dt
    # A slope needs the samples on both sides.
    around = slice(max(here.start - 1, 0), min(here.stop + 1, imu.dtheta.shape[0]))
    inner = slice(here.start - around.start, here.stop - around.start)
    parts: dict[str, list[FloatArray]] = {"gyro": [], "accelerometer": []}
    for sensor, kind in CAUSES.values():
        measured = imu.dtheta if sensor == "gyro" else imu.dvelocity
        increments = measured[here]
        for axis in range(3):
            if kind == "cross":
                signals = [increments[:, (axis + 1) % 3], increments[:, (axis + 2) % 3]]
            elif kind == "scale":
                signals = [increments[:, axis]]
            elif kind == "force":
                signals = [imu.dvelocity[here, axis]]
            elif kind == "slope":
                rate = measured[around, axis] / np.diff(imu.time[around.start : around.stop + 1])
                signals = [-np.gradient(rate)[inner]]
            else:
                signals = [since]
            parts[sensor] += [gathered(C_nb[:, :, axis] * one[:, None]) for one in signals]
    return np.stack(parts["gyro"], axis=-1), np.stack(parts["accelerometer"], axis=-1)
