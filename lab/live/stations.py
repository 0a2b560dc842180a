"""Stations: the open sources of a process, and who has opened and who watches each."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from lab.data.streams.transport import TransportError
from lab.live.owner import Owner, Visitor, may_join, may_share, may_watch, owned_by
from lab.live.station import Station

MOST = 8
"""Most stations of a server at a time: each has threads, and a navigator at 1 kHz takes a tenth of a core."""
MOST_OF_ONE = 2
"""Most stations that one visitor opens at a time: four visitors then fill a server, and not one."""
ENDED = "The source has ended: nobody watched it any more. Choose another one."
"""Said of a source that is not open, and of one that a visitor may not know of."""


@dataclass
class _Open:
    """A station that is open.

    Attributes
    ----------
    wanted
        What it reads, as the one who opened it said.
    counted
        Whose place it takes.
    watchers
        Those who watch, and whose places they could take.
    """

    wanted: str
    station: Station
    counted: str
    watchers: dict[Hashable, str] = field(default_factory=dict)

    @property
    def takes_place_of(self) -> str:
        """Whose place it takes: that of its opener, until the last page of the opener has left."""
        return self.counted if self.counted in self.watchers.values() else ""


@dataclass(eq=False)
class _Opening:
    """A station that is being made."""

    wanted: str
    owner: Owner
    counted: str


class Stations:
    """The stations of a process, by their keys; usable from any thread.

    Parameters
    ----------
    most
        Most stations at a time.
    most_of_one
        Most stations at a time that one visitor has opened and still watches.
    """

    def __init__(self, most: int = MOST, most_of_one: int = MOST_OF_ONE) -> None:
        self._most, self._most_of_one = most, most_of_one
        self._changed = threading.Condition()
        self._open: dict[str, _Open] = {}
        self._opening: list[_Opening] = []

    def keys(self) -> set[str]:
        """Return the keys of all stations; of these, pages learn what `names` says."""
        with self._changed:
            return set(self._open)

    def names(self, visitor: Visitor) -> dict[str, str]:
        """Return the names of the stations that a visitor may watch, by their keys; no two are the same.

        They are numbered among these, so that a number says nothing about others.
        """
        with self._changed:
            found = {key: one.station for key, one in self._open.items()}
        known = {key: one.name for key, one in found.items() if may_watch(visitor, one.owner)}
        return dict(zip(known, _number_names(known.values()), strict=True))

    def recordings(self) -> set[Path]:
        """Return the recordings that run."""
        with self._changed:
            running = [one.station.source.recording for one in self._open.values()]
        return {path for path in running if path is not None}

    def watchers(self, key: str) -> int:
        """Return how many watch a station; 0 if it is not open."""
        with self._changed:
            return len(self._open[key].watchers) if key in self._open else 0

    def watch(self, key: str, watcher: Hashable, visitor: Visitor) -> Station:
        """Return an open station, and count someone who watches it.

        Parameters
        ----------
        key
            Its key.
        watcher
            Who watches.
        visitor
            Whose page it is.

        Raises
        ------
        TransportError
            If it is not open, or if the visitor may not watch it; the message is the same.
        """
        with self._changed:
            one = self._open.get(key)
            if one is None or not may_watch(visitor, one.station.owner):
                raise TransportError(ENDED)
            one.watchers[watcher] = visitor.counted
            return one.station

    def open(
        self,
        wanted: str,
        watcher: Hashable,
        make: Callable[[], Station],
        visitor: Visitor,
        *,
        alone: bool = False,
    ) -> tuple[str, Station]:
        """Return the key and the station of what is wanted, made unless one was opened alike.

        Parameters
        ----------
        wanted
            What it reads, such as its address.
        watcher
            Who watches.
        make
            Makes the station; called at most once.
        visitor
            Whose page it is. Stations that others opened alike are taken as `may_join` says.
        alone
            Whether only one at a time can read it, as a serial port.

        Raises
        ------
        TransportError
            If too many are open, on the server or by this visitor, or if somebody else reads what only one
            can read.
        """
        with self._changed:
            found = self._found(wanted, visitor, alone=alone)
            if found is not None:
                key, one = found
                one.watchers[watcher] = visitor.counted
                return key, one.station
            self._check(visitor)
            # It counts from now on, so that two who open at once cannot both take the last place.
            opening = _Opening(wanted, owned_by(visitor), visitor.counted)
            self._opening.append(opening)
        try:
            # Outside of the lock: to open a port may take seconds, in which others come and go.
            made = make()
        except BaseException:
            with self._changed:
                self._opening.remove(opening)
                self._changed.notify_all()
            raise
        with self._changed:
            self._opening.remove(opening)
            made.owner = opening.owner
            key = _choose_free_name(wanted, self._open)
            self._open[key] = _Open(wanted, made, visitor.counted, {watcher: visitor.counted})
            self._changed.notify_all()
        return key, made

    def _found(self, wanted: str, visitor: Visitor, *, alone: bool) -> tuple[str, _Open] | None:
        """Return a station that was opened alike, of which a visitor may be given; wait if it is being made.

        Raises
        ------
        TransportError
            If one is open alone, and not for this visitor.
        """
        may = may_watch if alone else may_join

        def owner_distance(owner: Owner) -> tuple[bool, bool]:  # first one's own, then that of a teacher
            return visitor.identity == owner.identity, owner.teaches

        while True:
            alike = [(key, one) for key, one in self._open.items() if one.wanted == wanted]
            found = [(key, one) for key, one in alike if may(visitor, one.station.owner)]
            if found:
                return max(found, key=lambda item: owner_distance(item[1].station.owner))
            # Whoever wants the same waits for it rather than open it a second time, and looks again from the
            # begin.
            coming = [one for one in self._opening if one.wanted == wanted]
            if any(may(visitor, one.owner) for one in coming):
                self._changed.wait()
                continue
            if alone and (alike or coming):
                raise TransportError(
                    f"{wanted} is in use on this server, and only one can read it. Choose another source, or "
                    "try again later."
                )
            return None

    def check_place(self, visitor: Visitor) -> None:
        """Check that a visitor may open one more station now.

        Raises
        ------
        TransportError
            If not.
        """
        with self._changed:
            self._check(visitor)

    def _check(self, visitor: Visitor) -> None:
        count = len(self._open) + len(self._opening)
        if count >= self._most:
            raise TransportError(
                f"{count} sources are open on this server; accepted are up to {self._most}: "
                "watch one of them, or close one"
            )
        if not visitor.counted:
            return
        held = [one.station for one in self._open.values() if one.takes_place_of == visitor.counted]
        coming = sum(one.counted == visitor.counted for one in self._opening)
        if len(held) + coming < self._most_of_one:
            return
        words = [f"“{one.name}”" if may_watch(visitor, one.owner) else "one on another page" for one in held]
        words += ["one that is being opened"] * coming
        raise TransportError(
            f"You have {len(words)} sources open: {' and '.join(words)}. Accepted are up to "
            f"{self._most_of_one} for each visitor. Disconnect one on the page that shows it, then connect "
            "this one. A page that you closed gives its source back within half a minute."
        )

    def share(self, key: str, visitor: Visitor, shared: bool) -> None:
        """Share a station with the class of its owner, or no longer; from others, nothing is taken."""
        with self._changed:
            one = self._open.get(key)
            if one is not None and may_share(visitor, one.station.owner):
                one.station.owner = one.station.owner._replace(shared=shared)

    def leave(self, key: str, watcher: Hashable) -> bool:
        """Stop watching; may be repeated.

        Returns
        -------
        bool
            Whether the station has ended: it ends with the last who watches.
        """
        with self._changed:
            one = self._open.get(key)
            if one is None or watcher not in one.watchers:
                return False
            del one.watchers[watcher]
            if one.watchers:
                return False
            del self._open[key]
        # Outside of the lock: it waits for the threads of the station.
        one.station.close()
        return True

    def close(self) -> None:
        """End all stations."""
        with self._changed:
            stations = [one.station for one in self._open.values()]
            self._open.clear()
        for station in stations:
            station.close()


def _choose_free_name(name: str, taken: Iterable[str]) -> str:
    """Return a name that is not taken, numbered if it must be: people choose by names."""
    known = set(taken)
    numbered = (name if number == 1 else f"{name} ({number})" for number in itertools.count(1))
    return next(one for one in numbered if one not in known)


def _number_names(names: Iterable[str]) -> Iterator[str]:
    """Yield names of which no two are the same."""
    taken: set[str] = set()
    for name in names:
        free = _choose_free_name(name, taken)
        taken.add(free)
        yield free
