"""Budget: figures of the contribution of each source of error, and of σ over the manoeuvres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models.annotations import Legend, LegendItem, Title
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from lab.base.aid_table import FURTHER
from lab.views.envelope import SMALLEST_DRAWN
from lab.views.figures import TimeAxis, set_ordinate, time_figure
from lab.views.legend import SMALL, add_legend_beside
from lab.views.quantities import BLUE, FIXES, ORANGE, TRUTH

if TYPE_CHECKING:
    import xarray as xr

FAMILIES: dict[str, tuple[str, ...]] = {
    "initial": ("#5b6472", "#8b95a5", "#b9c0ca", "#454c57", "#727c8b", "#a2abb8"),
    "gyro": (
        *("#1f5fae", "#3b8eea", "#7db6f5", "#0f3f7a", "#a9cdf8"),
        *("#2c77c9", "#5aa2f2", "#c9e0fb", "#17508f", "#93c1f7"),
        *("#0a2c57", "#3568a8", "#6c95c9", "#bcd3ee", "#4d82c4", "#89b1e0"),
    ),
    "accelerometer": (
        *("#0c7a5b", "#12a67c", "#5cc9a7", "#07533d", "#98ddc6"),
        *("#0e9069", "#3db890", "#c2ebde", "#0a664b"),
        *("#043527", "#2f8f70", "#72bfa4", "#b1dccd", "#1f7d5f", "#87cfb5"),
    ),
    "vibration": ("#c9b22f",),
    "GPS": ("#e8862e", "#f3b27a", "#b85f12", "#f8d2b0", "#8a470d", "#d9772a"),
    "barometer": ("#7e57c2", "#a78bda", "#cfc0ec"),
    "heading": ("#c2477f", "#dd86ad", "#f0c2d6", "#8c2f5b"),
    "odometer": ("#4aa3a8", "#93cdd0"),
    "airspeed": ("#5b8c3e", "#a3c48c"),
    "wind": ("#7f8fa6", "#b5bfce"),
    "vehicle": ("#8d6e63", "#bcaaa4"),
}
"""Colours of the sources, by the first word of their names."""
_FURTHER = (
    ("#9c6b30", "#c9a06c", "#e6cfae"),
    ("#6b8e23", "#a4c05f", "#d2e0ae"),
    ("#b03a48", "#d57f89", "#ecc0c5"),
)
FAMILIES |= {
    aid.owner.partition(" ")[0]: _FURTHER[place % len(_FURTHER)] for place, aid in enumerate(FURTHER)
}

SLOTS = sum(len(colours) for colours in FAMILIES.values())
"""Largest number of drawn sources."""

WORTH_A_WORD = 1.0
"""Part of the variance that a source must have at some time to be in the legend [%]."""

LEAST_RATIO = 5.0
"""Smallest ratio of the ends of the axis of σ."""

TOTAL, BELIEVED, FREE = BLUE, ORANGE, FIXES


class BudgetFigures:
    """Stacked shares of the variance over time; and σ of errors, of the filter, and without GPS.

    Parameters
    ----------
    axis
        Time axis, shared with other figures.

    Attributes
    ----------
    figures : list of figure
        The stack, and σ with the manoeuvres.
    """

    def __init__(self, axis: TimeAxis) -> None:
        self._parts = ColumnDataSource(name="budget:shares")
        self._curves = ColumnDataSource({name: [] for name in ("time", "total", "believed", "free")})
        self._stretches = ColumnDataSource({name: [] for name in ("start", "end", "alpha", "name", "top")})
        self.figures = [self._draw_stack(axis), self._draw_sigma(axis)]
        self._titles = [fig.title for fig in self.figures if isinstance(fig.title, Title)]

    def show(self, budget: xr.Dataset, observability: xr.Dataset, quantity: str) -> None:
        """Draw a quantity.

        Parameters
        ----------
        budget, observability
            Datasets of a result.
        quantity
            One of their quantities.
        """
        here, seen = budget.sel(quantity=quantity), observability.sel(quantity=quantity)
        self._show_stack(here)
        curves = {
            "total": here.total.values,
            "believed": here.believed.values,
            "free": seen.free.values,
        }
        self._curves.data = {"time": here.time.values, **curves}
        values = np.concatenate(list(curves.values()))
        positive = values[values > SMALLEST_DRAWN]
        low, high = (positive.min(), positive.max()) if positive.size else (0.1, 1.0)
        room = max((high / low) ** 0.06, np.sqrt(LEAST_RATIO * low / high))
        low, high = low / room, high * room
        set_ordinate(self.figures[1], low, high)
        self._titles[1].text = f"σ of {quantity} and the manoeuvres [{here.unit.item()}]"
        count = seen.sizes["segment"]
        self._stretches.data = {
            "start": seen.start.values,
            "end": seen.end.values,
            "alpha": np.where(np.arange(count) % 2, 0.0, 0.1),
            "name": seen.segment.values.tolist(),
            "top": np.full(count, high / (high / low) ** 0.02),
        }

    def clear(self) -> None:
        """Draw nothing."""
        for source in (self._parts, self._curves, self._stretches):
            source.data = {name: [] for name in source.data}

    def _show_stack(self, here: xr.Dataset) -> None:
        edges = np.vstack((np.zeros(here.sizes["time"]), np.cumsum(here.share.values, axis=0)))
        names = [str(name) for name in here.source.values][:SLOTS]
        data = {f"edge_{slot}": edges[min(slot, len(names))] for slot in range(SLOTS + 1)}
        self._parts.data = {"time": here.time.values, **data}
        used = dict.fromkeys(FAMILIES, 0)
        for slot, (area, item) in enumerate(zip(self._areas, self._items, strict=True)):
            shown = slot < len(names)
            area.visible = shown
            item.visible = shown and float(here.share[slot].max()) >= WORTH_A_WORD
            if shown:
                family = names[slot].partition(" ")[0]
                colours = FAMILIES[family]
                area.glyph.fill_color = colours[used[family] % len(colours)]
                used[family] += 1
                item.label = {"value": names[slot]}
        self._titles[0].text = f"Share of the variance of {here.quantity.item()} [%]"

    def _draw_stack(self, axis: TimeAxis) -> figure:
        self._parts.data = {name: [] for name in ("time", *(f"edge_{slot}" for slot in range(SLOTS + 1)))}
        fig = time_figure("Share of the variance [%]", axis)
        fig.y_range.update(start=0.0, end=100.0)
        self._areas: list[GlyphRenderer[Any]] = [
            fig.varea("time", f"edge_{slot}", f"edge_{slot + 1}", source=self._parts, fill_alpha=0.9)
            for slot in range(SLOTS)
        ]
        self._items = [LegendItem(label="", renderers=[area], visible=False) for area in self._areas]
        legend = Legend(
            items=list(reversed(self._items)),
            location="top_left",
            styles=SMALL,
            glyph_height=12,
            glyph_width=12,
            label_height=12,
            spacing=0,
            margin=0,
        )
        add_legend_beside(fig, legend)
        return fig

    def _draw_sigma(self, axis: TimeAxis) -> figure:
        fig = time_figure("σ", axis, logarithmic=True)
        fig.vstrip(
            "start", "end", source=self._stretches, fill_color=TRUTH, fill_alpha="alpha", line_color=None
        )
        fig.text(
            *("start", "top", "name"),
            source=self._stretches,
            angle=-np.pi / 2,
            x_offset=3,
            text_font_size="11px",
            text_color=TRUTH,
            text_baseline="bottom",
        )
        glyphs: dict[str, GlyphRenderer[Any]] = {
            label: fig.line(
                *("time", name), source=self._curves, color=colour, line_width=1.6, line_dash=dash, name=label
            )
            for label, name, colour, dash in (
                ("true σ", "total", TOTAL, "solid"),
                ("the filter's σ", "believed", BELIEVED, "dashed"),
                ("without GPS", "free", FREE, "dotted"),
            )
        }
        if axis.hover:
            rows = [("time", "@time{0.0} s")]
            rows += [(label, f"@{glyph.glyph.y}{{0.0000}}") for label, glyph in glyphs.items()]
            fig.add_tools(HoverTool(mode="vline", renderers=[glyphs["true σ"]], tooltips=rows))
        items = [LegendItem(label=label, renderers=[glyph]) for label, glyph in glyphs.items()]
        legend = Legend(items=items, click_policy="hide", margin=2, styles=SMALL)
        legend.orientation = "horizontal"
        fig.add_layout(legend, "above")
        return fig
