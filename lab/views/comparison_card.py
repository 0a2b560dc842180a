"""Comparison card: error models and a user's algorithms side by side, in Jupyter and on the page *Models*."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from lab.experiment.ensembles.comparison import Compared, Comparison


def comparison_html(comparison: Comparison) -> str:
    """Return a comparison as HTML."""
    return (
        f'<div style="overflow-x:auto">{models_html(comparison)}</div>'
        "<p>The errors are root mean squares over all runs. NEES and NIS are means, beside their expected "
        "values. The time is that of the navigator for one flight.</p>"
    )


def models_html(rows: Sequence[Compared], chosen: str = "") -> str:
    """Return compared models as an HTML table, with the selected one in bold."""
    head = "".join(
        f"<th>{name}</th>"
        for name in ("position [m]", "velocity [m/s]", "heading [°]", "NEES", "NIS", "time [ms]")
    )
    return (
        f'<table><tr><th>model</th>{head}<th class="words">verdict</th></tr>'
        f"{''.join(_row(row, row.model == chosen) for row in rows)}</table>"
    )


def _row(row: Compared, is_chosen: bool) -> str:
    name = f"<b>{escape(row.model)}</b>" if is_chosen else escape(row.model)
    if row.refusal:
        return f"<tr><td>{name}</td>{'<td>–</td>' * 6}{_words(f'Does not run: {row.refusal}')}</tr>"
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
    return f"<tr><td>{name}</td>{cells}{_words(row.verdict)}</tr>"


def _words(text: str) -> str:
    # JupyterLab does not break the lines of a table by itself, and its cells are right-aligned.
    return f'<td class="words" style="text-align:left;white-space:normal;min-width:18em">{escape(text)}</td>'
