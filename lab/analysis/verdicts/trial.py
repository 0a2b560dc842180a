"""Trial: advice is tried before it is given, in a run with the advised settings.

Three figures judge the run, and none of them needs the truth: NIS over its degrees of freedom, the
correlation of the innovations from fix to fix, and the errors relative to the fixes withheld in artificial
outages of `OUTAGE` every `EVERY`. Advice that makes any of them worse, or none better, is not given.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import TRIED
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.finding import Change, Finding, Verdict, headline
from lab.analysis.verdicts.run_evidence import Filtered
from lab.analysis.verdicts.verdict import judge
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.base.parameters.setting_error import SettingError
from lab.motion.frames.displacement import displaced, displacement
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_quaternion
from lab.navigation.belief import r_factors
from lab.navigation.checks import DivergedError
from lab.navigation.filters.blocks import GPS_DRIFT, IMU_DENSITIES, find_states
from lab.run.experiment_settings import ExperimentSettings
from lab.run.run import Run

OUTAGE, EVERY = 10.0, 60.0
"""Length of the artificial outages, and time from one to the next [s]."""
SPREAD = np.sqrt(2 / 6)
"""σ of the NIS per degree of freedom of one fix: the variance of χ² is twice its six degrees of freedom."""

_TRYING = "Trying the advice"


class Figures(NamedTuple):
    """The figures of a run, or of several, that do not need the truth.

    Attributes
    ----------
    nis : float
        NIS over its degrees of freedom, for all offered fixes.
    correlation : float
        Largest absolute correlation of a kind of innovation from one fix to the next.
    outages : (k,) array
        Rms of the position errors in each outage, relative to the fixes withheld in it [m]; NaN without any,
        infinite if the run diverges without them. Empty if the flight is too short.
    fixes : float
        Number of fixes for NIS and the correlation.
    """

    nis: float
    correlation: float
    outages: FloatArray
    fixes: float

    @property
    def held_out(self) -> float:
        """Rms of the position errors across all outages [m]; NaN without one."""
        known = self.outages[~np.isnan(self.outages)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


class Repeatable(Run, ABC):
    """A run that can be repeated with other settings, and gives evidence about its filter."""

    @property
    @abstractmethod
    def epoch(self) -> float:
        """Time 0 in the clock of the outages [s]; for a log, the clock of its file."""

    @property
    @abstractmethod
    def evidence(self) -> Evidence:
        """The evidence of this run for each assumption of the filter; for a log, from its innovations."""

    @property
    @abstractmethod
    def filtered(self) -> Filtered:
        """The filter's own run: for a smoothed run, its forward run, otherwise the solution."""

    @abstractmethod
    def repeated(self, experiment: ExperimentSettings) -> Repeatable:
        """Return the run with a changed copy of its settings."""


def can_be_tried(verdict: Verdict, algorithm: str) -> bool:
    """Return whether any advice names settings to try; false for a user's own navigator."""
    return not algorithm and any(finding.changes for finding in verdict.findings)


def try_advice(
    verdict: Verdict, runs: Sequence[Repeatable], progress: Callable[[str, float], None] | None = None
) -> Verdict:
    """Return a verdict with the effect of its advice.

    Each finding whose advice names settings takes two runs for each of `runs`, and the first one a third.

    Parameters
    ----------
    verdict
        The verdict on these runs, or on these and others with the same settings.
    runs
        Runs on which the advice is tried; the figures are their averages.
    progress
        Called before each trial with a phrase and the fraction done, from 0 to 1.
    """
    tell = progress or (lambda _phrase, _done: None)
    with_changes = [finding for finding in verdict.findings if finding.changes]
    if not with_changes:
        return verdict
    tell(_TRYING, 0.0)
    before = average([figures(run) for run in runs])
    together = _describe_joint_effect(with_changes, runs, before, tell) if len(with_changes) > 1 else ""
    found, useless = [], []
    for number, finding in enumerate(verdict.findings):
        if not finding.changes or (together and finding is not with_changes[-1]):
            found.append(finding)
        elif together:  # the effect of all advice stands once, behind the last of it
            found.append(replace(finding, advice=_describe_row("better together", finding, effect=together)))
        else:
            tell(_TRYING, (number + 1) / (len(verdict.findings) + 1))
            after = _try_finding(finding, runs, before)
            useless += [len(found)] if after.advice == TRIED["useless"] else []
            found.append(after)
    for again in useless[1:]:  # once is enough
        found[again] = replace(found[again], advice="")
    findings = tuple(found)
    return Verdict(headline(findings, verdict.headline), findings, verdict.basis, together=bool(together))


