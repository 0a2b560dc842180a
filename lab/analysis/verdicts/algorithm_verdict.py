"""Algorithm verdict: whether the covariance and innovations of a user's algorithm are consistent.

Its assumptions about sensors, start and fixes are unknown, so the verdict does not name Q, P₀ or R. It only
states whether errors and innovations are as large as the algorithm states, and whether the innovations are
white.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lab.analysis import consistency
from lab.analysis.verdicts import limits, verdict
from lab.analysis.verdicts.agreement import FigureWording, judge_agreement
from lab.analysis.verdicts.evidence import Evidence, Reference, state_means, usage
from lab.analysis.verdicts.finding import (
    NOTHING,
    Verdict,
    Weighed,
    headline,
    judge_size,
    sorted_findings,
    wrong_direction,
)
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.innovation_evidence import nis_means, none_given, sizes
from lab.analysis.verdicts.sums import Squares
from lab.base.arrays import FloatArray
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.solution import Solution


@dataclass(frozen=True)
class AlgorithmEvidence(Evidence):
    """The evidence of runs of a user's algorithm: none on fixes, noise and start."""


def algorithm_evidence(
    solution: Solution, time: FloatArray, span: tuple[float, float], reference: Reference | None
) -> AlgorithmEvidence:
    """Return the evidence of a run of a user's algorithm, from its covariance and innovations.

    Parameters
    ----------
    solution
        Its solution; arrays that it did not return are NaN and have no effect.
    time : (m,) array
        Times of all fixes [s].
    span
        Start and end of the flight [s].
    reference
        The truth; None if unknown.
    """
    used = np.flatnonzero(solution.fix_sample >= 0)
    given = used[np.isfinite(solution.innovation[used]).all(axis=1)]
    nu, S = solution.innovation[given], solution.innovation_covariance[given]
    squares, sums, lagged = sizes(nu / np.sqrt(np.diagonal(S, axis1=1, axis2=2)))
    nis = consistency.normalised_squares(nu, S)
    has_covariance = used.size > 0 and bool(np.isfinite(solution.fix_covariance[used]).all())
    found = AlgorithmEvidence(
        runs=1,
        innovations=replace(
            none_given(squares, sums, lagged, nis_means(time[given], nu, S, np.isfinite(nu), span)),
            nis=Squares(np.array(nis.sum()), np.array(float(MEASUREMENTS * nis.size))),
        ),
        usage=usage(solution, 0.0),
    )
    if not has_covariance or reference is None:
        return found
    samples = np.maximum(solution.fix_sample[used], 0)
    return replace(found, states=state_means(solution, used, samples, reference))


def judge(evidence: Evidence) -> Verdict:
    """Return the verdict on runs of the lab's own filter, or of a user's algorithm."""
    if not isinstance(evidence, AlgorithmEvidence):
        return verdict.judge(evidence)
    parts = {"errors": evidence.nees is not None, "innovations": bool(evidence.innovations.nis.number)}
    judged = " and ".join(name for name, known in parts.items() if known)
    if not judged:
        return Verdict("Unknown: there is neither a covariance nor an innovation at any fix.", (), NOTHING)
    weighed = _gain(evidence)
    if evidence.nees is not None:
        weighed += judge_size(evidence.nees, FINDINGS["covariance"], "errors")
    weighed += judge_size(evidence.innovations.nis, FINDINGS["innovation covariance"], "innovations")
    worded = FigureWording(FINDINGS["unexplained of an algorithm"])
    findings = sorted_findings(weighed or judge_agreement(evidence.means, worded))
    said = headline(findings, f"Consistent: {judged} are as large as the algorithm states.")
    runs = f"{evidence.runs} run{'s' if evidence.runs > 1 else ''}"
    return Verdict(said, findings, f"{runs}, {judged}{'' if all(parts.values()) else ' only'}")


def _gain(evidence: AlgorithmEvidence) -> list[Weighed]:
    """Judge the gain: innovations are correlated if it is too low, and alternate if it is too high."""
    seen = evidence.innovations
    power = seen.squares.total.reshape(2, 3).sum(axis=1)
    after = seen.lagged.reshape(-1, 2, 3).sum(axis=2) / np.maximum(power, 1e-12)
    count = float(seen.squares.number.sum()) / 2
    # A positive correlation lasts for several lags; an alternation shows at the first lag.
    follows = float((after.sum(axis=0) * np.sqrt(count / after.shape[0])).max())
    alternates = float((after[0] * np.sqrt(count)).min())
    most = follows if follows > -alternates else alternates
    if abs(most) < limits.VERDICT.correlation_sigmas:
        return []
    finding = FINDINGS["low gain of an algorithm" if most > 0 else "high gain of an algorithm"].finding(
        float("nan"),
        f"correlation from fix to fix {after[0, 0]:.2f} (position), {after[0, 1]:.2f} (velocity)",
        direction=wrong_direction(most),
    )
    return [Weighed(most**2 / 2, finding)]
