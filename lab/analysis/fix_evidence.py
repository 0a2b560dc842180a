"""Fix evidence: what the errors of the fixes say of R, of their correlation, and of latency and lever arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab import ecef
from lab.analysis import errors
from lab.analysis.fix_causes import CAUSES
from lab.analysis.outliers import outliers
from lab.analysis.pattern import binned
from lab.analysis.sums import Fit, Kept, Squares, Sum, normal_equations
from lab.navigation.error_models import POS, VEL
from lab.navigation.solution import Belief, Fixes
from lab.rotation import wrap
from lab.trajectory import Truth

FloatArray = NDArray[np.float64]

TIMES = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
"""Correlation times that are tried on the position errors of the fixes [s]."""
RATIOS = (0.0, 0.1, 0.3, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 200.0)
"""Variances of the correlated part that are tried, in those of the white part."""
CAPPED = 10.8
"""Square of unit variance that one in 1,000 exceeds."""
NONLINEAR = 0.05
"""Latency from which on the fixes are compared with the truth so much earlier [s]."""
FEWEST = 10
"""Fixes from which on latency and lever arm are looked for."""
LEAST = 6.0
"""Logarithm of the likelihood ratio from which on latency (with its price 8, 1 in 16,000) or a lever arm (12,
1 in 40,000) are stated."""
STRETCH = 200
"""Fixes that are taken as correlated with each other; longer records are cut, which keeps the work linear."""


@dataclass(frozen=True)
class FixErrors(Sum):
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
    outliers, refused : int
        Fixes whose errors no Gaussian would give: those used, and those the gate rejected.
    channels, in_time : Squares
        Of what latency and lever arm leave: of each channel (2, 6), plain and with no fix counting for more
        than `CAPPED`, and of position and velocity in each part
        of the flight (2, 2, BINS).
    span : Kept
        Begin and end of each flight [s].
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
    rejected: NDArray[np.bool_],
) -> FixErrors:
    """Return what the errors of the fixes offered say.

    Parameters
    ----------
    belief, fixes
        What the filter assumed, and was given.
    used : (m,) array
        Numbers of the fixes it was offered.
    causes : (m, 6, CAUSES) array
        What latency and lever arm make of these.
    truth
        The true flight.
    rejected : (m,) array
        Which of them the filter rejected.
    """
    times = fixes.time[used]
    told = causes[:, :, 1:] @ belief.lever_arm
    error = _errors(fixes, used, truth, 0.0) - told
    root = np.sqrt(np.diagonal(belief.R))
    plain = normal_equations(causes / root[:, None], error / root)
    late, gain = _latency(plain)
    if times.size >= FEWEST and gain > LEAST and abs(late) > NONLINEAR:
        # What is far off in time is off by more than its velocity: compared with the truth then.
        error = _errors(fixes, used, truth, late) - told + causes[..., 0] * late
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
    """Return the latency [s] that explains the errors if nothing else does, and what likelihood it gains."""
    late = float(fit.vector[0] / max(fit.matrix[0, 0], 1e-30))
    return late, 0.5 * late * float(fit.vector[0])


def _errors(fixes: Fixes, used: NDArray[np.intp], truth: Truth, late: float) -> FloatArray:
    """Return the errors (m, 6) of fixes against the truth so much earlier [m], [m/s]."""
    times = np.clip(fixes.time[used] - late, truth.time[0], truth.time[-1])
    longitude = np.unwrap(truth.longitude)
    there = Truth(
        time=times,
        latitude=np.interp(times, truth.time, truth.latitude),
        longitude=wrap(np.interp(times, truth.time, longitude)),
        height=np.interp(times, truth.time, truth.height),
        velocity_n=np.stack([np.interp(times, truth.time, v) for v in truth.velocity_n.T], axis=-1),
        q_nb=truth.q_nb[:0],
        euler=np.zeros((0, 3)),
    )
    velocity_n = ecef.resolved_near_pole(fixes.velocity_n[used], fixes.position[used], there.position)
    return np.concatenate(
        (errors.position_error(fixes.position[used], there), velocity_n - there.velocity_n), axis=1
    )


def coloured(times: FloatArray, causes: FloatArray, values: FloatArray) -> tuple[Fit, FloatArray]:
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
            power, basis = correlation_spectrum(since.tobytes(), correlation_time)
            weight = 1 / (1 + ratios[:, None] * power)
            a = np.tensordot(basis.T, causes[part], axes=1)
            y = basis.T @ values[part]
            fit.matrix[at] += np.einsum("rm,mij->rij", weight, np.einsum("mci,mcj->mij", a, a))
            fit.vector[at] += weight @ np.einsum("mci,mc->mi", a, y)
            fit.squares[at] += weight @ np.sum(y**2, axis=1)
            log_determinant[at] -= values.shape[1] * np.sum(np.log(weight), axis=1)
    return fit, log_determinant


@lru_cache(maxsize=64)
def correlation_spectrum(times: bytes, correlation_time: float) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (m,) and eigenvectors (m, m) of exp(−|t − t'| / time); runs share their times."""
    t = np.frombuffer(times)
    power, basis = np.linalg.eigh(np.exp(-np.abs(t[:, None] - t) / correlation_time))
    return np.maximum(power, 0), basis