def _describe_joint_effect(
    findings: list[Finding], runs: Sequence[Repeatable], before: Figures, tell: Callable[[str, float], None]
) -> str:
    """Return the effect of all advice together as text; empty if it makes anything worse, or nothing better.

    If one fault hides another, the advice for it alone can make things worse.
    """
    changes = tuple(change for finding in findings for change in finding.changes)
    tell(_TRYING, 0.1)
    try:
        after = [run.repeated(apply_changes(run, changes)) for run in runs]
        there = average([figures(run) for run in after])
    except (SettingError, ValueError):
        return ""
    if describe_worsened(before, there) or not _has_helped(findings, before, there, after):
        return ""
    return _describe(before, there)


def _try_finding(finding: Finding, runs: Sequence[Repeatable], before: Figures) -> Finding:
    """Return a finding with the effect of its advice, or without its advice."""
    try:
        after = [run.repeated(apply_changes(run, finding.changes)) for run in runs]
        there = average([figures(run) for run in after])
    except (SettingError, ValueError) as error:
        return replace(finding, advice=_describe_row("refused", finding, error=error), changes=())
    worse = describe_worsened(before, there)
    if worse:
        return replace(finding, advice=_describe_row("worse", finding, worse=worse), changes=())
    if not _has_helped([finding], before, there, after):
        return replace(finding, advice=TRIED["useless"], changes=())
    return replace(finding, advice=_describe_row("better", finding, effect=_describe(before, there)))


def _describe_row(row: str, finding: Finding, **fields: object) -> str:
    return TRIED[row].format(advice=finding.advice, **fields)


def _has_helped(
    findings: Sequence[Finding], before: Figures, there: Figures, after: Sequence[Repeatable]
) -> bool:
    """Return whether advice improved a figure, or with the truth, removed one of its findings.

    Errors that the filter states wrongly need not show in the innovations, such as those of the start.
    """
    if has_improved(before, there):
        return True
    evidence = [run.evidence for run in after]
    if any(one.start is None for one in evidence):
        return False
    left = judge(reduce(add, evidence[1:], evidence[0])).findings
    return any(
        (one.quantity, one.direction) not in {(o.quantity, o.direction) for o in left} for one in findings
    )


def has_improved(before: Figures, after: Figures) -> bool:
    """Return whether a figure became better, by more than counts as a change."""
    return bool(
        abs(np.log(max(after.nis, 1e-9))) < abs(np.log(max(before.nis, 1e-9))) - limits.VERDICT.figure_change
        or after.correlation < before.correlation - limits.VERDICT.figure_change
        or after.held_out < before.held_out / limits.VERDICT.worse_factor
    )


def describe_worsened(before: Figures, after: Figures) -> str:
    """Return the figures that became worse, as text; empty if none did."""
    found = []
    by_chance = limits.VERDICT.figure_sigmas / np.sqrt(max(after.fixes, 1.0))
    off = abs(np.log(max(after.nis, 1e-9)))
    if off > max(by_chance * SPREAD, abs(np.log(max(before.nis, 1e-9))) + limits.VERDICT.figure_change):
        found.append(f"NIS per degree of freedom ({before.nis:.2f}, then {after.nis:.2f})")
    if after.correlation > max(by_chance, before.correlation + limits.VERDICT.figure_change):
        found.append(
            f"the correlation of the innovations ({before.correlation:.2f}, then {after.correlation:.2f})"
        )
    if _outage_errors_grew(before, after):
        found.append(
            f"the error across outages of {OUTAGE:.0f} s ({metres(before.held_out)}, then "
            f"{metres(after.held_out)})"
        )
    return " and ".join(found)


