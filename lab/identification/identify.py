"""Identify: noise of sensors, latency and lever arm from the innovations, judged by withheld fixes."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.analysis.consistency import chi_square_interval
from lab.analysis.identification import ChosenBy, HeldOut, Identification, Row, better
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
from lab.analysis.spread import spread
from lab.blas_threads import OneBlasThread
from lab.experiment_settings import ExperimentSettings
from lab.identification.assumptions import (
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
    scaled_rows,
)
from lab.identification.factors import choose, scaled
from lab.identification.renavigation import Subject, subject
from lab.identification.withheld import EVERY, OUTAGE, TURNS, held_out, outages
from lab.progress import Progress
from lab.run import ResultError, Run

FloatArray = NDArray[np.float64]
Flags = NDArray[np.bool_]

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
REJECTED = 3.84
"""Twice the loss of log-likelihood at the ends of the 95 % interval (χ², 1 degree of freedom)."""

_OTHER = (
    "sensors.barometer.fitted, sensors.heading.fitted, sensors.odometer.fitted, "
    "sensors.airspeed.fitted, navigator.no_slip, navigator.zero_velocity, "
    "navigator.estimate_misalignments, navigator.estimate_g_sensitivity, "
    "navigator.estimate_bias_drift, navigator.estimate_gps_drift, "
    "navigator.estimate_lever_arm, navigator.estimate_latency, navigator.own_states"
)
"""Settings that name other measurements or further states, as text."""


class _Search(NamedTuple):
    """The data of the likelihood: all fixes in sequence, or those predicted across outages."""

    subject: Subject
    experiment: ExperimentSettings  # with a filter that uses every fix
    begun: Assumed
    counted: Flags  # fixes after the initial errors
    dropped: Flags  # outliers
    masks: tuple[Flags, ...] = ()  # fixes in outages

    def run(self, by: FloatArray) -> Seen:
        """Return the innovations in the likelihood, with other assumptions."""
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
    """The result of a search, and its accuracy of prediction."""

    rows: tuple[Row, ...]
    changes: dict[str, Any]
    before: HeldOut
    after: HeldOut
    experiment: ExperimentSettings
    white: bool
    chosen_by: ChosenBy


def _of(seen: Seen, rows: Flags, counts: Flags) -> Seen:
    """Return some rows of the innovations, with NaN for the ignored ones."""
    return Seen(np.where(counts[:, None], seen.innovation, np.nan)[rows], seen.covariance[rows])


def _seconds_apart(stamps: FloatArray) -> Flags:
    """Return the mask of the first fix of each second: closer ones add no information about a prediction."""
    return np.asarray(np.diff(np.floor(stamps + 1e-6), prepend=-1.0) > 0)


@OneBlasThread()
def identify(run: Run, progress: Progress | None = None) -> Identification:
    """Identify the sensors of a run from its innovations.

    Parameters
    ----------
    run
        A simulated run, or that of a log.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    ResultError
        If a user's algorithm navigated, the filter uses other measurements, or there are too few fixes.
    ValueError
        If the filter cannot run with the settings of the run.
    """
    _check_filter(run)
    tell, begun_at = progress or (lambda _stage, _fraction: None), time.perf_counter()
    again = subject(run)
    now, densities = assumed(run)
    begun = now._replace(noise=densities)
    first, last = again.span
    settling = min(SETTLING, LARGEST_PART * (last - first))
    margin = min(MARGIN, LARGEST_PART * (last - first))
    counted = (again.stamps > first + settling) & (again.stamps < last - margin)
    search = _Search(again, _every_fix(run.experiment), begun, counted, np.zeros(counted.size, np.bool_))
    whole = parameters(now)
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
    found = _judged(run, search, whole, estimate, now, masks, before, tell)
    white = found.white
    if not white or not better(before, found.after):
        # A filter that follows correlated errors of the fixes predicts the next fix well, but not fixes
        # withheld for longer.
        ahead = search._replace(masks=tuple(between[: _turns(last - first)]))
        if ahead.masks:
            free = np.zeros(begin.size, np.bool_)
            estimate = _maximised(ahead, whole, begin, free, tell, 0.7, 0.8)
            other = _judged(run, ahead, whole, estimate, now, masks, before, tell)
            found = _better_of(found, other)
    if not better(before, found.after):
        tell("trying factors on R and Q", 0.9)
        found = _by_factors(run, again, now, [*masks, *between], search.dropped) or found
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
        spread=spread(seen[1]),
        chosen_by=found.chosen_by,
        outliers=int(search.dropped.sum()),
        fixes=int((counted & ~search.dropped).sum()),
        changes=found.changes,
        seconds=time.perf_counter() - begun_at,
    )


def _check_filter(run: Run) -> None:
    """Raise `ResultError` if the assumptions of the navigator cannot be identified."""
    if run.algorithm:
        raise ResultError("The navigator is your own algorithm, so its assumptions are unknown.")
    if run.is_aided:
        raise ResultError(
            f"{_OTHER}: the identification is from the innovations of IMU and GPS alone, and this filter "
            "uses other measurements or has further states; accepted are none"
        )


def _without_outliers(search: _Search, whole: list[Parameter], begin: FloatArray, tell: Progress) -> Estimate:
    """Return the estimate of all parameters; outliers are dropped from the search, for later ones too."""
    free = np.zeros(begin.size, np.bool_)
    estimate = _maximised(search, whole, begin, free, tell, 0.0, 0.4)
    outliers = _outliers(estimate.seen)
    if outliers.any():
        search.dropped[np.flatnonzero(search.counted)[outliers]] = True
        estimate = _maximised(search, whole, estimate.value, free, tell, 0.4, 0.5)
    return estimate


def _judged(
    run: Run,
    search: _Search,
    whole: list[Parameter],
    estimate: Estimate,
    now: Assumed,
    masks: list[Flags],
    before: HeldOut,
    tell: Progress,
) -> _Found:
    """Return the result of a search and its prediction; unobservable parameters do not change."""
    done = 0.8 if search.masks else 0.5
    estimate, shown, bounded = _observable(search, whole, estimate, _zero(now), tell, done)
    begun = search.begun
    found = _with_what_stays(begun.moved(estimate.value), now, shown)
    intervals = _intervals(search, whole, estimate, shown)
    rows = rows_of(run, now, begun, estimate, intervals, bounded)
    changes = changes_of(run, rows, found)
    changed = run.experiment.copy().update(changes)
    tell("predicting withheld fixes", done + 0.1)
    after = held_out(search.subject, changed, masks, search.dropped)
    chosen_by: ChosenBy = "outages" if search.masks else "next fixes"
    return _Found(rows, changes, before, after, changed, estimate.white, chosen_by)


def _by_factors(run: Run, again: Subject, now: Assumed, turns: list[Flags], dropped: Flags) -> _Found | None:
    """Return the factors on R and Q that predict withheld fixes better; None if no factors do."""
    factors = choose(again, run.experiment, turns, dropped)
    if factors is None:
        return None
    changed = scaled(run.experiment, factors.r, factors.q)
    navigator = {"r_scale": changed.navigator.r_scale, "q_scale": changed.navigator.q_scale}
    rows = scaled_rows(run, now, factors.r, factors.q)
    return _Found(rows, {"navigator": navigator}, factors.before, factors.after, changed, False, "factors")


def _better_of(one: _Found, other: _Found) -> _Found:
    """Return the better prediction; a larger error outweighs a better likelihood."""
    fine = [found for found in (one, other) if better(found.before, found.after)]
    return max(fine or (one, other), key=lambda found: found.after.log_likelihood)


def _turns(length: float) -> int:
    """Return the number of sets of outages for a search: a long log has enough outages in one set."""
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
    def told(stage: str, fraction: float) -> None:
        tell(stage, start + (end - start) * fraction)

    return maximise(search.run, whole, begin, held, told, AHEAD if search.masks else ROUNDS)


def _outliers(seen: Seen) -> Flags:
    """Return the mask of non-Gaussian fixes; all False if there are so many that the model must be wrong."""
    nis, degrees = squares(seen)
    far = (degrees > 0) & (special.gammaincc(np.maximum(degrees, 1) / 2, nis / 2) < BY_CHANCE)
    few = far.sum() <= MOST_OUTLIERS * max(1, int((degrees > 0).sum()))
    return np.asarray(far & few)


def _observable(
    search: _Search, whole: list[Parameter], estimate: Estimate, zero: Flags, tell: Progress, done: float
) -> tuple[Estimate, Flags, Flags]:
    """Return the estimate with unobservable parameters held, and masks: observable, without lower bound.

    A noise that may be zero is not observable, unless the log refutes the assumed value: then the log shows
    an upper bound. Other poorly known parameters are also set back to their start values.
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
        # A held lever arm is unknown: along the track, it has the same effect as a latency.
        unsure = ~held & (np.arange(held.size) >= LATENCY) & held[LATENCY:].any()
        estimate = replace(
            estimate, sigma=np.where(unsure, np.maximum(estimate.sigma, together), estimate.sigma)
        )
    return estimate, ~held, bounded


