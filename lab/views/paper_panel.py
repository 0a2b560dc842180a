"""Paper panel: one panel of a printed figure, drawn with matplotlib from the elements of a HoloViews plot.

Curves of one panel differ in line style and markers as well as in colour, so that a print in grey shows the
same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal

import holoviews as hv
import numpy as np

from lab.views.sweep_figure import label_with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

FEW_DECADES = 60.0
"""Ratio of the ends of a logarithmic axis below which it has more numbers than its decades."""
SIZE, SMALLEST, LETTER, NUMBERS = 7.0, 5.5, 1.38, 10.0
"""Size of the words [pt], the smallest that a journal prints, the width of a letter of that size, and that of
the numbers beside a panel [mm]."""
COLOURS = ("#0b4f8a", "#d95f02", "#3f9e6e", "#7b4a9e", "#a6761d", "#4d4d4d")
"""Colours of curves on white paper; a print in grey shows the first one dark, and line styles all others."""
SOLID = ("-", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (1, 2.5)), (0, (9, 2)))
"""Line styles of curves that are drawn whole on the screen, in the order of the colours."""
DASHED = (0, (4, 1.8))
"""Line style of curves that are dashed on the screen."""
MARKS = ("o", "s", "^", "D", "v", "P")
"""Markers of points, in the order of the colours."""


@dataclass
class Keys:
    """The legend of a figure: what each label looks like, the same in all panels.

    Attributes
    ----------
    numbers : dict of str to int
        Number of the look of each label.
    lines : dict of str to int
        Number of the line style of each label.
    handles : dict of str to Any
        What stands in the legend for each label, and how that looks.
    """

    numbers: dict[str, int] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    handles: dict[str, tuple[Any, tuple[Any, ...]]] = field(default_factory=dict)

    def entries(self) -> list[tuple[Any, str]]:
        """Return what stands in the legend; labels that look alike, in different panels, are one entry."""
        found: dict[tuple[Any, ...], tuple[Any, list[str]]] = {}
        for label, (handle, look) in self.handles.items():
            found.setdefault(look, (handle, []))[1].append(label)
        return [(handle, ", ".join(labels)) for handle, labels in found.values()]

    @staticmethod
    def number(known: dict[str, int], label: str, taken: set[int]) -> int:
        """Return the number that a label has in other panels, unless it is taken in this one."""
        free = next(number for number in range(len(taken) + 1) if number not in taken)
        usual = known.get(label, free) if label else free
        found = free if usual in taken else usual
        if label:
            known.setdefault(label, found)
        return found


class PaperPanel:
    """One panel, which draws the elements of a plot.

    Parameters
    ----------
    axes
        Where it draws.
    keys
        The legend of the figure.
    width
        Width of the panel with its numbers [mm].
    """

    def __init__(self, axes: Axes, keys: Keys, width: float) -> None:
        self._axes, self._keys, self._width = axes, keys, width
        self._looks: dict[str, int] = {}
        self._lines: dict[str, int] = {}

    def draw(self, panel: Any, options: Mapping[str, Any]) -> None:
        """Draw the elements of a plot, and its title, labels, scales and limits."""
        elements = list(panel) if isinstance(panel, hv.Overlay) else [panel]
        drawers: dict[type, Callable[[Any, Mapping[str, Any]], Any]] = {
            hv.Area: self._area,
            hv.Curve: self._curve,
            hv.Scatter: self._points,
            hv.Path: self._path,
            hv.Spikes: self._spikes,
            hv.Segments: self._segments,
            hv.HSpan: self._span,
            hv.HLine: self._level,
        }
        styles = [bokeh_options(element, "style") for element in elements]
        # Curves choose their looks first, then what is dashed; a band has that of its curve.
        for element, style in sorted(zip(elements, styles, strict=True), key=lambda one: _is_dashed(one[1])):
            if not isinstance(element, hv.Area | hv.HSpan | hv.HLine | hv.Segments):
                self._look(element, style)
        alone = sum(isinstance(one, hv.Curve | hv.Scatter) for one in elements) == 1
        for element, style in zip(elements, styles, strict=True):
            handle, label = drawers[type(element)](element, style), _label(element)
            is_title = alone and str(options.get("title", "")).startswith(f"{label}:")
            if handle is not None and label and not is_title:
                self._keys.handles.setdefault(label, (handle, self._seen(element, style)))
        self._style_axes(elements[0], options)
        kinds = {type(one) for one in elements}
        beyond = 0.15 if hv.Segments in kinds else 0.0 if options.get("xlabel") == "Time [s]" else 0.04
        if hv.Path not in kinds:
            self._axes.margins(x=beyond)

    def _style_axes(self, first: Any, options: Mapping[str, Any]) -> None:
        axes = self._axes
        titled = options.get("title", "")
        words, size = self._fit_words(titled)
        axes.set_title(words, loc="left", fontsize=size)
        dimensions = [label_with_unit(one.label, one.unit or "") for one in first.dimensions()[:2]]
        words, size = self._fit_words(options.get("xlabel", dimensions[0]))
        axes.set_xlabel(words, fontsize=size)
        axes.set_ylabel(options.get("ylabel", "" if titled else dimensions[1]))
        axes.grid(visible=True)
        axes.set_axisbelow(True)
        names: tuple[Literal["x", "y"], ...] = ("x", "y")
        for name, is_log in zip(names, (options.get("logx"), options.get("logy")), strict=True):
            # What has no positive value, such as the σ of a state that is known, has no logarithm.
            if is_log and np.isfinite(getattr(axes.dataLim, f"minpos{name}")):
                getattr(axes, f"set_{name}scale")("log")
                _plain_numbers(getattr(axes, f"{name}axis"))
            elif f"{name}ticks" not in options:
                axes.locator_params(axis=name, nbins=5)
        if "xticks" in options and not options.get("logx"):
            places, texts = zip(*options["xticks"], strict=True)
            axes.set_xticks(places, texts, rotation=options.get("xrotation", 0), minor=False)
            axes.set_xticks([], minor=True)
        if limits := options.get("ylim"):
            axes.set_ylim(*limits)
        if "data_aspect" in options:
            axes.set_aspect("equal", adjustable="datalim")

    def _fit_words(self, words: str) -> tuple[str, float]:
        """Return words, on several lines if needed, and their size [pt], so that they fit above the panel."""
        room = max(self._width - NUMBERS, NUMBERS)
        size = max(SIZE * min(1.0, room / max(len(words) * LETTER, 1.0)), SMALLEST)
        return fill(words, max(int(room / (LETTER * size / SIZE)), 1)), size

    def _look(self, element: Any, style: Mapping[str, Any]) -> int:
        """Return the number of the look of what has a colour on the screen."""
        colour = str(style.get("color"))
        if colour not in self._looks:
            taken = set(self._looks.values())
            self._looks[colour] = self._keys.number(self._keys.numbers, _label(element), taken)
        is_line = isinstance(element, hv.Curve | hv.Path) and not _is_dashed(style)
        if is_line and colour not in self._lines:
            taken = set(self._lines.values())
            self._lines[colour] = self._keys.number(self._keys.lines, _label(element), taken)
        return self._looks[colour]

    def _ink(self, element: Any, style: Mapping[str, Any]) -> tuple[str, Any, str]:
        """Return colour, line style and marker."""
        number = self._look(element, style) % len(COLOURS)
        line = SOLID[self._lines.get(str(style.get("color")), 0) % len(SOLID)]
        return COLOURS[number], DASHED if _is_dashed(style) else line, MARKS[number]

    def _band_colour(self, style: Mapping[str, Any]) -> str:
        """Return the colour of a band: that of its curve, or grey."""
        number = self._looks.get(str(style.get("color")))
        return "0.4" if number is None else COLOURS[number % len(COLOURS)]

    def _seen(self, element: Any, style: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return how an element looks, as far as a legend shows it."""
        kind = type(element)
        if isinstance(element, hv.Area | hv.Segments):
            return kind, self._band_colour(style)
        return kind, *self._ink(element, style), style.get("marker")

    def _area(self, element: Any, style: Mapping[str, Any]) -> Any:
        time, low, high = (element.dimension_values(at) for at in range(3))
        colour = self._band_colour(style)
        band = self._axes.fill_between(time, low, high, facecolor=colour, alpha=0.16, linewidth=0, zorder=1)
        for edge in (low, high):
            self._axes.plot(time, edge, color=colour, alpha=0.5, linewidth=0.4, zorder=1)
        return band

    def _curve(self, element: Any, style: Mapping[str, Any]) -> Any:
        colour, line, _ = self._ink(element, style)
        x, y = (element.dimension_values(at) for at in range(2))
        return self._axes.plot(x, y, color=colour, linestyle=line, linewidth=0.9, zorder=3)[0]

    def _points(self, element: Any, style: Mapping[str, Any]) -> Any:
        colour, _, mark = self._ink(element, style)
        x, y = (element.dimension_values(at) for at in range(2))
        is_dash = _is_dashed(style)
        many = 1.6 if len(x) > 30 else 3.2
        return self._axes.plot(
            x,
            y,
            linestyle="none",
            marker="_" if is_dash else mark,
            markersize=9 if is_dash else many,
            markerfacecolor=colour,
            markeredgecolor=colour,
            markeredgewidth=0.9 if is_dash else 0.3,
            zorder=2,
        )[0]

    def _path(self, element: Any, style: Mapping[str, Any]) -> Any:
        colour, line, _ = self._ink(element, style)
        for piece in element.split(datatype="array"):
            drawn = self._axes.plot(
                piece[:, 0], piece[:, 1], color=colour, linestyle=line, linewidth=1.0, zorder=3
            )
        return drawn[0]

    def _spikes(self, element: Any, style: Mapping[str, Any]) -> Any:
        colour, _, _ = self._ink(element, style)
        x, y = (element.dimension_values(at) for at in range(2))
        return self._axes.vlines(x, 0, y, color=colour, linewidth=1.2, zorder=3)

    def _segments(self, element: Any, style: Mapping[str, Any]) -> Any:
        colour = self._band_colour(style)
        x, low, _, high = (element.dimension_values(at) for at in range(4))
        return self._axes.vlines(x, low, high, color=colour, alpha=0.35, linewidth=2.5, zorder=1)

    def _span(self, element: Any, style: Mapping[str, Any]) -> Any:
        low, high = element.data
        return self._axes.axhspan(low, high, facecolor="0.85", linewidth=0, zorder=0)

    def _level(self, element: Any, style: Mapping[str, Any]) -> Any:
        self._axes.axhline(element.data, color="0.35", linewidth=0.6, zorder=1)


def _plain_numbers(axis: Axis) -> None:
    """Have a logarithmic axis write its decades as numbers; of few decades, 2 and 5 in them too."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415 - as above

    class Decades(LogLocator):
        def tick_values(self, low: float, high: float) -> Any:
            few = high < FEW_DECADES * low
            self.set_params(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=6)
            return super().tick_values(low, high)

    axis.set_major_locator(Decades())
    axis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _is_dashed(style: Mapping[str, Any]) -> bool:
    """Return whether a curve, or what stands for one over texts, is dashed on the screen."""
    return style.get("line_dash") == "dashed" or style.get("marker") == "dash"


def _label(element: Any) -> str:
    """Return what an element is called in a legend: its group, if that is not just its kind, or its label."""
    return str(element.label if element.group == type(element).__name__ else element.group)


def bokeh_options(element: Any, kind: str) -> dict[str, Any]:
    """Return the options of an element that were set for Bokeh."""
    found: dict[str, Any] = hv.Store.lookup_options("bokeh", element, kind).kwargs
    return found
