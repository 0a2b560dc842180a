"""IMU causes: errors of the inertial sensors without a filter state, and their effect on the error.

Between fixes, a sensor error, resolved in n, adds to attitude and velocity. The filter corrects a part of it
through its gains. The rest appears in the innovations, like the effect of fix causes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_causes import add_product, write_imu_columns
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.kernels.compilation import entry_kernel, kernel
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
NODES = ((-math.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (math.sqrt(0.6), 5 / 18))
"""Gauss-Legendre nodes and weights, exact for the powers in the short-term error."""
AT_ONCE = 256
"""Fixes whose steps are computed together, with some 50 kB each at 200 Hz and 21 states."""

STEP, DTHETA, DVELOCITY = 0, slice(1, 4), slice(4, 7)
"""Places of the signals: length of a sample interval [s], and increments of gyros and accelerometers."""
GYRO_SLOPE, ACCEL_SLOPE, SINCE, SIGNALS = slice(7, 10), slice(10, 13), 13, 14
"""Places of minus what these lose in a sample, of a bias drift, and the number of signals."""
_OF_GAPS = ((ATT, slice(0, 3)), (VEL, slice(3, 6)))
"""States that unknown motion in gaps acts on, and the places of its densities."""


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
    rotated, plain = _sum_signals(solution, imu, edges, forced=forced)
    rotated[duration <= 0], plain[duration <= 0] = 0.0, 0.0
    mean_C, safe = rotated[..., STEP], np.maximum(duration, 1e-9)[:, None]
    force_n = np.trace(rotated[..., DVELOCITY], axis1=2, axis2=3) / safe
    rate_b, force_b = plain[:, DTHETA] / safe, plain[:, DVELOCITY] / safe
    C_nb = mean_C / safe[..., None]
    F = _system_matrix(names, C_nb, force_n, rate_b, force_b, belief)
    n, unknown = solution.states, _in_gaps(belief, imu.time, edges, duration)
    drives = [
        (ATT, 0, C_nb * np.sqrt(belief.noise[:3])),
        (VEL, 1, C_nb * np.sqrt(belief.noise[3:6])),
        (GYRO_BIAS, 2, np.broadcast_to(np.diag(np.sqrt(belief.noise[6:9])), C_nb.shape)),
        (ACCEL_BIAS, 3, np.broadcast_to(np.diag(np.sqrt(belief.noise[9:12])), C_nb.shape)),
    ]
    if unknown.any():
        drives += [(rows, 4, C_nb * np.sqrt(unknown[:, None, own])) for rows, own in _OF_GAPS]
    # The errors that the causes of gyros and accelerometers add, resolved in n.
    gyros, axes, signals = (one if forced else one[:0] for one in _REGRESSORS)
    direct, kick = rotated[:, :, axes, signals], np.zeros((count, n, axes.size))
    # What a sensor adds acts as minus an error of its estimated bias, with which F has the signs.
    kick[:, ATT, gyros], kick[:, VEL, ~gyros] = -direct[..., gyros], direct[..., ~gyros]
    found = Steps(np.empty(F.shape), np.zeros((count, 5, n, n)), np.zeros(kick.shape))
    _integrate(
        F,
        duration,
        np.array([(rows.start, part) for rows, part, _ in drives]),
        np.stack([roots for *_, roots in drives], axis=1),
        kick,
        found,
    )
    return found


def _in_gaps(belief: Belief, time: FloatArray, edges: NDArray[np.intp], duration: FloatArray) -> FloatArray:
    """Return the mean densities (m, 6) that gaps of the IMU add to the noise between samples (m + 1,)."""
    start, end = (belief.gaps[:, at] for at in (0, 1))
    first, last = (time[one, None] for one in (edges[:-1], edges[1:]))
    within = np.maximum(np.minimum(last, end) - np.maximum(first, start), 0.0)
    return np.asarray(within @ belief.gaps[:, 2:] / np.maximum(duration, 1e-9)[:, None])


@entry_kernel
def _integrate(
    F: FloatArray,
    duration: FloatArray,
    places: NDArray[np.int64],
    roots: FloatArray,
    kick: FloatArray,
    found: Steps,
) -> None:
    """Write the transitions over the intervals (m,), and add the noise and the causes within them.

    Parameters
    ----------
    F : (m, n, n) array
        System matrices.
    duration : (m,) array
        Lengths of the intervals [s].
    places : (d, 2) array
        First of the three states that a drive acts on, and the part of the noise that it belongs to.
    roots : (m, d, 3, 3) array
        Roots of the densities of the drives.
    kick : (m, n, p) array
        What the causes add, as if all of it came in the middle of the interval.
    """
    n = F.shape[1]
    second, third, onwards = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    G, some = np.empty((n, 3)), np.empty(n, np.int64)
    for k in range(len(F)):
        T = duration[k]
        second[:], third[:] = 0.0, 0.0
        add_product(F[k], F[k], 1 / 2, second)
        add_product(F[k], second, 1 / 3, third)
        _exponential(F[k], second, third, T, found.transition[k])
        for node, weight in NODES:
            _exponential(F[k], second, third, 0.5 * (1 - node) * T, onwards)
            if node == 0.0:
                add_product(onwards, kick[k], 1.0, found.forced[k])
            for d in range(len(places)):
                first, count = places[d, 0], 0
                for i in range(n):
                    a, b, c = onwards[i, first], onwards[i, first + 1], onwards[i, first + 2]
                    if a != 0 or b != 0 or c != 0:
                        for s in range(3):
                            G[count, s] = (
                                a * roots[k, d, 0, s] + b * roots[k, d, 1, s] + c * roots[k, d, 2, s]
                            )
                        some[count] = i
                        count += 1
                noise = found.noise[k, places[d, 1]]
                for row in range(count):
                    for column in range(row + 1):
                        both = G[row, 0] * G[column, 0] + G[row, 1] * G[column, 1] + G[row, 2] * G[column, 2]
                        i, j = some[row], some[column]
                        noise[i, j] += weight * T * both
                        noise[j, i] = noise[i, j]


@kernel
def _exponential(first: FloatArray, second: FloatArray, third: FloatArray, T: float, out: FloatArray) -> None:
    """Write exp(F T) to third order, from F, F²/2 and F³/6."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = T * (first[i, j] + T * (second[i, j] + T * third[i, j]))
        out[i, i] += 1.0


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
    # [f ×], whose columns are f × e.
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


