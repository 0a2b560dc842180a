"""Twin part: the stream beside simulations of its motion, with the sensors of the settings or a card."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

import panel_material_ui as pmui

from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.watched import ABOVE, PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.pages.missions.job import Job
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.analysis.rest import with_noise
from lab.experiment.experiment import Experiment
from lab.live.station import Station
from lab.live.twin import TwinComparison, twin_at_rest, twin_of
from lab.sensors.cards import Card
from lab.views.twin_comparison import STYLE, TwinFigures, twin_html

SETTINGS, MEASURED = "Those of the settings", "The card made under Allan"
"""Sensors that are simulated."""
LEAST_STREAM = 60.0
"""Least time for which fixes have come, for a comparison with motion [s]: the filter needs half of it."""
LEAST_REST = 30.0
"""Least length of a record at rest without fixes [s]: it shows the Allan deviation over 1 s."""


class TwinPart(PartOfWatched):
    """A button that simulates the stream, and what came of it.

    Parameters
    ----------
    session
        Its sensors are simulated.
    measured
        Returns the card that was made of the record at rest, or None.

    Attributes
    ----------
    view : panel.Column
        All of it.
    """

    def __init__(self, session: Session, measured: Callable[[], Card | None]) -> None:
        self._session, self._measured = session, measured
        self._figures = TwinFigures()
        self._words = wide_html(margin=(4, 10))
        self._sensors = pmui.Select(
            label="Simulated sensors", options=[SETTINGS, MEASURED], value=SETTINGS, size="small",
            margin=(8, 4), **layout_width(240),
        )  # fmt: skip
        self._compare = pmui.Button(
            label="Compare with a simulation", icon="compare", disabled=True, margin=(10, 4)
        )
        self._compare.on_click(lambda _event: self._start())
        self._job = Job()
        self._table = wide_html(margin=(4, 10), stylesheets=[STYLE])
        self._grid = make_hideable(plot_grid(self._figures.figures, 2, least=300, beside=ABOVE))
        self.view = whole_column(
            self._words, fields_row(self._sensors, self._compare), self._job.view, self._table, self._grid
        )

    def watch(self, watched: Watched | None) -> None:
        """Compare another source, or none."""
        self._watched = watched
        self._table.object = ""
        self._grid.visible = False
        self._job.say("")
        self.tell()

    def tell(self) -> None:
        """Say what can be compared."""
        sentence, ready = self._describe_readiness()
        self._words.object = f"<p>{escape(sentence)}</p>"
        self._compare.disabled = not ready

    def close(self) -> None:
        """Deliver no further results."""
        self._job.close()

    def _describe_readiness(self) -> tuple[str, bool]:
        """Return what can be compared, and whether it can."""
        station = self._station
        if station is None:
            return "Connect a source: its motion is simulated with sensors of yours, and compared.", False
        if station.source.end.fix:
            length = station.newest - station.zero
            if length < LEAST_STREAM:
                return f"A comparison needs {LEAST_STREAM - length:.0f} s more of the stream.", False
            return (
                "The last two minutes are smoothed, then simulated ten times to see how much varies by "
                "chance. Noise, lines, innovations and drift are compared.",
                True,
            )
        with station.growing() as growing:
            length = growing.duration
        if length < LEAST_REST:
            return (
                f"Without fixes, only a device at rest is compared: leave it at rest for "
                f"{LEAST_REST - length:.0f} s more.",
                False,
            )
        return f"The record of {length:.0f} s at rest is compared with ten simulations.", True

    def _start(self) -> None:
        station = self._station
        if station is None or self._job.busy or not self._describe_readiness()[1]:
            return
        experiment = self._session.experiment.copy()
        if self._sensors.value == MEASURED:
            card = self._measured()
            if card is None:
                self._job.say("There is no card yet: make one under Allan, of a record at rest.")
                return
            experiment.update({"sensors": with_noise(experiment.sensors, card).to_dict()})
        self._job.start(
            "Comparing",
            lambda progress: _compare_station(station, experiment, progress),
            lambda found: self._arrived(station, found),
        )

    def _arrived(self, station: Station, found: TwinComparison) -> None:
        if station is not self._station:  # disconnected meanwhile
            return
        self._table.object = twin_html(found)
        self._figures.show(found)
        self._grid.visible = True


def _compare_station(
    station: Station, experiment: Experiment, progress: Callable[[str, float], Any]
) -> TwinComparison:
    """Return the comparison of what a station keeps; in a thread."""
    if station.source.end.fix:
        return twin_of(station.log(), experiment.sensors, experiment.navigator, progress=progress)
    with station.growing() as growing:
        records = growing.records()
    return twin_at_rest(records, experiment.sensors, progress=progress)
