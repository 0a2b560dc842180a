"""Rolling plot: curves over the last seconds of a stream, to which rows are appended.

The abscissa is the age of a row, so the axes stand still while the curves move. The curves are painted in the
overlay of the figure: a browser paints axes, title and legend, which take most of its time, only when the
ordinate changes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from bokeh.models.annotations import Title
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import FixedTicker
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.views.envelope import nice_limit
from lab.views.figures import decade_ticks, plain_figure, set_ordinate, tick_by_hand
from lab.views.legend import add_still_legend
from lab.views.parcel import Parcel
from lab.views.quantities import AXIS_COLOURS

NOTHING = ": none yet"
"""Words behind the title of a plot that has no value yet."""
_LEGEND = 0.25
"""Part of an ordinate that is left free at the top for the legend."""
_ROWS_PER_SECOND = 60
"""Rows of a source per second at most: those of `lab.data.streams.rolling` and marks of gaps."""
_MARKERS = ("circle",) * 3 + ("triangle",) * 3
"""Markers of points, in the order of the curves."""
_JOINED = 1.5
"""Longest time between two rows that a line joins [s]: a navigator has no rows until it is aligned again."""
_STANDS_STILL = 0.6
"""Part of an ordinate below which what is shown is drawn larger."""


class RollingPlot:
    """A figure over time with curves of one source, whose ordinate follows what is shown.

    Parameters
    ----------
    title, unit
        Title and unit of the ordinate.
    labels
        Labels of the curves.
    ages
        Shared range of the abscissa, from the oldest row to the newest [s].
    parcel
        Takes the changes.
    logarithmic
        Whether the ordinate is logarithmic.
    points
        Whether points are drawn in place of lines.
    least
        Least half height of a linear ordinate, in its unit.
    colours
        Colours of the curves.
    legend
        Names of the entries of the legend, with the labels of their curves; by default, up to three curves
        have an entry each.
    group
        Group of the changes in the parcel.
    """

    def __init__(
        self,
        title: str,
        unit: str,
        labels: tuple[str, ...],
        ages: Range1d,
        parcel: Parcel,
        *,
        logarithmic: bool = False,
        points: bool = False,
        least: float = 0.0,
        colours: tuple[str, ...] = AXIS_COLOURS * 2,
        legend: Mapping[str, tuple[str, ...]] | None = None,
        group: int = 0,
    ) -> None:
        self._labels, self._logarithmic, self._least = labels, logarithmic, least
        self._are_points = points
        self._parcel = parcel
        self._span = (0.0, 0.0)
        self._ordinate = Range1d(start=0.1 if logarithmic else -1.0, end=1.0)
        self._words = f"{title} [{unit}]"
        heading = Title(text=self._words + NOTHING)
        self._waits = True  # for a first value
        self.figure: figure = plain_figure(
            heading,
            "time before now [s]",
            x_range=ages,
            y_range=self._ordinate,
            y_axis_type="log" if logarithmic else "linear",
        )
        if logarithmic:
            tick_by_hand(self.figure)
            set_ordinate(self.figure, 0.1, 1.0)
        self._nothing: dict[str, list[float]] = {name: [] for name in ("time", "age", *labels)}
        self.source = ColumnDataSource(self._nothing, name=f"live:{title}")
        self.glyphs: dict[str, GlyphRenderer[Any]] = {
            label: self._draw(label, colour, marker if points else None)
            for label, colour, marker in zip(labels, colours, _MARKERS, strict=False)
        }
        if legend is None and 1 < len(labels) <= len(AXIS_COLOURS):
            legend = {label: (label,) for label in labels}
        if legend:
            shown = {name: [self.glyphs[label] for label in curves] for name, curves in legend.items()}
            add_still_legend(self.figure, shown)
        self._kept: deque[FloatArray] = deque()
        self._source, self._y, self._title = (
            parcel.number(one, group) for one in (self.source, self._ordinate, heading)
        )
        ticker = self.figure.yaxis[0].ticker
        self._ticks = parcel.number(ticker, group) if isinstance(ticker, FixedTicker) else -1

    def _draw(self, label: str, colour: str, marker: str | None) -> GlyphRenderer[Any]:
        """Draw a curve: points with a marker, or else a line."""
        if marker is None:
            return self.figure.line(
                "age", label, source=self.source, color=colour, line_width=1.4, level="overlay"
            )
        return self.figure.scatter(
            "age",
            label,
            source=self.source,
            color=colour,
            size=6,
            alpha=0.9,
            marker=marker,
            level="overlay",
        )

    def clear(self) -> None:
        """Forget all rows."""
        self._kept.clear()
        self._span = (0.0, 0.0)
        self._waits = True
        self._parcel.set(self._title, text=self._words + NOTHING)
        self._parcel.stream(self._source, self._nothing, None)

    def add(self, time: FloatArray, values: FloatArray, window: float) -> None:
        """Append rows.

        Parameters
        ----------
        time : (n,) array
            Times [s].
        values : (n, k) array
            A column for each curve.
        window
            Length of time that is shown [s].
        """
        if not time.size:
            return
        rows = np.column_stack((time, values))
        if not self._are_points:
            rows = self._break_at_gaps(rows)
        self._kept.append(rows)
        while len(self._kept) > 1 and self._kept[0][-1, 0] < time[-1] - window:
            self._kept.popleft()
        columns = dict(zip(("time", *self._labels), rows.T, strict=True))
        self._parcel.stream(self._source, columns, int(window * _ROWS_PER_SECOND))
        self._fit()

    def _break_at_gaps(self, rows: FloatArray) -> FloatArray:
        """Return rows with one of NaN in the middle of each stretch of time that no line may cross."""
        before = self._kept[-1][-1, 0] if self._kept else rows[0, 0]
        steps = np.diff(rows[:, 0], prepend=before)
        (gaps,) = np.nonzero(steps > _JOINED)
        marks = np.full((gaps.size, rows.shape[1]), np.nan)
        marks[:, 0] = rows[gaps, 0] - steps[gaps] / 2
        return np.insert(rows, gaps, marks, axis=0)

    def move(self, now: float, window: float) -> None:
        """Show the time [s] up to now, over the length of a window [s]."""
        self._parcel.age(self._source, now, window)

    def _fit(self) -> None:
        """Let the ordinate hold what is shown, and change it only when it must."""
        shown = np.concatenate([rows[:, 1:] for rows in self._kept])
        known = shown[np.isfinite(shown)]
        if self._logarithmic:
            known = known[known > 0]
        if not known.size:
            return
        if self._waits:
            self._waits = False
            self._parcel.set(self._title, text=self._words)
        low, high = float(known.min()), float(known.max())
        start, end = self._span
        if self._logarithmic:
            low, high = 10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high) + 1e-9)
            high = max(high, 10 * low)
            high *= (high / low) ** _LEGEND
            if (start, end) != (low, high):
                self._set(float(low), float(high))
            return
        if len(self._labels) > 1:
            high += _LEGEND * max(high - low, 2 * self._least)
        middle, half = (low + high) / 2, max((high - low) / 2, self._least)
        inside = start <= low and high <= end
        if inside and half > _STANDS_STILL * (end - start) / 2 / 1.1:
            return
        half = nice_limit(1.1 * half)
        self._set(middle - half, middle + half)

    def _set(self, low: float, high: float) -> None:
        """Set the ends of the ordinate, and its ticks if it is logarithmic."""
        self._span = low, high
        self._parcel.set(self._y, start=low, end=high)
        if self._logarithmic:
            self._parcel.set(self._ticks, ticks=decade_ticks(low, high))
