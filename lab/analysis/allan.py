"""Allan: the overlapping Allan deviation of an inertial sensor at rest, and the noise terms fitted to it.

Quantisation noise Q, white noise N, bias instability B, random walk K of the bias and a ramp R of it show as
slopes −1, −1/2, 0, +1/2 and +1:

    σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2 / π) B² + K² τ/3 + R² τ²/2

References
----------
IEEE Std 952-1997, *Specification Format Guide and Test Procedure for Single-Axis Interferometric Fiber Optic
Gyros*, Annex C: the terms C.1, the variance C.2.
W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST Special Publication 1065 (2008): overlapping
estimate 5.2.4, degrees of freedom 5.4.1, table 5.
E. B. Wilson and M. M. Hilferty, *The Distribution of Chi-Square*, Proc. Natl. Acad. Sci. 17 (1931): the cube
root of a mean square is close to normal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.allan_covariance import LETTERS, covariance
from lab.analysis.low_pass import LowPass
from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread

PER_OCTAVE = 3
"""Averaging times in each factor of two."""
FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Deviation of a bias instability B, in units of B: 0.664."""
MIN_SAMPLES = 16
"""Fewest samples for an Allan deviation."""

FITS = 1e-3
"""p value below which the five terms do not explain a deviation. Of 600 simulated axes with white noise, half
of them with a random walk, one was below it; of 90 with a Gauss-Markov bias of the same σ and a correlation
time of 100 samples besides, 26."""

_FEWEST_DEGREES = 3.0
"""Fewest degrees of freedom of an estimate that is used: with three, its σ is 40 % of the estimate."""
_REWEIGHTINGS = 20
"""Most iterations in which the weights are adapted to the fit."""
_GENERALISED = 6
"""Iterations in which the covariance of the estimates is adapted to the fit; nothing changes after the
fourth."""
_DISTINCT = 1e-2
"""Smallest used eigenvalue of the estimates' correlations, relative to the largest. The estimates of
neighbouring times are nearly the same, and smaller eigenvalues contain only rounding and approximation
errors."""
_BEYOND = np.array((3.0, 2.0, 2.0, 2.0, 3.0))[:, None]
"""Threshold on the square of each of `LETTERS`, in its σ, above which the term counts as present. Chance
exceeds 2 in one case of 44 and 3 in one of 740: most sensors have no quantisation noise and no ramp, and
should show none."""


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
        Number of samples of the record; the shortest averaging time is one sample.
    """

    tau: FloatArray
    deviation: FloatArray
    degrees: FloatArray
    samples: int

    def interval(self, probability: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the ends (k, axes) of the confidence interval of the true deviation (Riley 5.3.2).

        Parameters
        ----------
        probability
            Probability that the interval contains the true deviation, with equal tails.
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
        White noise [rad/s/√Hz] or [m/s²/√Hz], two-sided.
    B, B_sigma : (axes,) arrays
        Bias instability [rad/s] or [m/s²]; its floor in the deviation is 0.664 B.
    K, K_sigma : (axes,) arrays
        Random walk of the bias [rad/s/√s] or [m/s²/√s].
    Q, Q_sigma : (axes,) arrays
        Quantisation noise: white noise of the angle or velocity itself [rad] or [m/s].
    R, R_sigma : (axes,) arrays
        Ramp of the bias [rad/s²] or [m/s³], without its sign.
    chi_square, degrees, p_value : (axes,) arrays
        Goodness of fit: sum of the squared decorrelated residuals in their σ; its degrees of freedom; and the
        probability of such a large sum if there are only the five terms. Below `FITS`, there are other
        errors, and the terms describe the deviation only roughly.
    low_pass : LowPass or None
        The filter in the sensor that was found and undone, or whose averaging times were left out.
    """

    N: FloatArray
    B: FloatArray
    K: FloatArray
    Q: FloatArray
    R: FloatArray
    N_sigma: FloatArray
    B_sigma: FloatArray
    K_sigma: FloatArray
    Q_sigma: FloatArray
    R_sigma: FloatArray
    chi_square: FloatArray
    degrees: FloatArray
    p_value: FloatArray
    low_pass: LowPass | None = None

    def deviation(self, tau: FloatArray) -> FloatArray:
        """Return the Allan deviation (k, axes) of all terms together at averaging times (k,) [s]."""
        squares = np.stack([getattr(self, letter) for letter in LETTERS]) ** 2
        return np.asarray(np.sqrt(_slopes(np.asarray(tau, dtype=np.float64)) @ squares))


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
        If the record is too short, or contains a value that is not finite.
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
    # The mean has no effect on the deviation; without it, the integral keeps its digits.
    theta = np.zeros((samples + 1, table.shape[1]))
    np.cumsum((table - table.mean(axis=0)) * (1.0 if increments else dt), axis=0, out=theta[1:])
    lengths = cluster_lengths(samples)
    variance = np.stack([_variance(theta, length, dt) for length in lengths])
    tau = dt * lengths.astype(np.float64)
    return AllanDeviation(tau, np.sqrt(variance), degrees_of_freedom(samples, lengths), samples)


