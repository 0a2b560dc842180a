"""Contradiction: data that no noise explains, and the fault of the log that does.

A filter whose gyros have the wrong sign is helped by any noise that makes it believe them less: such a noise
explains the innovations, and is not there. So a large factor is tried before it is stated, beside faults of
the log as a whole (`log_faults`) and noise of single channels. The innovations of each are those of a run.

References
----------
F. C. Schweppe, *Evaluation of Likelihood Functions for Gaussian Signals*, IEEE Trans. Information Theory 11
(1965), for the likelihood of the innovations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lab.analysis.identification.candidate_trials import Candidate, Outcome, Trials
from lab.analysis.identification.identification import HeldOut
from lab.analysis.identification.likelihood import InnovationSeries, Parameter, maximise
from lab.analysis.identification.log_faults import LogFault, iterate_faults, iterate_range_faults, with_clock
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import TRIED
from lab.analysis.verdicts.finding import Change, Finding, Verdict, headline, size_weight
from lab.analysis.verdicts.finding_table import (
    AID_NOISE,
    ARM_OR_LATENCY,
    AS_LIKELY,
    EITHER,
    FAULT_OF_LOG,
    FINDINGS,
)
from lab.analysis.verdicts.fix_verdict import latency
from lab.analysis.verdicts.innovation_verdict import GPS, explanations, make_finding
from lab.analysis.verdicts.pattern import AXES
from lab.analysis.verdicts.state_advice import advise_log
from lab.analysis.verdicts.trial import Repeatable
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.data.checks.full_scale import full_scales
from lab.data.checks.imu_axes import NAMES
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import SensorLog
from lab.navigation.solution import Imu

HALF = 0.5
"""Part of NIS that a fault may leave at most: one that explains less is a part of what is wrong."""
MOST = 0.5
"""Part of the samples at the end of a range from which the range is a finding by itself."""
VISIBLE = 10.0
"""Factor by which noise that is stated may exceed all that the samples show: of a sensor with a bandwidth of
2 Hz, means over a tenth of a second show a seventh."""
AVERAGED = 0.1
"""Time over which samples are averaged for that [s]: motion is slow against it, vibration fast."""
MEDIAN_SQUARE = 0.455
"""Median of the square of a normal variable of unit variance."""
SCREENED = 12_000
"""Samples of a log on which all candidates are tried: some 0.1 s each; the best are tried on the whole."""
BEFORE = 0.25
"""Part of these samples before the time from which the data contradict each other."""
OF_CHANNEL, OF_TRIAD, OF_FIXES = (1e3, 1e5), (1e2, 1e3, 1e4), (10.0, 100.0)
"""Tried factors on the noise of one axis of the IMU, of a triad, and on R. A plain choice."""
RATES, ZEROS = (0.003, 0.01, 0.03), (0.0, 0.5, 1.0)
"""Differences of clock rates from which the search begins, of either sign, and the parts of the log at which
both clocks then agree. Crystals keep 0.01 %, oscillators inside sensors 1 to 3 %."""
ROUNDS = 6
"""Most steps of that search: it begins within the reach of a few."""
LATEST = 20.0
"""Largest lateness that is searched [s]."""
FASTEST = 0.1
"""Largest difference of clock rates that is searched."""
LEAST_RATE = 2e-4
"""Smallest difference of clock rates that is stated: 0.1 s in 500 s."""
_WHITE = (0, 6)
"""Rows of Q with the white noise of gyros and accelerometers."""
_BY_TIME = ("GPS latency", "GPS lever arm", ARM_OR_LATENCY)
"""Findings that another rate of a clock causes, too."""


def explain_by_faults(run: Repeatable, verdict: Verdict) -> Verdict:
    """Return a verdict on innovations after its large factors were tried, beside faults of the log.

    The verdict itself, if its first finding makes the innovations consistent, with a factor below `LARGE` or
    one that predicts withheld fixes better and shows in the samples.

    Parameters
    ----------
    run
        The run.
    verdict
        The verdict on its innovations.
    """
    recorded = run.recorded
    too_long = run.is_long and recorded is None
    if run.algorithm or too_long or not verdict.findings or not _is_doubtful(verdict.findings[0]):
        return verdict
    log = None if recorded is None else recorded.log
    whole = Trials(run, _cut_screened_part(log, 0.0) if log is not None and run.is_long else log)
    first = verdict.findings[0]
    stated = Candidate("", first.changes)
    try:
        before = whole.as_it_is
        cured = whole.outcome(stated) if first.changes else before
    except ValueError:  # such as a run of withheld settings that diverges
        return verdict
    holds = cured is not None and cured.mean < limits.VERDICT.consistent_nis
    moved = _is_by_time(run, first)
    if holds and not _is_large(first) and not moved:
        return verdict
    since = _find_onset(before, whole.stamps)
    found = _fault(run, whole, cured, since, clock_first=moved)
    if found is not None and found.quantity != first.quantity:
        return Verdict(headline((found,), ""), (found,), verdict.basis)
    if not _is_large(first) or (holds and _is_noise(run, whole, stated)):
        return verdict
    found = _misalignment(run, whole) or _range(run, since) or _contradiction(run, whole, before, since)
    return Verdict(headline((found,), ""), (found,), verdict.basis)


def _is_doubtful(finding: Finding) -> bool:
    """Return whether a finding may be due to a fault of the log."""
    return finding.quantity not in (*AID_NOISE, "GPS outliers", "feedforward", "correction period")


def _is_by_time(run: Repeatable, finding: Finding) -> bool:
    """Return whether a finding is, or may as likely be, one that another rate of a clock causes, too."""
    if finding.quantity != EITHER:
        return finding.quantity in _BY_TIME
    of_fixes = (one.name for one in explanations(run.evidence.innovations) if one.source == GPS)
    return next(of_fixes, "") in _BY_TIME


def _is_large(finding: Finding) -> bool:
    """Return whether a finding, or its advice, raises a variance by a large factor.

    Innovations that are too small contradict nothing.
    """
    factors = [change.value for change in finding.changes if change.times]
    return any(isinstance(one, float | int) and one > limits.VERDICT.large_factor for one in factors)


def _find_onset(outcome: Outcome, stamps: FloatArray) -> float:
    """Return the time from which the innovations are too large, while they are right before [s]."""
    rows = outcome.degrees > 0
    # From each fix to the end.
    squares_after = np.cumsum(outcome.nis[rows][::-1])[::-1]
    number_after = np.cumsum(outcome.degrees[rows][::-1])[::-1]
    worth = [
        size_weight(*both) if both[0] > both[1] else 0.0
        for both in zip(squares_after, number_after, strict=True)
    ]
    return float(stamps[rows][int(np.argmax(worth))]) if worth else 0.0


def _fault(
    run: Repeatable, whole: Trials, cured: Outcome | None, since: float, *, clock_first: bool
) -> Finding | None:
    """Return the finding of a fault of the log that explains the innovations better than noise does."""
    recorded = run.recorded
    if recorded is None:
        return None
    log = _cut_screened_part(recorded.log, since)
    part = whole if log is recorded.log else Trials(run, log)
    rivals = [part.as_it_is, *(outcome for _, outcome in part.outcomes(_of_noise()))]
    rivals += [cured] if cured is not None and part is whole else []
    for of_clock in (clock_first, not clock_first):
        tried = part.outcomes(_of_clock(run, part, log) if of_clock else _of_log(log))
        if not tried:
            continue
        (best, outcome), *others = sorted(tried, key=lambda one: -one[1].gain(part.as_it_is))
        # What stands at the end of its range is seen, whatever noise is like it.
        if _explains_as_much(outcome, rivals, HALF if best.changes else 1 - limits.VERDICT.alike_part):
            alike = [
                other.fault
                for other, there in others
                if outcome.gain(there) < limits.VERDICT.likelihood_ratio and other.fault
            ]
            return _state_fault(part, best, outcome, since, alike)
    return None


def _explains_as_much(outcome: Outcome, rivals: Sequence[Outcome], part: float) -> bool:
    """Return whether an outcome explains as much as noise does; the first rival is the run as it is.

    If it makes the innovations consistent, a `part` of the gain is as much.
    """
    before = rivals[0]
    gain, other = outcome.gain(before), max(rival.gain(before) for rival in rivals)
    if gain < limits.VERDICT.likelihood_ratio or outcome.mean > max(
        HALF * before.mean, limits.VERDICT.consistent_nis
    ):
        return False
    return gain > other - limits.VERDICT.likelihood_ratio or (
        gain > part * other and outcome.mean < limits.VERDICT.consistent_nis
    )


def _cut_screened_part(log: SensorLog, since: float) -> SensorLog:
    """Return the part of a log on which all candidates are tried, around a time [s]."""
    if log.time.size <= SCREENED:
        return log
    at = int(np.searchsorted(log.time, since))
    first = int(np.clip(at - BEFORE * SCREENED, 0, log.time.size - SCREENED))
    last = min(first + SCREENED, log.time.size - 1)
    return cut_section(log, log.epoch + float(log.time[first]), log.epoch + float(log.time[last]))


def _of_log(log: SensorLog) -> list[Candidate]:
    """Return the faults of a log but for those of its clock; a range with each noise of its sensor."""
    found = [Candidate("", fault=one) for one in iterate_faults(log)]
    noise = [one for one in _of_noise() if one.changes[0].path == "navigator.q"]
    for sensor, fault in iterate_range_faults(log):
        for one in noise:
            rows = one.changes[0].rows
            assert rows is not None
            found += [one._replace(fault=fault)] if rows[0] // 3 == sensor else []
    return found


def _of_noise() -> list[Candidate]:
    """Return noise of single axes of the IMU, of triads, and of the fixes."""
    found = []
    for first, kind in ((0, "gyro"), (3, "accelerometer")):
        places = {f"the {name} {kind}": (first + axis, first + axis + 1) for axis, name in enumerate(NAMES)}
        found += _scale_channels("navigator.q", places, OF_CHANNEL)
        found += _scale_channels("navigator.q", {f"the {kind}s": (first, first + 3)}, OF_TRIAD)
    for first, name in ((0, "position"), (3, "velocity")):
        places = {
            f"the {name} of the fixes": (first, first + 3),
            f"the {name} {AXES[2]} of the fixes": (first + 2, first + 3),
        }
        found += _scale_channels("navigator.r", places, OF_FIXES)
    return found


def _scale_channels(
    path: str, places: Mapping[str, tuple[int, int]], factors: Sequence[float]
) -> list[Candidate]:
    """Return a matrix with the variances of each of some channels multiplied by each factor."""
    return [
        Candidate(channel, (Change(path, factor, True, rows),))
        for channel, rows in places.items()
        for factor in factors
    ]


def _of_clock(run: Repeatable, part: Trials, log: SensorLog) -> list[Candidate]:
    """Return the likeliest constant lateness of the fixes, and that of two clocks of different rate."""

    def repeat_innovations(values: FloatArray) -> InnovationSeries:
        return part.seen(Candidate("", fault=_clock(log, values)))

    late = Parameter("lateness", 0.0, -LATEST, LATEST, LATEST, 0.01, 1.0, both=True)
    rate = Parameter("rate", 0.0, -FASTEST, FASTEST, FASTEST, 1e-4, 0.01, both=True)
    starts = [
        np.array([rate * where * log.duration, rate])  # late at first, by what the faster clock then makes up
        for size in RATES
        for rate in (size, -size)
        for where in ZEROS
    ]
    tried = part.outcomes([Candidate(str(at), fault=_clock(log, one)) for at, one in enumerate(starts)])
    begins = [(np.zeros(2), np.array([False, True]))]
    if tried:
        best = max(tried, key=lambda one: one[1].gain(part.as_it_is))[0]
        begins.append((starts[int(best.channel)], np.zeros(2, np.bool_)))
    found = []
    for begin, held in begins:
        try:
            value = maximise(repeat_innovations, (late, rate), begin, held, most=ROUNDS).value
        except (ValueError, np.linalg.LinAlgError):
            continue
        if held[1]:
            found.append(
                Candidate("", fault=_delay_fixes(run, log, float(value[0])), price=limits.VERDICT.price)
            )
        elif abs(value[1]) > LEAST_RATE:
            found.append(
                Candidate(
                    "",
                    fault=_clock(log, value),
                    price=2 * limits.VERDICT.price + limits.VERDICT.likelihood_ratio,
                )
            )
    return found


def _clock(log: SensorLog, values: FloatArray) -> LogFault:
    """Return two clocks: lateness of the fixes at time 0 [s], and how much faster the IMU's runs."""
    late, rate = (float(value) for value in values)
    finding = FINDINGS["clock"].finding(
        float("nan"),
        "",
        percent=100 * abs(rate),
        side="fast" if rate > 0 else "slow",
        first=_format_lateness(late),
        last=_format_lateness(late - rate * log.duration),
        ratio=1 + rate,
    )
    return LogFault(finding, with_clock(log, late, rate))


