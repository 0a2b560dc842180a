"""Foreign filter: the verdict on a filter that is not ours, as HTML and as one figure over time."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from bokeh.models.annotations import Span
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.palettes import Category10_10
from bokeh.plotting import figure

from lab.analysis.verdicts.foreign_evidence import Measurement
from lab.analysis.verdicts.foreign_verdict import ForeignVerdict
from lab.views.ensemble_cards import scroll_box, verdict_html
from lab.views.figures import plain_figure

PARTS = 60
"""Parts of a log, of each of which the root mean square is drawn: some values each, and the course shows."""
LEAST_ROOT = 1e-3
"""Smallest root mean square that is drawn: logs write test ratios in steps of 0.01."""
MOST_SHOWN = 100
"""Most events in a page; the command lists all."""
HEADS = (
    "number",
    "mean square",
    "matched filter",
    "correlation with the next",
    "rejected",
    "test ratio up to",
)


def foreign_html(found: ForeignVerdict) -> str:
    """Return the verdict, the table of measurements, statements with what they rest on, and events."""
    statements = "".join(
        f'<li>{escape(one.sentence)} <span style="opacity:.75">{escape(one.evidence)}</span></li>'
        for one in (*found.comparisons, *found.remarks)
    )
    events = "".join(
        f"<tr><td>{one.time:.1f} s</td><td>{escape(one.kind)}</td>"
        f'<td class="words">{escape(one.text)} <span '
        f'style="opacity:.75">{escape(one.source)}</span></td></tr>'
        for one in found.log.events[:MOST_SHOWN]
    )
    more = len(found.log.events) - MOST_SHOWN
    cut = f"<p>{more} more events; ins-lab judge lists all.</p>" if more > 0 else ""
    table = f"<table><tr><th>time</th><th>kind</th><th></th></tr>{events}</table>"
    happened = f"<p><b>What happened</b></p>{scroll_box(table, 'Events')}{cut}"
    return (
        f"{verdict_html(found.verdict)}{_table(found.measurements)}"
        f"{f'<ul>{statements}</ul>' if statements else ''}{happened if events else ''}"
        f"<p>What its own flags say: {escape(found.log.flags)}</p>"
    )


def _table(measurements: Iterable[Measurement]) -> str:
    rows = "".join(
        f"<tr><td>{escape(one.innovations.name)}</td><td>{one.count}</td><td>{_number(one.mean_square)}</td>"
        f"<td>{' to '.join(map(_number, one.interval))}</td><td>{_number(float(one.lagged[0]))}</td>"
        f"<td>{one.rejected.sum()}</td><td>{_number(one.worst)}</td></tr>"
        for one in measurements
    )
    head = "".join(f"<th>{name}</th>" for name in HEADS)
    return scroll_box(f"<table><tr><th>measurement</th>{head}</tr>{rows}</table>", "Measurements")


def _number(value: float) -> str:
    return f"{value:.3g}".replace("nan", "–")


class ForeignFigure:
    """The size of the innovations over time, with resets, lanes, rejections and faults as lines.

    Attributes
    ----------
    figure : figure
        The figure.
    """

    def __init__(self) -> None:
        self.figure = _empty_figure()

    def show(self, found: ForeignVerdict) -> figure:
        """Return a new figure of a verdict: another log has other measurements."""
        self.figure = _empty_figure()
        low, high = 0.5, 2.0
        begin, end = found.log.span
        self.figure.x_range.update(start=begin, end=max(end, begin + 1.0))
        for one, colour in zip(found.measurements, Category10_10 * 3, strict=False):
            time, root = rms_over_time(one)
            if time.size:
                low, high = min(low, float(root.min())), max(high, float(root.max()))
                source = ColumnDataSource({"time": time, "root": root})
                curve = self.figure.line(
                    "time",
                    "root",
                    source=source,
                    color=colour,
                    line_width=2,
                    legend_label=one.innovations.name,
                )
                hover = HoverTool(
                    renderers=[curve],
                    tooltips=[(one.innovations.name, "@root{0.00} σ"), ("time", "@time{0.0} s")],
                )
                self.figure.add_tools(hover)
        self.figure.y_range.update(start=0.8 * low, end=1.25 * high)
        for event in found.log.events[:MOST_SHOWN]:
            if event.kind != "message":
                self.figure.add_layout(
                    Span(location=event.time, dimension="height", line_color="#b3261e", line_dash="dashed")
                )
        self.figure.add_layout(Span(location=1.0, dimension="width", line_color="#8b95a5"))
        if self.figure.legend:
            self.figure.add_layout(self.figure.legend[0], "right")
        return self.figure


def _empty_figure() -> figure:
    made = plain_figure(
        "Root mean square of the innovations in their σ (1: as large as the filter says)",
        "time [s]",
        x_range=Range1d(start=0.0, end=1.0),
        y_range=Range1d(start=0.1, end=10.0),
        y_axis_type="log",
        tools="xbox_zoom,xwheel_zoom,reset",
    )
    made.update(sizing_mode="stretch_width", height=300)
    return made


def rms_over_time(one: Measurement) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the root mean squares of parts of a log that have innovations."""
    time, square = one.innovations.time, one.innovations.square
    if not time.size or not np.isfinite(square).all():
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(time[0], time[-1], PARTS + 1)
    at = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, PARTS - 1)
    count = np.bincount(at, minlength=PARTS)
    there = count > 0
    mean = np.bincount(at, square, PARTS)[there] / count[there]
    return (0.5 * (edges[:-1] + edges[1:]))[there], np.maximum(np.sqrt(mean), LEAST_ROOT)