def cluster_lengths(samples: int) -> NDArray[np.int64]:
    """Return averaging lengths in samples: `PER_OCTAVE` per factor of two, up to a third of the record."""
    octaves = math.log2(samples / 3)
    lengths = np.round(2 ** np.arange(0, octaves + 1e-9, 1 / PER_OCTAVE)).astype(np.int64)
    lengths = np.unique(lengths)
    return lengths[degrees_of_freedom(samples, lengths) >= _FEWEST_DEGREES]


def degrees_of_freedom(samples: int, lengths: NDArray[np.int64]) -> FloatArray:
    """Return the degrees of freedom of overlapping estimates (Riley, table 5).

    Those of quantisation, white, flicker and random-walk noise differ; the fewest are returned.

    Parameters
    ----------
    samples
        Number of samples of the record.
    lengths : (k,) array
        Numbers of samples averaged over.
    """
    phases, m = samples + 1.0, lengths.astype(np.float64)
    quantisation = (phases + 1) * (phases - 2 * m) / (2 * (phases - m))
    white = (3 * (phases - 1) / (2 * m) - 2 * (phases - 2) / phases) * 4 * m**2 / (4 * m**2 + 5)
    flicker = np.where(
        m == 1,
        2 * (phases - 2) ** 2 / (2.3 * phases - 4.9),
        5 * phases**2 / (4 * m * (phases + 3 * m)),
    )
    walk = (phases - 2) * ((phases - 1) ** 2 - 3 * m * (phases - 1) + 4 * m**2) / (m * (phases - 3) ** 2)
    return np.asarray(np.minimum.reduce((quantisation, white, flicker, walk)))


@OneBlasThread()
def fit(allan: AllanDeviation, shortest: float = 0.0, longest: float = math.inf) -> NoiseTerms:
    """Fit quantisation noise Q, white noise N, bias instability B, random walk K and ramp R to a deviation.

    The fit is a generalised least-squares fit of the variance. The estimates share their data and are
    correlated; their covariance follows from the fitted terms (`allan_covariance`). If the five terms do not
    explain the deviation, only weights are used, with no negative terms, which keeps the fit close to the
    deviation. A term is not shown by the record if its square is below twice its σ, or three times for
    quantisation noise and ramp. Its σ is then the size whose square would equal its own uncertainty.

    Parameters
    ----------
    allan
        The deviation.
    shortest, longest
        Averaging times from which and up to which it is used [s]: shorter ones may belong to a filter in
        the sensor, longer ones to its temperature. As many as there are terms are used in any case.
    """
    first, last = np.searchsorted(allan.tau, (shortest * (1 - 1e-9), longest * (1 + 1e-9)))
    used = np.s_[min(first, max(len(allan.tau) - len(LETTERS), 0)) : max(last, len(LETTERS))]
    tau, deviations = allan.tau[used], allan.deviation[used]
    terms = _slopes(tau)
    # The terms are per sample interval; the variances are those of rates.
    dt = float(allan.tau[0])
    intervals = np.array((1 / dt**2, 1 / dt, 1.0, dt, dt**2))
    together = covariance(allan.samples, tuple(np.round(tau / dt).astype(int).tolist()))
    together = together * np.multiply.outer(intervals, intervals)[:, :, None, None]
    axes = [_fit_axis(terms, axis**2, allan.degrees[used], together) for axis in deviations.T]
    squares, variances, goodness = (np.stack(part, axis=1) for part in zip(*axes, strict=True))
    values, sigmas = np.sqrt(squares), np.empty_like(squares)
    hidden = squares <= _BEYOND * np.sqrt(variances)
    # √variance is the σ of the square; its root is the size whose square is as large.
    sigmas[hidden] = variances[hidden] ** 0.25
    # σ of a root: that of the square, divided by twice the root.
    sigmas[~hidden] = np.sqrt(variances[~hidden]) / (2 * values[~hidden])
    order = [LETTERS.index(letter) for letter in "NBKQR"]
    return NoiseTerms(*values[order], *sigmas[order], *goodness)


def _slopes(tau: FloatArray) -> FloatArray:
    """Return the Allan variance (k, 5) of each term of unit size, in the order of `LETTERS`."""
    return np.stack((3 / tau**2, 1 / tau, np.full_like(tau, FLOOR**2), tau / 3, tau**2 / 2), axis=1)


def _variance(theta: FloatArray, length: int, dt: float) -> FloatArray:
    # In place, because for a long record, writing to memory takes most of the time.
    second = theta[2 * length :] - theta[length:-length]
    second -= theta[length:-length]
    second += theta[: -2 * length]
    squares = np.einsum("ka,ka->a", second, second)
    return np.asarray(squares / (2 * len(second) * (length * dt) ** 2))


