"""Attitudes part: the attitude of the navigator beside that of one's own algorithm and of the device itself.

Algorithms are those that whoever runs the server has named; visitors choose among them by name.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.algorithms import live_places
from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.watched import ABOVE, RollingPart, Watched
from dashboards.pages.missions.entry_fields import layout_width
from dashboards.style import whole_column, wide_html
from lab.base.arrays import FloatArray
from lab.live.beside.attitude_comparison import DEVICE, OURS, AttitudeComparison, Difference
from lab.live.beside.own_algorithm import OwnAlgorithm
from lab.views.ensemble_cards import scroll_box
from lab.views.rolling_figures import LiveAttitudeFigures

NONE = "none"
"""Choice of no algorithm."""
RECENT = 60.0
"""Time over which attitudes are compared in the table [s]."""
_HEAD = (
    f"<tr><th>Last {RECENT:g} s</th><th>Tilt</th><th>Roll</th><th>Pitch</th><th>Heading, mean</th>"
    "<th>Heading about it</th></tr>"
)
_NOTHING = "<p>Connect a source to see its attitudes side by side.</p>"
_TABLE = """
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 2px 12px 2px 0; text-align: right; font-weight: 400; } th { opacity: 0.75; }
th:first-child, td:first-child { text-align: left; }
"""


class AttitudesPart(RollingPart):
    """The attitudes of one source.

    Parameters
    ----------
    window
        Length of time that is shown [s].
    begin_anew
        Fills the plots again from what the station still has.

    Attributes
    ----------
    view : panel.Column
        All of it.
    """

    def __init__(self, window: float, begin_anew: Callable[[], None]) -> None:
        self._comparison: AttitudeComparison | None = None
        self._own: OwnAlgorithm | None = None
        self._places = live_places()
        self._anew = begin_anew
        self._figures: LiveAttitudeFigures = LiveAttitudeFigures(window)
        self._words = wide_html(margin=(4, 10), stylesheets=[_TABLE])
        self._grid = make_hideable(plot_grid(self._figures.figures, 3, least=280, beside=ABOVE))
        names = list(self._places)
        self._choice = pmui.Select(
            label="Your algorithm",
            options=[NONE, *names],
            value=names[0] if len(names) == 1 else NONE,
            size="small",
            margin=(8, 10),
            visible=bool(names),
            **layout_width(240),
        )
        self._choice.param.watch(lambda _event: self._anew(), "value")
        self.view = whole_column(pn.Row(self._choice, margin=0), self._grid, self._words)
        self.watch(None)

    def watch(self, watched: Watched | None) -> None:
        """Show the attitudes of another source, or of none."""
        self._watched = watched
        self.begin_anew()
        self.tell()

    def close(self) -> None:
        """Refer to no source any more."""
        self._watched = self._comparison = self._own = None

    def begin_anew(self) -> None:
        """Forget what is drawn: the next `advance` draws all that the station still has."""
        self._comparison = self._own = None
        self._grid.visible = False
        self._figures.clear()

    def advance(self) -> None:
        """Append what came since the last time."""
        station = self._station
        if station is None:
            return
        if self._comparison is None:
            name = str(self._choice.value)  # a hand-made message may contain any value
            place = self._places.get(name)
            self._own = None if place is None else station.beside(name, place)
            self._comparison = AttitudeComparison(station, [self._own] if self._own else [])
        time, euler = self._comparison.advance()
        self._figures.add(time - station.zero, self._in_order(euler))
        if self._comparison.known:
            self._grid.visible = True
        self._figures.move(station.newest - station.zero)

    def _in_order(self, euler: FloatArray) -> FloatArray:
        """Return attitudes (n, 4, 3) in the order of the curves; without an algorithm, its curve is empty."""
        if self._own is None:
            return np.insert(euler, 1, np.nan, axis=1)
        return euler

    def tell(self) -> None:
        """Say how the attitudes differ, and how the algorithm fares."""
        station, comparison = self._station, self._comparison
        if station is None or comparison is None:
            self._words.object = _NOTHING
            return
        known = comparison.known
        sentences = [] if self._own is None else [self._own.sentence]
        if OURS not in known:
            sentences.append(f"The navigator of the lab has no attitude yet. {station.state.reason}")
        if DEVICE not in known:
            sentences.append("The device sends no attitude of its own.")
        if not self._places:
            sentences.append("A server with --live-algorithm FILE.py:Name shows your own here.")
        words = escape(" ".join(sentence for sentence in sentences if sentence))
        self._words.object = f"<p>{words}</p>{_table(comparison.differences(RECENT))}"


def _table(differences: list[Difference]) -> str:
    """Return the differences as a table."""
    if not differences:
        return ""
    rows = "".join(f"<tr>{''.join(_cells(one))}</tr>" for one in differences)
    return (
        f"{scroll_box(f'<table>{_HEAD}{rows}</table>', 'Differences')}"
        "<p>Tilt, roll, pitch and the last column are rms. Without a source of heading, its mean is "
        "arbitrary.</p>"
    )


def _cells(one: Difference) -> list[str]:
    values = np.degrees([one.tilt, one.roll, one.pitch, one.heading_offset, one.heading])
    shown = [f"{value:.2f}°" if np.isfinite(value) else "—" for value in values]
    names = escape(f"{one.first} − {one.second}")
    return [f"<td>{names}</td>", *(f"<td>{value.replace('-', '−')}</td>" for value in shown)]
