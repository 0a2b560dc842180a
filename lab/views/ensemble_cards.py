"""Ensemble cards: what a notebook shows of compared models, an ensemble and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from lab.analysis.verdicts.finding import Finding, Verdict
from lab.experiment.ensembles.comparison import Compared, Comparison
from lab.experiment.ensembles.ensemble import Ensemble
from lab.views.mission_card import title_of_mission

SETTLED = 20.0
"""Time after which the averages inside their intervals are counted [s]."""
BY_CHANCE = 0.05
"""Part of the averages of a matched filter that is outside a 95 % interval."""


def scroll_box(table: str, label: str) -> str:
    """Return a table that scrolls sideways within its box where that is narrow, also by keys.

    Parameters
    ----------
    table
        Its HTML.
    label
        Name of the box for who hears the page.
    """
    return (
        '<div style="overflow-x:auto;max-width:100%" tabindex="0" role="region" '
        f'aria-label="{escape(label)}">{table}</div>'
    )


def comparison_html(comparison: Comparison) -> str:
    """Return a comparison as HTML."""
    return (
        f"{scroll_box(models_html(comparison), 'Comparison')}"
        "<p>The errors are root mean squares over all runs. NEES and NIS are means, beside their expected "
        "values. The time is that of the navigator for one flight.</p>"
    )


def models_html(rows: Sequence[Compared]) -> str:
    """Return compared models as an HTML table."""
    head = "".join(
        f"<th>{name}</th>"
        for name in ("position [m]", "velocity [m/s]", "heading [°]", "NEES", "NIS", "time [ms]")
    )
    return (
        f'<table><tr><th>model</th>{head}<th class="words">verdict</th></tr>'
        f"{''.join(_row(row) for row in rows)}</table>"
    )


def _row(row: Compared) -> str:
    name = escape(row.model)
    if row.refusal:
        return f"<tr><td>{name}</td>{'<td>–</td>' * 6}{_describe(f'Does not run: {row.refusal}')}</tr>"
    figures = (
        *(
            f"{error:.3f}" if np.isfinite(error) else "–"
            for error in (row.position, row.velocity, row.heading)
        ),
        f"{row.nees:.1f} / {row.degrees}" if np.isfinite(row.nees) else "unknown",
        f"{row.nis:.1f} / {row.nis_degrees}" if np.isfinite(row.nis) else "unknown",
        f"{1e3 * row.seconds:.0f}",
    )
    cells = "".join(f"<td>{figure}</td>" for figure in figures)
    return f"<tr><td>{name}</td>{cells}{_describe(row.verdict)}</tr>"


def _describe(text: str) -> str:
    # JupyterLab does not break the lines of a table by itself, and its cells are right-aligned.
    return f'<td class="words" style="text-align:left;white-space:normal;min-width:18em">{escape(text)}</td>'


def ensemble_html(ensemble: Ensemble) -> str:
    """Return many runs as HTML."""
    seeds = ensemble.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} runs, seeds {seeds[0]} to {seeds[-1]}"
    who = f", {ensemble.algorithm}" if ensemble.algorithm else ""
    shown = ensemble.coverage.copy()
    # A column for the units made the table wider than a notebook beside a side bar.
    shown["quantity"] += " [" + shown.pop("unit") + "]"
    table = shown.to_html(index=False, border=0, float_format=lambda value: f"{value:.3g}", na_rep="unknown")
    return (
        f"<h4>{escape(title_of_mission(ensemble.experiment.mission))}, {which}{escape(who)}</h4>"
        f"{verdict_html(ensemble.verdict)}<p>{escape(ensemble.remark)} "
        f"{describe_coverage(ensemble)}</p>{table}"
        "<p>The root mean square is that of the whole flights; the other columns are those of the errors "
        "after the fixes.</p>"
    )


def describe_coverage(ensemble: Ensemble) -> str:
    """Return how often the averages over the runs are in their 95 % intervals, and what chance explains."""
    parts = {
        name: part
        for name, part in zip(("NEES", "NIS"), ensemble.inside(SETTLED), strict=True)
        if np.isfinite(part)
    }
    if not parts:
        return "NEES and NIS are unknown."
    shares = " and ".join(f"{100 * part:.0f} % ({name})" for name, part in parts.items())
    explained = " and ".join(f"{_by_chance(part)} ({name})" for name, part in parts.items())
    return (
        f"After {SETTLED:g} s, the average over the runs is in its 95 % interval at {shares} of the fixes. "
        f"Of the fixes outside, chance explains {explained}. Chance puts 5 % of all fixes there on average; "
        "in one flight, it puts more or fewer there, because neighbouring fixes share their errors."
    )


def _by_chance(part: float) -> str:
    """Return which part of the fixes outside chance explains, given the part inside."""
    outside = 1 - part
    return "all" if outside <= BY_CHANCE else f"{100 * BY_CHANCE / outside:.0f} %"


SIGNS = {True: ("#1a8f4c", "✓"), False: ("#b3541e", "✗"), None: ("#777", "?")}
"""Colour and sign of a consistent, a wrong and an unknown filter; all are readable on white and on black."""


def verdict_html(verdict: Verdict) -> str:
    """Return a verdict as HTML."""
    colour, sign = SIGNS[verdict.consistent]
    # The headline is the sentence of the first finding.
    findings = "".join(
        f"<li>{escape(finding.sentence) if number else ''} {_advice(finding)}</li>"
        for number, finding in enumerate(verdict.findings)
    )
    findings += "".join(
        f"<li>{escape(one.sentence)} {_format_counsel(one.counsel)}</li>" for one in verdict.suggestions
    )
    return (
        f'<div style="border-left:4px solid {colour};padding:.2em .8em;max-width:60em">'
        f'<b><span style="color:{colour}">{sign}</span> {escape(verdict.headline)}</b>'
        f"{f'<ul>{findings}</ul>' if findings else ''}"
        f'<p style="opacity:.75;margin:.3em 0 0">Judged by {escape(verdict.basis)}.</p></div>'
    )


def _advice(finding: Finding) -> str:
    evidence = f'<span style="opacity:.75">Evidence: {escape(finding.evidence)}.</span>'
    return f"{_format_counsel(finding.counsel)} {evidence}"


def _format_counsel(counsel: str) -> str:
    return escape(counsel).replace("Try:", "<b>Try:</b>", 1)
