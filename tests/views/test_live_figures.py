"""Live figures: what must not be drawn anew with each row."""

from __future__ import annotations

from bokeh.models.sources import ColumnDataSource

from lab.views.live_figures import LiveFigures


def test_no_legend_listens_to_a_stream() -> None:
    """A legend makes its elements again when anything changes that its entries reach."""
    legends = [legend for fig in LiveFigures().figures for legend in fig.legend]
    assert len(legends) == 7
    reached = {model for legend in legends for item in legend.items for model in item.references()}
    assert [one.name for one in reached if isinstance(one, ColumnDataSource) and one.name] == []