def _format_lateness(seconds: float) -> str:
    return f"{abs(seconds):.2f} s {'late' if seconds >= 0 else 'early'}"


def _delay_fixes(run: Repeatable, log: SensorLog, size: float) -> LogFault:
    """Return fixes that are late by a constant time [s]."""
    assumed = np.append(run.latency, np.zeros(3))
    return LogFault(latency(size, 0.0, assumed), with_clock(log, size, 0.0))


def _state_fault(
    part: Trials, best: Candidate, outcome: Outcome, since: float, alike: Sequence[LogFault]
) -> Finding | None:
    """Return the finding of a fault, if withheld fixes are not predicted worse without it.

    `alike` explain the same.
    """
    fault, before = best.fault, part.as_it_is
    assert fault is not None
    was, becomes = part.withheld(Candidate("")), part.withheld(best)
    if was is not None and (becomes is None or becomes.position_error > was.position_error):
        return None
    effect = f"NIS per degree of freedom {before.mean:.2f}, then {outcome.mean:.2f}"
    if was is not None and becomes is not None:
        errors = (f"{format_number(one.position_error)} m" for one in (was, becomes))
        effect += f"; error of fixes withheld for 10 s: {', then '.join(errors)}"
    finding = fault.finding
    tried = TRIED["with less trust" if best.changes else "better"]
    same = dict.fromkeys(one.finding.sentence for one in alike if one.finding.sentence != finding.sentence)
    sentence = AS_LIKELY.join((finding.sentence, *same))
    return replace(
        finding,
        factor=float("nan"),
        sentence=FAULT_OF_LOG.format(fault=sentence, since=_describe_onset(since)),
        advice=finding.advice if finding.changes else tried.format(advice=finding.advice, effect=effect),
        evidence=f"logarithm of the likelihood ratio {outcome.gain(before):.0f}",
    )


