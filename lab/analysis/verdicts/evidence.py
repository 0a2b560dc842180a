"""Evidence: the statistics of one run, or many together, for each assumption of the filter.

With the truth, each assumption has its own sample: the errors of the fixes for R, the sensor errors besides
the biases for Q, the initial error for P0. Without the truth, there are only the innovations. All figures are
sums, or are kept run by run, so the figures of many runs can be added.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, errors
from lab.analysis.consistency import normalised_squares
from lab.analysis.fix_causes import MotionAtFixes, error_per_cause, motion_at_fixes, of_fixes
from lab.analysis.verdicts.aid_verdict import aid_squares
from lab.analysis.verdicts.fix_evidence import FixErrors, fix_errors
from lab.analysis.verdicts.innovation_evidence import Innovations, innovations, offered
from lab.analysis.verdicts.run_means import (
    ALL,
    BETWEEN,
    BLOCKS,
    FURTHER,
    NEES,
    Figure,
    RunMeans,
    Series,
    run_means,
)
from lab.analysis.verdicts.sensor_evidence import SensorErrors, sensor_errors
from lab.analysis.verdicts.sums import Kept, Squares, Sum
from lab.analysis.verdicts.true_motion import Reference
from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.navigation.aids import NAMES, NO_AIDS
from lab.navigation.filters.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_SCALE, POS
from lab.navigation.solution import Belief, Fixes, Imu, Solution


@dataclass(frozen=True)
class Linearity(Sum):
    """How far the attitude errors of a filter are from small, run by run.

    Attributes
    ----------
    start : (runs,) array
        Largest σ of the attitude at the start [rad].
    largest : (runs,) array
        The same of the whole flight.
    neglected : (runs,) array
        Mean square of the mean neglected acceleration in σ of the accelerometer biases, over the fixes.
    """

    start: Kept
    largest: Kept
    neglected: Kept


def linearity(solution: Solution, belief: Belief, motion: MotionAtFixes, seen: NDArray[np.intp]) -> Linearity:
    """Return how far the attitude errors of a run are from small.

    Parameters
    ----------
    solution, belief
        The solution of a filter, and its assumptions.
    motion
        Motion at the fixes `seen` (m,), used or not.
    """
    used = np.flatnonzero(solution.fix_sample[seen] >= 0)
    if used.size and solution.fix_covariance.size:
        P = of_fixes(solution.fix_covariance, seen[used])
        (found,) = linearity_abreast(belief, P[None], motion.force_n[None, used], motion.C_nb[None, used])
        return found
    start = _largest_attitude(belief.P0)
    return Linearity(*(Kept(np.array([value])) for value in (start, start, 0.0)))


def _largest_attitude(P: FloatArray) -> float:
    """Return the largest σ of the attitude in covariances (…, n, n) [rad]."""
    return float(np.sqrt(np.diagonal(P[..., ATT, ATT], axis1=-2, axis2=-1).max()))


def linearity_abreast(
    belief: Belief, P: FloatArray, force_n: FloatArray, C_nb: FloatArray
) -> list[Linearity]:
    """Return how far the attitude errors of some runs are from small; see `linearity`.

    Parameters
    ----------
    belief
        The assumptions of all filters.
    P : (runs, m, n, n) array
        Covariances after the used fixes.
    force_n, C_nb : (runs, m, 3), (runs, m, 3, 3) arrays
        Specific forces [m/s²] and attitudes there.
    """
    start, about = _largest_attitude(belief.P0), P[..., ATT, ATT]
    # The mean of φ × (φ × f) is (P − tr P) f.
    trace = np.trace(about, axis1=-2, axis2=-1)[..., None]
    mean_n = ((about @ force_n[..., None])[..., 0] - trace * force_n) / 2
    mean_b = (np.swapaxes(C_nb, -1, -2) @ mean_n[..., None])[..., 0]
    of_bias = np.ascontiguousarray(P[..., ACCEL_BIAS, ACCEL_BIAS])
    neglected = normalised_squares(mean_b.reshape(-1, 3), of_bias.reshape(-1, 3, 3)).reshape(len(P), -1)
    return [
        Linearity(*(Kept(np.array([value])) for value in (start, max(start, _largest_attitude(own)), mean)))
        for own, mean in zip(P, neglected.mean(axis=1).tolist(), strict=True)
    ]


__all__ = [
    "BLOCKS",
    "SETTLING",
    "Evidence",
    "Innovations",
    "Reference",
    "Squares",
    "Usage",
    "evidence",
    "usage",
]


SETTLING = 60.0
"""Correlation time of the errors of a solution [s]; that of biases is longer, that of attitude and position
shorter. Over 100 runs, the mean NEES of flights of 205 s and 105 s varies like that of 3.5 and 2.6
independent epochs."""
GRID = 1.0
"""Step of the time grid for the NEES of the position [s]."""
APART = {"position": SETTLING, "velocity": SETTLING, "attitude": SETTLING}
"""Time after which the errors of a group are other ones [s]; those of other groups stay for the flight."""


@dataclass(frozen=True)
class Usage(Sum):
    """The numbers of fixes: offered, used and rejected.

    Attributes
    ----------
    offered, used, rejected
        Numbers of fixes during the IMU data, of used ones, and of those rejected by the gate.
    expected
        Number of rejections expected from the gate's probability if the filter's assumptions are right.
    """

    offered: int
    used: int
    rejected: int
    expected: float


@dataclass(frozen=True)
class Evidence(Sum):
    """The evidence of one run or of many.

    Attributes
    ----------
    runs : int
        Number of runs.
    innovations : Innovations
        Innovations of the fixes.
    usage : Usage
        Use of the fixes.
    assumed : Kept
        Latency [s] and lever arm [m] that the filter assumed, (runs, 4).
    fixes : FixErrors or None
        Errors of the fixes; needs the truth.
    sensors : SensorErrors or None
        Errors of gyros and accelerometers; needs the truth.
    start : Squares or None
        Initial error relative to P0, for all states (first) and each of `BLOCKS`.
    states : RunMeans or None
        Mean NEES of all states and of each group of them after the fixes, and of the position on the time
        grid, once a second, and just before the fixes, where outages show; needs the truth.
    linearity : Linearity or None
        How far attitude errors are from small; None for a user's algorithm.
    aids : Squares
        Squared innovations of each kind of measurement other than fixes.
    """

    runs: int
    innovations: Innovations
    usage: Usage
    assumed: Kept = field(default_factory=lambda: Kept(np.zeros((1, 4))))
    fixes: FixErrors | None = None
    sensors: SensorErrors | None = None
    start: Squares | None = None
    states: RunMeans | None = None
    linearity: Linearity | None = None
    aids: Squares = field(default_factory=lambda: Squares(np.zeros(len(NAMES)), np.zeros(len(NAMES))))

    @property
    def means(self) -> RunMeans:
        """Mean NEES, if the truth is known, and mean NIS."""
        return self.innovations.means if self.states is None else self.states.beside(self.innovations.means)

    @property
    def nees(self) -> Squares | None:
        """Sum of NEES of all states and its degrees of freedom, reduced for its correlation in time."""
        return None if self.states is None else self.states.together(0)

    def without_truth(self) -> Self:
        """Return the evidence without that which needs the truth."""
        return type(self)(
            self.runs, self.innovations, self.usage, self.assumed, linearity=self.linearity, aids=self.aids
        )


@OneBlasThread()
def evidence(
    solution: Solution,
    belief: Belief,
    fixes: Fixes,
    imu: Imu,
    reference: Reference | None = None,
    *,
    gate: float = 0.0,
    latency: float = 0.0,
    smoothed: Solution | None = None,
    explain: bool = True,
    aided: bool = False,
    names: tuple[str, ...] | None = None,
    calibrating: bool = False,
    aid_kinds: NDArray[np.int64] = NO_AIDS.kind,
    motion: MotionAtFixes | None = None,
    sensors: SensorErrors | None = None,
    gains: FloatArray | None = None,
) -> Evidence:
    """Return the evidence of a run about its filter.

    Parameters
    ----------
    solution, belief
        The solution and the assumptions of the filter. Innovations that are NaN, of quantities that the
        receiver does not measure, have no effect: their R is very large.
    fixes, imu
        The input of the filter; the fixes at the filter's times of validity.
    reference
        The truth, if known.
    gate
        Fraction of the good fixes that pass the gate; 0 without a gate.
    latency
        Latency that the filter assumed [s].
    smoothed
        Smoothed solution: NEES is then that of the smoothed states. All other evidence, including the start
        and the innovations, is the filter's.
    explain
        Whether suspicious innovations are explained.
    aided
        Whether the filter uses other measurements, or has states that `names` may not hold. Their effects
        between the fixes are not modelled here, so causes of the innovations are then not sought.
    names
        The further blocks of the filter, of scale factors, misalignments and g-sensitivity; by default, the
        scale factors of a filter with 21 states.
    calibrating
        Whether the filter estimates errors of the receiver. The errors of the fixes themselves are then not
        judged: they contain what is estimated.
    aid_kinds : (a,) array
        Kinds of the measurements other than fixes.
    motion
        Motion at the fixes that were `offered`; by default, from the solution at all samples.
    gains : (m, states, 6) array
        Gains of these fixes; by default, from the P after each.
    sensors
        Errors of the sensors; by default, from the increments. With motion and sensors given, solution,
        increments and truth may have some samples only: start, end and whole seconds, and those with a fix
        and before. The reference then needs its `flight` too: late fixes are compared with an earlier truth.
    """
    seen, samples = offered(solution, fixes, imu)
    motion = motion_at_fixes(solution, samples, imu) if motion is None else motion
    found = Evidence(
        runs=1,
        innovations=innovations(
            solution, belief, fixes, imu, motion, explain=explain, aided=aided, names=names, gained=gains
        ),
        usage=usage(solution, gate),
        assumed=Kept(np.append(latency, belief.lever_arm)[None]),
        linearity=linearity(solution, belief, motion, seen),
        aids=aid_squares(solution, aid_kinds, gate),
    )
    if reference is None:
        return found
    shown, used = solution if smoothed is None else smoothed, np.flatnonzero(solution.fix_sample >= 0)
    return replace(
        found,
        fixes=None
        if calibrating
        else fix_errors(
            belief,
            fixes,
            seen,
            error_per_cause(motion),
            reference.whole,
            reference.dtheta,
            solution.fix_rejected[seen],
        ),
        sensors=sensor_errors(belief, imu, reference) if sensors is None else sensors,
        start=_start(solution, belief, reference),
        states=state_means(shown, used, samples, reference),
    )


def usage(solution: Solution, gate: float) -> Usage:
    """Return the use of fixes by a filter whose gate passes the fraction `gate` of good fixes."""
    used, rejected = int(np.sum(solution.fix_sample >= 0)), int(solution.fix_rejected.sum())
    return Usage(used + rejected, used, rejected, (1 - gate) * (used + rejected) if gate else 0.0)


def _start(solution: Solution, belief: Belief, reference: Reference) -> Squares:
    x = _errors(solution, np.zeros(1, dtype=np.int64), reference)
    (found,) = start_squares(belief, x, scaled=solution.scale.shape[1] > 0)
    return found


def start_squares(belief: Belief, x: FloatArray, *, scaled: bool) -> list[Squares]:
    """Return the squares of the initial errors (runs, n) of filters with the same P0; see `Evidence`.

    `scaled` is true if the filter has states for scale factors.
    """
    total, number = np.zeros((len(x), 1 + len(BLOCKS))), np.zeros(1 + len(BLOCKS))
    for at, block in enumerate((slice(None), *BLOCKS.values())):
        if block in (GYRO_SCALE, ACCEL_SCALE) and not scaled:
            continue  # other states may be there
        P0 = belief.P0[block, block]
        if P0.size:
            inverse, number[at] = _inverse(P0.tobytes())
            total[:, at] = [own @ inverse @ own for own in x[:, block]]
    return [Squares(own, number) for own in total]


def _errors(solution: Solution, at: NDArray[np.intp], reference: Reference) -> FloatArray:
    """Return the errors of all states (k, states) at samples (k,)."""
    return errors.error_state(
        solution, at, reference.truth, reference.bias, reference.scale, reference.further
    )


@lru_cache(maxsize=64)
def _inverse(P0: bytes) -> tuple[FloatArray, float]:
    """Return W (n, n) of `consistency.normalised_squares`, vᵀ W v, and the number of independent errors.

    Many runs have the same covariance matrix.
    """
    values = np.frombuffer(P0)
    states = math.isqrt(values.size)
    P = values.reshape(states, states)
    sigma = np.sqrt(np.diagonal(P))
    scale = np.divide(1, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    scales = scale[:, None] * scale
    inverse = np.linalg.pinv(P * scales, rcond=consistency.SINGULAR**2, hermitian=True) * scales
    return inverse, float(np.linalg.matrix_rank(P * scales))


def state_means(
    solution: Solution, used: NDArray[np.intp], samples: NDArray[np.intp], reference: Reference
) -> RunMeans:
    """Return mean NEES after the used fixes, and between the fixes at samples (m,); see `Evidence`."""
    time = reference.truth.time
    span = float(time[0]), float(time[-1])
    at, P = solution.fix_sample[used], of_fixes(solution.fix_covariance, used)
    x = _errors(solution, at, reference)
    after = series_of_states(time[at], x[None], P[None], solution)
    seconds = between_fixes(time, samples)
    nees, degrees = position_nees(solution, seconds, reference) if seconds.size else (np.zeros(0), 0)
    return run_means([*after, series_between(time[seconds], nees, degrees)], span)


def between_fixes(time: FloatArray, samples: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return those of the samples at times (n,) at whole seconds, and just before fixes at samples (m,)."""
    return np.unique(np.concatenate((whole_seconds(time), np.maximum(samples - 1, 1))))


