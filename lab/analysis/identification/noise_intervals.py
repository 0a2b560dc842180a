"""Noise intervals: the 95 % interval of each noise, whatever the others are, by the profile likelihood.

Far below the resolution of the fixes, a noise has no effect: its likelihood is flat there and steep above,
and σ at the maximum says little. So the ends are where the likelihood, with the best values of the other
noises, has fallen by what χ² of one degree of freedom allows. Each noise has an interval, whether or not the
flight shows the noise: those that luck made large would contain the truth less often.

References
----------
S. S. Wilks, *The large-sample distribution of the likelihood ratio for testing composite hypotheses*, Annals
of Mathematical Statistics 9 (1938); D. J. Venzon, S. H. Moolgavkar, *A method for computing
profile-likelihood-based confidence intervals*, Applied Statistics 37 (1988).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy import special

from lab.analysis.identification.assumptions import FIX, LATENCY, NOISE, NOTHING, PARAMETERS, Known
from lab.analysis.identification.likelihood import NORMAL, Estimate, Parameter, log_likelihoods, maximise
from lab.analysis.identification.observable import AHEAD, UNLIKE_ZERO, Search
from lab.base.arrays import Flags, FloatArray

OUTSIDE = 0.05
"""Probability that an interval does not contain the truth."""
TRIALS = 9
"""Most trials for an end."""
CLOSE = 0.2
"""Accuracy of the loss at an end, before the last step to it, as a part of what is wanted."""
GROWTH = 1.5
"""Power of a noise with which the loss in σ grows there, if no trial below it says so: 1 to 2."""
ROUNDS_BESIDE = 2
"""Most steps of the search for the best values of the other noises; it begins near them."""
LEAST = 0.05
"""Least loss in σ, and least part of a bracket that a trial of a lower end leaves on each side: a plain
choice."""
SHORTEST = 0.25
"""Least part of a bracket of an upper end that a trial leaves on each side: beyond it, the loss is steep."""
STEP = 0.3
"""Shortest step of the logarithm of a noise while an end is not enclosed. A plain choice."""
LONGEST = 2.0
"""Longest such step: that of the search."""
HARDLY = 0.5
"""Loss in σ without the other noises below which they stand for nothing: an eighth of a unit of
log-likelihood, of the 1.9 at an end."""
BELOW = 0.35
"""How far below its upper end another noise begins: a logarithm, of half the variance."""
LARGE = 1e3
"""Largest loss in σ that decides the next trial. A plain choice."""

Ends = tuple[float, float]
"""Ends of an interval, in the coordinate of the search; −∞ if the noise may be zero."""


def logarithm_intervals(
    search: Search, whole: list[Parameter], joint: Estimate, without: FloatArray, known: Mapping[int, Known]
) -> dict[int, Ends]:
    """Return the 95 % interval of each noise and of each variance of a fix, whatever the other noises are.

    Parameters
    ----------
    search, whole
        The search, and its parameters.
    joint
        The estimate of all parameters.
    without : (4,) array
        Twice the losses of log-likelihood without each noise, as of `find_observable`.
    known
        What the log shows beside values that were held; the intervals contain its estimates.
    """
    noise = np.flatnonzero(~search.held[NOISE])
    profiles = [_Profile(search, whole, joint, without, int(index)) for index in noise]
    highs = np.full(PARAMETERS, -math.inf)
    with ThreadPoolExecutor(max_workers=2) as pool:
        # All upper ends first: a lower end begins with the other noises near theirs.
        highs[noise] = list(pool.map(_Profile.high, profiles))
        lows = dict(zip(noise, pool.map(lambda one: one.low(highs), profiles), strict=True))
    ends = {int(index): (lows[index], float(highs[index])) for index in noise}
    for index in range(*FIX.indices(PARAMETERS)):
        ends[index] = _of_variance(float(joint.value[index]), float(joint.sigma[index]))
    return {index: _widen_interval(known.get(index), index, *both) for index, both in ends.items()}


def _of_variance(value: float, sigma: float) -> Ends:
    """Return the interval of ln σ of a variance, which has a χ² distribution, from the σ of its estimate."""
    if not sigma > 0:
        return value, value
    # An estimate of ln σ by n degrees of freedom has the variance 1 / (2 n).
    degrees = 1 / (2 * sigma**2)
    below, above = special.chdtri(degrees, [OUTSIDE / 2, 1 - OUTSIDE / 2])
    return value + 0.5 * math.log(degrees / below), value + 0.5 * math.log(degrees / above)


def _widen_interval(known: Known | None, index: int, low: float, high: float) -> Ends:
    """Return an interval that contains what is known beside values that were held."""
    if known is None:
        return low, high
    if index < NOISE.stop:
        return -math.inf if known.bounded else min(low, known.value), max(high, known.value)
    beside = _of_variance(known.value, known.sigma)
    return -math.inf if known.bounded else min(low, beside[0]), max(high, beside[1])


class _Profile:
    """The loss of likelihood over one noise, in the σ of a parabola.

    Parameters
    ----------
    search, whole, joint, without, index
        As of `logarithm_intervals`, and the index of the noise.

    Attributes
    ----------
    wanted : float
        The loss at the ends; correlated innovations raise it, as they do σ.
    """

    def __init__(
        self, search: Search, whole: list[Parameter], joint: Estimate, without: FloatArray, index: int
    ) -> None:
        self._search, self._whole, self._joint, self._index = search, whole, joint, index
        self._without = math.sqrt(max(float(without[index]), 0.0))
        self._sigma = float(joint.sigma[index])
        # This σ allows for correlated innovations, the covariance does not: their ratio says how much.
        self.wanted = NORMAL * max(1.0, self._sigma / math.sqrt(joint.covariance[index, index]))
        every = np.arange(PARAMETERS)
        self._kept: Flags = search.held | (every == index)
        self._late = every >= LATENCY
        self._idle = (every < NOISE.stop) & (every != index)
        self._idle[NOISE] &= without <= self.wanted**2

    def _loss(self, likelihood: float) -> float:
        return math.sqrt(max(2 * (self._joint.log_likelihood - likelihood), 0.0))

    def _loss_at(self, at: float, place: FloatArray) -> float:
        """Return the loss with the others at a place; infinite if the filter cannot run there."""
        moved = place.copy()
        moved[self._index] = at
        try:
            return self._loss(float(log_likelihoods(self._search.run(moved)).sum()))
        except (ValueError, np.linalg.LinAlgError):
            return math.inf

    def _fit_alone(self) -> tuple[float, float, FloatArray] | None:
        """Return estimate, σ and place where it stands for all that may be zero; None if it cannot."""
        place = np.where(self._idle, -NOTHING, self._joint.value)
        value, sigma = float(self._joint.value[self._index]), self._sigma
        if self._loss_at(value, place) < HARDLY:
            return value, sigma, place
        held = self._search.held | self._idle | self._late
        try:
            found = maximise(self._search.run, self._whole, place, held, most=AHEAD)
        except (ValueError, np.linalg.LinAlgError):  # without the other noise, the filter cannot run
            return None
        if self._loss(found.log_likelihood) >= self.wanted:
            return None
        return float(found.value[self._index]), float(found.sigma[self._index]), found.value

    def _minimize_others(
        self, at: float, place: FloatArray, kept: Flags, most: int
    ) -> tuple[float, FloatArray]:
        """Return the loss with the best values of the others, and these."""
        begin = place.copy()
        begin[self._index] = at
        try:
            found = maximise(self._search.run, self._whole, begin, kept, most=most, certain=False)
        except (ValueError, np.linalg.LinAlgError):
            return math.inf, place
        return self._loss(found.log_likelihood), found.value

    def high(self) -> float:
        """Return the upper end: without the noises for which this one may stand, or with them."""
        value, sigma, place = float(self._joint.value[self._index]), self._sigma, self._joint.value
        kept, top = self._kept | self._late, self._whole[self._index].high
        alone = self._fit_alone() if self._idle.any() else None
        if alone is not None:
            (value, sigma, place), kept = alone, kept | self._idle
        certain = sigma < UNLIKE_ZERO
        # Where a parabola holds, its own end is the first trial.
        at = value + NORMAL * sigma if certain else max(value, 0.0) + STEP
        low, high = (value, LEAST) if certain else None, None
        for _ in range(TRIALS):
            lost = self._loss_at(at, place)
            if abs(lost / self.wanted - 1) < CLOSE or (lost < self.wanted and at >= top):
                break
            if lost < self.wanted:
                low = at, max(lost, LEAST)
            else:
                high = at, lost
            at = min(_choose_next_trial(low, high, self.wanted, at), top)
        else:
            lost = self.wanted
        slope = lost * GROWTH if low is None or low[0] >= at else max(lost - low[1], LEAST) / (at - low[0])
        for _ in range(2):
            lost, _ = self._minimize_others(at, place, kept, 1)
            if not math.isfinite(lost):
                break
            at = min(at + float(np.clip((self.wanted - lost) / slope, -STEP, STEP)), top)
            if abs(lost / self.wanted - 1) < CLOSE:
                break
        return at

    def low(self, highs: FloatArray) -> float:
        """Return the lower end: with the noises that may stand for this one; `highs` are their upper ends."""
        if self._without <= self.wanted:
            return -math.inf
        value = float(self._joint.value[self._index])
        # Of its variance over that of the estimate, from 0 to 1.
        first, last = (0.0, min(self._without, LARGE)), (1.0, 0.0)
        at = max(
            math.exp(-2 * NORMAL * self._sigma),
            1 - self.wanted / self._without if self._without < 2 * self.wanted else 0.0,
        )
        # Far below its upper end, a noise has no slope by which a search could find it.
        places = [self._joint.value]
        for other in np.flatnonzero(self._idle):
            places.append(self._joint.value.copy())
            places[-1][other] = max(places[-1][other], highs[other] - BELOW)
        place = min(places, key=lambda one: self._loss_at(value + 0.5 * math.log(at), one))
        for _ in range(TRIALS):
            lost, place = self._minimize_others(value + 0.5 * math.log(at), place, self._kept, ROUNDS_BESIDE)
            if lost > self.wanted:
                first = at, min(lost, LARGE)
            else:
                last = at, lost
            part = (self.wanted - last[1]) / max(first[1] - last[1], LEAST)
            near = abs(lost / self.wanted - 1) < CLOSE
            part = part if near else float(np.clip(part, LEAST, 1 - LEAST))
            at = last[0] + part * (first[0] - last[0])
            if near:
                break
        return value + 0.5 * math.log(at)


def _choose_next_trial(
    low: tuple[float, float] | None, high: tuple[float, float] | None, wanted: float, at: float
) -> float:
    """Return the next trial for an end, from the trials below and above it: places and losses."""
    if low is None or high is None:
        (place, lost) = low or high or (at, wanted)
        step = math.log(wanted / min(max(lost, LEAST), LARGE))
        return place + math.copysign(float(np.clip(abs(step), STEP, LONGEST)), step)
    parts = math.log(wanted / low[1]) / math.log(min(high[1], LARGE) / low[1])
    return low[0] + float(np.clip(parts, SHORTEST, 1 - SHORTEST)) * (high[0] - low[0])