def _outage_errors_grew(before: Figures, after: Figures) -> bool:
    """Return whether the errors across outages grew, by more than they scatter from one to another."""
    if not after.held_out > limits.VERDICT.worse_factor * before.held_out:
        return False
    if not np.isfinite(after.held_out):
        return True
    growth = measure_growth(before.outages, after.outages)
    return (
        growth is not None
        and growth[0] > np.log(limits.VERDICT.worse_factor) + limits.VERDICT.likely_errors * growth[1]
    )


def measure_growth(before: FloatArray, after: FloatArray) -> tuple[float, float] | None:
    """Return the mean logarithm of the growth of the errors of outages (k,), and its standard error.

    None without an outage that has errors before and after.
    """
    # Another latency moves the fixes, so an outage may lose its only one, and the last one may fit no more.
    pairs = zip(before, after, strict=False)
    growth = np.array([np.log(max(then, 1e-9) / max(was, 1e-9)) for was, then in pairs])
    growth = growth[~np.isnan(growth)]
    if not growth.size:
        return None
    # With few outages their scatter is hardly known: the usual one stands for some further ones.
    scatter = limits.VERDICT.outage_weight * limits.VERDICT.outage_scatter**2 + np.sum(
        (growth - growth.mean()) ** 2
    )
    return float(growth.mean()), float(
        np.sqrt(scatter / (limits.VERDICT.outage_weight + growth.size - 1) / growth.size)
    )


def _describe(before: Figures, after: Figures) -> str:
    words = [
        f"NIS per degree of freedom {before.nis:.2f}, then {after.nis:.2f}",
        f"correlation of the innovations {before.correlation:.2f}, then {after.correlation:.2f}",
    ]
    if not np.isnan(before.held_out):
        was, becomes = metres(before.held_out), metres(after.held_out)
        words.append(f"error across outages of {OUTAGE:.0f} s: {was}, then {becomes}")
    return "; ".join(words)


def metres(error: float) -> str:
    """Return an error as text; it is infinite where a run diverges."""
    return f"{format_number(error)} m" if np.isfinite(error) else "without bound"


def apply_changes(run: Repeatable, changes: tuple[Change, ...]) -> ExperimentSettings:
    """Return the experiment of a run with some settings changed.

    Matched matrices are replaced by the filter's, without its further states; for the fixes of a log, which
    have their own σ, by the mean.
    """
    experiment, assumed = run.experiment.copy(), run.belief
    navigator = experiment.navigator
    R = assumed.R if assumed.R.ndim == 2 else assumed.R.mean(axis=0)
    P0 = assumed.P0[: navigator.states, : navigator.states]
    variances = np.diag(P0)
    P0 = variances if np.array_equal(np.diag(variances), P0) else P0
    matched = {
        "navigator.r": np.diag(R) / r_factors(navigator),
        "navigator.q": assumed.noise[:IMU_DENSITIES] / navigator.q_scale,
        "navigator.p0": P0 / navigator.p0_scale,
    }
    for change in changes:
        value = change.value
        if change.times:
            assert isinstance(value, float | int)
            own = experiment.get(change.path)
            if change.rows is None:
                value = float(f"{float(own) * value:.12g}")  # 0.1 × 9.8 is 0.98, and not 0.9800000000000001
            else:
                now = np.array(matched[change.path] if own is None else own, dtype=np.float64)
                scale = np.ones(now.shape[0])
                scale[slice(*change.rows)] = value
                # A covariance changes by the root of each factor, so that correlations stay.
                root = np.sqrt(scale)
                value = (now * scale if now.ndim == 1 else now * root[:, None] * root).tolist()
        experiment.set(change.path, value)
    return experiment