def series_between(time: FloatArray, nees: FloatArray, degrees: int) -> Series:
    """Return the series of NEES (k,) or (runs, k) of the position between fixes at times (k,) [s]."""
    return Series(Figure(BETWEEN), time, nees, np.full(time.size, float(degrees)), SETTLING)


def series_of_states(
    time: FloatArray, x: FloatArray, P: FloatArray, solution: Solution, nees: FloatArray | None = None
) -> list[Series]:
    """Return the series of NEES of all states, and of each group of them, after the fixes.

    Parameters
    ----------
    time : (m,) array
        Times of the fixes [s].
    x, P : (runs, m, n), (runs, m, n, n) arrays
        Errors of all states, and their covariances.
    solution
        A solution with these states.
    nees : (runs, m) array
        NEES of all states, if it is known.
    """
    further = slice(solution.states - solution.further.shape[1], solution.states)

    def series(group: str, block: slice, apart: float) -> Series:
        values, own = x[..., block], P[..., block, block]
        width, squares = values.shape[-1], np.zeros(x.shape[:-1])
        own = own.reshape(squares.size, width, width)
        degrees = np.full(time.size, float(consistency.find_uncertain_states(own).size if own.size else 0))
        if group == ALL and nees is not None:
            squares = nees
        elif own.size:
            squares = consistency.normalised_squares(values.reshape(squares.size, width), own).reshape(
                squares.shape
            )
        return Series(Figure(NEES, group), time, squares, degrees, apart, quartered=group == ALL)

    found = [series(ALL, slice(None), SETTLING)]
    for group, block in (BLOCKS | {FURTHER: further}).items():
        missing = block in (GYRO_SCALE, ACCEL_SCALE) and not solution.scale.shape[1]
        own = slice(0, 0) if missing else block  # other states may be there
        found.append(series(group, own, APART.get(group, np.inf)))
    return found


def whole_seconds(time: FloatArray) -> NDArray[np.intp]:
    """Return the samples (k,) at whole seconds after the start, or the first ones after them."""
    return np.searchsorted(time, np.arange(time[0] + GRID, time[-1], GRID))


def position_nees(solution: Solution, at: NDArray[np.intp], reference: Reference) -> tuple[FloatArray, int]:
    """Return NEES of the position at samples (k,), and its degrees of freedom."""
    x = _errors(solution, at, reference)[:, POS]
    P = errors.block_matrices(solution.variance[at][:, POS], solution.covariance[at, 0])
    return consistency.normalised_squares(x, P), consistency.find_uncertain_states(P).size
