"""Identify: noise of sensors, latency and lever arm from the innovations, judged by withheld fixes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from lab.analysis.consistency import chi_square_interval
from lab.analysis.identification.assumptions import (
    LATENCY,
    LEVER_ARM,
    NOISE,
    NOTHING,
    PARAMETERS,
    Assumed,
    Known,
    apply_advice,
    assumed,
    least_factors,
    mix_assumptions,
    parameters,
    scaled_rows,
    tabulate_parameters,
    without_zeros,
)
from lab.analysis.identification.factors import choose, scale_noise
from lab.analysis.identification.identification import ChosenBy, HeldOut, Identification, Row, predicts_better
from lab.analysis.identification.identified_settings import at_bounds, list_changes
from lab.analysis.identification.likelihood import (
    Estimate,
    InnovationSeries,
    Parameter,
    squares,
)
from lab.analysis.identification.noise_intervals import logarithm_intervals
from lab.analysis.identification.observable import (
    Search,
    describe_parameters,
    find_observable,
    find_refuted,
    maximize_likelihood,
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
FEWEST = 20
"""Fewest fixes for an identification."""
BY_CHANCE = 1e-6
"""Probability of the NIS below which a fix is an outlier."""
MOST_OUTLIERS = 0.05
"""Fraction of the fixes above which apparent outliers indicate a wrong model."""


class _Found(NamedTuple):
    """The result of a search, and its accuracy of prediction."""

    rows: Callable[[], tuple[Row, ...]]
    changes: dict[str, Any]
    assumed: Assumed
    before: HeldOut
    after: HeldOut
    experiment: ExperimentSettings
    white: bool
    chosen_by: ChosenBy
    known: Mapping[int, Known]


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
    stands, cure = _apply_first_advice(now, verdict, least)
    begun = without_zeros(stands)
    first, last = again.span
    settling = min(SETTLING, LARGEST_PART * (last - first))
    margin = min(MARGIN, LARGEST_PART * (last - first))
    counted = (again.stamps > first + settling) & (again.stamps < last - margin)
    none = np.zeros(counted.size, np.bool_)
    search = Search(
        again, _every_fix(run.experiment), begun, counted, none, _estimated_parameters(run.experiment)
    )
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
    found = _run_search(run, search, whole, estimate, (now, stands), masks, before, tell)
    # White innovations hold all that the log shows. The few outages that judge are won by chance, too.
    white = found.white
    if not white:
        # A filter that follows correlated errors of the fixes predicts the next fix well, but not fixes
        # withheld for longer.
        ahead = search._replace(masks=tuple(between[: _count_outage_sets(last - first)]))
        if ahead.masks:
            estimate = maximize_likelihood(ahead, whole, begin, ahead.held, tell, 0.7, 0.8)
            other = _run_search(run, ahead, whole, estimate, (now, stands), masks, before, tell)
            found = _choose_prediction(found, other)
    if not (white or predicts_better(before, found.after)):
        tell("trying factors on R and Q", 0.9)
        turns = masks if _count_outage_sets(last - first) < TURNS else [*masks, *between]
        found = _by_factors(run, again, now, turns, search.dropped, float(least.max())) or found
    tell("judging the innovations", 0.95)
    seen = [_next_fixes(search, settings) for settings in (run.experiment, found.experiment)]
    tell("done", 1.0)
    return Identification(
        mission=run.mission.title or run.mission.name,
        rows=found.rows(),
        before=found.before,
        after=found.after,
        withheld=OUTAGE,
        every=EVERY,
        inside=(_fraction_inside(seen[0]), _fraction_inside(seen[1])),
        white=white,
        spread=describe_spread(seen[1]),
        chosen_by=found.chosen_by,
        outliers=int(search.dropped.sum()),
        fixes=int((counted & ~search.dropped).sum()),
        changes=found.changes,
        changes_of=partial(list_changes, run, now, found.assumed),
        cure="" if found.chosen_by == "factors" else cure,
        at_bounds=at_bounds(run, now, found.assumed, found.changes, least),
        seconds=time.perf_counter() - begun_at,
    )


def _apply_first_advice(now: Assumed, verdict: Verdict, least: FloatArray) -> tuple[Assumed, str]:
    """Return the assumptions with the first advice of a verdict, and this advice; empty if of others."""
    first = verdict.findings[0] if verdict.findings else None
    changed = None if first is None else apply_advice(now, first.changes)
    if first is None or changed is None:
        return now, ""
    (path, value, times, _), *_ = first.changes
    advice = f"{path} {'times' if times else 'is'} {value}"
    return changed._replace(factors=np.maximum(changed.factors, least)), advice


def _estimated_parameters(experiment: ExperimentSettings) -> Flags:
    """Return the mask (11,) of the parameters that states of the filter estimate, and the search does not."""
    navigator = experiment.navigator
    estimated = np.zeros(PARAMETERS, np.bool_)
    estimated[LATENCY], estimated[LEVER_ARM] = navigator.estimate_latency, navigator.estimate_lever_arm
    return estimated


def _without_outliers(search: Search, whole: list[Parameter], begin: FloatArray, tell: Progress) -> Estimate:
    """Return the estimate of all parameters; outliers are dropped from the search, for later ones too."""
    estimate = maximize_likelihood(search, whole, begin, search.held, tell, 0.0, 0.4)
    outliers = _outliers(estimate.seen)
    if outliers.any():
        search.dropped[np.flatnonzero(search.counted)[outliers]] = True
        estimate = maximize_likelihood(search, whole, estimate.value, search.held, tell, 0.4, 0.5)
    return estimate


def _run_search(
    run: Run,
    search: Search,
    whole: list[Parameter],
    estimate: Estimate,
    assumptions: tuple[Assumed, Assumed],
    masks: list[Flags],
    before: HeldOut,
    tell: Progress,
) -> _Found:
    """Return the result of a search and its prediction; `assumptions` are as of `_judge_search`.

    If the innovations are not white, no parameter is the whole cause, and several explain a part of it about
    as well. Latency and lever arm then change only if withheld fixes are predicted better than without.
    """
    found = _judge_search(run, search, whole, estimate, assumptions, masks, before, tell, {})
    stands, where = assumptions[1], found.assumed
    if found.white or (where.latency == stands.latency and np.array_equal(where.lever_arm, stands.lever_arm)):
        return found
    fixed = search._replace(held=search.held | (np.arange(PARAMETERS) >= LATENCY))
    begin = np.where(fixed.held, [parameter.start for parameter in whole], estimate.value)
    tell("searching without latency and lever arm", 0.85 if search.masks else 0.6)
    estimate = maximize_likelihood(fixed, whole, begin, fixed.held, _ignore_progress, 0.0, 1.0)
    known = {index: one for index, one in found.known.items() if index >= LATENCY}
    other = _judge_search(run, fixed, whole, estimate, assumptions, masks, before, _ignore_progress, known)
    fine, fine_without = (predicts_better(before, one.after) for one in (found, other))
    if fine != fine_without:
        return found if fine else other
    return found if predicts_better(other.after, found.after) else other


def _ignore_progress(_stage: str, _fraction: float) -> None:
    """Tell nobody of the progress."""


def _judge_search(
    run: Run,
    search: Search,
    whole: list[Parameter],
    estimate: Estimate,
    assumptions: tuple[Assumed, Assumed],
    masks: list[Flags],
    before: HeldOut,
    tell: Progress,
    seen: Mapping[int, Known],
) -> _Found:
    """Return the result of a search and its prediction.

    `assumptions` are those of the filter, and with the advice of the verdict. Of these, only those change
    that the log refutes; the others are held while the rest is estimated again. `seen` is what the log shows
    of parameters that the search holds.
    """
    now, stands = assumptions
    done = 0.8 if search.masks else 0.5
    zero = _zero(stands)
    joint = estimate
    estimate, shown, bounded, without = find_observable(search, whole, estimate, zero, tell, done)
    known = describe_parameters(search, whole, estimate, shown, bounded)
    start = np.where(zero, -NOTHING, [parameter.start for parameter in whole])
    wrong = find_refuted(estimate, known, start)
    while wrong.sum() < shown.sum():
        begin, shown = np.where(wrong, estimate.value, start), wrong
        estimate = maximize_likelihood(search, whole, begin, ~shown, tell, done, done + 0.1)
        known |= describe_parameters(search, whole, estimate, shown, bounded)
        wrong = find_refuted(
            estimate, {int(index): known[int(index)] for index in np.flatnonzero(shown)}, start
        )
    known, begun = {**seen, **known}, search.begun
    found = mix_assumptions(stands, begun.moved(estimate.value), wrong)

    def rows() -> tuple[Row, ...]:
        intervals = logarithm_intervals(search, whole, joint, without, known)
        return tabulate_parameters(run, now, begun, found, known, intervals)

    changes = list_changes(run, now, found)
    changed = run.experiment.copy().update(changes)
    tell("predicting withheld fixes", done + 0.1)
    after = held_out(search.subject, changed, masks, search.dropped)
    chosen_by: ChosenBy = "outages" if search.masks else "next fixes"
    return _Found(rows, changes, found, before, after, changed, estimate.white, chosen_by, known)


def _by_factors(
    run: Run, again: Subject, now: Assumed, turns: list[Flags], dropped: Flags, least: float
) -> _Found | None:
    """Return the factors on R and Q that predict withheld fixes better; None if no factors do."""
    factors = choose(again, run.experiment, turns, dropped, float(np.max(least / now.factors)))
    if factors is None:
        return None
    changed = scale_noise(run.experiment, factors.r, factors.q)
    navigator = {"r_scale": changed.navigator.r_scale, "q_scale": changed.navigator.q_scale}
    found = now._replace(noise=factors.q * now.noise, factors=factors.r * now.factors)
    rows = partial(scaled_rows, run, now, found)
    return _Found(
        rows, {"navigator": navigator}, found, factors.before, factors.after, changed, False, "factors", {}
    )


def _choose_prediction(one: _Found, other: _Found) -> _Found:
    """Return the better prediction; a larger error outweighs a better likelihood."""
    fine = [found for found in (one, other) if predicts_better(found.before, found.after)]
    return max(fine or (one, other), key=lambda found: found.after.log_likelihood)


def _count_outage_sets(length: float) -> int:
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


def _outliers(seen: InnovationSeries) -> Flags:
    """Return the mask of non-Gaussian fixes; all False if there are so many that the model must be wrong."""
    nis, degrees = squares(seen)
    far = (degrees > 0) & (special.gammaincc(np.maximum(degrees, 1) / 2, nis / 2) < BY_CHANCE)
    few = far.sum() <= MOST_OUTLIERS * max(1, int((degrees > 0).sum()))
    return np.asarray(far & few)


def _zero(now: Assumed) -> Flags:
    """Return the mask (11,) of noise parameters that the filter assumes to be zero."""
    zero = np.zeros(PARAMETERS, np.bool_)
    zero[NOISE] = ~now.noise.reshape(4, 3).any(axis=1)
    return zero


def _next_fixes(search: Search, experiment: ExperimentSettings) -> InnovationSeries:
    """Return the used innovations of a filter with some settings, each fix predicted from all before it."""
    seen, _ = search.subject.navigate(_every_fix(experiment), search.dropped)
    counts = search.counted & ~search.dropped
    return InnovationSeries(seen.innovation[counts], seen.covariance[counts])


def _fraction_inside(seen: InnovationSeries) -> float:
    """Return the fraction of the NIS in the 95 % interval."""
    nis, degrees = squares(seen)
    nis, degrees = nis[degrees > 0], degrees[degrees > 0]
    if not nis.size:
        return float("nan")
    bounds = {int(count): chi_square_interval(int(count)) for count in np.unique(degrees)}
    low, high = np.array([bounds[int(count)] for count in degrees]).T
    return float(np.mean((nis >= low) & (nis <= high)))
