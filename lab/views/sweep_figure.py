"""Sweep figure: a figure of merit over the values of one setting, as a curve, or of two, as a map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from bokeh.models.annotations import ColorBar, Span
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.mappers import LinearColorMapper, LogColorMapper
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.views.figures import decade_ticks, plain_figure
from lab.views.quantities import CURSOR, ESTIMATE, TRUTH

if TYPE_CHECKING:
    import xarray as xr

    from lab.experiment.sweep import Sweep

BAND = (0.05, 0.95)
"""Quantiles of the runs at the edges of the band, between which 90 % of them are."""
WIDE_RANGE = 15.0
"""Ratio of the largest and the smallest value from which the axis is logarithmic."""
HEIGHT = 380
"""Least height of a figure [px]."""
UNKNOWN = "#808895"
"""Colour of a cell of the map without a run, on white and on black."""
ERRORS = {
    "Position, rms": "position",
    "Velocity, rms": "velocity",
    "Heading, rms": "attitude heading",
    "Roll, rms": "attitude roll",
    "Pitch, rms": "attitude pitch",
}
MOST = "Horizontal position, 95 %"
RATIOS = {"NEES per state": "nees", "NIS per measured value": "nis"}
METRICS = (*ERRORS, MOST, *RATIOS)
"""What a figure shows over the values of the settings."""


class Panel(NamedTuple):
    """One plot: title, unit, values (…, seed) of the runs, and what the filter expects (…, seed)."""

    title: str
    unit: str
    runs: xr.DataArray
    expected: xr.DataArray


def panel(data: xr.Dataset, name: str) -> Panel:
    """Return root mean square and σ of a quantity, or of a whole vector.

    Raises
    ------
    ValueError
        If there is no such quantity.
    """
    known = data["quantity"].values.tolist()
    parts = [one for one in known if name in (one, one.split()[0])]
    if not parts:
        vectors = dict.fromkeys(one.split()[0] for one in known)
        raise ValueError(f"plot: there is no quantity {name!r}; accepted are {', '.join((*vectors, *known))}")
    chosen = data.sel(quantity=parts)
    rms, sigma = ((chosen[one] ** 2).sum("quantity", skipna=False) ** 0.5 for one in ("rms", "sigma"))
    return Panel(f"{name.capitalize()} error, rms", str(chosen["unit"].values[0]), rms, sigma)


def tests(data: xr.Dataset) -> list[Panel]:
    """Return NEES and NIS, if they are known."""
    return [
        Panel(f"{name.upper()}, mean over the fixes", "", data[name], data[f"{name}_degrees"])
        for name in ("nees", "nis")
        if np.isfinite(data[name]).any()
    ]


def label_with_unit(words: str, unit: str) -> str:
    """Return words with a unit in brackets, if there is one."""
    return f"{words} [{unit}]" if unit else words


def abscissa(values: xr.DataArray) -> tuple[FloatArray, list[tuple[float, str]]]:
    """Return the places of a setting's values, and the ticks; without ticks, the axis has its own."""
    if is_text(values):
        texts = [(float(at), str(value)) for at, value in enumerate(values.values)]
        return np.arange(values.size, dtype=np.float64), texts
    axis = values.values.astype(np.float64)
    if not is_wide(axis):
        return axis, []
    return axis, [(tick, f"{tick:g}") for tick in decade_ticks(axis.min(), axis.max())]


def is_text(values: xr.DataArray) -> bool:
    """Return whether the values of a setting are no numbers."""
    return bool(values.dtype.kind not in "fiu")


def is_wide(axis: FloatArray) -> bool:
    """Return whether an axis is better logarithmic."""
    return bool(axis.min() > 0 and axis.max() >= WIDE_RANGE * axis.min())


def metric(data: xr.Dataset, name: str) -> Panel:
    """Return one of `METRICS`, and what the filter expects of it; NaN if it expects nothing."""
    if name in ERRORS:
        return panel(data, ERRORS[name])._replace(title=name)
    if name == MOST:
        return Panel(MOST, "m", data["horizontal_95"], data["horizontal_95"] * np.nan)
    ratio = data[RATIOS[name]] / data[f"{RATIOS[name]}_degrees"]
    return Panel(name, "", ratio, ratio * 0 + 1)


def sweep_figure(sweep: Sweep, name: str, present: dict[str, float]) -> figure:
    """Return the figure of a sweep of numbers: over one setting a curve with its band, over two a map.

    Parameters
    ----------
    sweep
        The sweep, of one or two settings whose values are numbers.
    name
        One of `METRICS`.
    present
        Present values of the settings, by their path; each is marked.
    """
    data = sweep.dataset.sortby(list(sweep.dims))
    shown = metric(data, name)
    # Errors are averaged as squares, as those of a run are; the quantile and the ratios are not.
    squared = name in ERRORS
    middle, expected = (_mean(one, squared) for one in (shown.runs, shown.expected))
    if len(sweep.dims) == 1:
        return _curve(data, shown, middle, expected, present)
    return _map(data, shown, middle, present)


def is_known(sweep: Sweep, name: str) -> bool:
    """Return whether any run of a sweep has a figure of merit."""
    return bool(np.isfinite(metric(sweep.dataset, name).runs).any())


def _mean(runs: xr.DataArray, squared: bool) -> xr.DataArray:
    return (runs**2).mean("seed") ** 0.5 if squared else runs.mean("seed")


