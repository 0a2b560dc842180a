"""Identify: noise of sensors, latency and lever arm from the innovations, judged by withheld fixes."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from lab.analysis.consistency import chi_square_interval
from lab.analysis.identification.assumptions import (
    LATENCY,
    LEVER_ARM,
    LOGARITHMS,
    NOISE,
    NOTHING,
    OBSERVABLE,
    PARAMETERS,
    Assumed,
    Known,
    assumed,
    cured,
    least_factors,
    mixed,
    parameters,
    rows_of,
    scaled_rows,
    without_zeros,
)
from lab.analysis.identification.factors import choose, scaled
from lab.analysis.identification.identification import ChosenBy, HeldOut, Identification, Row, better
from lab.analysis.identification.identified_settings import at_bounds, changes_of
from lab.analysis.identification.likelihood import (
    NORMAL,
    ROUNDS,
    Estimate,
    InnovationSeries,
    Parameter,
    interval,
    log_likelihoods,
    maximise,
    squares,
)
from lab.analysis.identification.renavigation import Subject, subject
from lab.analysis.identification.spread import describe_spread
from lab.analysis.identification.withheld import EVERY, OUTAGE, TURNS, held_out, outages
from lab.analysis.verdicts.finding import Verdict
from lab.base.arrays import Flags, FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.base.progress import Progress
from lab.run.experiment_settings import ExperimentSettings
from lab.run.run import ResultError, Run

SETTLING = 30.0
"""Time after the start in which initial errors, not sensor errors, dominate the innovations [s]."""
LARGEST_PART = 0.2
"""Largest fraction of the run that is omitted for this, and largest fraction at its end."""
MARGIN = 3.0
"""Time before the end whose fixes are omitted, because another latency could move them beyond the end [s]."""
AHEAD = 5
"""Most steps of a search across outages; each runs the filter up to three times as often."""
FEWEST = 20
"""Fewest fixes for an identification."""
BY_CHANCE = 1e-6
"""Probability of the NIS below which a fix is an outlier."""
MOST_OUTLIERS = 0.05
"""Fraction of the fixes above which apparent outliers indicate a wrong model."""
BY_ALL = 0.05
"""Probability that any of the parameters changes by chance. A convention."""
TINY = 1e-300
"""Smallest divisor."""
UNLIKE_ZERO = 1.0
"""σ of the logarithm of a noise above which the noise may be zero: its interval spans a factor of 50."""
REJECTED = 3.84
"""Twice the loss of log-likelihood at the ends of the 95 % interval (χ², 1 degree of freedom)."""


class _Search(NamedTuple):
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
            return _of(seen, self.counted, counts)
        parts = [self.subject.navigate(experiment, self.dropped | mask)[1] for mask in self.masks]
        thin = _seconds_apart(self.subject.stamps)
        parts = [_of(part, mask & thin, counts) for part, mask in zip(parts, self.masks, strict=True)]
        return InnovationSeries(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


class _Found(NamedTuple):
    """The result of a search, and its accuracy of prediction."""

    rows: tuple[Row, ...]
    changes: dict[str, Any]
    assumed: Assumed
    before: HeldOut
    after: HeldOut
    experiment: ExperimentSettings
    white: bool
    chosen_by: ChosenBy


def _of(seen: InnovationSeries, rows: Flags, counts: Flags) -> InnovationSeries:
    """Return some rows of the innovations, with NaN for the ignored ones."""
    return InnovationSeries(np.where(counts[:, None], seen.innovation, np.nan)[rows], seen.covariance[rows])


def _seconds_apart(stamps: FloatArray) -> Flags:
    """Return the mask of the first fix of each second: closer ones add no information about a prediction."""
    return np.asarray(np.diff(np.floor(stamps + 1e-6), prepend=-1.0) > 0)


@OneBlasThread()
def identify(run: Run, verdict: Verdict, progress: Progress | None = None) -> Identification:
    """Identify the sensors of a run from its innovations.

    The search begins with what the verdict advises, and changes only those of the other parameters whose
    interval excludes what is then assumed.

    Parameters
    ----------
    run
        A simulated run, or that of a log.
    verdict
        The verdict on it.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    ResultError
        If a user's algorithm navigated, or there are too few fixes.
    ValueError
        If the filter cannot run with the settings of the run.
    """
    if run.algorithm:
        raise ResultError("The navigator is your own algorithm, so its assumptions are unknown.")
    tell, begun_at = progress or (lambda _stage, _fraction: None), time.perf_counter()
    again = subject(run)
    now = assumed(run)
    least = least_factors(run, now)
    stands, cure = _cured(now, verdict, least)
    begun = without_zeros(stands)
    first, last = again.span
    settling = min(SETTLING, LARGEST_PART * (last - first))
    margin = min(MARGIN, LARGEST_PART * (last - first))
    counted = (again.stamps > first + settling) & (again.stamps < last - margin)
    none = np.zeros(counted.size, np.bool_)
    search = _Search(again, _every_fix(run.experiment), begun, counted, none, _estimated(run.experiment))
    whole = parameters(stands, least)
    begin = np.array([parameter.start for parameter in whole])
    if int(np.isfinite(search.run(begin).innovation).any(axis=1).sum()) < FEWEST:
        raise ResultError(
            f"There are too few fixes for an identification; accepted are at least {FEWEST} after the first "
            f"{settling:.0f} s."
        )
    estimate = _without_outliers(search, whole, begin, tell)
    masks = outages(again.stamps, first + settling, last)
    between = outages(again.stamps, first + settling, last, EVERY / TURNS / 2)
    before = held_out(again, run.experiment, masks, search.dropped)
    found = _judged(run, search, whole, estimate, (now, stands), masks, before, tell)
    # White innovations hold all that the log shows. The few outages that judge are won by chance, too.
    white = found.white
    if not white:
        # A filter that follows correlated errors of the fixes predicts the next fix well, but not fixes
        # withheld for longer.
        ahead = search._replace(masks=tuple(between[: _turns(last - first)]))
        if ahead.masks:
            estimate = _maximised(ahead, whole, begin, ahead.held, tell, 0.7, 0.8)
            other = _judged(run, ahead, whole, estimate, (now, stands), masks, before, tell)
            found = _better_of(found, other)
    if not (white or better(before, found.after)):
        tell("trying factors on R and Q", 0.9)
        turns = masks if _turns(last - first) < TURNS else [*masks, *between]
        found = _by_factors(run, again, now, turns, search.dropped, float(least.max())) or found
    tell("judging the innovations", 0.95)
    seen = [_next_fixes(search, settings) for settings in (run.experiment, found.experiment)]
    tell("done", 1.0)
    return Identification(
        mission=run.mission.title or run.mission.name,
        rows=found.rows,
        before=found.before,
        after=found.after,
        withheld=OUTAGE,
        every=EVERY,
        inside=(_inside(seen[0]), _inside(seen[1])),
        white=white,
        spread=describe_spread(seen[1]),
        chosen_by=found.chosen_by,
        outliers=int(search.dropped.sum()),
        fixes=int((counted & ~search.dropped).sum()),
        changes=found.changes,
        changes_of=partial(changes_of, run, now, found.assumed),
        cure="" if found.chosen_by == "factors" else cure,
        at_bounds=at_bounds(run, now, found.assumed, found.changes, least),
        seconds=time.perf_counter() - begun_at,
    )


def _cured(now: Assumed, verdict: Verdict, least: FloatArray) -> tuple[Assumed, str]:
    """Return the assumptions with the first advice of a verdict, and this advice; empty if of others."""
    first = verdict.findings[0] if verdict.findings else None
    changed = None if first is None else cured(now, first.changes)
    if first is None or changed is None:
        return now, ""
    (path, value, times, _), *_ = first.changes
    advice = f"{path} {'times' if times else 'is'} {value}"
    return changed._replace(factors=np.maximum(changed.factors, least)), advice


def _estimated(experiment: ExperimentSettings) -> Flags:
    """Return the mask (11,) of the parameters that states of the filter estimate, and the search does not."""
    navigator = experiment.navigator
    estimated = np.zeros(PARAMETERS, np.bool_)
    estimated[LATENCY], estimated[LEVER_ARM] = navigator.estimate_latency, navigator.estimate_lever_arm
    return estimated


def _without_outliers(search: _Search, whole: list[Parameter], begin: FloatArray, tell: Progress) -> Estimate:
    """Return the estimate of all parameters; outliers are dropped from the search, for later ones too."""
    estimate = _maximised(search, whole, begin, search.held, tell, 0.0, 0.4)
    outliers = _outliers(estimate.seen)
    if outliers.any():
        search.dropped[np.flatnonzero(search.counted)[outliers]] = True
        estimate = _maximised(search, whole, estimate.value, search.held, tell, 0.4, 0.5)
    return estimate


def _judged(
    run: Run,
    search: _Search,
    whole: list[Parameter],
    estimate: Estimate,
    assumptions: tuple[Assumed, Assumed],
    masks: list[Flags],
    before: HeldOut,
    tell: Progress,
) -> _Found:
    """Return the result of a search and its prediction.

    `assumptions` are those of the filter, and with the advice of the verdict. Of these, only those change
    that the log refutes; the others are held while the rest is estimated again.
    """
    now, stands = assumptions
    done = 0.8 if search.masks else 0.5
    zero = _zero(stands)
    joint = estimate
    estimate, shown, bounded = find_observable(search, whole, estimate, zero, tell, done)
    known = _known(search, whole, estimate, shown, bounded)
    start = np.where(zero, -NOTHING, [parameter.start for parameter in whole])
    wrong = refuted(estimate, known, start)
    while wrong.sum() < shown.sum():
        begin, shown = np.where(wrong, estimate.value, start), wrong
        estimate = _maximised(search, whole, begin, ~shown, tell, done, done + 0.1)
        known |= _known(search, whole, estimate, shown, bounded)
        wrong = refuted(estimate, {int(index): known[int(index)] for index in np.flatnonzero(shown)}, start)
    begun = search.begun
    found = mixed(stands, begun.moved(estimate.value), wrong)
    rows = rows_of(run, now, begun, found, whatever_others(search, whole, joint, known))
    changes = changes_of(run, now, found)
    changed = run.experiment.copy().update(changes)
    tell("predicting withheld fixes", done + 0.1)
    after = held_out(search.subject, changed, masks, search.dropped)
    chosen_by: ChosenBy = "outages" if search.masks else "next fixes"
    return _Found(rows, changes, found, before, after, changed, estimate.white, chosen_by)


def refuted(estimate: Estimate, known: Mapping[int, Known], stands: FloatArray) -> Flags:
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


def _known(
    search: _Search, whole: list[Parameter], estimate: Estimate, shown: Flags, bounded: Flags
) -> dict[int, Known]:
    """Return what the log shows of each parameter."""
    return {
        index: Known(float(estimate.value[index]), float(estimate.sigma[index]), *ends, bool(bounded[index]))
        for index, ends in _intervals(search, whole, estimate, shown, bounded).items()
    }


def whatever_others(
    search: _Search, whole: list[Parameter], joint: Estimate, known: Mapping[int, Known]
) -> dict[int, Known]:
    """Return what the log shows of each parameter, whatever noise has the values that were held.

    One noise can stand for another. So the upper end of noise that may be zero is where it stands for all
    others that may, and other noise has an interval of the search for all parameters, too.

    Parameters
    ----------
    search, whole
        The search, and its parameters.
    joint
        The estimate of all parameters.
    known
        What the log shows beside values that were held.
    """
    noise = np.arange(PARAMETERS) < NOISE.stop
    small = noise & (joint.sigma > UNLIKE_ZERO)
    found = dict(known)
    for index in sorted(set(known) & set(range(NOISE.stop))):
        one, half = known[index], NORMAL * float(joint.sigma[index])
        others = small & (np.arange(PARAMETERS) != index)
        if not others.any():
            continue
        if not one.bounded:
            low, high = joint.value[index] - half, joint.value[index] + half
            found[index] = one._replace(low=min(one.low, float(low)), high=max(one.high, float(high)))
            continue
        begin = np.where(others, -NOTHING, joint.value)
        held = others | (np.arange(PARAMETERS) >= LATENCY)
        try:
            alone = maximise(search.run, whole, begin, held, most=AHEAD)
        except (ValueError, np.linalg.LinAlgError):  # without the other noise, the filter cannot run
            continue
        if joint.log_likelihood - alone.log_likelihood < REJECTED / 2:
            alone = replace(alone, log_likelihood=max(alone.log_likelihood, joint.log_likelihood))
            high = interval(search.run, whole, alone, index)[1]
            found[index] = one._replace(high=max(one.high, high))
    return found


def _by_factors(
    run: Run, again: Subject, now: Assumed, turns: list[Flags], dropped: Flags, least: float
) -> _Found | None:
    """Return the factors on R and Q that predict withheld fixes better; None if no factors do."""
    factors = choose(again, run.experiment, turns, dropped, float(np.max(least / now.factors)))
    if factors is None:
        return None
    changed = scaled(run.experiment, factors.r, factors.q)
    navigator = {"r_scale": changed.navigator.r_scale, "q_scale": changed.navigator.q_scale}
    found = now._replace(noise=factors.q * now.noise, factors=factors.r * now.factors)
    rows = scaled_rows(run, now, found)
    return _Found(
        rows, {"navigator": navigator}, found, factors.before, factors.after, changed, False, "factors"
    )


def _better_of(one: _Found, other: _Found) -> _Found:
    """Return the better prediction; a larger error outweighs a better likelihood."""
    fine = [found for found in (one, other) if better(found.before, found.after)]
    return max(fine or (one, other), key=lambda found: found.after.log_likelihood)


def _turns(length: float) -> int:
    """Return the number of sets of outages for a search: of a long log, one set has enough outages."""
    return TURNS if length < TURNS * EVERY * 2 else 1


def _every_fix(experiment: ExperimentSettings) -> ExperimentSettings:
    """Return the experiment with a filter that uses every fix fully and immediately, without smoothing."""
    plain = experiment.copy()
    navigator = plain.navigator
    navigator.gate, navigator.robust, navigator.smoother = 0.0, "none", False
    navigator.correction, navigator.correction_period, navigator.engine = "feedback", 0.0, "compiled"
    if navigator.model == "nonlinear":
        navigator.model = "invariant"  # as good for large attitude errors, and much faster
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
    def report(stage: str, fraction: float) -> None:
        tell(stage, start + (end - start) * fraction)

    return maximise(search.run, whole, begin, held, report, AHEAD if search.masks else ROUNDS)


def _outliers(seen: InnovationSeries) -> Flags:
    """Return the mask of non-Gaussian fixes; all False if there are so many that the model must be wrong."""
    nis, degrees = squares(seen)
    far = (degrees > 0) & (special.gammaincc(np.maximum(degrees, 1) / 2, nis / 2) < BY_CHANCE)
    few = far.sum() <= MOST_OUTLIERS * max(1, int((degrees > 0).sum()))
    return np.asarray(far & few)


def find_observable(
    search: _Search, whole: list[Parameter], estimate: Estimate, zero: Flags, tell: Progress, done: float
) -> tuple[Estimate, Flags, Flags]:
    """Return the estimate with unobservable parameters held, and masks: observable, without lower bound.

    A noise that may be zero, if the others change with it, is not observable, unless the log refutes the
    assumed value: then the log shows an upper bound. Other poorly known parameters are also set back to their
    start values.
    """
    prior = np.array([parameter.prior for parameter in whole])
    start = np.array([parameter.start for parameter in whole])
    poor = (estimate.sigma > OBSERVABLE * prior) | search.held
    bounded, held = np.zeros(poor.size, np.bool_), poor.copy()

    every = np.arange(poor.size)

    def refuted(index: int, value: float) -> bool:
        other = estimate.value.copy()
        other[index] = value
        if 2 * (estimate.log_likelihood - float(log_likelihoods(search.run(other)).sum())) <= REJECTED:
            return False
        # Another noise may stand for this one: only what no other parameters explain is refuted.
        kept = search.held | (every == index) | (every >= LATENCY)
        try:
            best = maximise(search.run, whole, other, kept, most=AHEAD).log_likelihood
        except (ValueError, np.linalg.LinAlgError):  # with this value, the filter cannot run
            return True
        return 2 * (estimate.log_likelihood - best) > REJECTED

    for index in range(LOGARITHMS.stop):
        if index < NOISE.stop and not refuted(index, -NOTHING):
            bounded[index] = not zero[index] and refuted(index, start[index])
            held[index] = not bounded[index]
        elif poor[index] and refuted(index, start[index]):
            bounded[index], held[index] = True, False
    if held.any():
        begin, together = np.where(held, np.where(zero, -NOTHING, start), estimate.value), estimate.sigma
        estimate = _maximised(search, whole, begin, held, tell, done, done + 0.1)
        # A held lever arm is unknown: along the track, it has the same effect as a latency.
        unsure = ~held & (np.arange(held.size) >= LATENCY) & held[LATENCY:].any()
        estimate = replace(
            estimate, sigma=np.where(unsure, np.maximum(estimate.sigma, together), estimate.sigma)
        )
    return estimate, ~held, bounded


def _intervals(
    search: _Search, whole: list[Parameter], estimate: Estimate, shown: Flags, bounded: Flags
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


def _zero(now: Assumed) -> Flags:
    """Return the mask (11,) of noise parameters that the filter assumes to be zero."""
    zero = np.zeros(PARAMETERS, np.bool_)
    zero[NOISE] = ~now.noise.reshape(4, 3).any(axis=1)
    return zero


def _next_fixes(search: _Search, experiment: ExperimentSettings) -> InnovationSeries:
    """Return the used innovations of a filter with some settings, each fix predicted from all before it."""
    seen, _ = search.subject.navigate(_every_fix(experiment), search.dropped)
    counts = search.counted & ~search.dropped
    return InnovationSeries(seen.innovation[counts], seen.covariance[counts])


def _inside(seen: InnovationSeries) -> float:
    """Return the fraction of the NIS in the 95 % interval."""
    nis, degrees = squares(seen)
    nis, degrees = nis[degrees > 0], degrees[degrees > 0]
    if not nis.size:
        return float("nan")
    bounds = {int(count): chi_square_interval(int(count)) for count in np.unique(degrees)}
    low, high = np.array([bounds[int(count)] for count in degrees]).T
    return float(np.mean((nis >= low) & (nis <= high)))
