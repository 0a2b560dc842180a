"""Watched: the source that a page watches, for as long as its visitor may."""

from __future__ import annotations

from collections.abc import Callable

from dashboards.devices import STATIONS
from lab.live.owner import Visitor, may_change, may_share, may_watch
from lab.live.station import Station


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
