"""Foreign verdict: whether a filter that is not ours states its errors correctly, from its log.

Findings accuse: innovations larger than the filter says, of all its flight or of a stretch; innovations that
follow each other, or alternate; innovations whose mean is not zero; measurements that its test rejected;
resets and changes of lanes in flight; faults that it reported itself. Remarks do not: a filter that
overstates its σ is careful, and most autopilots are by design.

Size and correlation together tell R from Q (Mehra 1970). If R is too small, innovations are too large and the
filter corrects too much, so that they do not follow each other; if Q is too small, it corrects too little,
and they do. Slow errors of a measurement look like a Q that is too small, which the sentence says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import (
    NOTHING,
    Verdict,
    Weighed,
    headline,
    interval_words,
    is_right,
    size_weight,
    sorted_findings,
    wrong_direction,
    wrong_factor_interval,
)
from lab.analysis.verdicts.finding_table import FOREIGN_FINDINGS
from lab.analysis.verdicts.foreign_delay import of_delay
from lab.analysis.verdicts.foreign_evidence import FEWEST, Measurement, lag_correlation, measure_innovations
from lab.analysis.verdicts.foreign_motion import of_heading
from lab.analysis.verdicts.foreign_track import Compared, Jump, Statement, compare_positions, jumps
from lab.base.notebook_card import NotebookCard
from lab.base.numbers import format_number
from lab.data.log.filter_log import Event, FilterLog, Track
from lab.data.log.sensor_log import SensorLog

GPS = "GPS", "position", "velocity"
"""Beginnings of the names of measurements that are fixes."""

_CAREFUL = (
    "The filter overstates the σ of its innovations; in σ, their size is {sizes}. It is careful, which is no "
    "fault."
)
_Q_TOO_LARGE = (
    "The innovations of the fixes are small and alternate: the filter corrects too much. Q is too large."
)
_R_TOO_LARGE = (
    "Some of these follow each other: R is too large ({factors}), or errors of these measurements last from "
    "one to the next, which innovations hide."
)


@dataclass(frozen=True, eq=False, repr=False)
class ForeignVerdict(NotebookCard):
    """The verdict on a filter that is not ours.

    Attributes
    ----------
    log : FilterLog
        What the filter says of itself.
    measurements : tuple of Measurement
        Figures of the innovations of the lane that was used.
    verdict : Verdict
        Findings, in the words of our own verdict.
    remarks : tuple of Statement
        What accuses nobody: a filter that overstates its σ, and what is not judged.
    comparisons : tuple of Statement
        Its positions against the fixes of the log and against our smoother.
    """

    CARD: ClassVar[str] = "foreign verdict"

    log: FilterLog
    measurements: tuple[Measurement, ...]
    verdict: Verdict
    remarks: tuple[Statement, ...]
    comparisons: tuple[Statement, ...] = ()

    def __repr__(self) -> str:
        return repr(self.verdict)


def judge_foreign(
    log: FilterLog, sensors: SensorLog | None = None, further: Sequence[Compared] = ()
) -> ForeignVerdict:
    """Return the verdict on the lane of a filter that was used.

    Parameters
    ----------
    log
        What the filter says of itself.
    sensors
        The fixes of the same log, if there are any.
    further
        Comparisons of its positions with others.
    """
    found = tuple(measure_innovations(one) for one in log.lane.innovations)
    judged = [one for one in found if one.is_judged]
    weighed = [entry for one in judged for entry in _of_size(one, len(judged))]
    gnss, epoch = (None, 0.0) if sensors is None else (sensors.gnss, sensors.epoch)
    turned = [] if gnss is None else [entry for one in judged for entry in of_heading(one, gnss, epoch)]
    turned += [] if gnss is None else of_delay(judged, gnss, epoch)
    gain = None if weighed or turned else _gain(judged)  # size, heading or delay says it already
    weighed += turned + _of_gain(gain)
    weighed += [entry for one in judged for entry in _of_bias(one)]
    weighed += [entry for one in found for entry in _of_rejections(one)]
    weighed += _of_events(log)
    remarks, compared = _state_caution(judged), list(further)
    if gain is not None and gain.sigmas < 0 and gain.square < 1 / limits.VERDICT.wrong_factor:
        remarks.append(Statement(_Q_TOO_LARGE, gain.evidence))
    if sensors is not None:
        explained, statements = _by_jumps(log, found, jumps(sensors.gnss, sensors.epoch))
        weighed += explained
        remarks += statements
        fixes = None if log.lane.track is None else _against_fixes(log.lane.track, sensors)
        compared = compared if fixes is None else [fixes, *compared]
    weighed += [entry for one in compared for entry in one.weighed]
    findings = sorted_findings(weighed)
    remarks += [_state_not_judged(one) for one in found if not one.is_judged]
    remarks += _other_lanes(log)
    if not judged and not findings:
        verdict = Verdict(_too_little(found), (), NOTHING)
    else:
        verdict = Verdict(headline(findings, _describe_soundness(judged)), findings, _basis(log, judged))
    return ForeignVerdict(log, found, verdict, tuple(remarks), tuple(one.statement for one in compared))


def _against_fixes(track: Track, sensors: SensorLog) -> Compared | None:
    gnss = sensors.gnss
    time = gnss.time - gnss.latency + sensors.epoch
    arm = float(np.linalg.norm(gnss.lever_arm))
    return compare_positions(
        track, "the fixes of the log", time, gnss.position, gnss.position_sigma, gnss.velocity_n, arm
    )


def _by_jumps(
    log: FilterLog, found: Sequence[Measurement], jumped: Sequence[Jump]
) -> tuple[list[Weighed], list[Statement]]:
    """Return the jump of the receiver that explains what happened to the fixes, or that none does."""
    troubles = _list_troubles(log, found)
    for begin, end, what in troubles:
        for jump in jumped:
            if begin - limits.VERDICT.explained_within <= jump.time <= end:
                finding = FOREIGN_FINDINGS["jump"].finding(
                    jump.size,
                    f"{jump.size:.2g} m between position and velocity, {jump.usual:.2g} m usually; "
                    f"{len(jumped)} jumps in all (fixes of the log)",
                    time=jump.time,
                    size=jump.size,
                    what=what,
                )
                # It stands before what it explains.
                return [Weighed(float("inf"), finding)], []
    if not troubles:
        return [], []
    said = "The positions and the velocities of the receiver agree then: no jump of the receiver explains it."
    return [], [Statement(said, "no jump beyond the limits among the fixes of the log")]


def _list_troubles(log: FilterLog, found: Sequence[Measurement]) -> list[tuple[float, float, str]]:
    """Return when fixes were rejected or too large or positions were reset, and what to call that."""
    troubles = []
    for one in found:
        if not one.innovations.name.startswith(GPS):
            continue
        if one.apart is not None:
            troubles.append((*one.apart_times, f"the {one.innovations.name} innovations"))
        outside = one.offered.time[one.rejected]
        if outside.size > 1:
            troubles.append((float(outside[0]), float(outside[-1]), "the rejections"))
    start = max(log.fusing, log.span[0]) + limits.VERDICT.settling
    resets = [event.time for event in log.events if event.kind == "reset" and _is_fault(event, start)]
    return troubles + [(time, time, "the reset") for time in resets]


def _describe_soundness(judged: Sequence[Measurement]) -> str:
    names = ", ".join(one.innovations.name for one in judged)
    return (
        f"No finding: no innovations ({names}) are larger than the filter says, none were rejected for "
        "long, and it reported no fault."
    )


def _too_little(found: Sequence[Measurement]) -> str:
    most = max((one.count for one in found), default=0)
    return f"No verdict: {most} innovations of a measurement at most; accepted are at least {FEWEST}."


def _basis(log: FilterLog, judged: Sequence[Measurement]) -> str:
    begin, end = log.span
    count = sum(one.count for one in judged)
    return f"{count} innovations of {log.filter} ({log.lane.name}), {begin:.0f} s to {end:.0f} s"


def _evidence(one: Measurement) -> str:
    low, high = one.interval
    return (
        f"normalised mean square {format_number(one.mean_square, 3)} of {one.count} innovations, of which "
        f"{one.independent:.0f} independent values; a matched filter gives {low:.2f} to {high:.2f} "
        f"({one.innovations.source})"
    )


def _memory_words(one: Measurement) -> str:
    return f"; correlation with the next {one.lagged[0]:.2f}, {one.follows:.1f} σ over {len(one.lagged)} lags"


def _of_size(one: Measurement, tested: int) -> list[Weighed]:
    """Judge innovations that are too large: all of them, or those of a stretch."""
    kind, doubt = one.innovations.name, limits.VERDICT.doubt / tested
    if one.apart is not None:
        begin, end = one.apart_times
        ratio = float(one.apart.squares.mean)
        finding = FOREIGN_FINDINGS["stretch"].finding(
            ratio,
            f"normalised mean square {format_number(ratio, 3)} of {one.apart.squares.number:.0f} values, "
            f"logarithm of the likelihood ratio {one.apart.gain:.0f} ({one.innovations.source})",
            direction="too small", kind=kind, begin=begin, end=end, root=ratio**0.5,
        )  # fmt: skip
        return [Weighed(one.apart.gain, finding)]
    total = one.mean_square * one.independent
    if one.mean_square < 1 or is_right(total, one.independent, doubt):
        return []
    low, high = chi_square_interval(one.independent, 1, limits.VERDICT.confidence)
    interval = wrong_factor_interval(one.mean_square, total / high, total / low)
    follows = one.follows > limits.VERDICT.correlation_sigmas
    row = "size and memory" if follows else "size"
    if not one.values:
        row = "size, causes not compared"
    evidence = _evidence(one) + interval_words(interval) + (_memory_words(one) if one.values else "")
    finding = FOREIGN_FINDINGS[row].finding(
        one.mean_square, evidence, interval, direction="too small",
        kind=kind, root=one.mean_square**0.5, factor=one.mean_square, multiply=one.mean_square,
    )  # fmt: skip
    return [Weighed(size_weight(total, one.independent), finding)]


class _Gain(NamedTuple):
    """What the innovations of all fixes together say of the gain.

    Attributes
    ----------
    sigmas : float
        Their correlation in its σ: positive for a gain that is too low, negative for one too high.
    square : float
        Their normalised mean square.
    evidence : str
        Both in words.
    """

    sigmas: float
    square: float
    evidence: str


def _gain(judged: Sequence[Measurement]) -> _Gain | None:
    """Return what the fixes say of the gain; None if it may be right."""
    known = [one for one in judged if one.innovations.name.startswith(GPS) and one.values]
    if not known:
        return None
    values = sum(one.values for one in known)
    lagged = np.sum([one.values * one.lagged for one in known], axis=0) / values
    # A positive correlation lasts for several lags; an alternation may show at the first lag alone.
    over, first = lag_correlation(lagged, values), float(lagged[0] * np.sqrt(values))
    most = over if over > limits.VERDICT.gain_sigmas else min(over, first)
    if abs(most) < limits.VERDICT.gain_sigmas:
        return None
    square = sum(one.values * one.mean_square for one in known) / values
    return _Gain(
        most,
        square,
        f"correlation from one fix to the next {lagged[0]:.2f} ({first:.1f} σ; over {len(lagged)} lags "
        f"{over:.1f} σ); normalised mean square {format_number(square, 3)} "
        f"({', '.join(one.innovations.source for one in known)})",
    )


def _of_gain(found: _Gain | None) -> list[Weighed]:
    """Judge the gain of a filter whose innovations are as large as it says: others are careful."""
    if found is None or found.square < 1 / limits.VERDICT.wrong_factor:
        return []
    row = FOREIGN_FINDINGS["follows" if found.sigmas > 0 else "alternates"]
    finding = row.finding(float("nan"), found.evidence, direction=wrong_direction(found.sigmas))
    return [Weighed(found.sigmas**2 / 2, finding)]


def _of_bias(one: Measurement) -> list[Weighed]:
    found = []
    for axis, mean, sigma in zip(one.innovations.axes, one.bias, one.bias_sigma, strict=True):
        size = abs(mean) / sigma if sigma > 0 else 0.0
        if abs(mean) < limits.VERDICT.innovation_bias or size < limits.VERDICT.correlation_sigmas:
            continue
        evidence = f"mean {mean:.2f} ± {sigma:.2f} σ of {one.count} innovations ({one.innovations.source})"
        finding = FOREIGN_FINDINGS["bias"].finding(
            float(mean),
            evidence,
            kind=one.innovations.name,
            axis=f"{axis} " if axis else "",
            size=f"{mean:.2g}",
        )
        found.append(Weighed(size**2 / 2, finding))
    return found


def _of_rejections(one: Measurement) -> list[Weighed]:
    """Judge the use of measurements: a filter that rejects many does not navigate by them."""
    time, outside = one.offered.time, one.rejected
    count = int(outside.sum())
    part = count / max(len(time), 1)
    if part <= limits.VERDICT.unused_fixes or count < 2:
        return []
    edges = np.concatenate(([time[0]], time[~outside], [time[-1]]))
    finding = FOREIGN_FINDINGS["rejected"].finding(
        part,
        f"test ratio above 1 in {count} of {len(time)} innovations, {one.worst:.3g} at most "
        f"({one.innovations.source})",
        direction="rejected",
        percent=100 * part,
        kind=one.innovations.name,
        begin=float(time[outside][0]),
        longest=float(np.diff(edges).max()),
    )
    return [Weighed(float(count), finding)]


def _of_events(log: FilterLog) -> list[Weighed]:
    """Judge what the filter did in flight: position and velocity that it reset, lanes and faults."""
    found = []
    start = max(log.fusing, log.span[0]) + limits.VERDICT.settling
    for kind in ("lane", "reset", "fault", "timeout"):
        own = [event for event in log.events if event.kind == kind and _is_fault(event, start)]
        if own:
            more = f" {len(own) - 1} more of this kind follow." if len(own) > 1 else ""
            first = own[0]
            finding = FOREIGN_FINDINGS[kind].finding(float(len(own)), first.source, text=first.text + more)
            found.append(Weighed(float(len(own)) + 1, finding))
    return found


def _is_fault(event: Event, start: float) -> bool:
    """Return whether an event is a fault: start, yaw and height are aligned in flight without any."""
    if event.kind == "reset":
        return event.time > start and ("position" in event.text or "velocity" in event.text)
    return event.kind != "timeout" or event.time > start


def _state_caution(judged: Sequence[Measurement]) -> list[Statement]:
    """Return what is said of innovations that are smaller than the filter says."""
    small = [one for one in judged if _is_small(one)]
    if not small:
        return []
    sizes = ", ".join(f"{one.innovations.name} {_size_words(one)}" for one in small)
    found = [Statement(_CAREFUL.format(sizes=sizes), "; ".join(map(_short_name, small)))]
    slow = [one for one in small if one.follows > limits.VERDICT.correlation_sigmas and one.mean_square > 0]
    if slow:
        factors = ", ".join(
            f"{one.innovations.name} about {format_number(1 / one.mean_square)} times" for one in slow
        )
        evidence = "; ".join(
            f"{one.innovations.name}: {_memory_words(one).removeprefix('; ')}" for one in slow
        )
        found.append(Statement(_R_TOO_LARGE.format(factors=factors), evidence))
    return found


def _short_name(one: Measurement) -> str:
    low, high = one.interval
    return (
        f"{one.innovations.name}: normalised mean square {format_number(one.mean_square, 3)}, matched "
        f"{low:.2f} to "
        f"{high:.2f} ({one.innovations.source})"
    )


def _is_small(one: Measurement) -> bool:
    total = one.mean_square * one.independent
    return one.apart is None and one.mean_square < 1 and not is_right(total, one.independent)


def _size_words(one: Measurement) -> str:
    """Return the size of innovations in their σ; those below the steps of a log are zero."""
    return (
        format_number(one.mean_square**0.5) if one.mean_square > 0 else "too small for the steps of the log"
    )


def _state_not_judged(one: Measurement) -> Statement:
    ratio = "" if np.isnan(one.worst) else f"; its test ratio is {one.worst:.2g} at most"
    why = f"{one.count} are too few" if one.count < FEWEST else "the log does not give their variances"
    return Statement(
        f"The size of the {one.innovations.name} innovations is not judged: {why}{ratio}.",
        one.innovations.source,
    )


def _other_lanes(log: FilterLog) -> list[Statement]:
    """Return which measurements other lanes found too large."""
    found = []
    for lane in log.lanes:
        if lane is log.lane:
            continue
        large = [entry.finding for one in map(measure_innovations, lane.innovations) if one.is_judged
                 for entry in _of_size(one, len(lane.innovations))]  # fmt: skip
        found += [
            Statement(f"{lane.name.capitalize()}, not used: {one.sentence}", one.evidence) for one in large
        ]
    return found