def _fit_axis(
    terms: FloatArray, variance: FloatArray, degrees: FloatArray, together: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the squares of the terms, their variances, and the goodness of the fit (3,)."""
    if not variance.any():
        return np.zeros(len(LETTERS)), np.zeros(len(LETTERS)), np.array((0.0, 0.0, 1.0))
    weighted = _weighted(terms, variance, degrees)
    if not weighted[:-1].any():  # a ramp alone is deterministic
        return weighted, np.zeros(len(LETTERS)), np.array((0.0, 0.0, 1.0))
    squares, uncertain, goodness = fit_by_generalised_least_squares(terms, variance, weighted, together)
    if goodness[2] >= FITS:
        return squares, uncertain, goodness
    weights = np.sqrt(degrees / 2) / np.maximum(terms @ weighted, negligible_variance(variance))
    scaled = terms * weights[:, None]
    norms = _norms(scaled)
    # The columns, from 3 / τ² to τ² / 2, differ by many orders of magnitude.
    gain = np.linalg.pinv(scaled / norms) * weights / norms[:, None]
    spread = np.einsum("a,b,abij->ij", weighted, weighted, together)
    uncertain = np.maximum(np.einsum("ti,ij,tj->t", gain, spread, gain), 0.0)
    return weighted, uncertain, goodness


def fit_by_generalised_least_squares(
    terms: FloatArray, variance: FloatArray, squares: FloatArray, together: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the terms from generalised least squares, and the goodness of the fit.

    Squares may be negative during the iteration, so that an absent term does not bias the others; the
    returned square is then zero.
    """
    for _ in range(_GENERALISED):
        freed = whiten_free_terms(squares, together)
        scaled = freed @ terms
        norms = _norms(scaled)
        inverse = np.linalg.pinv(scaled / norms)
        found = inverse @ (freed @ variance) / norms
        if not (found[:-1] > 0).any():
            break
        squares = np.maximum(found, 0.0)
    goodness = _goodness(terms, variance, found, squares, together)
    return squares, np.sum(inverse**2, axis=1) / norms**2, goodness


def _weighted(terms: FloatArray, variance: FloatArray, degrees: FloatArray) -> FloatArray:
    """Return the squares of the terms by least squares, weighted by the fit and its degrees of freedom."""
    model = np.maximum(variance, negligible_variance(variance))
    for _ in range(_REWEIGHTINGS):
        weights = np.sqrt(degrees / 2) / model
        squares = _positive(terms * weights[:, None], variance * weights)
        model = np.maximum(terms @ squares, negligible_variance(variance))
    return squares


def _positive(scaled: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the least-squares solution without negative components."""
    from scipy.optimize import nnls  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    norms = _norms(scaled)
    return np.asarray(nnls(scaled / norms, wanted, maxiter=1000)[0] / norms)


def _norms(columns: FloatArray) -> FloatArray:
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > 0, norms, 1.0)


def negligible_variance(variance: FloatArray) -> float:
    """Return a negligible variance."""
    return 1e-12 * float(variance.max())


def whiten_free_terms(squares: FloatArray, together: FloatArray) -> FloatArray:
    """Return the whitening matrix (r, k) of the estimates for the given terms."""
    spread = np.einsum("a,b,abij->ij", squares, squares, together)
    sigma = np.sqrt(np.diag(spread))
    sizes, vectors = np.linalg.eigh(spread / np.outer(sigma, sigma))
    # Variances at neighbouring averaging times are nearly the same number: only what differs is inverted.
    distinct = sizes > _DISTINCT * sizes[-1]
    return np.asarray((vectors[:, distinct] / np.sqrt(sizes[distinct])).T / sigma)


def _goodness(
    terms: FloatArray, variance: FloatArray, found: FloatArray, squares: FloatArray, together: FloatArray
) -> FloatArray:
    """Return χ² of a fit, its degrees of freedom and its p value (3,).

    The residuals use the fitted squares, the covariance uses those that are not negative. Mean squares with
    few degrees of freedom are skewed, which would look like a misfit; their cube roots are nearly normal
    (Wilson and Hilferty).
    """
    from scipy import special  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    model = terms @ squares
    relative = np.sqrt(np.einsum("a,b,abii->i", squares, squares, together)) / model
    residual = 3 * model * (np.cbrt(variance / model) - 1 + relative**2 / 9) + model - terms @ found
    freed = whiten_free_terms(squares, together)
    chi_square = float(np.sum((freed @ residual) ** 2))
    degrees = freed.shape[0] - len(LETTERS)
    p_value = float(special.gammaincc(degrees / 2, chi_square / 2)) if degrees > 0 else 1.0
    return np.array((chi_square, max(degrees, 0), p_value))