def _describe_onset(since: float) -> str:
    return f"{since:.0f} s" if since >= 1 else "the start"


def _misalignment(run: Repeatable, whole: Trials) -> Finding | None:
    """Return the finding of misalignments whose states make the innovations of a log consistent.

    Large ones are beyond the responses of first order, so that noise explains the innovations better.
    """
    if run.recorded is None:
        return None
    evidence = run.evidence
    assumed = evidence.assumed.values.mean(axis=0)
    for one in explanations(evidence.innovations):
        if not one.name.endswith("misalignment"):
            continue
        statistic = f"logarithm of the likelihood ratio {one.gain:.0f}"
        found = make_finding([one], evidence.innovations, statistic, assumed)
        (found,) = advise_log(Verdict("", (found,), ""), run).findings
        candidate = Candidate("", found.changes)
        outcome = whole.outcome(candidate) if found.changes else None
        if outcome is None or outcome.mean > limits.VERDICT.consistent_nis:
            continue
        was, becomes = whole.withheld(Candidate("")), whole.withheld(candidate)
        if (
            was is None
            or becomes is None
            or becomes.position_error > was.position_error / limits.VERDICT.worse_factor
        ):
            continue
        return found
    return None


def _range(run: Repeatable, since: float) -> Finding | None:
    """Return the finding of a sensor that stands at the end of its range most of the time.

    The motion beyond is then no noise of that sensor, so that the noise of another may explain more. That
    most samples stand there is seen all the same.
    """
    if run.recorded is None:
        return None
    log = run.recorded.log
    most = {one.axis // 3 for one in full_scales(np.concatenate(log.rates, axis=1)) if one.at.mean() > MOST}
    for sensor, fault in iterate_range_faults(log):
        if sensor not in most:
            continue
        sentence = FAULT_OF_LOG.format(fault=fault.finding.sentence, since=_describe_onset(since))
        return replace(fault.finding, sentence=sentence)
    return None


def _is_noise(run: Repeatable, whole: Trials, stated: Candidate) -> bool:
    """Return whether a large factor predicts withheld fixes better, and the samples show such noise."""
    was, becomes = whole.withheld(Candidate("")), whole.withheld(stated)
    if was is not None and not _predicts_better(becomes, was, stated, whole.as_it_is):
        return False
    imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
    shown = shown_noise(imu)
    for change in stated.changes:
        if change.path not in ("navigator.q", "navigator.q_scale"):
            continue
        # Only white noise can be compared with samples; drives of biases are in the rows after it.
        first, last = change.rows or _WHITE
        rows = range(first, min(last, _WHITE[1]))
        assert isinstance(change.value, float | int)
        if any(change.value * run.belief.noise[row] > VISIBLE * shown[row] for row in rows):
            return False
    return True


def _predicts_better(becomes: HeldOut | None, was: HeldOut, stated: Candidate, before: Outcome) -> bool:
    """Return whether withheld fixes are predicted better with the changes of a candidate.

    A start moves the few fixes after it, and hardly any of them is withheld, while the smallest prior would
    win. So it need not predict better where the innovations contradict nothing; elsewhere, the likelihood
    decides, which a start that is trusted too much has lost.
    """
    if becomes is None:
        return False
    if all(change.path.startswith("navigator.p0") for change in stated.changes):
        return before.mean < limits.VERDICT.consistent_nis or becomes.log_likelihood > was.log_likelihood
    return becomes.position_error < was.position_error


def shown_noise(imu: Imu) -> FloatArray:
    """Return the largest densities (6,) of white noise that the samples of an IMU leave room for.

    They are those of the third differences of means over `AVERAGED`, in which smooth motion is small: of
    white noise, half of their squares are below 0.455 × 20 σ², and manoeuvres are the other half.
    """
    width = max(1, round(AVERAGED / imu.step))
    count = imu.dtheta.shape[0] // width
    edges = imu.time[: count * width + 1 : width]
    step = float(np.median(np.diff(edges)))
    found = []
    for values in (imu.dtheta, imu.dvelocity):
        sums = values[: count * width].astype(np.float64).reshape(count, width, 3).sum(axis=1)
        third = np.diff(sums / np.diff(edges)[:, None], 3, axis=0)
        # A third difference of white noise has 20 times its variance, and next to nothing of smooth motion.
        found.append(np.median(third**2, axis=0) / MEDIAN_SQUARE / 20 * step)
    return np.concatenate(found)


def _contradiction(run: Repeatable, whole: Trials, before: Outcome, since: float) -> Finding:
    """Return the finding of data that contradict each other, with the channel whose noise helps most."""
    recorded = run.recorded
    log = None if recorded is None else _cut_screened_part(recorded.log, since)
    part = whole if recorded is None or log is recorded.log else Trials(run, log)
    tried = part.outcomes(_of_noise())
    evidence, words = f"NIS per degree of freedom {before.mean:.2f}", _describe_onset(since)
    if not tried:
        return FINDINGS["contradiction"].finding(float("nan"), evidence, since=words)
    best, outcome = max(tried, key=lambda one: one[1].gain(part.as_it_is))
    return FINDINGS["contradiction in a channel"].finding(
        float("nan"),
        evidence,
        since=words,
        channel=best.channel,
        without=outcome.mean,
        nis=part.as_it_is.mean,
    )
