"""Fix evidence: statistics of the errors of fixes on R, correlation, latency and lever arm."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.analysis import errors
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.outliers import outliers, stands_out
from lab.analysis.verdicts.pattern import bin_squares
from lab.analysis.verdicts.sums import Fit, Kept, Squares, Sum, normal_equations, pseudoinverse
from lab.base.arrays import FloatArray, of_kernel
from lab.motion.frames import ecef
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.filters.error_models import POS, VEL
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels.compilation import entry_kernel
from lab.navigation.kernels.lane_views import LANES, wide, wide_vectors
from lab.navigation.solution import Belief, Fixes

TIMES = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
"""Tried correlation times of the position errors of the fixes [s]."""
RATIOS = (0.0, 0.1, 0.3, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 200.0)
"""Tried variances of the correlated part, relative to those of the white part."""
CAPPED = 10.8
"""Square of a variable of unit variance that one in 1,000 exceeds."""
NONLINEAR = 0.05
"""Smallest latency for which the fixes are compared with an earlier truth [s]."""


@dataclass(frozen=True)
class FixErrors(Sum):
    """Statistics of the errors of the fixes, in the σ of R, without outliers.

    Attributes
    ----------
    count : int
        Number of fixes that are not outliers.
    position : Fit
        Fit of the position errors, whitened with each correlation time and variance ratio (TIMES, RATIOS).
    log_determinant : (TIMES, RATIOS) array
        Log-determinant of the covariance used for whitening.
    velocity : Fit
        Fit of the velocity errors.
    variance : (6,) array
        Variance according to R, times the number of fixes [m²], [(m/s)²].
    outliers, refused : int
        Numbers of fixes with non-Gaussian errors: used ones, and ones that the gate rejected.
    channels, in_time : Squares
        Squares of the errors without latency and lever arm: of each channel (2, 6), plain and with each
        square limited to `CAPPED`; and of position and velocity in each part of the flight (2, 2, BINS).
    span : Kept
        Start and end of each flight [s].
    """

    count: int
    position: Fit
    log_determinant: FloatArray
    velocity: Fit
    variance: FloatArray
    outliers: int
    refused: int
    channels: Squares
    in_time: Squares
    span: Kept


def fix_errors(
    belief: Belief,
    fixes: Fixes,
    used: NDArray[np.intp],
    causes: FloatArray,
    truth: Truth,
    dtheta: FloatArray,
    rejected: NDArray[np.bool_],
) -> FixErrors:
    """Return the statistics of the errors of the offered fixes.

    Parameters
    ----------
    belief, fixes
        Assumptions and input of the filter.
    used : (m,) array
        Indices of the offered fixes.
    causes : (m, 6, CAUSES) array
        Effects of latency and lever arm on them.
    truth
        The true flight.
    dtheta : (n, 3) array
        True angular increments [rad].
    rejected : (m,) array
        Mask of the rejected ones.
    """
    times = fixes.time[used]
    assumed = _of_lever_arm(belief.lever_arm, truth, dtheta, times)
    error = _errors(fixes, used, truth, 0.0) - assumed
    root = np.sqrt(np.diagonal(belief.R))
    plain, apart = normal_equations(causes / root[:, None], error / root), error
    late, gain = _latency(plain)
    if _is_late(times.size, late, gain):
        # For a long latency, the error is not velocity times latency, so the fixes are compared with the
        # earlier truth.
        apart = _errors(fixes, used, truth, late) - assumed
        error = apart + causes[..., 0] * late
    variance = np.diagonal(belief.R)
    # Where the vehicle turns, what a latency adds to fixes stands out from that of their neighbours.
    kept = ~outliers(apart / root)
    error, causes = error / root, causes / root[:, None]
    span = float(truth.time[0]), float(truth.time[-1])
    (found,) = _of_errors(times[kept], causes[None, kept], error[None, kept], variance, span)
    return replace(found, outliers=int(np.sum(~kept & ~rejected)), refused=int(np.sum(~kept & rejected)))


def fix_errors_abreast(
    belief: Belief,
    times: FloatArray,
    positions: FloatArray,
    velocities_n: FloatArray,
    causes: FloatArray,
    truth: Truth,
) -> list[FixErrors | None]:
    """Return the statistics of the fixes of some runs, all used and none with a lever arm; see `fix_errors`.

    None stands for a run whose fixes may have outliers, or are so late that they are compared with an earlier
    truth.

    Parameters
    ----------
    belief
        The assumptions of all filters.
    times : (m,) array
        Times of the fixes of all runs [s].
    positions, velocities_n : (runs, m, 3) arrays
        The fixes of each.
    causes : (runs, m, 6, CAUSES) array
        Effects of latency and lever arm on them.
    truth
        The true flight.
    """
    variance = np.diagonal(belief.R)
    there = _interpolate_truth(truth, times)
    true = np.tile(there.position, (len(positions), 1))
    off = displacement(true, positions.reshape(-1, 3)).reshape(positions.shape)
    error = np.concatenate((off, velocities_n - there.velocity_n), axis=2) / np.sqrt(variance)
    causes = causes / np.sqrt(variance)[:, None]
    plain = normal_equations(causes, error)
    late = [_is_late(times.size, *_latency(Fit(*one))) for one in zip(*plain, strict=True)]
    usual = ~(late | stands_out(error))
    span = float(truth.time[0]), float(truth.time[-1])
    found = iter(_of_errors(times, causes[usual], error[usual], variance, span) if usual.any() else ())
    return [next(found) if own else None for own in usual]


def _of_errors(
    times: FloatArray, causes: FloatArray, error: FloatArray, variance: FloatArray, span: tuple[float, float]
) -> list[FixErrors]:
    """Return the statistics of errors (runs, m, 6) and causes (runs, m, 6, p), both in σ, at times (m,)."""
    position, log_determinant = coloured(times, causes[:, :, POS], error[:, :, POS])
    velocity, plain = normal_equations(causes[:, :, VEL], error[:, :, VEL]), normal_equations(causes, error)
    by_causes = pseudoinverse(plain.matrix) @ plain.vector[..., None]
    rest = error - (causes @ by_causes[:, None])[..., 0]
    squares = np.stack((np.sum(rest**2, axis=1), np.sum(np.minimum(rest**2, CAPPED), axis=1)), axis=1)
    in_time = bin_squares(rest, times, span)
    return [
        FixErrors(
            count=times.size,
            position=Fit(*(part[run] for part in position)),
            log_determinant=log_determinant,
            velocity=Fit(*(np.asarray(part[run]) for part in velocity)),
            variance=variance * times.size,
            outliers=0,
            refused=0,
            channels=Squares(squares[run], np.full((2, 6), float(times.size))),
            in_time=Squares(*(part[run] for part in in_time)),
            span=Kept(np.array([span])),
        )
        for run in range(len(error))
    ]


def _is_late(fixes: int, late: float, gain: float) -> bool:
    """Return whether a latency [s] of so many fixes is so sure and long that the errors depend on its square.

    `gain` is that in log-likelihood.
    """
    return fixes >= limits.VERDICT.cause_fixes and gain > limits.VERDICT.cause_ratio and abs(late) > NONLINEAR


def _latency(fit: Fit) -> tuple[float, float]:
    """Return the latency [s] that best explains the errors alone, and its gain in log-likelihood."""
    late = float(fit.vector[0] / max(fit.matrix[0, 0], 1e-30))
    return late, 0.5 * late * float(fit.vector[0])


def _of_lever_arm(lever_arm: FloatArray, truth: Truth, dtheta: FloatArray, times: FloatArray) -> FloatArray:
    """Return the effect (m, 6) of a lever arm l on fixes at some times [s]: C_nb l and C_nb (ω × l).

    Both are true. An estimated attitude that is wrong by 1° moves an antenna at 2 m by 3.5 cm for as long as
    it is wrong, and the mean rate before a fix is late; both are more than the noise of the best receivers,
    whose errors do not contain them.

    Parameters
    ----------
    lever_arm : (3,) array
        The lever arm [m].
    truth
        The true flight at n + 1 samples.
    dtheta : (n, 3) array
        True angular increments [rad].
    times : (m,) array
        Times of validity of the fixes [s].
    """
    if not lever_arm.any():
        return np.zeros((times.size, 6))
    time, count = truth.time, dtheta.shape[0]
    times = np.clip(times, time[0], time[-1])
    last = np.clip(np.searchsorted(time, times), 1, count)
    before, after = truth.q_nb[last - 1], truth.q_nb[last]
    # Of q and −q, the one that is near the attitude before.
    after = np.where(np.sum(before * after, axis=1, keepdims=True) < 0, -after, after)
    step = time[last] - time[last - 1]
    part = ((times - time[last - 1]) / step)[:, None]
    # The angle between samples is small; `from_quat` normalises.
    C_nb = Rotation.from_quat((1 - part) * before + part * after, scalar_first=True).as_matrix()
    # The mean rate of an interval is that of its middle.
    from_middle = part - 1 / 2
    other = np.clip(np.where(from_middle[:, 0] < 0, last - 1, last + 1), 1, count)
    weight = np.abs(from_middle)
    rate = ((1 - weight) * dtheta[last - 1] + weight * dtheta[other - 1]) / step[:, None]
    speed = np.einsum("mij,mj->mi", C_nb, np.cross(rate, lever_arm))
    return np.concatenate((C_nb @ lever_arm, speed), axis=1)


def _errors(fixes: Fixes, used: NDArray[np.intp], truth: Truth, late: float) -> FloatArray:
    """Return the errors (m, 6) of fixes relative to the truth one latency earlier [m], [m/s]."""
    there = _interpolate_truth(truth, fixes.time[used] - late)
    velocity_n = ecef.resolved_near_pole(fixes.velocity_n[used], fixes.position[used], there.position)
    return np.concatenate(
        (errors.position_error(fixes.position[used], there), velocity_n - there.velocity_n), axis=1
    )


def _interpolate_truth(truth: Truth, times: FloatArray) -> Truth:
    """Return the truth at times (m,) without attitudes [s]."""
    times = np.clip(times, truth.time[0], truth.time[-1])
    after = np.clip(np.searchsorted(truth.time, times, side="right"), 1, truth.time.size - 1)
    before, then = truth.taken(after - 1), truth.taken(after)
    part = (times - before.time) / (then.time - before.time)
    return Truth(
        time=times,
        latitude=before.latitude + part * (then.latitude - before.latitude),
        longitude=wrap(before.longitude + part * wrap(then.longitude - before.longitude)),
        height=before.height + part * (then.height - before.height),
        velocity_n=before.velocity_n + part[:, None] * (then.velocity_n - before.velocity_n),
        q_nb=before.q_nb[:0],
        euler=np.zeros((0, 3)),
    )


def coloured(times: FloatArray, causes: FloatArray, values: FloatArray) -> tuple[Fit, FloatArray]:
    """Return normal equations and log-determinants under each correlation time and variance ratio.

    The covariance of the values at t and t' is δ(t − t') + ratio exp(−|t − t'| / time): the correlated part
    is a process of first order, which a scalar Kalman filter follows.

    Parameters
    ----------
    times : (m,) array
        Times of the values [s].
    causes, values : (runs, m, c, p) and (runs, m, c) arrays
        Of up to eight runs; for a single one, the first dimension may be missing.
    """
    both = np.concatenate((causes, values[..., None]), axis=-1)
    m, channels, width = both.shape[-3:]
    runs, tried, rows = math.prod(both.shape[:-3]), (len(TIMES), len(RATIOS)), m * channels * width
    columns = aligned_zeros(rows * LANES)
    columns.reshape(rows, LANES)[:, :runs] = both.reshape(runs, rows).T
    squares, log_determinant = aligned_zeros(math.prod(tried) * width**2 * LANES), np.zeros(tried)
    room, left = aligned_zeros((channels + 1) * width * LANES), np.empty(m)
    _whiten(
        of_kernel(times),
        columns,
        (m, channels, width),
        np.array(TIMES),
        np.array(RATIOS),
        left,
        room,
        squares,
        log_determinant,
    )
    found = squares.reshape(*tried, width, width, LANES)[..., :runs]
    found = np.ascontiguousarray(np.moveaxis(found, -1, 0)).reshape(*both.shape[:-3], *found.shape[:-1])
    return Fit(found[..., :-1, :-1], found[..., :-1, -1], found[..., -1, -1]), log_determinant


@entry_kernel
def _whiten(
    times: FloatArray,
    columns: FloatArray,
    shape: tuple[int, int, int],
    lasting: FloatArray,
    ratios: FloatArray,
    left: FloatArray,
    room: FloatArray,
    squares: FloatArray,
    log_determinant: FloatArray,
) -> None:
    """Write products of whitened columns (m, c, w, LANES) into `squares` (times, ratios, w, w, LANES).

    `left` (m,) and `room` (c + 1, w, LANES) are room for what is left of the correlated part at each time,
    and for expected and whitened values.
    """
    wide_vectors()
    m, channels, width = shape
    both, expected, rest = wide(columns, 0), wide(room, 0), wide(room, channels * width)
    for a in range(lasting.size):
        for k in range(1, m):
            left[k] = math.exp((times[k - 1] - times[k]) / lasting[a])
        for b in range(ratios.size):
            total = wide(squares, (a * ratios.size + b) * width * width)
            for i in range(channels * width):
                expected[i] = 0.0
            variance = ratios[b]
            for k in range(m):
                fade = left[k] if k > 0 else 0.0
                # A Kalman filter of the correlated part, in units of the white variance.
                variance = fade * fade * variance + (1 - fade * fade) * ratios[b]
                per = 1 / (1 + variance)
                gain = variance * per
                log_determinant[a, b] -= channels * math.log(per)
                variance = gain
                for c in range(channels):
                    at = (k * channels + c) * width
                    for i in range(width):
                        before = expected[c * width + i] * fade
                        apart = both[at + i] - before
                        expected[c * width + i] = before + apart * gain
                        rest[i] = apart
                    for i in range(width):
                        weighted = rest[i] * per
                        for j in range(i + 1):
                            total[i * width + j] = total[i * width + j] + weighted * rest[j]
            for i in range(width):
                for j in range(i):
                    total[j * width + i] = total[i * width + j]
