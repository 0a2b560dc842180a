"""Import preview: the samples of a flight to import, and the curve through them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.embed import file_html
from bokeh.layouts import column, row
from bokeh.models.layouts import Column, LayoutDOM, Row
from bokeh.models.ranges import DataRange1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import BasicTicker
from bokeh.models.tools import PanTool, ResetTool, WheelZoomTool
from bokeh.models.widgets.markups import PreText
from bokeh.plotting import figure
from bokeh.resources import INLINE

from lab.base.arrays import FloatArray
from lab.base.files.atomic_file import write_file
from lab.missions.flight_import import FlightImport
from lab.motion.frames import ecef
from lab.motion.frames.east_north_up import east_north_up
from lab.views.envelope import envelope, limits, thin_path
from lab.views.figures import TimeAxis, plain_figure, set_ordinate, time_figure
from lab.views.legend import add_legend
from lab.views.quantities import ESTIMATE, FIXES

POINTS = 2000
"""Largest number of drawn points of a curve or a path."""
ANGLES = ("roll", "pitch", "heading")


def preview_figures(read: FlightImport) -> tuple[figure, list[figure]]:
    """Return figures of a flight to import: the track, and height, speed and attitude over time.

    Parameters
    ----------
    read
        The flight, as `lab.missions.flight_import.prepare_import` returns it.

    Returns
    -------
    tuple of figure and list of figures
        The data of the file as points, the curves of the mission as lines.
    """
    axis = TimeAxis(name="preview")
    axis.span(float(read.recording.time[-1]))
    return _track(read), [_height(read, axis), _speed(read, axis), *_attitude(read, axis)]


def import_preview(read: FlightImport) -> Row:
    """Return the figures of `preview_figures` beside each other."""
    track, times = preview_figures(read)
    children: list[LayoutDOM] = [*times]
    return row(
        track, column(children, sizing_mode="stretch_both"), sizing_mode="stretch_both", min_height=640
    )


def save_preview(read: FlightImport, path: Path) -> None:
    """Write the preview and the report as a self-contained html file.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    text = PreText(text=str(read.report), sizing_mode="stretch_width")
    page: Column = column(import_preview(read), text, sizing_mode="stretch_width")
    html = file_html(page, INLINE, title=f"Import of {', '.join(one.name for one in read.paths)}")
    write_file(path, html)


def _track(read: FlightImport) -> figure:
    """Return the ground track in metres north and east of the start, equal scales."""
    recording, raw = read.recording, read.flight.raw
    made = recording.position
    fig = plain_figure(
        "Ground track",
        "east of the start [m]",
        "north of the start [m]",
        height=420,
        match_aspect=True,
        x_range=DataRange1d(range_padding=0.06),
        y_range=DataRange1d(range_padding=0.06),
        tools=[PanTool(), zoom := WheelZoomTool(), ResetTool()],
    )
    fig.toolbar.active_scroll = zoom
    fig.min_border_left = 80
    glyphs: dict[str, GlyphRenderer[Any]] = {}
    recorded = raw.position
    if recorded is not None:
        east, north = _map(made[:1], recorded)
        glyphs["recorded"] = fig.scatter(east, north, size=4, color=FIXES, line_color=None, alpha=0.6)
    east, north = _map(made[:1], made)
    glyphs["curve"] = fig.line(east, north, color=ESTIMATE, line_width=1.6)
    fig.scatter(east[:1], north[:1], size=9, color=ESTIMATE, marker="triangle")
    add_legend(fig, glyphs)
    return fig


def _map(start: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return metres east and north of the start, thinned for the screen."""
    metres = east_north_up(ecef.displacement(np.broadcast_to(start, position.shape), position))[:, :2]
    east, north = metres[thin_path(metres, POINTS)].T
    return east, north


def _height(read: FlightImport, axis: TimeAxis) -> figure:
    return _over_time(read, axis, "Height [m]", read.recording.height, read.flight.raw.height)


def _speed(read: FlightImport, axis: TimeAxis) -> figure:
    velocity = read.flight.raw.velocity_n
    recorded = None if velocity is None else np.linalg.norm(velocity, axis=1)
    made = np.linalg.norm(read.recording.velocity_n, axis=1)
    return _over_time(read, axis, "Speed over the Earth [m/s]", made, recorded)


def _attitude(read: FlightImport, axis: TimeAxis) -> Sequence[figure]:
    euler = read.flight.raw.euler
    made = np.degrees(np.unwrap(read.recording.euler, axis=0))
    recorded = None if euler is None else np.degrees(np.unwrap(euler, axis=0))
    label = ", reconstructed" if read.rebuilt.attitude_reconstructed else ""
    figures = []
    for column_, name in enumerate(ANGLES):
        turns = 0.0
        if recorded is not None:
            turns = 360 * np.round(np.median(recorded[:1, column_] - made[:1, column_]) / 360)
        figures.append(
            _over_time(
                read,
                axis,
                f"{name.capitalize()}{label} [°]",
                made[:, column_] + turns,
                None if recorded is None else recorded[:, column_],
            )
        )
    return figures


def _over_time(
    read: FlightImport, axis: TimeAxis, title: str, made: FloatArray, recorded: FloatArray | None
) -> figure:
    """Return a figure of a quantity over time: the curve as a line, the samples as points."""
    fig = time_figure(title, axis, height=120)
    whole = (0.0, axis.duration)
    if recorded is not None:
        time, (values,) = envelope(read.flight.raw.time, [recorded], whole, POINTS // 2)
        points = ColumnDataSource({"time": time, "value": values})
        fig.scatter("time", "value", source=points, size=3, color=FIXES, line_color=None, alpha=0.6)
    time, (values,) = envelope(read.recording.time, [made], whole, POINTS // 2)
    line = ColumnDataSource({"time": time, "value": values})
    fig.line("time", "value", source=line, color=ESTIMATE, line_width=1.3)
    fig.yaxis.ticker = BasicTicker(desired_num_ticks=4, num_minor_ticks=0)
    set_ordinate(fig, *limits([values], "free"))
    return fig
