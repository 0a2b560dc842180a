"""Verdict: whether a filter states its errors correctly, and if not, what is wrong, in plain words.

Each statement is based on one statistic with a known distribution. It is made only if the deviation is both
beyond doubt and large enough to matter:

- *Beyond doubt.* A χ² statistic is outside its two-sided 99.8 % interval (`doubt` of `limits`), an
  explanation raises the likelihood by e¹⁰ (`likelihood_ratio`) beyond the price of its parameters, or a fix
  differs from its neighbours as one in 5 million does (`outliers`). Together they raise less than one false
  alarm in 100 runs.
- *Large enough.* A variance that is wrong by less than half (`wrong_factor`) hardly affects a filter, because
  its gain depends on the root of the variance. The same holds for a latency below 10 ms, or a lever arm below
  20 cm.

The first question is whether all values are inconsistent, or a stretch, a channel, or single fixes
(`pattern`). With the truth, each assumption has its own sample (`fix_verdict`, `sensor_verdict`,
`state_verdict`), so one wrong assumption is not mistaken for another. Innovations alone
(`innovation_verdict`) cannot distinguish all causes: a P0 or Q that is too large hardly shows.
"""

from __future__ import annotations

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.aid_verdict import judge_aids
from lab.analysis.verdicts.evidence import Evidence, Usage
from lab.analysis.verdicts.finding import (
    NOTHING,
    Finding,
    Verdict,
    Weighed,
    headline,
    judge_size,
    sorted_findings,
)
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.fix_verdict import judge_fixes
from lab.analysis.verdicts.innovation_verdict import judge_innovations
from lab.analysis.verdicts.sensor_verdict import judge_sensors
from lab.analysis.verdicts.state_verdict import judge_start, judge_states

__all__ = [
    "NOTHING",
    "Finding",
    "Verdict",
    "Weighed",
    "judge",
    "judge_size",
    "judge_usage",
]


def judge(evidence: Evidence) -> Verdict:
    """Return the verdict on one run, or on many with added evidence.

    Without a used fix, errors that the truth shows to be wrong are named; where none is, there is no verdict.
    """
    with_truth = evidence.start is not None  # also where the fixes themselves are not judged
    refused = evidence.innovations.refused if evidence.fixes is None else evidence.fixes.refused
    weighed = judge_usage(evidence.usage, refused)
    weighed += _by_truth(evidence) if with_truth else _by_innovations(evidence)
    findings = sorted_findings(weighed)
    if not evidence.usage.used and not findings:
        return Verdict("No verdict: no fix was used.", (), NOTHING)
    runs = f"{evidence.runs} run{'s' if evidence.runs > 1 else ''}"
    runs += "" if evidence.usage.used else ", no fix used"
    basis = f"{runs}, {_describe_basis(evidence) if with_truth else 'innovations only'}"
    what = "the errors match" if with_truth else "the innovations are white and match"
    return Verdict(headline(findings, f"Consistent: {what} the filter's own σ."), findings, basis)


def _describe_basis(evidence: Evidence) -> str:
    """Return what a verdict with the truth is based on: without any measurement, there are no innovations."""
    seen = evidence.usage.offered or evidence.aids.number.any()
    return "errors and innovations" if seen else "errors only"


def judge_usage(usage: Usage, refused: int) -> list[Weighed]:
    """Judge the number of fixes that the gate rejected; `refused` of them differ from their neighbours."""
    unused = usage.rejected - usage.expected
    beyond = usage.rejected > usage.expected + limits.VERDICT.correlation_sigmas * np.sqrt(usage.expected + 1)
    if not usage.offered or unused <= limits.VERDICT.unused_fixes * usage.offered or not beyond:
        return []
    part = usage.rejected / usage.offered
    finding = FINDINGS[
        "refused outliers" if refused >= limits.VERDICT.rightly_rejected * usage.rejected else "gate"
    ].finding(
        part,
        f"{usage.rejected} rejected, expected {usage.expected:.2g}",
        direction="rejected",
        rejected=usage.rejected,
        offered=usage.offered,
        percent=100 * part,
        expected=usage.expected,
    )
    return [Weighed(float(unused), finding)]


def _by_innovations(evidence: Evidence) -> list[Weighed]:
    found = judge_innovations(evidence) + judge_aids(evidence.aids)
    # Of a single run, they were judged above, by the figures that tell causes apart.
    return found or (judge_states(evidence) if evidence.runs > 1 else [])


def _by_truth(evidence: Evidence) -> list[Weighed]:
    found = [] if evidence.sensors is None else judge_sensors(evidence.sensors)
    assert evidence.start is not None
    # The effect of the specific force on the gyros looks like an unexpected initial bias.
    g_sensitive = any(entry.finding.quantity == "gyro g-sensitivity" for entry in found)
    found += judge_start(evidence.start, without=("gyro bias",) if g_sensitive else ())
    found += _fixes_by_truth(evidence)
    aids = judge_aids(evidence.aids)
    if any(entry.finding.direction != "too large" for entry in found):
        # Such errors, those of the fixes too, move the navigator off what other sensors rightly measure.
        aids = [entry for entry in aids if entry.finding.direction == "too large"]
    found += aids
    if not found and evidence.fixes is None:
        found = judge_innovations(evidence)
    return found or judge_states(evidence)


def _fixes_by_truth(evidence: Evidence) -> list[Weighed]:
    """Judge the errors of the fixes, unless the filter estimates a part of them."""
    if evidence.fixes is None:
        return []
    sizes = np.sqrt(evidence.innovations.squares.mean.reshape(2, 3).mean(axis=1))
    return judge_fixes(evidence.fixes, sizes, evidence.assumed.values.mean(axis=0))
