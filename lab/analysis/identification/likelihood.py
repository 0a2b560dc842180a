"""Likelihood: the maximum-likelihood parameters of a filter, from its innovations, and their σ.

The innovations of the right filter are white, with the covariance S it states; their log-likelihood is −½ Σ
(ln det S + νᵀ S⁻¹ ν). It is maximised by Fisher scoring: the derivatives of ν and S are differences of whole
runs of the filter, and the expected information replaces the Hessian.

References
----------
N. K. Gupta, R. K. Mehra, *Computational aspects of maximum likelihood estimation and reduction in sensitivity
function calculations*, IEEE Trans. AC 19 (1974), for score and information; W. K. Newey, K. D. West, *A
simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix*,
Econometrica 55 (1987), for scores that are correlated in time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import MAX_LAG, autocorrelation, ljung_box
from lab.base.arrays import FloatArray
from lab.base.processors import processors
from lab.base.progress import Progress

ROUNDS = 12
"""Most steps of the search; from parameters wrong by a factor of ten, 8 to 12 are needed."""
SETTLED = 0.1
"""A step shorter than this fraction of each σ ends the search."""
NORMAL = 1.959964
"""Half-width of a 95 % interval in σ."""
BRACKETS = 4
"""Most steps to find an end of an interval."""
CLOSE = 0.03
"""Accuracy of an end of an interval, as a fraction of the loss in σ."""
FARTHEST = 2.0
"""Largest factor between successive steps to an end of an interval."""
FEWEST = 10
"""Number of innovations of a channel above which their correlation is tested: ten have one lag."""
DAMPING = 1e-3
"""Least damping that is tried after a step that made it worse: a thousandth of the information."""
STIFFER = 10.0
"""Factor on the damping after a step, up or down (D. W. Marquardt, J. SIAM 11, 1963)."""
AT_ONCE = 4
"""Most runs of the filter at once: each holds the arrays of a run. A plain choice."""
VALUES_PER_LAG = 10
"""Values for each lag of a correlation: with a tenth as many lags χ² is wrong by chance three times as often
as said, with a third of them ten times."""
JUMP = 0.01
"""Change of the innovations over a step of a difference, squared in their σ, above which it may be a jump of
the filter: a step is a small part of the σ of a parameter."""
UNLIKE = 4.0
"""Ratio of both sides above which it is one: smooth changes are alike within some percent, and a jump is a
thousand times as large."""
FALSE_ALARM = 0.001
"""Probability of χ² beyond which innovations are not white, of all channels together. Of 175 white fixes,
Q is beyond it in 1 % of the cases: its own tail is heavier."""
STIFFEST = 1e8
"""Damping at which the search ends without a step."""


class InnovationSeries(NamedTuple):
    """The innovations of a filter at the fixes.

    Attributes
    ----------
    innovation : (m, 6) array
        Innovations; NaN for unmeasured components, and for fixes without effect.
    covariance : (m, 6, 6) array
        S of the innovations.
    """

    innovation: FloatArray
    covariance: FloatArray


Run = Callable[[FloatArray], InnovationSeries]
"""Runs the filter with the parameters (p,); the fixes are always the same, in the same order."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the filter, in the coordinate of the search.

    Attributes
    ----------
    name : str
        Name of the parameter.
    start : float
        Where the search begins.
    low, high : float
        Its bounds.
    prior : float
        σ of the prior about the start value.
    step : float
        Step of the finite differences.
    both : bool
        Whether the differences are central. The noise of the gyros on the lever arm makes the likelihood
        uneven over the latency: there, the step is long and central.
    longest : float
        Longest step of the search.
    """

    name: str
    start: float
    low: float
    high: float
    prior: float
    step: float
    longest: float
    both: bool = False


@dataclass(frozen=True)
class Estimate:
    """The most likely parameters.

    Attributes
    ----------
    value, sigma : (p,) arrays
        Estimates and their standard deviations; 0 for a parameter that was held.
    covariance : (p, p) array
        Covariance from the information only; σ may be larger.
    log_likelihood : float
        Log-likelihood at the estimate.
    seen : InnovationSeries
        Innovations at the estimate.
    white : bool
        Whether the innovations are white.
    rounds : int
        Steps of the search.
    """

    value: FloatArray
    sigma: FloatArray
    covariance: FloatArray
    log_likelihood: float
    seen: InnovationSeries
    white: bool
    rounds: int


class _Slopes(NamedTuple):
    """Derivatives of the log-likelihood at one point."""

    scores: FloatArray  # (m, p), of each fix
    information: FloatArray  # (p, p)


def log_likelihoods(seen: InnovationSeries) -> FloatArray:
    """Return the log-likelihood of each fix (m,), without the constant; 0 for a fix without measurements."""
    nu, S = _fill_unmeasured(seen)
    square = np.einsum("mi,mi->m", nu, np.linalg.solve(S, nu[..., None])[..., 0])
    return np.asarray(-0.5 * (np.linalg.slogdet(S)[1] + square))


def squares(seen: InnovationSeries) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return NIS (m,) and its degrees of freedom (m,), from the measured components of each fix."""
    nu, S = _fill_unmeasured(seen)
    degrees = np.isfinite(seen.innovation).sum(axis=1)
    return np.einsum("mi,mi->m", nu, np.linalg.solve(S, nu[..., None])[..., 0]), degrees


