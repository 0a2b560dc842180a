"""Live figures: rolling plots of a stream and of its navigator; made once, rows are appended to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from bokeh.models.annotations import Span, Title
from bokeh.models.callbacks import CustomJS
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.live.live_state import ALIGNING, ATTITUDE_ONLY
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap
from lab.views.attitude_figure import AttitudeFigure
from lab.views.envelope import nice_limit
from lab.views.figures import plain_figure
from lab.views.legend import add_still_legend
from lab.views.parcel import Parcel
from lab.views.quantities import CURSOR, ESTIMATE, FIXES
from lab.views.rolling_figures import RollingFigures
from lab.views.rolling_plot import RollingPlot

WINDOWS = {"10 s": 10.0, "20 s": 20.0, "1 min": 60.0, "4 min": 240.0}
"""Lengths of time that are shown [s]."""
AXES = ("forward", "right", "down")
"""Labels of the axes of the vehicle."""
ANGLES = ("roll", "pitch", "heading")
"""Labels of the angles."""
NORTH_EAST_DOWN = ("north", "east", "down")
"""Labels of the axes of the Earth."""
INNOVATIONS = tuple(f"{what} {axis}" for what in ("position", "velocity") for axis in NORTH_EAST_DOWN)
"""Names of the measurements of a fix."""
# Colours are those of the axes beside; the markers tell position from velocity.
_MEASURED = {"position": INNOVATIONS[:3], "velocity": INNOVATIONS[3:]}
_TURNS = 3
"""Groups of figures that take turns."""
_TRACK_RATE = 10.0
"""Points of the ground track per second [Hz]: 3 m apart at 30 m/s."""
_TRACK_POINTS = 3000
"""Most points of the ground track: five minutes at 10 Hz."""
_FREE = 0.25
"""Part of the north axis of the ground track that is left free at the top, for the legend."""
_UNKNOWN = np.pi
"""σ of a heading from which it is unknown [rad]."""


class LiveTrack:
    """The ground track in metres from the first position, with the 3σ ellipse of the last one.

    Parameters
    ----------
    parcel
        Takes the changes.
    group
        Their group.
    """

    def __init__(self, parcel: Parcel, group: int = 0) -> None:
        self._parcel = parcel
        self._title = Title(text="Ground track: no position")
        # Ranges by hand: automatic ones would paint the figure twice.
        self._x, self._y = Range1d(start=-10, end=10), Range1d(start=-10, end=20 / (1 - _FREE) - 10)
        self.figure: figure = plain_figure(
            self._title,
            "east [m]",
            "north [m]",
            x_range=self._x,
            y_range=self._y,
        )
        nothing: dict[str, Any] = {"east": [], "north": []}
        self._path = ColumnDataSource(dict(nothing), name="live:track")
        self._fixes = ColumnDataSource(dict(nothing), name="live:fixes")
        self._now = ColumnDataSource({**nothing, "width": [], "height": []}, name="live:position")
        keep_equal(self.figure, self._x, self._y)
        fixes = self.figure.scatter(
            "east", "north", source=self._fixes, color=FIXES, size=4, alpha=0.7, level="overlay"
        )
        path = self.figure.line(
            "east", "north", source=self._path, color=ESTIMATE, line_width=2, level="overlay"
        )
        ellipse = self.figure.ellipse(
            "east", "north", "width", "height", source=self._now, fill_color=CURSOR, fill_alpha=0.2,
            line_color=CURSOR, level="overlay",
        )  # fmt: skip
        here = self.figure.scatter("east", "north", source=self._now, color=CURSOR, size=6, level="overlay")
        add_still_legend(self.figure, {"estimate": [path], "fixes": [fixes], "now with 3σ": [here, ellipse]})
        self._origin: FloatArray | None = None
        self._drawn = False  # whether the path ends with a position
        self._shown = (10.0, -10.0, -10.0)
        self._extent = np.array([[-10.0, -10.0], [10.0, 10.0]])
        self._numbers = [
            parcel.number(model, group)
            for model in (self._path, self._fixes, self._now, self._title, self._x, self._y)
        ]

    def clear(self) -> None:
        """Forget the path."""
        self._origin, self._drawn, self._shown = None, False, (0.0, 0.0, 0.0)
        self._extent = np.array([[-10.0, -10.0], [10.0, 10.0]])
        for number in self._numbers[:2]:
            self._parcel.stream(number, {"east": [], "north": []}, None)
        self._show_none()
        self._fit()

    def _show_none(self) -> None:
        now, title = self._numbers[2:4]
        self._parcel.stream(now, {"east": [], "north": [], "width": [], "height": []}, None)
        self._parcel.set(title, text="Ground track: no position")

    def add(self, position: FloatArray, fixes: FloatArray) -> None:
        """Append positions and fixes, (n, 2 or 3) and (m, 2 or 3): latitude, longitude [rad]."""
        position = self._with_breaks(position)
        if self._origin is None:
            known = (rows[np.isfinite(rows).all(axis=1)] for rows in (position, fixes))
            first = next((rows[0] for rows in known if len(rows)), None)
            if first is None:
                return
            self._origin = np.array(first[:2])
        for number, rows in zip(self._numbers[:2], (position, fixes), strict=True):
            if len(rows):
                east, north = self._metres(rows)
                self._parcel.stream(number, {"east": east, "north": north}, _TRACK_POINTS)
                points = np.stack((east, north), axis=-1)
                points = points[np.isfinite(points).all(axis=1)]
                if not len(points):
                    continue
                self._extent = np.stack(
                    (
                        np.minimum(self._extent[0], points.min(axis=0)),
                        np.maximum(self._extent[1], points.max(axis=0)),
                    )
                )
                self._fit()

    def _with_breaks(self, position: FloatArray) -> FloatArray:
        """Return positions with one row of NaN for each time without: the path is interrupted there."""
        if not len(position):
            return position
        known: NDArray[np.bool_] = np.asarray(np.isfinite(position).all(axis=1))
        before = np.append(self._drawn, known[:-1])
        self._drawn = bool(known[-1])
        return np.asarray(position[known | before])

    def show(self, position: FloatArray, sigma: FloatArray, *, words: bool, of_fix: bool = False) -> None:
        """Draw where it is now.

        Parameters
        ----------
        position : (3,) array
            Latitude, longitude [rad], height [m]; NaN if unknown.
        sigma : (3,) array
            σ north, east, down [m].
        words
            Whether the title is renewed, with which a browser paints the whole figure.
        of_fix
            Whether the position is that of the last fix, as of a navigator without one of its own.
        """
        if self._origin is None or not np.isfinite(position).all():
            self._show_none()
            return
        east, north = self._metres(position[None])
        now, title = self._numbers[2:4]
        size = {"width": [6 * sigma[1]], "height": [6 * sigma[0]]}
        self._parcel.stream(now, {"east": east, "north": north, **size}, None)
        if words:
            sigma_now = float(f"{max(sigma[0], sigma[1]):.2g}")  # two digits, without an exponent
            numbers = f"σ {sigma_now:g} m, height {position[2]:.0f} m".replace("-", "\u2212")
            self._parcel.set(title, text=f"Ground track: {'last fix, ' if of_fix else ''}{numbers}")

    def _metres(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self._origin is not None
        per_latitude, per_longitude = metres_per_radian(self._origin[0], 0.0)
        return (
            np.asarray(wrap(rows[:, 1] - self._origin[1]) * per_longitude),
            np.asarray((rows[:, 0] - self._origin[0]) * per_latitude),
        )

    def _fit(self) -> None:
        low, high = self._extent
        middle, half = (low + high) / 2, nice_limit(0.55 * float((high - low).max()))
        start = middle - half
        if self._shown != (half, *start) and not self._fits_track(low, high, half):
            self._shown = (half, *start)
            lengths = 2 * half, 2 * half / (1 - _FREE)
            for number, low_end, length in zip(self._numbers[4:], start, lengths, strict=True):
                self._parcel.set(number, start=float(low_end), end=float(low_end + length))

    def _fits_track(self, low: FloatArray, high: FloatArray, half: float) -> bool:
        """Return whether what is shown holds the track, at a scale that still fits."""
        shown_half, *start = self._shown
        return bool(
            shown_half == half
            and (np.array(start) <= low).all()
            and (high <= np.array(start) + 2 * half).all()
        )


class LiveFigures(RollingFigures):
    """All plots of a stream, over the same rolling time.

    Attributes
    ----------
    figures : list of figure
        In reading order.
    """

    def __init__(self) -> None:
        super().__init__(WINDOWS["20 s"], "live ages")
        ages, parcel = self._range, self._parcel
        self._rate = RollingPlot("Angular rate", "°/s", AXES, ages, parcel, least=0.5)
        self._force = RollingPlot("Specific force", "m/s²", AXES, ages, parcel, least=0.5)
        self._tilt = RollingPlot("Roll and pitch", "°", ANGLES[:2], ages, parcel, least=1.0, group=1)
        self._heading = RollingPlot("Heading", "°", ("heading",), ages, parcel, least=5.0, group=1)
        self._sigma = RollingPlot("σ of the attitude", "°", ANGLES, ages, parcel, logarithmic=True, group=2)
        self._velocity = RollingPlot("Velocity", "m/s", NORTH_EAST_DOWN, ages, parcel, least=0.5, group=2)
        self._innovation = RollingPlot(
            "Innovations, dashed ±3",
            "σ",
            INNOVATIONS,
            ages,
            parcel,
            points=True,
            least=3.5,
            legend=_MEASURED,
            group=3,
        )
        for limit in (-3.0, 3.0):
            self._innovation.figure.add_layout(
                Span(location=limit, dimension="width", line_color="#808895", line_dash="dashed")
            )
        self._track = LiveTrack(parcel, 3)
        self._attitude = AttitudeFigure(parcel)
        self._hold_plots((
            self._rate, self._force, self._tilt, self._heading, self._sigma, self._velocity, self._innovation,
        ))  # fmt: skip
        self._turn = 0
        self._last_heading = np.nan  # [°]
        self._last_step = -np.inf  # of the ground track, 1 / `_TRACK_RATE`
        self.figures = [
            self._rate.figure, self._force.figure, self._attitude.figure,
            self._tilt.figure, self._heading.figure, self._sigma.figure,
            self._velocity.figure, self._innovation.figure, self._track.figure,
        ]  # fmt: skip

    def clear(self) -> None:
        """Forget all rows, as for another source; drawn with the next `show`."""
        super().clear()
        self._track.clear()
        self._attitude.show(None)
        self._last_heading, self._last_step = np.nan, -np.inf

    def add_samples(self, rows: NDArray[np.void], zero: float) -> None:
        """Append thinned samples.

        Parameters
        ----------
        rows : (n,) array of `lab.data.streams.rolling.THINNED`
            Samples.
        zero
            Time that the plots call zero [s].
        """
        time = rows["time"] - zero
        self._rate.add(time, np.degrees(rows["rate"]), self.window)
        self._force.add(time, rows["force"], self.window)

    def add_history(self, history: Any, zero: float) -> None:
        """Append what a live navigator showed, a `lab.live.live_state.LiveHistory`; `zero` as before."""
        time = history.time - zero
        euler, sigma = np.degrees(history.euler), np.degrees(history.euler_sigma)
        unknown = history.euler_sigma[:, 2] >= _UNKNOWN
        heading = np.where(unknown, np.nan, euler[:, 2] % 360)
        # Rows come one by one: the turn through north may be between the last call and this.
        jumps = np.abs(np.diff(heading, prepend=self._last_heading)) > 180
        self._last_heading = float(heading[-1]) if heading.size else self._last_heading
        self._tilt.add(time, euler[:, :2], self.window)
        self._heading.add(time, np.where(jumps, np.nan, heading)[:, None], self.window)
        self._sigma.add(time, np.where(sigma < np.degrees(_UNKNOWN), sigma, np.nan), self.window)
        self._velocity.add(time, history.velocity_n, self.window)
        spread = np.sqrt(np.diagonal(history.innovation_covariance, axis1=1, axis2=2))
        self._innovation.add(history.fix_time - zero, history.innovation / spread, self.window)
        step = np.floor(history.time * _TRACK_RATE)
        drawn = np.diff(step, prepend=self._last_step) > 0
        self._last_step = float(step[-1]) if step.size else self._last_step
        self._track.add(history.position[drawn][-_TRACK_POINTS:], np.empty((0, 3)))

    def add_fixes(self, fix: NDArray[np.void]) -> None:
        """Append fixes to the ground track, rows of `lab.data.clock.timed_samples.TIMED_FIX`."""
        self._track.add(np.empty((0, 3)), np.column_stack((fix["latitude"], fix["longitude"])))

    def show(self, state: Any, now: float, *, whole: bool = True, words: bool = True) -> None:
        """Draw the present, and move the window.

        Parameters
        ----------
        state
            A `lab.live.live_state.LiveState`.
        now
            End of the window [s].
        whole
            Whether all figures are drawn. Otherwise rate, force and attitude are drawn, and the others take
            turns: a browser paints five figures sooner than nine.
        words
            Whether the titles with numbers are renewed, with which a browser paints the whole figure.
        """
        relative = not np.isfinite(state.euler_sigma[2]) or state.euler_sigma[2] >= _UNKNOWN
        self._attitude.show(state.euler, is_relative=bool(relative), title=words)
        of_fix = state.phase in (ALIGNING, ATTITUDE_ONLY)
        self._track.show(state.position, state.position_sigma, words=words, of_fix=of_fix)
        self._turn = (self._turn + 1) % _TURNS
        self.move(now, None if whole else (0, 1 + self._turn))


WIDEN = Path(__file__).with_name("live_figures.js").read_text("utf-8")
"""Widens the shorter range about its middle; what the server or a person has set is shown whole."""


def keep_equal(fig: figure, x: Range1d, y: Range1d) -> None:
    """Keep the scales of both axes equal in the browser, whatever its size.

    Parameters
    ----------
    fig
        The figure.
    x, y
        Its ranges; who sets them sets the start first, or both at once.
    """
    widen = CustomJS(args={"fig": fig, "x": x, "y": y}, code=WIDEN)
    for size in ("inner_width", "inner_height"):  # they are set when the figure has been laid out
        fig.js_on_change(size, widen)
    for one in (x, y):
        one.js_on_change("end", widen)
