"""Sweep plot: errors, NEES and NIS over the values of a setting with the band of the runs, or a table."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import holoviews as hv
import numpy as np

from lab.base.arrays import FloatArray
from lab.views.ensemble_cards import scroll_box
from lab.views.mission_card import title_of_mission
from lab.views.paper_figure import Layout
from lab.views.plots import HEIGHT_PIXELS, WIDTH, columns, use_bokeh
from lab.views.quantities import AXIS_COLOURS, FIXES, TRUTH
from lab.views.sweep_figure import BAND, Panel, abscissa, is_text, is_wide, label_with_unit, panel, tests

if TYPE_CHECKING:
    import xarray as xr

    from lab.experiment.sweep import Sweep

ROWS = 30
"""Largest number of combinations in the table; the dataset has all."""
LEVEL = 5
"""Most texts that stand level below an axis; more are turned."""
BESIDE = 0.5
"""Part of the distance between two texts on an axis that the marks at one text take."""
MEAN, SPREAD = "over all seeds", "90 % of the runs"
"""What the legend of a printed figure calls the line and the band."""
_LEFT = 'style="text-align:left"'
DEFAULT = ("position", "velocity", "attitude heading")
"""The quantities that are drawn unless others are chosen."""
COLOURS = (*AXIS_COLOURS, FIXES, "#7d6bd6", "#a38b1c")
"""Colours of the values of a second setting, visible on white and on black."""


def sweep_plot(sweep: Sweep, quantities: Sequence[str] | None = None) -> Layout:
    """Return the plots of a sweep; see `Sweep.plot`."""
    swept = sweep.dims
    data = sweep.dataset.sortby([dim for dim in swept if not is_text(sweep.dataset[dim])])
    if not 1 <= len(swept) <= 2:
        raise ValueError(
            f"plot: {len(swept)} settings vary ({', '.join(swept) or 'none'}); accepted are one or two. "
            "sweep.sel chooses a value of a setting, as in sweep.sel(NAME=value).plot()"
        )
    use_bokeh()
    panels = [panel(data, name) for name in (DEFAULT if quantities is None else quantities)]
    drawn = [draw(one, data, swept) for one in panels + tests(data)]
    shown: Layout = Layout(drawn, made_by=lambda: sweep.facts).cols(columns(3)).opts(shared_axes=False)
    return shown


def draw(one: Panel, data: xr.Dataset, swept: tuple[str, ...]) -> hv.Overlay:
    """Draw a panel over the first setting, with a curve for each value of the second."""
    first, *second = swept
    axis, ticks = abscissa(data[first])
    layers: list[hv.Element] = []
    values = data[second[0]].values if second else [None]
    drawn = marks if is_text(data[first]) else curves
    for place, value in enumerate(values):
        at = {} if value is None else {second[0]: value}
        label = "" if value is None else f"{value} {data[second[0]].attrs['units']}".rstrip()
        # Marks of several values at one text stand side by side.
        aside = BESIDE * (place - (len(values) - 1) / 2) / len(values) if drawn is marks else 0.0
        layers += [
            layer.relabel(group=f"{data[second[0]].attrs['long_name']} {label}") if layer.label else layer
            for layer in drawn(
                one,
                one.runs.sel(at),
                one.expected.sel(at),
                axis + aside,
                COLOURS[place % len(COLOURS)],
                label,
            )
        ]
    about = data[first].attrs
    return hv.Overlay(layers).opts(
        width=WIDTH,
        height=HEIGHT_PIXELS,
        title=label_with_unit(one.title, one.unit),
        xlabel=label_with_unit(about["long_name"], about["units"]),
        ylabel="",
        logx=is_wide(axis) and not is_text(data[first]),
        show_grid=True,
        show_legend=bool(second),
        legend_position="top",
        legend_cols=3,
        legend_opts={"padding": 0, "margin": 0, "spacing": 8, "border_line_alpha": 0},
        fontsize={"title": 10, "labels": 9, "ticks": 8, "legend": 8},
        **({"xticks": ticks} if ticks else {}),
        **({"xrotation": 45} if len(ticks) > LEVEL else {}),
    )


def curves(
    one: Panel, runs: xr.DataArray, expected: xr.DataArray, axis: FloatArray, colour: str, label: str
) -> list[hv.Element]:
    """Draw the band, the mean over the seeds, and what the filter expects."""
    x, y = hv.Dimension("setting"), hv.Dimension(one.title, unit=one.unit or None)
    low, high = _band(runs)
    mean, assumed = _means(one, runs), _means(one, expected)
    drawn = [
        hv.Area((axis, low, high), x, [y, f"{one.title} high"], group=SPREAD).opts(
            color=colour, alpha=0.15, line_alpha=0
        ),
        hv.Curve((axis, assumed), x, y, group=_expected_label(one)).opts(
            color=colour if one.unit else TRUTH, line_dash="dashed", line_width=1.4
        ),
        hv.Curve((axis, mean), x, y, label=label, group=MEAN).opts(color=colour, line_width=2),
        hv.Scatter((axis, mean), x, y).opts(color=colour, size=5),
    ]
    return drawn if axis.size > 1 else drawn[3:]


def marks(
    one: Panel, runs: xr.DataArray, expected: xr.DataArray, axis: FloatArray, colour: str, label: str
) -> list[hv.Element]:
    """Draw the same over values that are texts, between which there is nothing: no line joins them."""
    x, y = hv.Dimension("setting"), hv.Dimension(one.title, unit=one.unit or None)
    low, high = _band(runs)
    assumed = hv.Scatter((axis, _means(one, expected)), x, y, group=_expected_label(one))
    return [
        hv.Segments((axis, low, axis, high), [x, y, "setting too", f"{one.title} high"], group=SPREAD).opts(
            color=colour, alpha=0.3, line_width=6
        ),
        assumed.opts(color=colour if one.unit else TRUTH, marker="dash", size=14),
        hv.Scatter((axis, _means(one, runs)), x, y, label=label, group=MEAN).opts(color=colour, size=7),
    ]


def _expected_label(one: Panel) -> str:
    """Return what the expected values are called in the legend of a printed figure."""
    return "σ of the filter" if one.unit else "expected value"


def _band(runs: xr.DataArray) -> tuple[FloatArray, FloatArray]:
    """Return the edges of the band of the runs; NaN where there is no run."""
    known = runs.notnull().any("seed")
    low, high = (runs.where(known, 0.0).quantile(edge, "seed").where(known).values for edge in BAND)
    return low, high


def _means(one: Panel, values: xr.DataArray) -> FloatArray:
    """Return means over the seeds: errors are averaged as squares; NEES and NIS are squares."""
    mean = (values**2).mean("seed") ** 0.5 if one.unit else values.mean("seed")
    return np.asarray(mean.values)


def sweep_html(sweep: Sweep) -> str:
    """Return a sweep as HTML."""
    data, dims = sweep.dataset, sweep.dims
    panels = [panel(data, name) for name in DEFAULT]
    panels += tests(data)
    heads = [label_with_unit(data[dim].attrs["long_name"], data[dim].attrs["units"]) for dim in dims]
    heads += [label_with_unit(one.title, one.unit) for one in panels]
    sizes = [data.sizes[dim] for dim in dims]
    rows = []
    for at in list(np.ndindex(*sizes))[:ROWS]:
        place = dict(zip(dims, at, strict=True))
        cells = [str(data[dim].values[index]) for dim, index in place.items()]
        rows.append((*cells, *(cell(one, place) for one in panels)))
    head = "".join(f"<th {_LEFT}>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td {_LEFT}>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
    more = f"<p>The first {ROWS} of {np.prod(sizes)} combinations.</p>" if np.prod(sizes) > ROWS else ""
    refused = "".join(f"<li>{escape(reason)}</li>" for reason in sweep.refused)
    return (
        f"<h4>{escape(title_of_mission(sweep.mission))}, {np.prod(sizes):.0f} combinations of values, "
        f"{data.sizes['seed']} seeds each</h4>"
        f"{scroll_box(f'<table><tr>{head}</tr>{body}</table>', 'Sweep')}{more}"
        "<p>The value over all seeds; in brackets, 90 % of the runs are between these.</p>"
        f"{f'<ul>{refused}</ul>' if refused else ''}"
    )


def cell(one: Panel, place: dict[str, int]) -> str:
    """Return the value of a panel over the seeds, with the band of the runs."""
    runs = one.runs.isel(place)
    if not np.isfinite(runs).any():
        return "unknown"
    middle = np.sqrt((runs**2).mean()) if one.unit else runs.mean()
    low, high = (float(runs.quantile(edge)) for edge in BAND)
    return f"{float(middle):.3g} ({low:.3g} to {high:.3g})"
