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

from lab.analysis.verdicts.hypothesis_bank import TOGETHER, Found, Offered, Place, Terms, follow
from lab.analysis.verdicts.imu_causes import Steps
from lab.analysis.verdicts.pattern import AXES
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels.lane_views import LANES

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
    r : (6,) tuple
        Factors on R of each channel.
    q : (4,) tuple
        Factors on gyro noise, accelerometer noise, and the drives of their biases.
    p0 : (6,) tuple
        Factors on the whole P0, and on each of `STARTS`.
    correlated : (2,) tuple
        Variance of correlated position errors relative to R, and their correlation time [s].
    """

    name: str
    factor: float
    r: tuple[float, ...] = (1.0,) * 6
    q: tuple[float, ...] = (1.0,) * 4
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


R_CHANNELS = {
    "R position": (0, 1, 2),
    "R velocity": (3, 4, 5),
    "R": (0, 1, 2, 3, 4, 5),
    **{f"R position {axis}": (at,) for at, axis in enumerate(AXES)},
    **{f"R velocity {axis}": (at,) for at, axis in enumerate(AXES, start=3)},
}
"""The channels of a fix whose R may be wrong together."""
_DECADES = tuple(10.0**power for power in range(-2, 7))
"""Tried factors on a start and on the drives of biases: their σ is about a decade."""
_HALF_DECADES = tuple(10.0 ** (half / 2) for half in range(-4, 9) if half)
"""Tried factors on R and Q: over half a decade, their likelihood is smooth."""


def _list_hypotheses() -> tuple[Hypothesis, ...]:
    """Return the hypotheses: of each quantity some factors, between which `likely_factor` interpolates."""
    found = [Hypothesis("none", 1.0)]
    for name, channels in R_CHANNELS.items():
        factors = _HALF_DECADES if len(channels) > 1 else _HALF_DECADES[2:8]
        found += [Hypothesis(name, factor, r=_factors(6, channels, factor)) for factor in factors]
    found += [Hypothesis("Q", factor, q=(factor,) * 4) for factor in _HALF_DECADES[2:8]]
    for row, name in enumerate(("Q gyro", "Q accelerometer")):
        found += [Hypothesis(name, factor, q=_factors(4, (row,), factor)) for factor in _HALF_DECADES[2:]]
    for row, name in enumerate(("Q gyro bias", "Q accelerometer bias"), start=2):
        for factor in _DECADES[3:]:
            found.append(Hypothesis(name, factor, q=_factors(4, (row,), factor)))
    for factor in (0.1, *_DECADES[3:7]):
        found.append(Hypothesis("P0", factor, p0=_factors(6, (0,), factor)))
    for block, name in enumerate(STARTS, start=1):
        for factor in _DECADES[3:7]:
            found.append(Hypothesis(f"P0 {name}", factor, p0=_factors(6, (block,), factor)))
    for time in (10.0, 60.0):
        for factor in (1.0, 5.0, 25.0):
            found.append(Hypothesis("GPS correlation", factor, correlated=(factor, time)))
    # A receiver that filters its fixes: hardly any of their errors is white.
    for white in (0.01, 0.1):
        for velocity in (white, 1.0):
            r = (*(white,) * 3, *(velocity,) * 3)
            found.append(Hypothesis("GPS correlation", 1.0, r=r, correlated=(1.0, 60.0)))
    return tuple(found)


def _factors(count: int, which: Sequence[int], factor: float) -> tuple[float, ...]:
    """Return `count` factors: `factor` for some, and 1 for the others."""
    return tuple(factor if at in which else 1.0 for at in range(count))


HYPOTHESES = _list_hypotheses()
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
    white = np.array([not hypothesis.correlated[0] for hypothesis in tried])
    position = float(np.mean(np.diagonal(R, axis1=1, axis2=2)[:, :3]))
    banks = [
        _Bank([tried[int(at)] for at in np.flatnonzero(own)], P0, position)
        for own in (white, ~white)
        if own.any()
    ]
    found = Found(np.zeros((m, 6)), np.zeros((m, 6, 6)), np.zeros((m, n, 6)))
    left = skipped.copy()
    first = 0
    for part in steps:
        here = slice(first, first + part.transition.shape[0])
        offered = Offered(
            of_kernel(part.transition),
            of_kernel(part.noise),
            of_kernel(H[here]),
            of_kernel(R[here]),
            of_kernel(innovation[here]),
            of_kernel(correction[here]),
            left[here],
        )
        for bank in banks:
            bank.follow(
                offered, np.diff(times[first : here.stop + 1]), limit, Found(*(one[here] for one in found))
            )
        first = here.stop
    np.linalg.cholesky(found.covariance)  # raises
    total = np.empty(len(tried))
    total[white] = banks[0].total
    total[~white] = banks[-1].total if (~white).any() else 0.0
    if not np.isfinite(total[0]):
        raise np.linalg.LinAlgError("the likelihood of the innovations is not finite")
    return Outcome(total - total[0], *found, left)


class _Bank:
    """Filters under hypotheses, and the differences of their errors from those of the filter that ran.

    Eight lie side by side in a buffer, as the runs of an ensemble do (`lab.navigation.kernels.lane_views`).

    Parameters
    ----------
    tried
        The hypotheses: all with correlated position errors, or all without.
    P0 : (n, n) array
        Initial covariance.
    position
        Mean variance of a position in R [m²].
    """

    def __init__(self, tried: Sequence[Hypothesis], P0: FloatArray, position: float) -> None:
        self._count, n = len(tried), P0.shape[0]
        if n % TOGETHER:
            raise ValueError(f"a filter with {n} states; hypotheses are tried for states that come in threes")
        # Whole groups of eight: the last one is repeated, and its copies are never read.
        tried = [*tried, *[tried[-1]] * (-len(tried) % LANES)]
        variance = position * np.array([one.correlated[0] for one in tried])
        self._time = np.array([one.correlated[1] for one in tried])
        N = n + 3 if variance.any() else n
        P = _start_covariances(P0, N, tried)
        slow = np.arange(n, N)
        P[:, slow, slow] = variance[:, None]
        self._place = Place.of(N)
        self._buffer = aligned_zeros(len(tried) * self._place.END)
        self._numbers = self._buffer.reshape(-1, self._place.END, LANES)
        for first, values in (
            (0, P.reshape(len(tried), -1)),
            (self._place.Q, np.array([(*one.q, 1.0) for one in tried])),  # what is unknown in gaps stays so
            (self._place.RATIO, np.sqrt(np.array([one.r for one in tried]))),
            (self._place.VARIANCE, variance[:, None]),
        ):
            self._write_values(self._numbers, first, values)

    @staticmethod
    def _write_values(numbers: FloatArray, first: int, values: FloatArray) -> None:
        """Write values (h, k) of the hypotheses into numbers (groups, k, LANES)."""
        wide = values.shape[1]
        numbers[:, first : first + wide] = values.reshape(-1, LANES, wide).transpose(0, 2, 1)

    @property
    def total(self) -> FloatArray:
        """Log-likelihood under each."""
        return self._numbers[:, self._place.TOTAL].reshape(-1)[: self._count]

    def follow(self, offered: Offered, dt: FloatArray, limit: float, found: Found) -> None:
        """Use some fixes (m,), each `dt` after the one before [s]; write what the first hypothesis says."""
        groups = self._numbers.shape[0]
        decays = aligned_zeros(dt.size * self._time.size)
        decays[:] = np.exp(-dt[:, None] / self._time).reshape(-1)
        follow(
            self._buffer,
            decays,
            groups,
            self._place,
            offered,
            Terms.of(offered.transition, np.arange(offered.transition.shape[1])),
            Terms.of(offered.H, np.zeros(offered.H.shape[1], dtype=np.intp)),
            _find_driven_parts(offered.noise),
            limit,
            found,
        )


def _find_driven_parts(noise: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of `hypothesis_bank.follow` of parts of the noise (m, PARTS, n, n)."""
    parts, n = noise.shape[1:3]
    return np.asarray(noise.any(axis=0).reshape(parts, n // TOGETHER, TOGETHER, n).any(axis=2))


def _start_covariances(P0: FloatArray, N: int, tried: Sequence[Hypothesis]) -> FloatArray:
    """Return P0 under each hypothesis (h, N, N)."""
    n = P0.shape[0]
    P = np.zeros((len(tried), N, N))
    roots = np.sqrt(np.array([one.p0 for one in tried]))
    scale = np.repeat(roots[:, :1], n, axis=1)
    for block, own in zip(STARTS.values(), roots.T[1:], strict=True):
        scale[:, block] *= own[:, None]
    P[:, :n, :n] = P0 * scale[:, :, None] * scale[:, None]
    return P
