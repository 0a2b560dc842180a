"""IMU causes: errors of the inertial sensors without a filter state, and their effect on the error.

Between fixes, a sensor error, resolved in n, adds to attitude and velocity. The filter corrects a part of it
through its gains. The rest appears in the innovations, like the effect of fix causes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_causes import write_imu_columns
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.kernels.compilation import entry_kernel
from lab.navigation.solution import Belief, Imu, Solution
from lab.navigation.strapdown import matrix

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

STEP, DTHETA, DVELOCITY = 0, slice(1, 4), slice(4, 7)
"""Places of the signals: length of a sample interval [s], and increments of gyros and accelerometers."""
GYRO_SLOPE, ACCEL_SLOPE, SINCE, SIGNALS = slice(7, 10), slice(10, 13), 13, 14
"""Places of minus what these lose in a sample, of a bias drift, and the number of signals."""


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
    count = duration.size
    rotated, plain = _gathered(solution, imu, edges, forced=forced)
    rotated[duration <= 0], plain[duration <= 0] = 0.0, 0.0
    mean_C, safe = rotated[..., STEP], np.maximum(duration, 1e-9)[:, None]
    force_n = np.trace(rotated[..., DVELOCITY], axis1=2, axis2=3) / safe
    rate_b, force_b = plain[:, DTHETA] / safe, plain[:, DVELOCITY] / safe
    F = _system_matrix(names, mean_C / safe[..., None], force_n, rate_b, force_b, belief)
    T = duration[:, None, None]
    n, unknown = solution.states, _in_gaps(belief, imu.time, edges, duration)
    noise = np.zeros((count, 5, n, n))
    blocks = [(ATT, 0, belief.noise[:3]), (VEL, 1, belief.noise[3:6])]
    blocks += [(ATT, 4, unknown[:, :3]), (VEL, 4, unknown[:, 3:])] if unknown.any() else []
    square = F @ F
    powers = F, square / 2, square @ F / 6
    for node, weight in NODES:
        onwards = exponential(powers, 0.5 * (1 - node) * T)
        for rows, block, density in blocks:
            G = onwards[:, :, rows] @ (mean_C / safe[..., None] * np.sqrt(density)[..., None, :])
            noise[:, block] += weight * T * (G @ G.transpose(0, 2, 1))
        for rows, block in ((GYRO_BIAS, 2), (ACCEL_BIAS, 3)):
            G = onwards[:, :, rows] * np.sqrt(belief.noise[3 * block : 3 * block + 3])
            noise[:, block] += weight * T * (G @ G.transpose(0, 2, 1))
    if not forced:
        return Steps(exponential(powers, T), noise, np.zeros((count, n, 0)))
    # The errors that the causes of gyros and accelerometers add, resolved in n.
    gyros, axes, signals = _REGRESSORS
    direct = rotated[:, :, axes, signals]
    kick = np.zeros((count, n, axes.size))
    kick[:, ATT, gyros], kick[:, VEL, ~gyros] = -direct[..., gyros], direct[..., ~gyros]
    return Steps(exponential(powers, T), noise, exponential(powers, 0.5 * T) @ kick)


def _in_gaps(belief: Belief, time: FloatArray, edges: NDArray[np.intp], duration: FloatArray) -> FloatArray:
    """Return the mean densities (m, 6) that gaps of the IMU add to the noise between samples (m + 1,)."""
    start, end = (belief.gaps[:, at] for at in (0, 1))
    first, last = (time[one, None] for one in (edges[:-1], edges[1:]))
    within = np.maximum(np.minimum(last, end) - np.maximum(first, start), 0.0)
    return np.asarray(within @ belief.gaps[:, 2:] / np.maximum(duration, 1e-9)[:, None])


def exponential(powers: tuple[FloatArray, FloatArray, FloatArray], T: FloatArray) -> FloatArray:
    """Return exp(F T) (m, n, n) to third order, from F, F²/2 and F³/6 and times (m, 1, 1) [s]."""
    first, second, third = powers
    found = T * (first + T * (second + T * third))
    found[:, range(found.shape[1]), range(found.shape[1])] += 1.0
    return np.asarray(found)


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


def _regressors() -> tuple[NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
    """Return of each regressor whether it is one of the gyros, its axis, and its place among the signals."""
    found = list[tuple[bool, int, int]]()
    for sensor, kind in CAUSES.values():
        gyro = sensor == "gyro"
        own, slope = (DTHETA, GYRO_SLOPE) if gyro else (DVELOCITY, ACCEL_SLOPE)
        for axis in range(3):
            signals = {
                "cross": [own.start + (axis + 1) % 3, own.start + (axis + 2) % 3],
                "scale": [own.start + axis],
                "force": [DVELOCITY.start + axis],
                "slope": [slope.start + axis],
                "drift": [SINCE],
            }
            found += [(gyro, axis, signal) for signal in signals[kind]]
    gyros, axes, places = zip(*found, strict=True)
    return np.array(gyros), np.array(axes), np.array(places)


_REGRESSORS = _regressors()


def _gathered(
    solution: Solution, imu: Imu, edges: NDArray[np.intp], *, forced: bool
) -> tuple[FloatArray, FloatArray]:
    """Return sums of signals between samples `edges` (m + 1,): of C_nb s, (m, 3, 3, s), and of s, (m, s).

    C_nb s has the columns of C_nb, each times the signal. Without the effects of the causes, the signals are
    the first ones.
    """
    begin, end = int(edges.min()), int(edges.max()) + 1
    here = slice(begin, end)
    dt = np.diff(imu.time[begin : end + 1])
    signals = np.empty((end - begin, SIGNALS if forced else DVELOCITY.stop))
    # Of a long flight, increments are float32, which would not do for sums.
    signals[:, STEP], signals[:, DTHETA], signals[:, DVELOCITY] = dt, imu.dtheta[here], imu.dvelocity[here]
    if forced:
        # A slope needs the samples on both sides.
        around = slice(max(begin - 1, 0), min(end + 1, imu.dtheta.shape[0]))
        inner = slice(begin - around.start, end - around.start)
        per = 1 / np.diff(imu.time[around.start : around.stop + 1])[:, None]
        for measured, place in ((imu.dtheta, GYRO_SLOPE), (imu.dvelocity, ACCEL_SLOPE)):
            signals[:, place] = -np.gradient(measured[around] * per, axis=0)[inner]
        signals[:, SINCE] = (imu.time[begin + 1 : end + 1] - imu.time[0]) / DRIFT_TIME * dt
    rotated = np.zeros((edges.size - 1, 3, 3, signals.shape[1]))
    plain = np.zeros((edges.size - 1, signals.shape[1]))
    _gather(of_kernel(solution.q_nb[begin : end + 1]), signals, edges - begin, rotated, plain)
    return rotated, plain


@entry_kernel
def _gather(
    q_nb: FloatArray, signals: FloatArray, edges: NDArray[np.intp], rotated: FloatArray, plain: FloatArray
) -> None:
    """Add signals (n, s) of the intervals, and their products with the mean of C_nb at both ends of each."""
    for k in range(edges.size - 1):
        for sample in range(edges[k], edges[k + 1]):
            before, after = q_nb[sample], q_nb[sample + 1]
            first = matrix((before[0], before[1], before[2], before[3]))
            last = matrix((after[0], after[1], after[2], after[3]))
            for i in range(3):
                for j in range(3):
                    entry = 0.5 * (first[i][j] + last[i][j])
                    for s in range(signals.shape[1]):
                        rotated[k, i, j, s] += entry * signals[sample, s]
            for s in range(signals.shape[1]):
                plain[k, s] += signals[sample, s]
