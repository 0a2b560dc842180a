"""Allan part: the Allan deviation of a device at rest as it grows, a card made of it, and the spectrum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.card_maker import CardMaker
from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.spectrum_part import SpectrumPart
from dashboards.pages.live.watched import ABOVE, PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import layout_width
from dashboards.sending import soon, together
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.analysis import allan, rest
from lab.base.progress import Progress
from lab.live.bench.growing_allan import LEAST_FOR_CARD, GrowingAllan
from lab.live.station import Station
from lab.sensors.cards import Card
from lab.views.allan import AllanFigures

WANTED = {"1 s": 1.0, "10 s": 10.0, "100 s": 100.0, "1000 s": 1000.0}
"""Averaging times that a person may wait for [s]."""
GROWN = 1.05
"""Growth of the record after which the deviation is computed again: the curve changes little before."""
SOONEST = 2.0
"""Least growth of the record after which it is computed again [s]."""


class AllanPart(PartOfWatched):
    """The deviation of both triads beside that of the sensors in the settings.

    Parameters
    ----------
    session
        Its sensors are compared.

    Attributes
    ----------
    view : panel.Column
        All of it.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._document = pn.state.curdoc
        self._seen = 0.0, 0  # length [s] of the record that is shown, and how often it had begun again
        self._figures = AllanFigures()
        self._grid = make_hideable(plot_grid(self._figures.figures, 2, least=360, beside=ABOVE))
        self._work: LatestWins[Station] = LatestWins(self._compute, self._deliver, LONG)
        self._words = wide_html(margin=(4, 10))
        self._wanted = pmui.Select(
            label="Wanted τ",
            options=list(WANTED),
            value="100 s",
            size="small",
            margin=(8, 4),
            **layout_width(110),
        )
        self._wanted.param.watch(lambda _event: self.tell(), "value")
        self._maker = CardMaker(lambda: self._station, _records)
        self._maker.view.insert(0, self._wanted)
        self._spectrum = SpectrumPart(self._session)
        self.view = whole_column(
            self._words, self._maker.view, self._maker.job.view, self._grid, self._spectrum.view
        )

    @property
    def card(self) -> Card | None:
        """The card that was made last of this source."""
        return self._maker.card

    def watch(self, watched: Watched | None) -> None:
        """Show another device, or none."""
        self._watched, self._seen = watched, (0.0, 0)
        self._spectrum.watch(watched)
        self._clear()
        self._maker.forget()
        if watched is None:
            self.tell()

    def tell(self) -> None:
        """Show how long the record is, and compute the deviation again if it has grown."""
        station = self._station
        if station is None:
            self._words.object = "<p>Connect a source that is at rest.</p>"
            return
        self._spectrum.tell()
        tau = WANTED.get(str(self._wanted.value), 100.0)
        with station.growing() as growing:
            duration, restarts, sentence = growing.duration, growing.restarts, growing.sentence
            left = growing.time_to(tau)
            ready = len(growing) > allan.MIN_SAMPLES
        self._words.object = f"<p>{escape(sentence)} {escape(_wait(left, tau, duration))}</p>"
        self._maker.button.disabled = duration < LEAST_FOR_CARD
        shown, before = self._seen
        if restarts != before:
            self._clear()
            shown = 0.0
            self._seen = 0.0, restarts
        if ready and not self._work.busy and duration > max(GROWN * shown, shown + SOONEST):
            self._seen = duration, restarts
            self._work.submit(station)

    def _clear(self) -> None:
        """Show no curves, and no plots without curves."""
        self._figures.clear()
        self._grid.visible = False

    def close(self) -> None:
        """Deliver no further results."""
        self._work.close()
        self._spectrum.close()
        self._maker.close()

    def _compute(self, station: Station, _progress: Progress) -> Outcome:
        def work() -> Any:
            with station.growing() as growing:
                records = growing.records()
            return {triad: allan.deviation(record.rates, record.dt) for triad, record in records.items()}

        return attempt(work)

    def _deliver(self, station: Station, outcome: Outcome) -> None:
        def arrive() -> None:
            assert self._document is not None
            # A record that has begun again may be too short: the next one is shown.
            if station is self._station and not outcome.problem:
                with together(self._document):
                    self._figures.show(self._session.experiment.sensors, outcome.result)
                    self._grid.visible = True

        if self._document is not None:
            soon(self._document, arrive)


def _records(station: Station) -> tuple[Mapping[str, rest.Record], str]:
    """Return the record of a device as far as it has grown, and the name of its source."""
    with station.growing() as growing:
        _refuse_short(growing)
        return growing.records(), station.name


def _refuse_short(growing: GrowingAllan) -> None:
    if growing.duration < LEAST_FOR_CARD:
        raise ValueError(
            f"The record has {growing.duration:.0f} s at rest; accepted for a card are "
            f"{LEAST_FOR_CARD:g} s or more"
        )


def _wait(left: float, tau: float, duration: float) -> str:
    """Return how long the device must still be at rest."""
    if math.isnan(left):
        return ""
    words = (
        f"τ = {tau:g} s is reached."
        if left <= 0
        else f"τ = {tau:g} s is reached in {_format_duration(left)}."
    )
    if duration < LEAST_FOR_CARD:
        words += f" A card can be made in {_format_duration(LEAST_FOR_CARD - duration)}."
    return words


def _format_duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
