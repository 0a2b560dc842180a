"""Hypotheses: the likelihood of the innovations if one assumption of the filter is wrong, for each in turn.

The result of a filter with another Q, R or P0 on the same flight follows, fix by fix, from the innovations
and gains of the filter that ran, because the errors of the two differ only by their gains. So the likelihood
of the innovations under each hypothesis is known without another run, for sensor logs too.

References
----------
R. K. Mehra, *On the Identification of Variances and Adaptive Kalman Filtering*, IEEE Trans. Automatic Control
15 (1970); F. C. Schweppe, *Evaluation of Likelihood Functions for Gaussian Signals*, IEEE Trans. Information
Theory 11 (1965).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.imu_causes import Steps
from lab.navigation.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL

FloatArray = NDArray[np.float64]


STARTS = {
    "position": POS,
    "velocity": VEL,
    "attitude": ATT,
    "gyro bias": GYRO_BIAS,
    "accelerometer bias": ACCEL_BIAS,
}
"""Groups of states that may have a wrong P0 alone."""


class Hypothesis(NamedTuple):
    """A hypothesis: factors on the assumptions of the filter.

    Attributes
    ----------
    name : str
        The wrong quantity.
    factor : float
        Ratio of its variance to the assumed one.
    r : (2,) tuple
        Factors on R of position and velocity.
    q : (4,) tuple
        Factors on gyro noise, accelerometer noise, and the drives of their biases.
    p0 : (6,) tuple
        Factors on the whole P0, and on each of `STARTS`.
    correlated : (2,) tuple
        Variance of correlated position errors relative to R, and their correlation time [s].
    """

    name: str
    factor: float
    r: tuple[float, float] = (1.0, 1.0)
    q: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    p0: tuple[float, ...] = (1.0,) * 6
    correlated: tuple[float, float] = (0.0, 60.0)


class Outcome(NamedTuple):
    """The innovations under the hypotheses.

    Attributes
    ----------
    likelihoods : (h,) array
        Log-likelihood under each, minus that under the first; -inf where rounding has taken the covariance
        of an innovation its positive definiteness, so that nothing is known.
    innovation, covariance : (m, 6), (m, 6, 6) arrays
        Innovations under the first, and their covariance.
    gains : (m, n, 6) array
        Gains of the first; zero for skipped fixes.
    skipped : (m,) array
        Mask of the skipped fixes.
    """

    likelihoods: FloatArray
    innovation: FloatArray
    covariance: FloatArray
    gains: FloatArray
    skipped: NDArray[np.bool_]


def _all() -> tuple[Hypothesis, ...]:
    found = [Hypothesis("none", 1.0)]
    smaller, larger = (0.01, 0.03, 0.1, 0.3), (3.0, 10.0, 100.0)
    found += [Hypothesis("R position", factor, r=(factor, 1.0)) for factor in (*smaller, *larger)]
    found += [Hypothesis("R velocity", factor, r=(1.0, factor)) for factor in (*smaller[2:], *larger)]
    found += [Hypothesis("R", factor, r=(factor, factor)) for factor in (*smaller, *larger[:2])]
    for factor in (0.1, 10.0):
        found.append(Hypothesis("Q", factor, q=(factor,) * 4))
    for factor in (0.1, 10.0, 100.0, 1000.0):
        found.append(Hypothesis("Q gyro", factor, q=(factor, 1.0, 1.0, 1.0)))
        found.append(Hypothesis("Q accelerometer", factor, q=(1.0, factor, 1.0, 1.0)))
    for factor in (100.0, 1e4, 1e6):
        found.append(Hypothesis("Q gyro bias", factor, q=(1.0, 1.0, factor, 1.0)))
        found.append(Hypothesis("Q accelerometer bias", factor, q=(1.0, 1.0, 1.0, factor)))
    found += [Hypothesis("P0", factor, p0=(factor, *(1.0,) * 5)) for factor in (0.1, 10.0, 100.0)]
    for at, name in enumerate(STARTS, start=1):
        for factor in (100.0, 1e4):
            p0 = tuple(factor if block == at else 1.0 for block in range(6))
            found.append(Hypothesis(f"P0 {name}", factor, p0=p0))
    for time in (10.0, 60.0):
        for factor in (1.0, 5.0, 25.0):
            found.append(Hypothesis("GPS correlation", factor, correlated=(factor, time)))
    # A receiver that filters its fixes: hardly any of their errors is white.
    for white in (0.01, 0.1):
        for velocity in (white, 1.0):
            found.append(Hypothesis("GPS correlation", 1.0, r=(white, velocity), correlated=(1.0, 60.0)))
    return tuple(found)


HYPOTHESES = _all()
"""The hypotheses; under the first, nothing is wrong."""


def likelihoods(
    innovation: FloatArray,
    correction: FloatArray,
    steps: Iterable[Steps],
    H: FloatArray,
    R: FloatArray,
    P0: FloatArray,
    times: FloatArray,
    skipped: NDArray[np.bool_],
    tried: Sequence[Hypothesis] = HYPOTHESES,
    limit: float = np.inf,
) -> Outcome:
    """Return the likelihood of the innovations under each hypothesis.

    Parameters
    ----------
    innovation : (m, 6) array
        Innovations of the offered fixes; zero for unmeasured components.
    correction : (m, n) array
        Correction of the error state at each fix, K ν; zero for a rejected fix.
    steps
        Transition of the error between the fixes, of some fixes after the others.
    H, R : (m, 6, n) and (m, 6, 6) arrays
        H and R of the fixes.
    P0 : (n, n) array
        Initial covariance.
    times : (m + 1,) array
        Times of the start and of the fixes [s].
    skipped : (m,) array
        Mask of the fixes that no hypothesis uses, such as outliers.
    limit
        Largest normalised square of position and of velocity innovations of used fixes, under the first
        hypothesis.
    tried
        The hypotheses; the innovations are returned for the first one.

    Raises
    ------
    LinAlgError
        If a covariance of the innovations under the first hypothesis is not positive definite: P0 and Q are
        then so many times larger than R that float64 does not hold their difference.
    """
    m, n = correction.shape
    N = n + 3
    q = np.array([h.q for h in tried])
    r = np.sqrt(np.array([h.r for h in tried]).repeat(3, axis=1))
    position = np.mean(np.diagonal(R, axis1=1, axis2=2)[:, :3])
    variance = position * np.array([h.correlated[0] for h in tried])
    correlation_time = np.array([h.correlated[1] for h in tried])
    P = _starts(P0, N, tried)
    P[:, n:, n:] = variance[:, None, None] * np.eye(3)
    apart = np.zeros((len(tried), N))
    total = np.zeros(len(tried))
    own, covariance, gains = np.zeros((m, 6)), np.zeros((m, 6, 6)), np.zeros((m, n, 6))
    left = np.zeros(m, dtype=np.bool_)
    Phi = np.zeros((len(tried), N, N))
    noise = np.zeros((len(tried), N, N))
    Haug = np.zeros((6, N))
    diagonal = np.arange(n, N)
    onwards = ((Phi, added) for part in steps for Phi, added in zip(part.transition, part.noise, strict=True))
    for k, (transition, added) in zip(range(m), onwards, strict=True):
        decay = np.exp(-(times[k + 1] - times[k]) / correlation_time)
        Phi[:, :n, :n] = transition
        Phi[:, diagonal, diagonal] = decay[:, None]
        noise[:, :n, :n] = np.tensordot(q, added, axes=1)
        noise[:, diagonal, diagonal] = (variance * (1 - decay**2))[:, None]
        P = Phi @ P @ Phi.transpose(0, 2, 1) + noise
        apart = np.einsum("hij,hj->hi", Phi, apart)
        Haug[:, :n], Haug[:3, n:] = H[k], -np.eye(3)
        seen = P @ Haug.T
        S = Haug @ seen + r[:, :, None] * R[k] * r[:, None, :]
        nu = innovation[k] - apart @ Haug.T
        own[k], covariance[k] = nu[0], S[0]
        apart[:, :n] -= correction[k]
        if skipped[k] or (limit < np.inf and _beyond(nu[0], S[0], limit)):
            left[k] = True
            continue
        inverse = np.linalg.inv(S)
        squares, (sign, size) = np.einsum("hi,hij,hj->h", nu, inverse, nu), np.linalg.slogdet(S)
        total = np.where((sign > 0) & (squares >= 0), total - 0.5 * (squares + size), -np.inf)
        gain = seen @ inverse
        gains[k] = gain[0, :n]
        P = P - gain @ seen.transpose(0, 2, 1)
        P = 0.5 * (P + P.transpose(0, 2, 1))
        apart += np.einsum("hij,hj->hi", gain, nu)
    np.linalg.cholesky(covariance)  # raises
    if not np.isfinite(total[0]):
        raise np.linalg.LinAlgError("the likelihood of the innovations is not finite")
    return Outcome(total - total[0], own, covariance, gains, left)


def _beyond(nu: FloatArray, S: FloatArray, limit: float) -> bool:
    """Return whether a position or a velocity innovation exceeds the limit."""
    return any(
        float(nu[own] @ np.linalg.solve(S[own, own], nu[own])) > limit for own in (slice(0, 3), slice(3, 6))
    )


def _starts(P0: FloatArray, N: int, tried: Sequence[Hypothesis]) -> FloatArray:
    """Return P0 under each hypothesis (h, N, N)."""
    n = P0.shape[0]
    P = np.zeros((len(tried), N, N))
    for at, hypothesis in enumerate(tried):
        scale = np.full(n, np.sqrt(hypothesis.p0[0]))
        for block, factor in zip(STARTS.values(), hypothesis.p0[1:], strict=True):
            scale[block] *= np.sqrt(factor)
        P[at, :n, :n] = P0 * scale[:, None] * scale
    return P