def _fill_unmeasured(seen: InnovationSeries) -> tuple[FloatArray, FloatArray]:
    """Return innovations and covariances, with zero and unit variance for unmeasured components."""
    known = np.isfinite(seen.innovation)
    S = np.where(known[:, :, None] & known[:, None, :], seen.covariance, 0.0)
    at = np.arange(known.shape[1])
    S[:, at, at] = np.where(known, S[:, at, at], 1.0)
    return np.where(known, seen.innovation, 0.0), S


def maximise(
    run: Run,
    parameters: Sequence[Parameter],
    begin: FloatArray,
    held: NDArray[np.bool_],
    progress: Progress = lambda _stage, _fraction: None,
    most: int = ROUNDS,
    enough: float = math.inf,
    certain: bool = True,
) -> Estimate:
    """Return the most likely parameters.

    Parameters
    ----------
    run
        Runs the filter; raises `ValueError` if it cannot.
    parameters
        The parameters of the search.
    begin : (p,) array
        Where the search begins.
    held : (p,) array
        Mask of the parameters that keep their start value.
    progress
        Called with a phrase and the fraction done; it may end the search by raising.
    most
        Most steps of the search.
    enough
        Log-likelihood at which the search ends.
    certain
        Whether σ and covariance are those at the estimate; otherwise they are those of the last step but one,
        and the search saves a run of the filter for each parameter.

    Raises
    ------
    ValueError
        If the filter cannot run at the start values.
    """
    free = np.flatnonzero(~held)
    low, high, longest, prior, start = (
        np.array([getattr(parameter, name) for parameter in parameters])[free]
        for name in ("low", "high", "longest", "prior", "start")
    )
    place = np.array(begin, dtype=np.float64)
    here = run(place)
    value = float(log_likelihoods(here).sum()) - _cost(place[free], start, prior)
    if not np.isfinite(value):
        raise ValueError("the innovations are not finite where the search begins")
    damping, rounds = DAMPING, 0
    with ThreadPoolExecutor(max_workers=min(AT_ONCE, processors())) as pool:
        slopes = _slopes(run, parameters, free, place, here, pool)
        while free.size and rounds < most:
            progress("maximising the likelihood", rounds / most)
            rounds += 1
            information = slopes.information + np.diag(1 / prior**2)
            slope = slopes.scores.sum(axis=0) - (place[free] - start) / prior**2
            moved = False
            while damping < STIFFEST:
                # Marquardt's damping: along each parameter, in proportion to its own information.
                step = np.linalg.solve(information + damping * np.diag(np.diag(information)), slope)
                # Shortened as a whole: the direction stays.
                step = step * min(1.0, float(np.min(longest / np.maximum(np.abs(step), 1e-300))))
                trial = place.copy()
                trial[free] = np.clip(place[free] + step, low, high)
                there, better = _navigate_at_point(run, trial, trial[free], start, prior)
                if there is not None and better > value:
                    moved = True
                    break
                damping = max(STIFFER * damping, DAMPING)
            if not moved:
                break
            assert there is not None
            sigma = np.sqrt(np.diag(np.linalg.inv(information)))
            small = bool(np.all(np.abs(trial[free] - place[free]) < SETTLED * sigma))
            place, here, value, damping = trial, there, better, damping / STIFFER
            if small or value > enough or (rounds == most and not certain):
                break  # the slopes there are those here, or are not asked for
            slopes = _slopes(run, parameters, free, place, here, pool)
    white = is_white(here)
    sigma = np.zeros(len(parameters))
    sigma[free] = _sigma(slopes, prior)
    covariance = np.zeros((sigma.size, sigma.size))
    covariance[np.ix_(free, free)] = np.linalg.inv(slopes.information + np.diag(1 / prior**2))
    return Estimate(place, sigma, covariance, float(log_likelihoods(here).sum()), here, white, rounds)


