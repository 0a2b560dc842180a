"""Linear verdict: attitude errors beyond the linear model of the filter, as the cause of an inconsistency.

References
----------
A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable observer*, IEEE Trans. AC 62 (2017):
the invariant error, whose model does not depend on the estimate.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.evidence import Evidence, Linearity
from lab.analysis.verdicts.finding import Finding, Verdict, Wording, headline
from lab.analysis.verdicts.finding_table import AID_NOISE, FINDINGS, LINEAR_MODEL, UNEXPLAINED
from lab.analysis.verdicts.run_means import NEES, Figure, RunMeans
from lab.analysis.verdicts.trial import figures_of_evidence, has_improved
from lab.navigation.filters.error_models import ACCEL_BIAS
from lab.navigation.settings import NavigatorSettings

PERTURBED = ("phi", "psi")
"""Models whose F holds for small attitude errors only."""
HOLDING = "invariant"
"""The model of the run that tells other causes from a start that is too uncertain."""
CURES = {
    "phi": ("invariant", "nonlinear"),
    "psi": ("invariant", "nonlinear"),
    "invariant": ("nonlinear",),
    "nonlinear": (),
}
"""Models that are tried where errors larger than σ have no other cause, in this order."""
_CONSEQUENCES = (*UNEXPLAINED, *AID_NOISE, LINEAR_MODEL)
"""Findings that a wrong attitude causes."""


def is_wide(start: float, navigator: NavigatorSettings) -> bool:
    """Return whether the attitude is too uncertain at the start for the model, given its largest σ [rad]."""
    return navigator.model in PERTURBED and start > limits.VERDICT.wide_attitude


def judge(
    verdict: Verdict,
    evidence: Evidence,
    navigator: NavigatorSettings,
    held: Callable[[], tuple[Verdict, Evidence] | None] = lambda: None,
    repeated: Callable[[str], tuple[float, float] | None] = lambda _model: None,
) -> Verdict:
    """Return the verdict, with the linear model as a cause of inconsistency if it is one.

    From a start that is too uncertain, no run is consistent: it may be right by chance alone. Causes that
    have a sample of their own can then be told, which needs the truth. Without the truth, a run whose model
    holds from such a start tells them: the start explains only what is not there.

    Parameters
    ----------
    verdict
        The verdict from the evidence.
    evidence
        The evidence.
    navigator
        The filter.
    held
        Returns the verdict on the innovations of the same run with the model `HOLDING`, and its evidence, or
        None if it cannot be navigated. Called only for inconsistent innovations from a start that is too
        uncertain for the model of the filter, but not for `HOLDING`.
    repeated
        Returns mean NEES over its degrees of freedom of the runs that are off most, as they are and with the
        named model, or None if they cannot be navigated with it. Called only for errors larger than σ that
        have no other cause.
    """
    found = evidence.linearity
    if found is None or verdict.consistent is None:  # of a user's algorithm, or without a fix
        return verdict
    start = float(np.median(found.start.values))
    if is_wide(start, navigator) and not any(_is_start_too_wide(one) for one in verdict.findings):
        return _add_findings(_from_wide_start(verdict, evidence, _of_start(start, navigator), held), verdict)
    unexplained = all(one.quantity in UNEXPLAINED for one in verdict.findings)
    if not verdict.findings or not unexplained or navigator.model == "nonlinear":
        return verdict
    cause = _in_flight(found, evidence, navigator, verdict) or _advise_other_model(
        repeated, evidence, navigator, verdict
    )
    return verdict if cause is None else _add_findings((cause,), verdict)


def _in_flight(
    found: Linearity, evidence: Evidence, navigator: NavigatorSettings, verdict: Verdict
) -> Finding | None:
    """Return the finding of attitude errors that are large by their σ, if they are."""
    largest, neglected = float(np.median(found.largest.values)), float(found.neglected.values.mean())
    if largest > limits.VERDICT.wide_attitude and navigator.model in PERTURBED:
        return _of_flight(largest, navigator, verdict)
    if (
        neglected
        > max(
            limits.VERDICT.neglected_square, limits.VERDICT.neglected_part * _bias_nees_excess(evidence.means)
        )
        and verdict.findings[0].direction == "too large"
    ):
        return _of_products(neglected, navigator, verdict)
    return None


def _advise_other_model(
    repeated: Callable[[str], tuple[float, float] | None],
    evidence: Evidence,
    navigator: NavigatorSettings,
    verdict: Verdict,
) -> Finding | None:
    """Return the finding of errors that are larger than σ with this model, and not with another."""
    if evidence.states is None or verdict.findings[0].direction != "too large":
        return None
    for model in CURES[navigator.model]:
        means = repeated(model)
        if means is not None and means[1] - 1 < (1 - limits.VERDICT.cured_part) * (means[0] - 1):
            return _of_model(model, *means, verdict)
    return None


def _from_wide_start(
    verdict: Verdict,
    evidence: Evidence,
    of_start: Finding,
    held: Callable[[], tuple[Verdict, Evidence] | None],
) -> tuple[Finding, ...]:
    """Return the findings of a run from a start that is too uncertain, the start last if it has an effect."""
    if evidence.start is not None:
        return (*_causes(verdict), of_start)
    can_be_held = verdict.findings and of_start.factor <= limits.VERDICT.held_attitude
    there = held() if can_be_held else None
    others = () if there is None else _causes(there[0])
    if (
        there is None
        or not others
        or has_improved(figures_of_evidence(evidence), figures_of_evidence(there[1]))
    ):
        return (*others, of_start)
    return others


def _causes(verdict: Verdict) -> tuple[Finding, ...]:
    """Return the findings that a wrong attitude does not cause."""
    return tuple(one for one in verdict.findings if one.quantity not in _CONSEQUENCES)


def _is_start_too_wide(finding: Finding) -> bool:
    """Return whether the attitude at the start is known better than P0 says: then the model holds."""
    return finding.quantity in ("P0", "P0 attitude") and finding.direction == "too large"


def _add_findings(findings: tuple[Finding, ...], verdict: Verdict) -> Verdict:
    return Verdict(headline(findings, ""), findings, verdict.basis)


def _bias_nees_excess(means: RunMeans) -> float:
    """Return by how much NEES of the accelerometer biases exceeds their number; zero if it is unknown."""
    figure = Figure(NEES, "accelerometer bias")
    if figure not in means.figures:
        return 0.0
    mean = float(means.together(means.figures.index(figure)).mean)
    return (ACCEL_BIAS.stop - ACCEL_BIAS.start) * (mean - 1)


def remark(start: float, navigator: NavigatorSettings) -> str:
    """Return a sentence about a start that is too uncertain for the model; empty if it is not.

    Parameters
    ----------
    start
        Largest σ of the attitude at the start [rad].
    navigator
        The filter.
    """
    if not is_wide(start, navigator):
        return ""
    limit = np.degrees(limits.VERDICT.wide_attitude)
    return (
        f"The attitude is uncertain by {np.degrees(start):.3g}° (1 σ) at the start, but the error model "
        f"{navigator.model} is linear only up to {limit:.0f}°: its σ may not describe its errors. "
        "navigator.model = invariant or nonlinear holds for large attitude errors."
    )


def _word_for_model(row: str, navigator: NavigatorSettings) -> Wording:
    """Return a row of the table of findings, with the model that holds where that of the filter does not."""
    wording = FINDINGS[row]
    return wording if navigator.model in PERTURBED else wording.with_advice(ADVICE["nonlinear model"])


def _of_start(start: float, navigator: NavigatorSettings) -> Finding:
    degrees, limit = np.degrees((start, limits.VERDICT.wide_attitude))
    return _word_for_model("linear model at the start", navigator).finding(
        start,
        f"σ of the attitude at the start {degrees:.3g}°, limit {limit:.0f}°",
        degrees=degrees,
        model=navigator.model,
    )


def _of_flight(largest: float, navigator: NavigatorSettings, verdict: Verdict) -> Finding:
    degrees, limit = np.degrees((largest, limits.VERDICT.wide_attitude))
    return _word_for_model("linear model in flight", navigator).finding(
        largest,
        f"σ of the attitude {degrees:.3g}°, limit {limit:.0f}°; {verdict.findings[0].evidence}",
        degrees=degrees,
        model=navigator.model,
    )


def _of_products(neglected: float, navigator: NavigatorSettings, verdict: Verdict) -> Finding:
    size = float(np.sqrt(neglected))
    return _word_for_model("neglected products", navigator).finding(
        size,
        f"mean square of the neglected acceleration in σ of the accelerometer biases {neglected:.2g}, limit "
        f"{limits.VERDICT.neglected_square:g}; {verdict.findings[0].evidence}",
        size=size,
        effect=f"{verdict.findings[0].sentence.split('. ')[0]}.",
    )


def _of_model(model: str, before: float, after: float, verdict: Verdict) -> Finding:
    advice = ADVICE["nonlinear model" if model == "nonlinear" else "hold large errors"]
    return (
        FINDINGS["cured by another model"]
        .with_advice(advice)
        .finding(
            before,
            f"mean NEES over its degrees of freedom {before:.3g}, {after:.3g} with {model}; "
            f"{verdict.findings[0].evidence}",
            model=model,
            before=before,
            after=after,
            effect=f"{verdict.findings[0].sentence.split('. ')[0]}.",
        )
    )
