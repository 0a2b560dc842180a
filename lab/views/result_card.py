"""Result card: a result in Jupyter: the run, the changed settings, and the errors."""

from __future__ import annotations

from html import escape

from lab.experiment.result import Result
from lab.views.settings_card import settings_html


def result_html(result: Result) -> str:
    """Return a result as HTML; for a log without reference, the innovations replace the errors."""
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in result.remarks)
    parts = (result.mission.title or result.mission.name, f"{result.time[-1]:.0f} s", result.realisation)
    title = ", ".join(part for part in parts if part)
    _, shown = result.overview
    summary = shown.to_html(index=False, border=0, float_format=lambda value: f"{value:.4g}")
    words = (
        result.lacks("summary") or f"Errors are estimate minus {result.truth_word}, over the whole flight."
    )
    return (
        f"<h4>{escape(title)}</h4>"
        f"{settings_html(result.experiment, changed_only=True)}{summary}"
        f"<p>{escape(words)}</p>"
        f"{f'<ul>{remarks}</ul>' if remarks else ''}"
    )