def interval(
    run: Run, parameters: Sequence[Parameter], estimate: Estimate, index: int
) -> tuple[float, float]:
    """Return the 95 % interval of a parameter: where the log-likelihood is 1.92 lower than at the estimate.

    The other parameters move with it according to the information. The interval is longer on the side on
    which the log-likelihood falls more slowly. For correlated innovations, it is longer by the ratio of their
    σ to that of the information. If the filter cannot run there, it is estimate ± 1.96 σ.

    Parameters
    ----------
    run, parameters
        As for `maximise`.
    estimate
        The most likely parameters.
    index
        Index of the parameter, which must not be a held one.
    """
    start, prior = (np.array([getattr(one, name) for one in parameters]) for name in ("start", "prior"))
    # Along it, the other parameters are the likeliest for each value of this one.
    direction = estimate.covariance[:, index] / estimate.covariance[index, index]
    sigma = float(estimate.sigma[index])
    # √(2 · 1.92) = 1.96, longer where the innovations are correlated.
    wanted = NORMAL * sigma / math.sqrt(estimate.covariance[index, index])
    moved = direction != 0
    best = estimate.log_likelihood - _cost(estimate.value[moved], start[moved], prior[moved])

    def loss_at_distance(distance: float) -> float:
        """Return the loss at a distance, in the σ of a parabola."""
        place = estimate.value + distance * direction
        _, there = _navigate_at_point(run, place, place[moved], start[moved], prior[moved])
        return math.sqrt(max(2 * (best - there), 0.0))

    ends = []
    for side in (-1.0, 1.0):
        distance = side * NORMAL * sigma
        for _ in range(BRACKETS):
            lost = loss_at_distance(distance)
            if not math.isfinite(lost):
                distance = side * NORMAL * sigma
                break
            if abs(lost - wanted) < CLOSE * wanted:
                break
            # The root of the loss grows about as the distance: one division nearly hits it.
            distance *= min(max(wanted / max(lost, 1e-9), 1 / FARTHEST), FARTHEST)
        ends.append(float(estimate.value[index] + distance))
    return ends[0], ends[1]


def _cost(values: FloatArray, start: FloatArray, prior: FloatArray) -> float:
    return 0.5 * float(np.sum(((values - start) / prior) ** 2))


def _navigate_at_point(
    run: Run, trial: FloatArray, values: FloatArray, start: FloatArray, prior: FloatArray
) -> tuple[InnovationSeries | None, float]:
    """Return the innovations and the log-likelihood at a point; None if the filter cannot run there."""
    try:
        there = run(trial)
        likely = float(log_likelihoods(there).sum())
    except (ValueError, np.linalg.LinAlgError):
        return None, -np.inf
    return (there, likely - _cost(values, start, prior)) if np.isfinite(likely) else (None, -np.inf)