def _curve(
    data: xr.Dataset, shown: Panel, middle: xr.DataArray, expected: xr.DataArray, present: dict[str, float]
) -> figure:
    """Draw the mean over the seeds, the band of 90 % of the runs, and what the filter expects."""
    (setting,) = (data[dim] for dim in middle.dims)
    known = np.isfinite(middle.values)
    x = setting.values.astype(float)[known]
    low, high = (shown.runs[known].quantile(edge, "seed").values for edge in BAND)
    about = {
        "x": x,
        "low": low,
        "high": high,
        "mean": middle.values[known],
        "expected": expected.values[known],
    }
    source = ColumnDataSource(about)
    title = label_with_unit(shown.title, shown.unit)
    fig = plain_figure(
        f"{title}, {data.sizes['seed']} seeds" if data.sizes["seed"] > 1 else title,
        _label(setting),
        title,
        x_axis_type=_scale(setting),
        y_axis_type="log" if known.any() and is_wide(about["mean"]) else "linear",
        tools=[],
        height=HEIGHT,
    )
    fig.varea("x", "low", "high", source=source, fill_color=ESTIMATE, fill_alpha=0.2)
    line = fig.line("x", "mean", source=source, color=ESTIMATE, line_width=1.6)
    fig.scatter("x", "mean", source=source, color=ESTIMATE, size=6)
    if np.isfinite(about["expected"]).any():
        fig.line("x", "expected", source=source, color=TRUTH, line_dash="dashed", line_width=1.4)
    tips = [
        (_label(setting), "@x{0.[0000]}"),
        (title, "@mean{0.[0000]}"),
        ("90 %", "@low{0.[000]} to @high{0.[000]}"),
    ]
    fig.add_tools(HoverTool(mode="vline", renderers=[line], tooltips=tips))
    _finish(fig, present, setting)
    return fig


def _map(data: xr.Dataset, shown: Panel, middle: xr.DataArray, present: dict[str, float]) -> figure:
    """Draw a cell for each pair of values, in the colour of the mean over the seeds."""
    first, second = (data[dim] for dim in middle.dims)
    sides = [_edges(one) for one in (first, second)]
    values = middle.values
    count = values.size
    at = [side.reshape(-1) for side in np.meshgrid(first.values, second.values, indexing="ij")]
    left, bottom = (side.reshape(-1) for side in np.meshgrid(sides[0][:-1], sides[1][:-1], indexing="ij"))
    right, top = (side.reshape(-1) for side in np.meshgrid(sides[0][1:], sides[1][1:], indexing="ij"))
    source = ColumnDataSource(
        {
            "left": left,
            "right": right,
            "bottom": bottom,
            "top": top,
            "x": at[0],
            "y": at[1],
            "value": values.reshape(count),
        }
    )
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    kind = LogColorMapper if finite.size and is_wide(finite) else LinearColorMapper
    colours = kind(palette=Viridis256, low=low, high=high if high > low else low + 1.0, nan_color=UNKNOWN)
    title = label_with_unit(shown.title, shown.unit)
    fig = plain_figure(
        f"{title}, {data.sizes['seed']} seeds" if data.sizes["seed"] > 1 else title,
        _label(first),
        _label(second),
        x_axis_type=_scale(first),
        y_axis_type=_scale(second),
        x_range=(sides[0][0], sides[0][-1]),
        y_range=(sides[1][0], sides[1][-1]),
        tools=[],
        height=HEIGHT,
    )
    colour: Any = {"field": "value", "transform": colours}
    cells = fig.quad("left", "right", "bottom", "top", source=source, fill_color=colour, line_color=None)
    tips = [(_label(first), "@x{0.[0000]}"), (_label(second), "@y{0.[0000]}"), (title, "@value{0.[0000]}")]
    fig.add_tools(HoverTool(renderers=[cells], tooltips=tips))
    fig.add_layout(ColorBar(color_mapper=colours, width=14, background_fill_alpha=0.0), "right")
    _finish(fig, present, first, second)
    return fig


def _label(setting: xr.DataArray) -> str:
    return label_with_unit(setting.attrs["long_name"], setting.attrs["units"])


def _scale(setting: xr.DataArray) -> str:
    """Return the scale on which the values of a setting are more even."""
    values = setting.values.astype(float)
    if values.min() <= 0 or values.size < 3:
        return "linear"
    plain, logarithmic = (np.diff(one) for one in (values, np.log(values)))
    return "log" if np.ptp(logarithmic) / logarithmic.mean() < np.ptp(plain) / plain.mean() else "linear"


def _edges(setting: xr.DataArray) -> FloatArray:
    """Return the edges (n + 1,) of the cells around the values of a setting, on its scale."""
    logarithmic = _scale(setting) == "log"
    values = setting.values.astype(float)
    places = np.log(values) if logarithmic else values
    half = np.diff(places) / 2 if places.size > 1 else np.array([0.5])
    edges = np.concatenate(
        ([places[0] - half[0]], places[:-1] + half[: places.size - 1], [places[-1] + half[-1]])
    )
    return np.exp(edges) if logarithmic else edges


def _finish(fig: figure, present: dict[str, float], *settings: xr.DataArray) -> None:
    """Mark the present value of each setting with a line, and write the ticks of its axis as numbers."""
    for setting, axis, dimension in zip(settings, (fig.xaxis, fig.yaxis), ("height", "width"), strict=False):
        ends = _edges(setting)
        if _scale(setting) == "log":
            axis.ticker = decade_ticks(ends[0], ends[-1])
            axis.formatter = CustomJSTickFormatter(code="return `${+tick.toPrecision(3)}`")
        value = present.get(setting.attrs["setting"])
        if value is not None and ends[0] <= value <= ends[-1]:
            mark = Span(location=value, dimension=dimension, line_color=CURSOR, line_dash="dotted")  # type: ignore[arg-type]
            fig.add_layout(mark)
