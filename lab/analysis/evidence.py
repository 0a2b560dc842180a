"""Evidence: what one run, or many together, say for and against each assumption of the filter.

With the truth, each assumption has a sample of its own: the errors of the fixes for R, what the sensors added
beside their biases for Q, the error at the start for P0. Without it there are the innovations alone. All
figures are sums, so those of many runs are added.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lab import ecef
from lab.analysis import consistency, errors
from lab.analysis.fix_causes import CAUSES, Motion, causes_of, motion_at_fixes, response
from lab.analysis.outliers import NEIGHBOURS, outliers
from lab.navigation.error_models import POS, VEL
from lab.navigation.kalman import MEASUREMENTS
from lab.navigation.solution import Belief, Fixes, Imu, Solution
from lab.rotation import wrap
from lab.trajectory import Truth

FloatArray = NDArray[np.float64]

LAGS = 5
"""Lags at which the innovations are correlated with themselves."""
TIMES = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
"""Correlation times that are tried on the position errors of the fixes [s]."""
RATIOS = (0.0, 0.1, 0.3, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 200.0)
"""Variances of the correlated part that are tried, in those of the white part."""
STRETCH = 200
"""Fixes that are taken as correlated with each other; longer records are cut, which keeps the work linear."""
WINDOW = 1.0
"""Time over which the sensors' noise is summed [s]."""
SETTLING = 60.0
"""Time in which a solution forgets its errors, biases more slowly, attitude and position faster [s]: over 100
runs the mean NEES of flights of 205 s and 105 s varies like that of 3.5 and 2.6 independent epochs."""


