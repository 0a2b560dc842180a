"""Verdict card: a verdict in Jupyter: the headline, and each finding with its advice and evidence."""

from __future__ import annotations

from html import escape

from lab.analysis.verdicts.finding import Finding, Verdict

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
        f"<li>{escape(one.sentence)} {_bold(one.counsel)}</li>" for one in verdict.suggestions
    )
    return (
        f'<div style="border-left:4px solid {colour};padding:.2em .8em;max-width:60em">'
        f'<b><span style="color:{colour}">{sign}</span> {escape(verdict.headline)}</b>'
        f"{f'<ul>{findings}</ul>' if findings else ''}"
        f'<p style="opacity:.75;margin:.3em 0 0">Judged by {escape(verdict.basis)}.</p></div>'
    )


def _advice(finding: Finding) -> str:
    return f'{_bold(finding.counsel)} <span style="opacity:.75">({escape(finding.evidence)})</span>'


def _bold(counsel: str) -> str:
    return escape(counsel).replace("Try:", "<b>Try:</b>", 1)
