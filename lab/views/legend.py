"""Legend: the names of the curves of a figure, right of its title; a click hides a curve."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.core.enums import PlaceType
from bokeh.events import LegendItemClick
from bokeh.models.annotations import Legend, LegendItem
from bokeh.models.callbacks import CustomJS
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure

SMALL: dict[str, str | None] = {"font-size": "12px"}
"""Style of a legend; the page gives its font relative to this one."""
HIDE: Final = """
for (const [item, glyphs] of entries)
    if (item == cb_obj.item) for (const glyph of glyphs) glyph.visible = !glyph.visible;
"""
"""Hides or shows the curves of a legend entry."""


NARROW: Final = 600
"""Width of a figure below which a legend beside the plot stands below it [px]: it has up to 230 px itself."""
SLIM: Final = 480
"""Width of a figure below which such a legend has one column [px]: two names of sources need 400 px."""
MOVE: Final = f"""
const narrow = fig.outer_width < {NARROW};
legend.setv({{ncols: narrow && fig.outer_width >= {SLIM} ? 2 : 1}}, {{sync: false}});
if (narrow !== fig.below.includes(legend)) {{
    const [right, below] = [fig.right, fig.below].map((many) => many.filter((one) => one !== legend));
    (narrow ? below : right).push(legend);
    fig.setv({{right, below}}, {{sync: false}});
}}
"""
"""Moves a legend below a narrow plot, and beside a wide one."""


def add_legend_beside(fig: figure, legend: Legend) -> None:
    """Put a legend beside the plot, or below it as long as the figure is narrow in the browser."""
    fig.add_layout(legend, "right")
    fig.js_on_change("outer_width", CustomJS(args={"fig": fig, "legend": legend}, code=MOVE))


def add_legend(
    fig: figure, glyphs: dict[str, GlyphRenderer[Any]], place: PlaceType = "center"
) -> dict[str, LegendItem]:
    """Put a legend over the plot, or beside it; a click hides a curve. Return its entries by label."""
    items = {label: LegendItem(label=label, renderers=[glyph]) for label, glyph in glyphs.items()}
    legend = Legend(
        items=list(items.values()),
        orientation="horizontal",
        location="top_right",
        click_policy="hide",
        margin=2,
        styles=SMALL,
    )
    fig.add_layout(legend, place)
    return items


def add_still_legend(fig: figure, glyphs: dict[str, list[GlyphRenderer[Any]]]) -> None:
    """Put a legend right of the title that is not made anew with each row of a stream.

    A legend listens to all that its entries reach, so also to the sources of their curves, and makes its
    elements again when one changes. This one has glyphs of its own; a click hides the curves with them.
    """
    samples = {
        label: fig.add_glyph(_unseen_source(many[0]), many[0].glyph.clone()) for label, many in glyphs.items()
    }
    items = add_legend(fig, samples)
    hidden = [(items[label], many) for label, many in glyphs.items()]
    fig.legend[0].js_on_event(LegendItemClick, CustomJS(args={"entries": hidden}, code=HIDE))


def _unseen_source(glyph: GlyphRenderer[Any]) -> ColumnDataSource:
    """Return a source with the columns of a glyph's, and one row that is not drawn: a legend needs one."""
    assert isinstance(glyph.data_source, ColumnDataSource)
    abscissa = glyph.glyph.x
    return ColumnDataSource(
        {name: [np.nan if name == abscissa else 1.0] for name in glyph.data_source.column_names}
    )