def _intervals(
    search: _Search, whole: list[Parameter], estimate: Estimate, shown: Flags
) -> dict[int, tuple[float, float]]:
    """Return the ends of the 95 % interval of each parameter that the log shows.

    Intervals of latency and lever arm follow the likelihood, because the information about one depends on the
    other.
    """
    half = NORMAL * estimate.sigma
    indices = [int(index) for index in np.flatnonzero(shown & (half > 0))]
    ends = {i: (float(estimate.value[i] - half[i]), float(estimate.value[i] + half[i])) for i in indices}
    receiver = [index for index in indices if index >= LATENCY]
    with ThreadPoolExecutor(max_workers=2) as pool:
        found = pool.map(lambda index: interval(search.run, whole, estimate, index), receiver)
        return ends | dict(zip(receiver, found, strict=True))


def _zero(now: Assumed) -> Flags:
    """Return the mask (11,) of noise parameters that the filter assumes to be zero."""
    zero = np.zeros(PARAMETERS, np.bool_)
    zero[NOISE] = ~now.noise.reshape(4, 3).any(axis=1)
    return zero


def _with_what_stays(found: Assumed, now: Assumed, shown: Flags) -> Assumed:
    """Return the identified assumptions, with the old ones for parameters that the log does not show."""
    noise = np.where(np.repeat(shown[:4], 3), found.noise, now.noise)
    factors = np.where(shown[4:7], found.factors, now.factors)
    arm = np.where(shown[8:], found.lever_arm, now.lever_arm)
    return Assumed(noise, factors, found.latency if shown[7] else now.latency, arm)


def _next_fixes(search: _Search, experiment: ExperimentSettings) -> Seen:
    """Return the used innovations of a filter with some settings, each fix predicted from all before it."""
    seen, _ = search.subject.navigate(_every_fix(experiment), search.dropped)
    counts = search.counted & ~search.dropped
    return Seen(seen.innovation[counts], seen.covariance[counts])


def _inside(seen: Seen) -> float:
    """Return the fraction of the NIS in the 95 % interval."""
    nis, degrees = squares(seen)
    nis, degrees = nis[degrees > 0], degrees[degrees > 0]
    if not nis.size:
        return float("nan")
    bounds = {int(count): chi_square_interval(int(count)) for count in np.unique(degrees)}
    low, high = np.array([bounds[int(count)] for count in degrees]).T
    return float(np.mean((nis >= low) & (nis <= high)))
