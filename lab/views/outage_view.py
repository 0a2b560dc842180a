"""Outage view: the table of outages as HTML, and how the errors drift while there is no GPS."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from bokeh.models.annotations import Span
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from lab.experiment.outage_table import OutageRow, OutageTable
from lab.views.ensemble_cards import scroll_box
from lab.views.figures import decade_ticks, plain_figure
from lab.views.legend import add_legend
from lab.views.mission_card import title_of_mission
from lab.views.quantities import AXIS_COLOURS, CURSOR, FIXES, HELD

MOST_CURVES = 6
"""Most sensors in one figure: more bands cover each other."""
COLOURS = (*AXIS_COLOURS, FIXES, HELD[0], HELD[2])
"""Their colours, visible on white and on black."""
HEIGHT = 380
"""Least height of the figure [px]."""
WIDE_RANGE = 15.0
"""Ratio of the largest and the smallest error at the end from which the ordinate is logarithmic."""
WORDS = {
    "pass": ("✓ pass", "#1a8f4c"),
    "fail": ("✗ fail", "#b3541e"),
    "undecided": ("? undecided", "#777"),
}
"""What a decision looks like: with a sign, so that the colour is not all that tells them apart."""
ABOUT = (
    "Line: 95 % of the outages stay below it. Band: its own 95 % interval. Red: the wish. A click on a name "
    "hides its curve."
)
ABOUT_TABLE = (
    "Errors at the end of the outage. CEP: half of the errors are smaller. The interval contains the 95 % "
    "value of endlessly many runs with a confidence of 95 %. Honest: it also contains the filter's own 95 % "
    "value."
)


def outages_html(table: OutageTable) -> str:
    """Return a table of outages as HTML, for a notebook."""
    title = f"{title_of_mission(table.mission)}, outages of {table.seconds:g} s"
    return f"<h4>{escape(title)}</h4>{table_html(table)}"


def table_html(table: OutageTable) -> str:
    """Return the rows as an HTML table, with the sentence about tuning and the remarks."""
    titles, rows = table.cells()
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join(
        f"<tr>{''.join(_cell(text, last=at == len(row) - 1) for at, text in enumerate(row))}</tr>"
        for row in rows
    )
    tuning = f"<p><b>{escape(table.tuning)}</b></p>" if table.tuning else ""
    remarks = "".join(f"<p>{escape(text)}</p>" for text in (*table.remarks, ABOUT_TABLE))
    shown = scroll_box(f"<table><tr>{head}</tr>{body}</table>", "Outages")
    return f"{tuning}{shown}{remarks}"


def _cell(text: str, *, last: bool) -> str:
    if last and text in WORDS:
        words, colour = WORDS[text]
        return f'<td style="color:{colour};white-space:nowrap"><b>{words}</b></td>'
    return f"<td>{escape(text)}</td>"


def choose_curves(table: OutageTable) -> list[OutageRow]:
    """Return the rows that a figure draws: those closest to the wish, or some from the best to the worst."""
    known = [row for row in table.rows if row.runs and np.isfinite(row.most.value)]
    if len(known) <= MOST_CURVES:
        return known
    known.sort(key=lambda row: row.most.value)
    if table.wish is not None:
        wish = table.wish
        known.sort(key=lambda row: abs(np.log(row.most.value / wish)))
        return sorted(known[:MOST_CURVES], key=lambda row: row.most.value)
    return [known[at] for at in np.linspace(0, len(known) - 1, MOST_CURVES).round().astype(int)]


def drift_figure(table: OutageTable, rows: Sequence[OutageRow]) -> figure:
    """Return how the horizontal errors drift: the 95 % over the time without GPS, with its interval.

    Parameters
    ----------
    table
        The table.
    rows
        The rows to draw, at most `MOST_CURVES`, with known errors.
    """
    ends = np.array([row.most.value for row in rows])
    is_wide = bool(ends.size) and ends.max() >= WIDE_RANGE * ends.min()
    options: dict[str, Any] = {"y_axis_type": "log"} if is_wide else {}
    title = "Horizontal error, 95 % [m]"
    fig = plain_figure(title, "Time without GPS [s]", title, tools=[], height=HEIGHT, **options)
    lines, drawn = {}, [np.zeros(0)]
    for row, colour in zip(rows, COLOURS, strict=False):
        curve = row.curve()
        known = np.isfinite(curve[:, 0])
        value, low, high = curve[known].T
        # Too few runs have no upper end: their band ends at the line.
        high = np.where(np.isfinite(high), high, value)
        low = np.where(np.isfinite(low), low, value)
        source = ColumnDataSource(
            {
                "x": table.since[known],
                "value": value,
                "low": low,
                "high": high,
                "card": [row.name] * value.size,
            }
        )
        fig.varea("x", "low", "high", source=source, fill_color=colour, fill_alpha=0.15)
        lines[row.name] = fig.line("x", "value", source=source, color=colour, line_width=1.8)
        drawn += [low, high]
    tips = [
        ("", "@card"),
        ("Without GPS", "@x{0} s"),
        ("95 %", "@value{0.[00]} m"),
        ("Interval", "@low{0.[00]} to @high{0.[00]} m"),
    ]
    fig.add_tools(HoverTool(mode="mouse", renderers=list(lines.values()), tooltips=tips))
    if table.wish is not None:
        fig.add_layout(Span(location=table.wish, dimension="width", line_color=CURSOR, line_dash="dashed"))
    if is_wide:
        every = np.concatenate(drawn)
        fig.yaxis.ticker = decade_ticks(float(np.nanmin(every[every > 0])), float(np.nanmax(every)))
        fig.yaxis.formatter = CustomJSTickFormatter(code="return `${+tick.toPrecision(3)}`")
    if lines:
        add_legend(fig, lines)
        fig.legend[0].update(location="top_left", orientation="vertical")  # where the errors are small
    return fig


def curve_words(table: OutageTable) -> str:
    """Return what the figure shows, and of which sensors if not of all."""
    shown = choose_curves(table)
    left = len([row for row in table.rows if row.runs]) - len(shown)
    which = "closest to the wish" if table.wish is not None else "from the best to the worst"
    return f"{ABOUT} {len(shown)} sensors {which}." if left > 0 else ABOUT
