"""Station: a source that many watch: its samples, thinned and navigated with once for all of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from lab.live.source import Source, Status
from lab.live.thinned import Thinned
from lab.live.transport import TransportError

MOST = 8
"""Most stations of a server at a time: each has threads, and a navigator at 1 kHz takes a tenth of a core."""
PERIOD = 0.05
"""Longest time between two turns of a station [s]: what is shown is late by no more."""


class Station:
    """A source with those who watch it; it ends when the last of them leaves.

    Parameters
    ----------
    source
        The source, which the station starts and ends.
    name
        What people call it.
    """

    def __init__(self, source: Source, name: str) -> None:
        self.source = source
        self.name = name
        self.thinned = Thinned()
        self.begun = time.monotonic()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"station {name}", daemon=True)
        source.start()
        self._thread.start()

    @property
    def status(self) -> Status:
        """The state of the source."""
        return self.source.status

    def _run(self) -> None:
        cursor = None
        while not self._ending.is_set():
            read = self.source.since(cursor)
            cursor = read.cursor
            self.thinned.add(read.imu)
            if self.source.ended and self.source.end == cursor:
                return
            self.source.wait(cursor, PERIOD)
            self._ending.wait(PERIOD)

    def close(self) -> None:
        """End the threads, and free the port; may be repeated."""
        self._ending.set()
        self.source.close()
        self._thread.join()


class Stations:
    """The stations of a process, by what they read.

    Parameters
    ----------
    most
        Most stations at a time.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._open: dict[str, tuple[Station, set[Any]]] = {}

    def names(self) -> dict[str, str]:
        """Return the names of the open stations, by their keys."""
        with self._lock:
            return {key: station.name for key, (station, _) in self._open.items()}

    def watch(self, key: str, watcher: Any, make: Callable[[], Source], name: str = "") -> Station:
        """Return the station of a key, which is opened if it is not open, and count someone who watches it.

        Parameters
        ----------
        key
            What it reads, such as its address.
        watcher
            Who watches; anything that can be in a set.
        make
            Makes its source; called by the first who watches.
        name
            What people call it; the key by default.

        Raises
        ------
        TransportError
            If too many are open, or the source cannot be made.
        """
        with self._lock:
            if key in self._open:
                station, watchers = self._open[key]
                watchers.add(watcher)
                return station
            if len(self._open) >= self._most:
                raise TransportError(
                    f"{len(self._open)} sources are open on this server; accepted are up to {self._most}: "
                    "watch one of them, or close one"
                )
        source = make()
        with self._lock:
            if key not in self._open:
                self._open[key] = Station(source, name or key), {watcher}
                return self._open[key][0]
        source.close()  # someone else was faster
        return self.watch(key, watcher, make, name)

    def leave(self, key: str, watcher: Any) -> None:
        """Stop watching; the station ends with the last who watches. May be repeated."""
        with self._lock:
            if key not in self._open:
                return
            station, watchers = self._open[key]
            watchers.discard(watcher)
            if watchers:
                return
            del self._open[key]
        station.close()

    def close(self) -> None:
        """End all stations."""
        with self._lock:
            stations = [station for station, _ in self._open.values()]
            self._open.clear()
        for station in stations:
            station.close()
