"""Observable: which parameters the innovations of a flight show, and which values they refute."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from lab.analysis.identification.assumptions import (
    LATENCY,
    LOGARITHMS,
    NOISE,
    NOTHING,
    OBSERVABLE,
    Assumed,
    Known,
)
from lab.analysis.identification.likelihood import (
    NORMAL,
    ROUNDS,
    Estimate,
    InnovationSeries,
    Parameter,
    interval,
    log_likelihoods,
    maximise,
)
from lab.analysis.identification.renavigation import Subject
from lab.base.arrays import Flags, FloatArray
from lab.base.progress import Progress
from lab.run.experiment_settings import ExperimentSettings

AHEAD = 5
"""Most steps of a search across outages; each runs the filter up to three times as often."""
BY_ALL = 0.05
"""Probability that any of the parameters changes by chance. A convention."""
TINY = 1e-300
"""Smallest divisor."""
UNLIKE_ZERO = 1.0
"""σ of the logarithm of a noise above which the noise may be zero: its interval spans a factor of 50."""
REJECTED = 3.84
"""Twice the loss of log-likelihood at the ends of the 95 % interval (χ², 1 degree of freedom)."""


class Search(NamedTuple):
    """The data of the likelihood: all fixes in sequence, or those predicted across outages."""

    subject: Subject
    experiment: ExperimentSettings  # with a filter that uses every fix
    begun: Assumed
    counted: Flags  # fixes after the initial errors
    dropped: Flags  # outliers
    held: Flags  # parameters that states of the filter estimate
    masks: tuple[Flags, ...] = ()  # fixes in outages

    def run(self, by: FloatArray) -> InnovationSeries:
        """Return the innovations in the likelihood, with other assumptions."""
        experiment = self.begun.moved(by).on(self.experiment)
        counts = self.counted & ~self.dropped
        if not self.masks:
            seen, _ = self.subject.navigate(experiment, self.dropped)
            return _select_innovations(seen, self.counted, counts)
        parts = [self.subject.navigate(experiment, self.dropped | mask)[1] for mask in self.masks]
        thin = _seconds_apart(self.subject.stamps)
        parts = [
            _select_innovations(part, mask & thin, counts)
            for part, mask in zip(parts, self.masks, strict=True)
        ]
        return InnovationSeries(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _select_innovations(seen: InnovationSeries, rows: Flags, counts: Flags) -> InnovationSeries:
    """Return some rows of the innovations, with NaN for the ignored ones."""
    return InnovationSeries(np.where(counts[:, None], seen.innovation, np.nan)[rows], seen.covariance[rows])


def _seconds_apart(stamps: FloatArray) -> Flags:
    """Return the mask of the first fix of each second: closer ones add no information about a prediction."""
    return np.asarray(np.diff(np.floor(stamps + 1e-6), prepend=-1.0) > 0)


def maximize_likelihood(
    search: Search,
    whole: list[Parameter],
    begin: FloatArray,
    held: Flags,
    tell: Progress,
    start: float,
    end: float,
) -> Estimate:
    """Return the most likely parameters of a search; progress goes from `start` to `end`."""

    def report(stage: str, fraction: float) -> None:
        tell(stage, start + (end - start) * fraction)

    return maximise(search.run, whole, begin, held, report, AHEAD if search.masks else ROUNDS)


def find_observable(
    search: Search, whole: list[Parameter], estimate: Estimate, zero: Flags, tell: Progress, done: float
) -> tuple[Estimate, Flags, Flags, FloatArray]:
    """Return the estimate with unobservable parameters held, masks (observable, without lower bound), losses.

    A noise that may be zero, if the others change with it, is not observable, unless the log refutes the
    assumed value: then the log shows an upper bound. Other poorly known parameters are also set back to their
    start values. The losses (4,) are twice those of log-likelihood without each noise.
    """
    prior = np.array([parameter.prior for parameter in whole])
    start = np.array([parameter.start for parameter in whole])
    poor = (estimate.sigma > OBSERVABLE * prior) | search.held
    bounded, held = np.zeros(poor.size, np.bool_), poor.copy()

    every = np.arange(poor.size)

    def loss(index: int, value: float) -> float:
        other = estimate.value.copy()
        other[index] = value
        try:
            lost = 2 * (estimate.log_likelihood - float(log_likelihoods(search.run(other)).sum()))
            if lost <= REJECTED:
                return lost
            # Another noise may stand for this one: only what no other parameters explain is refuted.
            kept = search.held | (every == index) | (every >= LATENCY)
            enough = estimate.log_likelihood - REJECTED / 2
            best = maximise(search.run, whole, other, kept, most=AHEAD, enough=enough, certain=False)
        except (ValueError, np.linalg.LinAlgError):  # with this value, the filter cannot run
            return math.inf
        return 2 * (estimate.log_likelihood - best.log_likelihood)

    def is_refuted(index: int, value: float) -> bool:
        return loss(index, value) > REJECTED

    without = np.array([loss(index, -NOTHING) for index in range(NOISE.stop)])
    for index in range(LOGARITHMS.stop):
        if index < NOISE.stop and without[index] <= REJECTED:
            bounded[index] = not zero[index] and is_refuted(index, start[index])
            held[index] = not bounded[index]
        elif poor[index] and is_refuted(index, start[index]):
            bounded[index], held[index] = True, False
    if held.any():
        joint, together = estimate, estimate.sigma
        stands = np.where(zero, -NOTHING, start)
        begin = np.where(held, stands, joint.value)
        estimate = maximize_likelihood(search, whole, begin, held, tell, done, done + 0.1)
        estimate = _free_refuted_noise(search, whole, joint, estimate, held, stands)
        # A held lever arm is unknown: along the track, it has the same effect as a latency.
        unsure = ~held & (np.arange(held.size) >= LATENCY) & held[LATENCY:].any()
        estimate = replace(
            estimate, sigma=np.where(unsure, np.maximum(estimate.sigma, together), estimate.sigma)
        )
    return estimate, ~held, bounded, without


def _free_refuted_noise(
    search: Search,
    whole: list[Parameter],
    joint: Estimate,
    estimate: Estimate,
    held: Flags,
    stands: FloatArray,
) -> Estimate:
    """Return the estimate with noise freed while the log refutes that all held noise stands; change `held`.

    Of two noises that may each stand for the other, neither is shown. One of them is nevertheless wrong if
    both together are. What the joint estimate explains by latency and lever arm frees no noise.
    """
    noise = np.arange(held.size) < NOISE.stop
    while len(left := [int(at) for at in np.flatnonzero(held & ~search.held & noise)]) > 1:
        lost = max(2 * (joint.log_likelihood - estimate.log_likelihood), 0.0)
        if special.gammaincc(len(left) / 2, lost / 2) > BY_ALL:
            break
        tried = []
        for one in left:
            alone = np.arange(held.size) != one
            begin = np.where(held & alone, stands, np.where(held, joint.value, estimate.value))
            tried.append(maximise(search.run, whole, begin, alone, most=AHEAD, certain=False))
        best = int(np.argmax([one.log_likelihood for one in tried]))
        others = held & (np.arange(held.size) != left[best])
        freed = maximise(search.run, whole, tried[best].value, others, most=AHEAD)
        if 2 * (freed.log_likelihood - estimate.log_likelihood) <= REJECTED:
            break
        held[left[best]], estimate = False, freed
    return estimate


def describe_parameters(
    search: Search, whole: list[Parameter], estimate: Estimate, shown: Flags, bounded: Flags
) -> dict[int, Known]:
    """Return what the log shows of each parameter."""
    return {
        index: Known(float(estimate.value[index]), float(estimate.sigma[index]), *ends, bool(bounded[index]))
        for index, ends in _intervals(search, whole, estimate, shown, bounded).items()
    }


def _intervals(
    search: Search, whole: list[Parameter], estimate: Estimate, shown: Flags, bounded: Flags
) -> dict[int, tuple[float, float]]:
    """Return the ends of the 95 % interval of each parameter that the log shows.

    Intervals of latency and lever arm follow the likelihood, because the information about one depends on the
    other, and so do those of noise that may be zero, where the likelihood is flat.
    """
    half = NORMAL * estimate.sigma
    indices = [int(index) for index in np.flatnonzero(shown & (half > 0))]
    ends = {i: (float(estimate.value[i] - half[i]), float(estimate.value[i] + half[i])) for i in indices}
    uneven = [index for index in indices if index >= LATENCY or bounded[index]]
    with ThreadPoolExecutor(max_workers=2) as pool:
        found = pool.map(lambda index: interval(search.run, whole, estimate, index), uneven)
        return ends | dict(zip(uneven, found, strict=True))


def find_refuted(estimate: Estimate, known: Mapping[int, Known], stands: FloatArray) -> Flags:
    """Return the mask (11,) of the parameters whose interval excludes what stands, beyond chance.

    Estimates that depend on each other, as latency and lever arm, may each contain it although both together
    do not: so the least significant one is set back first, and moves the others as their covariance says. Of
    eleven 95 % intervals, one in two runs has one that misses the truth: the limit is that of all together.

    Parameters
    ----------
    estimate
        The estimate.
    known
        What the log shows of each parameter that was not held.
    stands : (11,) array
        What stands, in the coordinates of the search.
    """
    free = [index for index, one in known.items() if not one.bounded]
    limit = float(special.ndtri(1 - BY_ALL / (2 * max(1, len(known)))))
    left, value = set(known), estimate.value.copy()
    plain = np.sqrt(np.diag(estimate.covariance))
    stretch = np.where(plain > 0, estimate.sigma / np.maximum(plain, TINY), 0.0)
    covariance = estimate.covariance * np.outer(stretch, stretch)
    while free:
        apart = [abs(value[at] - stands[at]) / math.sqrt(max(covariance[at, at], TINY)) for at in free]
        if min(apart) > limit:
            break
        least = free.pop(int(np.argmin(apart)))
        left.remove(least)
        gain = covariance[:, least] / max(covariance[least, least], TINY)
        value = value - gain * (value[least] - stands[least])
        covariance = covariance - np.outer(gain, covariance[least])
    if len(left) == len(known):
        # Intervals that follow the likelihood, and not a parabola, decide in the end.
        left = {index for index, one in known.items() if one.excludes(float(stands[index]))}
    return np.isin(np.arange(stands.size), list(left))