def _slopes(
    run: Run,
    parameters: Sequence[Parameter],
    free: NDArray[np.intp],
    place: FloatArray,
    here: InnovationSeries,
    pool: ThreadPoolExecutor,
) -> _Slopes:
    """Return scores and expected information from differences of runs."""
    nu, S = _fill_unmeasured(here)
    inverse = np.linalg.inv(S)

    def navigate_beside(index: int, side: int = 1) -> tuple[FloatArray, FloatArray]:
        step = side * parameters[index].step
        moved = place.copy()
        moved[index] += step
        other_nu, other_S = _fill_unmeasured(run(moved))
        return (other_nu - nu) / step, (other_S - S) / step

    def size(slope: tuple[FloatArray, FloatArray]) -> float:
        return float(np.einsum("mi,mij,mj->", slope[0], inverse, slope[0]))

    def slope(index: int) -> tuple[FloatArray, FloatArray]:
        one = navigate_beside(index)
        if parameters[index].both:
            other = navigate_beside(index, -1)
            return (one[0] + other[0]) / 2, (one[1] + other[1]) / 2
        if parameters[index].step ** 2 * size(one) < JUMP:
            return one
        # Where the filter decides something otherwise, such as what counts as a turn, one side has no slope.
        other = navigate_beside(index, -1)
        return other if size(other) < size(one) / UNLIKE else one

    found = list(pool.map(slope, map(int, free)))
    dnu = np.array([one for one, _ in found]).reshape(free.size, *nu.shape)
    dS = np.array([one for _, one in found]).reshape(free.size, *S.shape)
    white = np.einsum("mij,mj->mi", inverse, nu)
    relative = inverse @ dS  # S⁻¹ ∂S
    trace = np.trace(relative, axis1=-2, axis2=-1)
    quadratic = np.einsum("mi,pmij,mj->pm", white, dS, white, optimize=True)
    # −∂νᵀ S⁻¹ ν + ½ (νᵀ S⁻¹ ∂S S⁻¹ ν − tr S⁻¹ ∂S) of each fix.
    scores = -np.einsum("pmi,mi->pm", dnu, white) + 0.5 * (quadratic - trace)
    # ∂νᵀ S⁻¹ ∂ν + ½ tr(S⁻¹ ∂S S⁻¹ ∂S), summed over the fixes.
    information = np.einsum("pmi,mij,qmj->pq", dnu, inverse, dnu, optimize=True)
    information = information + 0.5 * np.einsum("pmij,qmji->pq", relative, relative, optimize=True)
    return _Slopes(scores.T, information)


def _sigma(slopes: _Slopes, prior: FloatArray) -> FloatArray:
    """Return the σ of the estimates from the information, or from the spread of the scores if larger."""
    inverse = np.linalg.inv(slopes.information + np.diag(1 / prior**2))
    variance = np.diag(inverse)
    if variance.size:
        spread = inverse @ long_run_covariance(slopes.scores) @ inverse
        variance = np.maximum(variance, np.diag(spread))
    return np.sqrt(variance)


def long_run_covariance(scores: FloatArray) -> FloatArray:
    """Return the covariance (p, p) of the sum of scores (m, p) that are correlated in time (Newey, West)."""
    m = scores.shape[0]
    centred = scores - scores.mean(axis=0)
    total = centred.T @ centred
    lags = max(1, m // VALUES_PER_LAG)
    for lag in range(1, lags + 1):
        product = centred[lag:].T @ centred[:-lag]
        total = total + (1 - lag / (lags + 1)) * (product + product.T)
    return np.asarray(total)


def is_white(seen: InnovationSeries) -> bool:
    """Return whether no channel of the innovations is autocorrelated over the first lags."""
    normalised = seen.innovation / np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    for channel in normalised.T:
        known = channel[np.isfinite(channel)]
        if known.size > FEWEST:
            found = autocorrelation(known[:, None], min(MAX_LAG, known.size // VALUES_PER_LAG))
            _, p = ljung_box(found, known.size)
            if float(np.min(p)) < FALSE_ALARM / normalised.shape[1]:
                return False
    return True