class Squares(NamedTuple):
    """Sums of squares of what should have unit variance, and how many independent values they are of."""

    total: FloatArray
    number: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Mean squares: one where the assumption holds."""
        return np.divide(self.total, self.number, out=np.ones_like(self.total), where=self.number > 0)


class Fit(NamedTuple):
    """Normal equations of least squares on the causes (…, 4, 4), (…, 4), and the squares (…)."""

    matrix: FloatArray
    vector: FloatArray
    squares: FloatArray


@dataclass(frozen=True)
class _Sum:
    """Figures that add up over runs."""

    def __add__(self, other: Self) -> Self:
        return type(self)(*(_add(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))


def _add(one: object, other: object) -> object:
    if one is None or other is None:
        return None
    if isinstance(one, tuple) and isinstance(other, tuple):
        return type(one)(*(a + b for a, b in zip(one, other, strict=True)))
    return one + other  # type: ignore[operator]


@dataclass(frozen=True)
class Innovations(_Sum):
    """What the innovations say, each divided by its σ; channels are position, then velocity, N, E, D.

    Attributes
    ----------
    squares : Squares
        Of each channel (6,).
    sums : (6,) array
        Of each channel.
    lagged : (LAGS, 6) array
        Sums of products with the innovations so many fixes later.
    fit : Fit
        Of the innovations, made white, on the filter's response to each cause.
    outliers : int
        How many no Gaussian would give.
    """

    squares: Squares
    sums: FloatArray
    lagged: FloatArray
    fit: Fit
    outliers: int


@dataclass(frozen=True)
class FixErrors(_Sum):
    """What the errors of the fixes say of R, in the units of its σ; those of outliers apart.

    Attributes
    ----------
    count : int
        Fixes that are no outliers.
    position : Fit
        For each correlation time and variance ratio (TIMES, RATIOS), the errors made white with them.
    log_determinant : (TIMES, RATIOS) array
        Of the covariance they were made white with.
    velocity : Fit
        Of the velocity errors.
    variance : (6,) array
        What R assumes, times the fixes [m²], [(m/s)²].
    outliers : int
        Fixes whose errors no Gaussian would give.
    """

    count: int
    position: Fit
    log_determinant: FloatArray
    velocity: Fit
    variance: FloatArray
    outliers: int


@dataclass(frozen=True)
class Evidence(_Sum):
    """All that is known of one run, or of many.

    Attributes
    ----------
    runs : int
        How many.
    innovations : Innovations
        Of the fixes used.
    nis : Squares
        NIS, in total, and its degrees of freedom.
    fixes : FixErrors or None
        With the truth.
    noise : Squares or None
        What gyros (first) and accelerometers add to the errors beside their biases, against Q.
    start : Squares or None
        Error at the start against P0.
    nees : Squares or None
        NEES, in total, and its degrees of freedom, discounted for its correlation in time.
    """

    runs: int
    innovations: Innovations
    nis: Squares
    fixes: FixErrors | None = None
    noise: Squares | None = None
    start: Squares | None = None
    nees: Squares | None = None

    def without_truth(self) -> Self:
        """Return what would be known without the truth."""
        return type(self)(self.runs, self.innovations, self.nis)


class Reference(NamedTuple):
    """The truth of a simulated run.

    Attributes
    ----------
    truth : Truth
        At all samples.
    bias : (n + 1, 6) array
        True gyro and accelerometer biases at all samples [rad/s], [m/s²].
    dtheta, dvelocity : (n, 3) arrays
        True increments [rad], [m/s].
    scale : (n + 1, 6) array
        True scale factor errors of gyros and accelerometers; needed of filters with 21 states only.
    """

    truth: Truth
    bias: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    scale: FloatArray | None = None


def evidence(
    solution: Solution, belief: Belief, fixes: Fixes, imu: Imu, reference: Reference | None = None
) -> Evidence:
    """Return what a run says of its filter.

    Parameters
    ----------
    solution, belief
        What the navigator computed, and what it assumed. Innovations that are NaN, of what the receiver does
        not measure, count for nothing: their R is very large.
    fixes, imu
        What it was given; the fixes at the times the filter takes for those of their validity.
    reference
        The truth, where it is known.
    """
    used = np.flatnonzero(solution.fix_sample >= 0)
    motion = motion_at_fixes(solution, used, imu)
    causes = causes_of(motion)
    known = np.isfinite(solution.innovation[used])
    nis = consistency.normalised_squares(
        np.nan_to_num(solution.innovation[used]), solution.innovation_covariance[used]
    )
    found = Evidence(
        runs=1,
        innovations=_innovations(solution, used, imu.time, motion, causes),
        nis=Squares(np.array(nis.sum()), np.array(float(known.sum()))),
    )
    if reference is None:
        return found
    return Evidence(
        found.runs,
        found.innovations,
        found.nis,
        fixes=_fix_errors(belief, fixes, used, causes, reference.truth),
        noise=_noise(belief, imu, reference),
        start=_start(solution, belief, reference),
        nees=nees_squares(solution, used, reference),
    )


def _innovations(
    solution: Solution,
    used: NDArray[np.intp],
    time: FloatArray,
    motion: Motion,
    causes: FloatArray,
) -> Innovations:
    known = np.isfinite(solution.innovation[used])
    nu, S = np.nan_to_num(solution.innovation[used]), solution.innovation_covariance[used]
    sigma = np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    normalised = nu / sigma
    squares, sums, lagged = sizes(normalised)
    answer = response(solution, used, time, motion, causes)
    root = np.linalg.cholesky(S / (sigma[:, :, None] * sigma[:, None, :]))
    both = np.concatenate((answer, nu[..., None]), axis=2) / sigma[..., None]
    white = np.asarray(np.linalg.solve(root, both), dtype=np.float64)
    return Innovations(
        squares=Squares(squares.total, known.sum(axis=0).astype(np.float64)),
        sums=sums,
        lagged=lagged,
        fit=_normal_equations(white[..., :CAUSES], white[..., CAUSES]),
        outliers=int(outliers(normalised, settled=NEIGHBOURS // 2).sum()),
    )


def sizes(normalised: FloatArray) -> tuple[Squares, FloatArray, FloatArray]:
    """Return squares, sums (6,) and lagged products (LAGS, 6) of innovations (m, 6) in their σ."""
    m = normalised.shape[0]
    lagged = np.zeros((LAGS, MEASUREMENTS))
    for lag in range(1, min(LAGS, m - 1) + 1):
        lagged[lag - 1] = np.sum(normalised[lag:] * normalised[:-lag], axis=0)
    squares = Squares(np.sum(normalised**2, axis=0), np.full(MEASUREMENTS, float(m)))
    return squares, normalised.sum(axis=0), lagged


def _normal_equations(causes: FloatArray, values: FloatArray) -> Fit:
    """Return the normal equations of white values (m, c) on causes (m, c, CAUSES)."""
    return Fit(
        np.einsum("mci,mcj->ij", causes, causes),
        np.einsum("mci,mc->i", causes, values),
        np.array(np.sum(values**2)),
    )


def _fix_errors(
    belief: Belief, fixes: Fixes, used: NDArray[np.intp], causes: FloatArray, truth: Truth
) -> FixErrors:
    times = fixes.time[used]
    longitude = np.unwrap(truth.longitude)
    there = Truth(
        time=times,
        latitude=np.interp(times, truth.time, truth.latitude),
        longitude=wrap(np.interp(times, truth.time, longitude)),
        height=np.interp(times, truth.time, truth.height),
        velocity_n=np.stack([np.interp(times, truth.time, v) for v in truth.velocity_n.T], axis=-1),
        q_nb=truth.q_nb[:0],
        euler=truth.euler[:0],
    )
    velocity_n = ecef.turned_near_pole(fixes.velocity_n[used], fixes.position[used], there.position)
    error = np.concatenate(
        (errors.position_error(fixes.position[used], there), velocity_n - there.velocity_n), axis=1
    )
    error -= causes[:, :, 1:] @ belief.lever_arm  # which the filter is told
    variance = np.diagonal(belief.R)
    error, causes = error / np.sqrt(variance), causes / np.sqrt(variance)[:, None]
    kept = ~outliers(error)
    times, error, causes = times[kept], error[kept], causes[kept]
    position, log_determinant = _coloured(times, causes[:, POS], error[:, POS])
    return FixErrors(
        count=times.size,
        position=position,
        log_determinant=log_determinant,
        velocity=_normal_equations(causes[:, VEL], error[:, VEL]),
        variance=variance * times.size,
        outliers=used.size - times.size,
    )


def _coloured(times: FloatArray, causes: FloatArray, values: FloatArray) -> tuple[Fit, FloatArray]:
    """Return normal equations and log-determinants under each correlation time and variance ratio.

    The covariance of the values at t and t' is δ(t − t') + ratio exp(−|t − t'| / time).
    """
    shape = (len(TIMES), len(RATIOS))
    fit = Fit(np.zeros((*shape, CAUSES, CAUSES)), np.zeros((*shape, CAUSES)), np.zeros(shape))
    log_determinant = np.zeros(shape)
    ratios = np.array(RATIOS)
    for first in range(0, times.size, STRETCH):
        part = slice(first, first + STRETCH)
        since = times[part] - times[first]
        for at, correlation_time in enumerate(TIMES):
            power, basis = _spectrum(since.tobytes(), correlation_time)
            weight = 1 / (1 + ratios[:, None] * power)
            a = np.tensordot(basis.T, causes[part], axes=1)
            y = basis.T @ values[part]
            fit.matrix[at] += np.einsum("rm,mij->rij", weight, np.einsum("mci,mcj->mij", a, a))
            fit.vector[at] += weight @ np.einsum("mci,mc->mi", a, y)
            fit.squares[at] += weight @ np.sum(y**2, axis=1)
            log_determinant[at] -= values.shape[1] * np.sum(np.log(weight), axis=1)
    return fit, log_determinant


@lru_cache(maxsize=64)
def _spectrum(times: bytes, correlation_time: float) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (m,) and eigenvectors (m, m) of exp(−|t − t'| / time); runs share their times."""
    t = np.frombuffer(times)
    power, basis = np.linalg.eigh(np.exp(-np.abs(t[:, None] - t) / correlation_time))
    return np.maximum(power, 0), basis


def _noise(belief: Belief, imu: Imu, reference: Reference) -> Squares:
    """Return what the sensors add beside their biases, summed over windows, against the densities of Q."""
    dt = np.diff(imu.time)[:, None]
    width = max(1, round(WINDOW / float(dt.mean())))
    windows = dt.size // width
    total, count = np.zeros(2), np.zeros(2)
    for sensor, (measured, true) in enumerate(
        ((imu.dtheta, reference.dtheta), (imu.dvelocity, reference.dvelocity))
    ):
        axes = slice(3 * sensor, 3 * sensor + 3)
        density = belief.noise[axes]
        added = measured - true - reference.bias[1:, axes] * dt
        if belief.P0.shape[0] > 15:  # scale factors are states, not noise
            power = np.sum(true**2, axis=0)
            slope = np.divide(np.sum(added * true, axis=0), power, out=np.zeros(3), where=power > 0)
            added = added - slope * true
        added = added[: windows * width].reshape(windows, width, 3).sum(axis=1)
        assumed = density > 0
        total[sensor] = np.sum(added[:, assumed] ** 2 / (density[assumed] * width * dt.mean()))
        count[sensor] = windows * np.count_nonzero(assumed)
    return Squares(total, count)


def _start(solution: Solution, belief: Belief, reference: Reference) -> Squares:
    first = np.zeros(1, dtype=np.int64)
    x = errors.error_state(solution, first, reference.truth, reference.bias, reference.scale)
    P0 = belief.P0[None]
    square = consistency.normalised_squares(x, P0).sum()
    return Squares(np.array(square), np.array(float(np.linalg.matrix_rank(_correlation(P0[0])))))


def _correlation(P: FloatArray) -> FloatArray:
    sigma = np.sqrt(np.diagonal(P))
    scale = np.divide(1, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    return P * scale[:, None] * scale


def nees_squares(solution: Solution, used: NDArray[np.intp], reference: Reference) -> Squares:
    """Return NEES; it changes slowly, so a flight counts as an epoch for each `SETTLING` seconds."""
    if not used.size:
        return Squares(np.zeros(()), np.zeros(()))
    at = solution.fix_sample[used]
    x = errors.error_state(solution, at, reference.truth, reference.bias, reference.scale)
    P = solution.fix_covariance[used]
    nees = consistency.normalised_squares(x, P)
    epochs = max(1.0, float(np.ptp(reference.truth.time)) / SETTLING)
    return Squares(np.array(epochs * nees.mean()), np.array(epochs * consistency.uncertain(P).size))
