"""Identify: noise of sensors, latency and lever arm from the innovations, judged by withheld fixes."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.analysis.consistency import chi_square_interval
from lab.analysis.identification import HeldOut, Identification, Row, better
from lab.analysis.likelihood import (
    NORMAL,
    ROUNDS,
    Estimate,
    Parameter,
    Seen,
    interval,
    log_likelihoods,
    maximise,
    squares,
)
from lab.assumptions import (
    LATENCY,
    LOGARITHMS,
    NOISE,
    NOTHING,
    OBSERVABLE,
    PARAMETERS,
    Assumed,
    assumed,
    changes_of,
    parameters,
    rows_of,
)
from lab.experiment import Experiment
from lab.renavigation import Subject, subject
from lab.result import Result, ResultError

FloatArray = NDArray[np.float64]
Flags = NDArray[np.bool_]
Progress = Callable[[str, float], None]

SETTLING = 30.0
"""Time after the start whose innovations are those of the initial errors, not of the sensors [s]."""
LARGEST_PART = 0.2
"""Largest part of the run that is left out for that, and largest part of its end."""
MARGIN = 3.0
"""Time before the end whose fixes are left out: with another latency they might be beyond it [s]."""
OUTAGE, EVERY, TURNS = 10.0, 60.0, 3
"""Length of the outages in which the prediction is judged, time from one to the next [s], and how often that
is done, each time with the outages elsewhere."""
AHEAD = 5
"""Most steps of a search across outages, each of which runs the filter up to three times as often."""
FEWEST = 20
"""Fewest fixes that something can be identified from."""
BY_CHANCE = 1e-6
"""Probability of the NIS beyond which a fix is an outlier."""
MOST_OUTLIERS = 0.05
"""Part of the fixes above which outliers are none, but a wrong model."""
REJECTED = 3.84
"""Twice the loss of log-likelihood at which a value is outside the 95 % interval (χ², 1 degree)."""


class _Search(NamedTuple):
    """What the likelihood is made of: all fixes one after the other, or those predicted across outages."""

    subject: Subject
    experiment: Experiment  # with a filter that uses every fix
    begun: Assumed
    counted: Flags  # fixes after the initial errors
    dropped: Flags  # outliers
    masks: tuple[Flags, ...] = ()  # fixes in outages

    def run(self, by: FloatArray) -> Seen:
        """Return the innovations that count, with other assumptions."""
        experiment = self.begun.moved(by).on(self.experiment)
        counts = self.counted & ~self.dropped
        if not self.masks:
            seen, _ = self.subject.navigate(experiment, self.dropped)
            return _of(seen, self.counted, counts)
        parts = [self.subject.navigate(experiment, self.dropped | mask)[1] for mask in self.masks]
        thin = _seconds_apart(self.subject.stamps)
        parts = [_of(part, mask & thin, counts) for part, mask in zip(parts, self.masks, strict=True)]
        return Seen(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


class _Found(NamedTuple):
    """What a search found, and how well it predicts."""

    estimate: Estimate
    shown: Flags
    rows: tuple[Row, ...]
    changes: dict[str, Any]
    held_out: HeldOut
    experiment: Experiment
    predicting: bool


def _of(seen: Seen, rows: Flags, counts: Flags) -> Seen:
    """Return some rows of what is seen, those that do not count without an innovation."""
    return Seen(np.where(counts[:, None], seen.innovation, np.nan)[rows], seen.covariance[rows])


def _seconds_apart(stamps: FloatArray) -> Flags:
    """Return which fixes are the first of their second: closer ones say the same of a prediction."""
    return np.asarray(np.diff(np.floor(stamps + 1e-6), prepend=-1.0) > 0)


def identify(result: Result, progress: Progress | None = None) -> Identification:
    """Return what the innovations of a result say of its sensors.

    Parameters
    ----------
    result
        A simulated run, or that of a log.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    ResultError
        If a user's algorithm navigated, or there are too few fixes.
    ValueError
        If the filter cannot be run with the settings of the result.
    """
    if result.algorithm:
        raise ResultError("The navigator is your own algorithm: what it assumes is not known here.")
    tell, begun_at = progress or (lambda _stage, _fraction: None), time.perf_counter()
    again = subject(result)
    now, densities = assumed(result)
    begun = now._replace(noise=densities)
    first, last = again.span
    settling = min(SETTLING, LARGEST_PART * (last - first))
    margin = min(MARGIN, LARGEST_PART * (last - first))
    counted = (again.stamps > first + settling) & (again.stamps < last - margin)
    plain = _every_fix(result.experiment)
    search = _Search(again, plain, begun, counted, np.zeros(counted.size, np.bool_))
    whole = parameters(now)
    begin = np.array([parameter.start for parameter in whole])
    if int(np.isfinite(search.run(begin).innovation).any(axis=1).sum()) < FEWEST:
        raise ResultError(
            f"There are too few fixes to identify anything from; accepted are at least {FEWEST} after the "
            f"first {settling:.0f} s."
        )
    free = np.zeros(begin.size, np.bool_)
    estimate = _maximised(search, whole, begin, free, tell, 0.0, 0.4)
    outliers = _outliers(estimate.seen)
    if outliers.any():
        search.dropped[np.flatnonzero(counted)[outliers]] = True
        estimate = _maximised(search, whole, estimate.value, free, tell, 0.4, 0.5)
    masks = _outages(again.stamps, first + settling, last, 0.0)
    before = _held_out(again, result.experiment, masks, search.dropped)
    found = _judged(result, search, whole, estimate, now, masks, tell)
    white = found.estimate.white
    if not white or not better(before, found.held_out):
        # The next fix is predicted well by a filter that follows correlated errors of the fixes; what is
        # withheld for longer is not.
        between = _outages(again.stamps, first + settling, last, EVERY / TURNS / 2)
        ahead = search._replace(masks=tuple(between[: _turns(last - first)]))
        if ahead.masks:
            estimate = _maximised(ahead, whole, begin, free, tell, 0.7, 0.8)
            other = _judged(result, ahead, whole, estimate, now, masks, tell)
            found = _better_of(before, found, other)
    tell("judging the innovations", 0.95)
    inside = tuple(_inside(again, settings, search) for settings in (result.experiment, found.experiment))
    tell("done", 1.0)
    return Identification(
        mission=result.mission.title or result.mission.name,
        rows=found.rows,
        before=before,
        after=found.held_out,
        withheld=OUTAGE,
        every=EVERY,
        inside=(inside[0], inside[1]),
        white=white,
        predicting=found.predicting,
        outliers=int(search.dropped.sum()),
        fixes=int((counted & ~search.dropped).sum()),
        changes=found.changes,
        seconds=time.perf_counter() - begun_at,
    )


def _judged(
    result: Result,
    search: _Search,
    whole: list[Parameter],
    estimate: Estimate,
    now: Assumed,
    masks: list[Flags],
    tell: Progress,
) -> _Found:
    """Return what a search found, with what is not observable left as it was, and how well it predicts."""
    done = 0.8 if search.masks else 0.5
    estimate, shown, bounded = _observable(search, whole, estimate, _zero(now), tell, done)
    begun = search.begun
    found = _with_what_stays(begun.moved(estimate.value), now, shown)
    intervals = _intervals(search, whole, estimate, shown)
    rows = rows_of(result, now, begun, estimate, intervals, bounded)
    changes = changes_of(result, rows, found)
    changed = result.experiment.copy().update(changes)
    tell("predicting withheld fixes", done + 0.1)
    judged = _held_out(search.subject, changed, masks, search.dropped)
    return _Found(estimate, shown, rows, changes, judged, changed, bool(search.masks))


def _better_of(before: HeldOut, one: _Found, other: _Found) -> _Found:
    """Return what predicts better; an error that grows counts before the likelihood."""
    fine = [found for found in (one, other) if better(before, found.held_out)]
    return max(fine or (one, other), key=lambda found: found.held_out.log_likelihood)


def _turns(length: float) -> int:
    """Return with how many turns of outages a search is made: a long log has enough of them in one."""
    return TURNS if length < TURNS * EVERY * 2 else 1


def _every_fix(experiment: Experiment) -> Experiment:
    """Return the experiment with a filter that uses every fix fully, at once, forwards."""
    plain = experiment.copy()
    navigator = plain.navigator
    navigator.gate, navigator.robust, navigator.smoother = 0.0, "none", False
    navigator.correction, navigator.correction_period, navigator.engine = "feedback", 0.0, "compiled"
    if navigator.model == "nonlinear":
        navigator.model = "invariant"  # as good with large errors of the attitude, and much faster
    return plain


def _maximised(
    search: _Search,
    whole: list[Parameter],
    begin: FloatArray,
    held: Flags,
    tell: Progress,
    start: float,
    end: float,
) -> Estimate:
    def told(stage: str, fraction: float) -> None:
        tell(stage, start + (end - start) * fraction)

    return maximise(search.run, whole, begin, held, told, AHEAD if search.masks else ROUNDS)


def _outliers(seen: Seen) -> Flags:
    """Return which fixes no Gaussian gives; none if so many are that the model must be wrong."""
    nis, degrees = squares(seen)
    far = (degrees > 0) & (special.gammaincc(np.maximum(degrees, 1) / 2, nis / 2) < BY_CHANCE)
    few = far.sum() <= MOST_OUTLIERS * max(1, int((degrees > 0).sum()))
    return np.asarray(far & few)


def _observable(
    search: _Search, whole: list[Parameter], estimate: Estimate, zero: Flags, tell: Progress, done: float
) -> tuple[Estimate, Flags, Flags]:
    """Return the estimate with what is not observable held where it was; what is; what has no lower bound.

    A noise that might as well be zero is not observable, unless what was assumed is refuted: then the log
    shows that it is not larger. Another parameter that is poorly known goes back to its start likewise.
    """
    prior = np.array([parameter.prior for parameter in whole])
    start = np.array([parameter.start for parameter in whole])
    poor = estimate.sigma > OBSERVABLE * prior
    bounded, held = np.zeros(poor.size, np.bool_), poor.copy()

    def refuted(index: int, value: float) -> bool:
        other = estimate.value.copy()
        other[index] = value
        return 2 * (estimate.log_likelihood - float(log_likelihoods(search.run(other)).sum())) > REJECTED

    for index in range(LOGARITHMS.stop):
        if index < NOISE.stop and not refuted(index, -NOTHING):
            bounded[index] = not zero[index] and refuted(index, start[index])
            held[index] = not bounded[index]
        elif poor[index] and refuted(index, start[index]):
            bounded[index], held[index] = True, False
    if held.any():
        begin, together = np.where(held, np.where(zero, -NOTHING, start), estimate.value), estimate.sigma
        estimate = _maximised(search, whole, begin, held, tell, done, done + 0.1)
        # A lever arm that is held is not known: along the track it is as good as a latency.
        unsure = ~held & (np.arange(held.size) >= LATENCY) & held[LATENCY:].any()
        estimate = replace(
            estimate, sigma=np.where(unsure, np.maximum(estimate.sigma, together), estimate.sigma)
        )
    return estimate, ~held, bounded


def _intervals(
    search: _Search, whole: list[Parameter], estimate: Estimate, shown: Flags
) -> dict[int, tuple[float, float]]:
    """Return the ends of the 95 % interval of each parameter that the log shows.

    Those of latency and lever arm follow the likelihood: how well the log shows one depends on the other.
    """
    half = NORMAL * estimate.sigma
    indices = [int(index) for index in np.flatnonzero(shown & (half > 0))]
    ends = {i: (float(estimate.value[i] - half[i]), float(estimate.value[i] + half[i])) for i in indices}
    receiver = [index for index in indices if index >= LATENCY]
    with ThreadPoolExecutor(max_workers=2) as pool:
        found = pool.map(lambda index: interval(search.run, whole, estimate, index), receiver)
        return ends | dict(zip(receiver, found, strict=True))


def _zero(now: Assumed) -> Flags:
    """Return which parameters (11,) are noise that the filter assumes to be zero."""
    zero = np.zeros(PARAMETERS, np.bool_)
    zero[NOISE] = ~now.noise.reshape(4, 3).any(axis=1)
    return zero


def _with_what_stays(found: Assumed, now: Assumed, shown: Flags) -> Assumed:
    """Return what was found, with what the filter assumed before in place of what the log does not show."""
    noise = np.where(np.repeat(shown[:4], 3), found.noise, now.noise)
    factors = np.where(shown[4:7], found.factors, now.factors)
    arm = np.where(shown[8:], found.lever_arm, now.lever_arm)
    return Assumed(noise, factors, found.latency if shown[7] else now.latency, arm)


def _outages(stamps: FloatArray, start: float, end: float, shift: float) -> list[Flags]:
    """Return which fixes are withheld, in each of the turns, the first of which begins `shift` later [s]."""
    since = stamps - start - shift
    masks = []
    for turn in range(TURNS):
        within = np.mod(since - turn * EVERY / TURNS, EVERY) < OUTAGE
        masks.append((since >= turn * EVERY / TURNS) & within & (stamps <= end))
    return [mask for mask in masks if mask.any()]


def _held_out(again: Subject, experiment: Experiment, masks: list[Flags], dropped: Flags) -> HeldOut:
    """Return how well a filter predicts withheld fixes, outliers apart."""

    def turn(mask: Flags) -> Seen:
        _, predicted = again.navigate(settings, mask)
        kept = mask & ~dropped
        return Seen(predicted.innovation[kept], predicted.covariance[kept])

    settings = experiment.copy()
    settings.navigator.smoother, settings.navigator.engine = False, "compiled"
    with ThreadPoolExecutor(max_workers=2) as pool:
        parts = list(pool.map(turn, masks))
    seen = Seen(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    known = np.isfinite(seen.innovation).any(axis=1)
    seen = Seen(seen.innovation[known], seen.covariance[known])
    nis, degrees = squares(seen)
    position, velocity = (
        float(np.sqrt(np.mean(np.nansum(block**2, axis=1)))) if np.isfinite(block).any() else float("nan")
        for block in (seen.innovation[:, :3], seen.innovation[:, 3:])
    )
    return HeldOut(
        int(known.sum()),
        position,
        velocity,
        float(np.sqrt(nis.sum() / max(1, int(degrees.sum())))),
        float(log_likelihoods(seen).mean()),
    )


def _inside(again: Subject, experiment: Experiment, search: _Search) -> float:
    """Return which part of the NIS lies in the 95 % interval, each fix from all before it."""
    settings = _every_fix(experiment)
    seen, _ = again.navigate(settings, search.dropped)
    counts = search.counted & ~search.dropped
    nis, degrees = squares(Seen(seen.innovation[counts], seen.covariance[counts]))
    nis, degrees = nis[degrees > 0], degrees[degrees > 0]
    if not nis.size:
        return float("nan")
    bounds = {int(count): chi_square_interval(int(count)) for count in np.unique(degrees)}
    low, high = np.array([bounds[int(count)] for count in degrees]).T
    return float(np.mean((nis >= low) & (nis <= high)))