def figures(run: Repeatable) -> Figures:
    """Return the figures of a run, without the truth."""
    return figures_of_evidence(run.evidence)._replace(outages=held_out(run))


def figures_of_evidence(evidence: Evidence) -> Figures:
    """Return the figures of a run from its evidence, without those of outages."""
    seen = evidence.innovations
    power = seen.squares.total.reshape(2, 3).sum(axis=1)
    after = seen.lagged[0].reshape(2, 3).sum(axis=1) / np.maximum(power, 1e-12)
    return Figures(float(seen.nis.mean), float(np.abs(after).max()), np.zeros(0), float(seen.nis.number) / 6)


def average(of: Sequence[Figures]) -> Figures:
    """Return the figures of several runs together."""
    nis, correlation, outages, fixes = zip(*of, strict=True)
    return Figures(
        float(np.average(nis, weights=np.maximum(fixes, 1.0))),
        float(np.mean(correlation)),
        np.concatenate(outages),
        float(sum(fixes)),
    )


def held_out(run: Repeatable, earlier: float = 0.0, length: float = OUTAGE) -> FloatArray:
    """Return the rms position error in each artificial outage, relative to the fixes withheld there (k,) [m].

    They are infinite where the run diverges without these fixes, NaN where there are none, and the array is
    empty if the flight is too short. The second half of each outage counts, where the errors have grown. A
    filter that estimates the drift of the receiver predicts fixes with it.

    Parameters
    ----------
    run
        The run.
    earlier
        By how much earlier all outages end [s].
    length
        Length of the outages [s].
    """
    begin, end = float(run.time[0]), float(run.time[-1])
    starts = np.arange(begin + EVERY - length - earlier, end - length, EVERY)
    outages = [[float(start), float(start + length)] for start in starts]
    experiment = run.experiment.copy()
    experiment.set("navigator.smoother", False)
    made = [[start + run.epoch, end + run.epoch] for start, end in outages]
    experiment.set("sensors.gps.outages", [*map(list, experiment.sensors.gps.outages), *made])
    fixes, times = run.fixes, run.fix_validity
    since = times[:, None] - starts
    withheld = (since > length / 2) & (since <= length)  # (fix, outage)
    chosen, counts = withheld.any(axis=1), withheld.sum(axis=0)
    if not chosen.any():
        return np.full(starts.size, np.nan)
    try:
        coasted = run.repeated(experiment)
    except DivergedError:
        return np.where(counts > 0, np.inf, np.nan)
    solution, time = coasted.solution_arrays, coasted.time
    at = times[chosen]
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    part = ((at - time[after - 1]) / np.maximum(time[after] - time[after - 1], 1e-9))[:, None]
    before = solution.position[after - 1]
    there = displaced(before, part * displacement(before, solution.position[after]))
    arm = C_nb_from_euler(euler_from_quaternion(solution.q_nb[after])) @ coasted.belief.lever_arm
    error = arm + _receiver_drift(coasted, after) - displacement(there, fixes.position[chosen])
    squares = np.sum(error**2, axis=1) @ withheld[chosen]
    return np.asarray(np.sqrt(squares / np.where(counts > 0, counts, np.nan)))


def _receiver_drift(run: Repeatable, samples: NDArray[np.intp]) -> FloatArray:
    """Return the estimated drift of the receiver (m, 3) at some samples [m]; zero if it is no state."""
    if GPS_DRIFT not in run.blocks:
        return np.zeros((samples.size, 3))
    solution = run.solution_arrays
    own = find_states(run.blocks, GPS_DRIFT)
    first = solution.states - solution.further.shape[1]
    return np.asarray(solution.further[samples, own.start - first : own.stop - first])
