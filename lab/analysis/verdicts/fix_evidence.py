"""Fix evidence: statistics of the errors of fixes on R, correlation, latency and lever arm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.analysis import errors
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.outliers import outliers
from lab.analysis.verdicts.pattern import binned
from lab.analysis.verdicts.sums import Fit, Kept, Squares, Sum, normal_equations
from lab.base.arrays import FloatArray, of_kernel
from lab.motion.frames import ecef
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.filters.error_models import POS, VEL
from lab.navigation.kernels.compilation import entry_kernel
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
    plain = normal_equations(causes / root[:, None], error / root)
    late, gain = _latency(plain)
    if (
        times.size >= limits.VERDICT.cause_fixes
        and gain > limits.VERDICT.cause_ratio
        and abs(late) > NONLINEAR
    ):
        # For a long latency, the error is not velocity times latency, so the fixes are compared with the
        # earlier truth.
        error = _errors(fixes, used, truth, late) - assumed + causes[..., 0] * late
    variance = np.diagonal(belief.R)
    error, causes = error / np.sqrt(variance), causes / np.sqrt(variance)[:, None]
    kept = ~outliers(error)
    times, error, causes = times[kept], error[kept], causes[kept]
    position, log_determinant = coloured(times, causes[:, POS], error[:, POS])
    plain = normal_equations(causes, error)
    rest = error - causes @ (np.linalg.pinv(plain.matrix, hermitian=True) @ plain.vector)
    span = float(truth.time[0]), float(truth.time[-1])
    return FixErrors(
        count=times.size,
        position=position,
        log_determinant=log_determinant,
        velocity=normal_equations(causes[:, VEL], error[:, VEL]),
        variance=variance * times.size,
        outliers=int(np.sum(~kept & ~rejected)),
        refused=int(np.sum(~kept & rejected)),
        channels=Squares(
            np.stack((np.sum(rest**2, axis=0), np.sum(np.minimum(rest**2, CAPPED), axis=0))),
            np.full((2, 6), float(times.size)),
        ),
        in_time=binned(rest, times, span),
        span=Kept(np.array([span])),
    )


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
    times = np.clip(fixes.time[used] - late, truth.time[0], truth.time[-1])
    after = np.clip(np.searchsorted(truth.time, times, side="right"), 1, truth.time.size - 1)
    before, then = truth.taken(after - 1), truth.taken(after)
    part = (times - before.time) / (then.time - before.time)
    there = Truth(
        time=times,
        latitude=before.latitude + part * (then.latitude - before.latitude),
        longitude=wrap(before.longitude + part * wrap(then.longitude - before.longitude)),
        height=before.height + part * (then.height - before.height),
        velocity_n=before.velocity_n + part[:, None] * (then.velocity_n - before.velocity_n),
        q_nb=before.q_nb[:0],
        euler=np.zeros((0, 3)),
    )
    velocity_n = ecef.resolved_near_pole(fixes.velocity_n[used], fixes.position[used], there.position)
    return np.concatenate(
        (errors.position_error(fixes.position[used], there), velocity_n - there.velocity_n), axis=1
    )


def coloured(times: FloatArray, causes: FloatArray, values: FloatArray) -> tuple[Fit, FloatArray]:
    """Return normal equations and log-determinants under each correlation time and variance ratio.

    The covariance of the values at t and t' is δ(t − t') + ratio exp(−|t − t'| / time): the correlated part
    is a process of first order, which a scalar Kalman filter follows.
    """
    both = np.concatenate((causes, values[:, :, None]), axis=2)
    wide = both.shape[2]
    squares, log_determinant = (
        np.zeros((len(TIMES), wide, wide, len(RATIOS))),
        np.zeros((len(TIMES), len(RATIOS))),
    )
    _whiten(of_kernel(times), of_kernel(both), np.array(TIMES), np.array(RATIOS), squares, log_determinant)
    squares = squares.transpose(0, 3, 1, 2)
    return Fit(squares[..., :-1, :-1], squares[..., :-1, -1], squares[..., -1, -1]), log_determinant


@entry_kernel
def _whiten(
    times: FloatArray,
    both: FloatArray,
    lasting: FloatArray,
    ratios: FloatArray,
    squares: FloatArray,
    log_determinant: FloatArray,
) -> None:
    """Add products of whitened columns (m, c, w) to `squares` (times, w, w, ratios)."""
    m, channels, wide = both.shape
    every = ratios.size
    variance, gain, per = np.empty(every), np.empty(every), np.empty(every)
    expected, rest = np.empty((channels, wide, every)), np.empty((wide, every))
    for a in range(lasting.size):
        expected[:] = 0.0
        variance[:] = ratios
        for k in range(m):
            left = math.exp((times[k - 1] - times[k]) / lasting[a]) if k > 0 else 0.0
            for b in range(every):
                variance[b] = left * left * variance[b] + (1 - left * left) * ratios[b]
                per[b] = 1 / (1 + variance[b])
                gain[b] = variance[b] * per[b]
                log_determinant[a, b] -= channels * math.log(per[b])
                variance[b] *= per[b]
            for c in range(channels):
                for i in range(wide):
                    value = both[k, c, i]
                    for b in range(every):
                        before = left * expected[c, i, b]
                        rest[i, b] = value - before
                        expected[c, i, b] = before + gain[b] * rest[i, b]
                for i in range(wide):
                    for j in range(i + 1):
                        for b in range(every):
                            squares[a, i, j, b] += rest[i, b] * rest[j, b] * per[b]
        for i in range(wide):
            for j in range(i):
                squares[a, j, i] = squares[a, i, j]
