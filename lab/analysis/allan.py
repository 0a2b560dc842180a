"""Allan: the overlapping Allan deviation of an inertial sensor at rest, and the noise terms fitted to it.

White noise N, bias instability B and random walk K of the bias show as slopes −1/2, 0 and +1/2:

    σ²(τ) = N²/τ + (2 ln 2 / π) B² + K² τ/3

References
----------
IEEE Std 952-1997, *Specification Format Guide and Test Procedure for Single-Axis Interferometric Fiber Optic
Gyros*, Annex C: the variance C.2, white noise C.1.1, bias instability C.1.3, rate random walk C.1.4.
W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST Special Publication 1065 (2008): overlapping
estimate 5.2.4, degrees of freedom 5.4.1, table 5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.allan_covariance import covariance

FloatArray = NDArray[np.float64]

PER_OCTAVE = 3
"""Averaging times in each factor of two."""
FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Deviation of a bias instability B, in units of B: 0.664."""
MIN_SAMPLES = 16
"""Fewest samples of which a deviation is estimated."""

_FEWEST_DEGREES = 3.0
_REWEIGHTINGS = 20
_BEYOND = 2.0
"""σ of the square of a term beyond which it is taken as there."""


class AllanDeviation(NamedTuple):
    """The Allan deviation of one or several axes.

    Attributes
    ----------
    tau : (k,) array
        Averaging times [s].
    deviation : (k, axes) array
        Overlapping Allan deviation, in the unit of the rate.
    degrees : (k,) array
        Degrees of freedom of each estimate.
    samples : int
        Number of samples of the record; the shortest averaging time is one of them.
    """

    tau: FloatArray
    deviation: FloatArray
    degrees: FloatArray
    samples: int

    def interval(self, probability: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the ends (k, axes) of the interval that holds the true deviation (Riley 5.3.2).

        Parameters
        ----------
        probability
            Probability that it does, on each side of the estimate alike.
        """
        from scipy import special  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

        tail = (1 - probability) / 2
        low, high = (2 * special.gammaincinv(self.degrees / 2, p) for p in (1 - tail, tail))
        return (
            self.deviation * np.sqrt(self.degrees / low)[:, None],
            self.deviation * np.sqrt(self.degrees / high)[:, None],
        )


class NoiseTerms(NamedTuple):
    """Noise terms fitted to an Allan deviation, one value for each axis, with their 1σ uncertainties.

    Attributes
    ----------
    N, N_sigma : (axes,) arrays
        White noise [rad/s/√Hz] or [m/s²/√Hz].
    B, B_sigma : (axes,) arrays
        Bias instability [rad/s] or [m/s²]; its floor in the deviation is 0.664 B.
    K, K_sigma : (axes,) arrays
        Random walk of the bias [rad/s/√s] or [m/s²/√s].
    """

    N: FloatArray
    B: FloatArray
    K: FloatArray
    N_sigma: FloatArray
    B_sigma: FloatArray
    K_sigma: FloatArray


def deviation(record: FloatArray, dt: float, *, increments: bool = False) -> AllanDeviation:
    """Return the overlapping Allan deviation of a record at rest (Riley eq. 11).

    σ²(τ) = ⟨(θ_{k+2m} − 2 θ_{k+m} + θ_k)²⟩ / (2 τ²) with θ the integral of the rate and τ = m dt.

    Parameters
    ----------
    record : (n,) or (n, axes) array
        Rates or specific forces, equally spaced in time.
    dt
        Time from sample to sample [s].
    increments
        True if the record holds the integrals over each sample interval instead.

    Raises
    ------
    ValueError
        If the record is too short, or holds what is not a finite number.
    """
    table = np.asarray(record, dtype=np.float64)
    table = table[:, None] if table.ndim == 1 else table
    samples = table.shape[0]
    if samples < MIN_SAMPLES:
        raise ValueError(f"{samples} samples; accepted are at least {MIN_SAMPLES}")
    if not np.isfinite(table).all():
        raise ValueError("there is a sample that is not a finite number")
    if not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"{dt!r} s from sample to sample; accepted is a time above zero")
    # The mean has no part in the deviation, and without it the integral keeps its digits.
    theta = np.zeros((samples + 1, table.shape[1]))
    np.cumsum((table - table.mean(axis=0)) * (1.0 if increments else dt), axis=0, out=theta[1:])
    lengths = cluster_lengths(samples)
    variance = np.stack([_variance(theta, length, dt) for length in lengths])
    tau = dt * lengths.astype(np.float64)
    return AllanDeviation(tau, np.sqrt(variance), degrees_of_freedom(samples, lengths), samples)


def cluster_lengths(samples: int) -> NDArray[np.int64]:
    """Return the numbers of samples averaged over: `PER_OCTAVE` in each factor of two, up to a third."""
    octaves = math.log2(samples / 3)
    lengths = np.round(2 ** np.arange(0, octaves + 1e-9, 1 / PER_OCTAVE)).astype(np.int64)
    lengths = np.unique(lengths)
    return lengths[degrees_of_freedom(samples, lengths) >= _FEWEST_DEGREES]


def degrees_of_freedom(samples: int, lengths: NDArray[np.int64]) -> FloatArray:
    """Return the degrees of freedom of overlapping estimates (Riley, table 5).

    Those of white, flicker and random-walk noise differ; the fewest are returned.

    Parameters
    ----------
    samples
        Number of samples of the record.
    lengths : (k,) array
        Numbers of samples averaged over.
    """
    phases, m = samples + 1.0, lengths.astype(np.float64)
    white = (3 * (phases - 1) / (2 * m) - 2 * (phases - 2) / phases) * 4 * m**2 / (4 * m**2 + 5)
    flicker = np.where(
        m == 1,
        2 * (phases - 2) ** 2 / (2.3 * phases - 4.9),
        5 * phases**2 / (4 * m * (phases + 3 * m)),
    )
    walk = (phases - 2) * ((phases - 1) ** 2 - 3 * m * (phases - 1) + 4 * m**2) / (m * (phases - 3) ** 2)
    return np.minimum(np.minimum(white, flicker), walk)


def fit(allan: AllanDeviation) -> NoiseTerms:
    """Fit white noise N, bias instability B and random walk K to an Allan deviation.

    Least squares of the variance, weighted by the fitted variance and its degrees of freedom, with no term
    below zero. Estimates share their data and vary together; the uncertainties count with the covariance
    that the fitted terms give them (`allan_covariance`). A term whose square is below twice its own
    uncertainty is one the record does not show: its σ is the size that would be as uncertain as large.
    """
    tau = allan.tau
    terms = np.stack((1 / tau, np.full_like(tau, FLOOR**2), tau / 3), axis=1)
    # The terms per sample interval, and variances of rates whatever the interval.
    dt = float(tau[0])
    intervals = np.array((1 / dt, 1.0, dt))
    together = covariance(allan.samples, tuple(np.round(tau / dt).astype(int).tolist()))
    together = together * np.multiply.outer(intervals, intervals)[:, :, None, None]
    columns = [_fit_axis(terms, axis**2, allan.degrees, together) for axis in allan.deviation.T]
    squares, variances = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    values, sigmas = np.sqrt(squares), np.empty_like(squares)
    hidden = squares <= _BEYOND * np.sqrt(variances)
    sigmas[hidden] = variances[hidden] ** 0.25
    sigmas[~hidden] = np.sqrt(variances[~hidden]) / (2 * values[~hidden])
    return NoiseTerms(*values, *sigmas)


def _variance(theta: FloatArray, length: int, dt: float) -> FloatArray:
    # In place: of a long record the memory written to is what takes the time.
    second = theta[2 * length :] - theta[length:-length]
    second -= theta[length:-length]
    second += theta[: -2 * length]
    squares = np.einsum("ka,ka->a", second, second)
    return np.asarray(squares / (2 * len(second) * (length * dt) ** 2))


def _fit_axis(
    terms: FloatArray, variance: FloatArray, degrees: FloatArray, together: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the squares of N, B and K and the variances of these squares."""
    from scipy.optimize import nnls  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    if not variance.any():
        return np.zeros(3), np.zeros(3)
    model = np.maximum(variance, 1e-12 * variance.max())
    for _ in range(_REWEIGHTINGS):
        weights = np.sqrt(degrees / 2) / model
        scaled = terms * weights[:, None]
        norms = np.linalg.norm(scaled, axis=0)
        squares = nnls(scaled / norms, variance * weights)[0] / norms
        model = np.maximum(terms @ squares, 1e-12 * variance.max())
    gain = np.linalg.pinv(scaled / norms) * weights / norms[:, None]
    spread = np.einsum("a,b,abij->ij", squares, squares, together)
    return squares, np.maximum(np.einsum("ti,ij,tj->t", gain, spread, gain), 0.0)
