"""Consistency: does the filter tell the truth about itself? The verdict in words, and what it rests on."""

from __future__ import annotations

from html import escape

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.analysis.verdict import Verdict
from lab.result import Result
from lab.views.figures import TimeFigures
from lab.views.quantities import CONSISTENCY

_STYLE = """
:host { font: 14px/1.5 Roboto, sans-serif; }
.verdict { border-left: 4px solid #12a67c; padding: 2px 14px; margin: 0 0 2px; max-width: 1100px; }
.verdict.wrong { border-color: #e8862e; }
.verdict h2 { font-size: 18px; font-weight: 500; margin: 0; }
.verdict p { margin: 2px 0 0; }
.quiet { opacity: .72; }
.tables { display: flex; flex-wrap: wrap; gap: 8px 48px; }
.tables p { max-width: 430px; margin: 4px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th { text-align: right; font-weight: 500; opacity: .72; padding: 3px 12px;
     border-bottom: 2px solid rgba(128,128,128,.35); }
td { text-align: right; padding: 3px 12px; border-bottom: 1px solid rgba(128,128,128,.18); }
th:first-child, td:first-child { text-align: left; padding-left: 4px; }
td.off { font-weight: 700; box-shadow: inset -3px 0 0 #e8862e; }
"""

DOUBTFUL = 0.01
"""Probability of being white below which a channel is marked."""
ALMOST_ALL = 95.0
"""Percent within ±3σ below which an error is marked: one flight is only a few independent samples."""


class Consistency(Page):
    """Verdict, NEES and NIS with their 95 % intervals, whiteness of innovations, coverage of the errors."""

    title = "Consistency"

    def make(self) -> pn.viewable.Viewable:
        """Return the verdict, the two plots and the tables, one below the other."""
        self._figures = TimeFigures(CONSISTENCY, self.axis)
        self._verdict = _html()
        self._tables = _html()
        plots = plot_grid(self._figures.figures, 2, least=230, fill=False)
        return pn.Column(self._verdict, plots, self._tables, sizing_mode="stretch_width", margin=(8, 8))

    def prepare(self, result: Result) -> None:
        """Have the result judge its filter."""
        self._figures.prepare(result)
        _ = result.verdict, result.innovation_verdict, result.whiteness, result.coverage

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time; the words are about the whole flight."""
        self._figures.show(result)
        self._verdict.object = verdict_html(result.verdict, result.innovation_verdict)
        self._tables.object = (
            f'<div class="tables"><div>{whiteness_html(result)}</div><div>{coverage_html(result)}</div></div>'
        )


def _html() -> pn.pane.HTML:
    return pn.pane.HTML("", sizing_mode="stretch_width", margin=(4, 12), stylesheets=[_STYLE])


def verdict_html(verdict: Verdict, by_innovations: Verdict) -> str:
    """Return a verdict with its findings, and what could be said without the truth."""
    findings = "".join(
        f"<p>{f'{escape(finding.sentence)} ' if number else ''}<b>Try:</b> {escape(finding.advice)} "
        f'<span class="quiet">({escape(finding.evidence)})</span></p>'
        for number, finding in enumerate(verdict.findings)
    )
    return (
        f'<div class="verdict {"fine" if verdict.consistent else "wrong"}">'
        f"<h2>{escape(verdict.headline)}</h2>{findings}"
        f'<p class="quiet">Judged by {escape(verdict.basis)}. By the innovations alone: '
        f"{escape(by_innovations.headline)}</p></div>"
    )


def whiteness_html(result: Result) -> str:
    """Return mean, variance and whiteness of each channel's innovations as a table."""
    table = result.whiteness
    limits = table.iloc[0]
    heads = (
        "Innovations, in their σ",
        f"mean, ±{limits['mean ±']:.2f}",
        f"variance, {limits['variance from']:.2f} to {limits['variance to']:.2f}",
        "p (white)",
    )
    rows = []
    for row in table.to_dict("records"):
        cells = (
            (f"{row['mean']:.2f}", abs(row["mean"]) > row["mean ±"]),
            (f"{row['variance']:.2f}", not row["variance from"] <= row["variance"] <= row["variance to"]),
            (f"{row['p white']:.3f}", row["p white"] < DOUBTFUL),
        )
        rows.append(_row(str(row["innovation"]), cells))
    note = "95 % of matched filters lie within the limits; what does not is marked. p is Ljung and Box's."
    return _table(heads, rows, note)


def coverage_html(result: Result) -> str:
    """Return which part of the errors lies within ±1σ and ±3σ as a table."""
    table = result.coverage
    heads = ("Errors", "mean [σ]", "within ±1σ, 68 %", "within ±3σ, 99.7 %")
    rows = [
        _row(
            str(row["quantity"]),
            (
                (f"{row['mean [σ]']:.2f}", False),
                (f"{row['within ±1σ [%]']:.0f} %", False),
                (f"{row['within ±3σ [%]']:.1f} %", row["within ±3σ [%]"] < ALMOST_ALL),
            ),
        )
        for row in table.to_dict("records")
    ]
    note = "Errors change slowly: one flight may well stray by half a σ for long. Marked is what must not be."
    return _table(heads, rows, note)


def _row(name: str, cells: tuple[tuple[str, bool], ...]) -> str:
    marked = "".join(f'<td class="{"off" if off else "fine"}">{text}</td>' for text, off in cells)
    return f"<tr><td>{escape(name)}</td>{marked}</tr>"


def _table(heads: tuple[str, ...], rows: list[str], note: str) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    return f'<table><tr>{head}</tr>{"".join(rows)}</table><p class="quiet">{escape(note)}</p>'
