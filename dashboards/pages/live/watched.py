"""Watched: the source that a page watches, for as long as its visitor may, and parts that look at it."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import panel as pn

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.devices import STATIONS
from dashboards.sending import soon, together
from lab.base.progress import Progress
from lab.live.owner import Visitor, may_change, may_share, may_watch
from lab.live.station import Station
from lab.views.rolling_figures import LiveAttitudeFigures, LiveErrorFigures

ABOVE = 245
"""Height of what stands above the plots of a part, without the time bar, which is not there [px]."""


class Watched:
    """A station with the rights of one page, which are looked up at each use.

    A page may leave its class, a class may end, and an owner may stop sharing while a stream runs.

    Parameters
    ----------
    key
        Key of the station.
    watcher
        Who watches, as `Stations` counts it.
    station
        The station.
    visitor
        Returns whose page it is.
    """

    def __init__(
        self, key: str, watcher: object, station: Station, visitor: Callable[[], Visitor] = Visitor
    ) -> None:
        self.key, self.watcher = key, watcher
        self._station, self._visitor = station, visitor

    @property
    def station(self) -> Station | None:
        """The station; None once the visitor may not watch it any more."""
        return self._station if may_watch(self._visitor(), self._station.owner) else None

    @property
    def may_change(self) -> bool:
        """Whether the visitor may change the axes, and unplug the source."""
        return self.station is not None and may_change(self._visitor(), self._station.owner)

    @property
    def may_share(self) -> bool:
        """Whether the visitor may share the source with a class."""
        return may_share(self._visitor(), self._station.owner)

    @property
    def is_shared(self) -> bool:
        """Whether the owner shares the source with a class."""
        return self._station.owner.shared

    def share(self, shared: bool) -> None:
        """Share the source with the class, or no longer; from others than its owner, nothing is taken."""
        STATIONS.share(self.key, self._visitor(), shared)


class PartOfWatched:
    """A part of the page Live: it has the station only while the visitor may watch it."""

    _watched: Watched | None = None

    @property
    def _station(self) -> Station | None:
        return None if self._watched is None else self._watched.station


class RollingPart(PartOfWatched):
    """A part whose plots move with the stream."""

    _figures: LiveErrorFigures | LiveAttitudeFigures

    def widen(self, window: float) -> None:
        """Show another length of time [s], from the next `begin_anew`."""
        self._figures.widen(window)

    @property
    def taken(self) -> bool:
        """Whether the browser has drawn what was sent last."""
        return self._figures.taken


class LookingPart(PartOfWatched):
    """A part that looks at the source again and again while it is seen, in the pool."""

    every: ClassVar[float] = 0.0
    """Least time of the stream from look to look [s]."""

    def __init__(self) -> None:
        self._looked = -math.inf
        self._document = pn.state.curdoc
        self._work: LatestWins[Station] = LatestWins(self._compute, self._deliver, LONG)

    @abstractmethod
    def look(self, station: Station) -> Any:
        """Return what is to be shown of a source; called in a thread."""

    @abstractmethod
    def show(self, found: Any) -> None:
        """Show what `look` has returned."""

    def tell(self) -> None:
        """Look at the source again, unless it is still looked at."""
        station = self._station
        if station is not None and not self._work.busy and abs(station.newest - self._looked) >= self.every:
            self._looked = station.newest
            self._work.submit(station)

    def close(self) -> None:
        """Deliver no further results."""
        self._work.close()

    def _compute(self, station: Station, _progress: Progress) -> Outcome:
        return attempt(lambda: self.look(station))

    def _deliver(self, station: Station, outcome: Outcome) -> None:
        def arrive() -> None:
            assert self._document is not None
            if station is self._station and not outcome.problem:
                with together(self._document):
                    self.show(outcome.result)

        if self._document is not None:
            soon(self._document, arrive)