def _sum_signals(
    solution: Solution, imu: Imu, edges: NDArray[np.intp], *, forced: bool
) -> tuple[FloatArray, FloatArray]:
    """Return sums of signals between samples `edges` (m + 1,): of C_nb s, (m, 3, 3, s), and of s, (m, s).

    C_nb s has the columns of C_nb, each times the signal. Without the effects of the causes, the signals are
    the first ones.
    """
    # A slope needs the samples on both sides.
    begin, end = max(int(edges.min()) - 1, 0), min(int(edges.max()) + 2, imu.dtheta.shape[0])
    count = SIGNALS if forced else DVELOCITY.stop
    rotated, plain = np.zeros((edges.size - 1, 3, 3, count)), np.zeros((edges.size - 1, count))
    _gather(
        of_kernel(imu.time[begin : end + 1]),
        of_kernel(imu.dtheta[begin:end]),
        of_kernel(imu.dvelocity[begin:end]),
        of_kernel(solution.q_nb[begin : end + 1]),
        edges - begin,
        float(imu.time[0]),
        rotated,
        plain,
    )
    return rotated, plain


@entry_kernel
def _gather(
    time: FloatArray,
    dtheta: FloatArray,
    dvelocity: FloatArray,
    q_nb: FloatArray,
    edges: NDArray[np.intp],
    start: float,
    rotated: FloatArray,
    plain: FloatArray,
) -> None:
    """Add the signals of the intervals, and their products with the mean of C_nb at both ends of each sample.

    `start` is the time of the first sample of all [s].
    """
    signals, last = np.empty(plain.shape[1]), matrix((1.0, 0.0, 0.0, 0.0))
    for k in range(edges.size - 1):
        for sample in range(edges[k], edges[k + 1]):
            dt = time[sample + 1] - time[sample]
            signals[STEP] = dt
            for axis in range(3):
                signals[DTHETA.start + axis] = dtheta[sample, axis]
                signals[DVELOCITY.start + axis] = dvelocity[sample, axis]
            if signals.size > DVELOCITY.stop:
                one, other = max(sample - 1, 0), min(sample + 1, len(dtheta) - 1)
                apart = max(other - one, 1)
                per_one = 1 / (apart * (time[one + 1] - time[one]))
                per_other = 1 / (apart * (time[other + 1] - time[other]))
                for axis in range(3):
                    signals[GYRO_SLOPE.start + axis] = (
                        dtheta[one, axis] * per_one - dtheta[other, axis] * per_other
                    )
                    signals[ACCEL_SLOPE.start + axis] = (
                        dvelocity[one, axis] * per_one - dvelocity[other, axis] * per_other
                    )
                signals[SINCE] = (time[sample + 1] - start) / DRIFT_TIME * dt
            before, after = q_nb[sample], q_nb[sample + 1]
            first = last if sample > edges[k] else matrix((before[0], before[1], before[2], before[3]))
            last = matrix((after[0], after[1], after[2], after[3]))
            for i in range(3):
                for j in range(3):
                    entry, here = 0.5 * (first[i][j] + last[i][j]), rotated[k, i, j]
                    for s in range(signals.size):
                        here[s] += entry * signals[s]
            for s in range(signals.size):
                plain[k, s] += signals[s]
