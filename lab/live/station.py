"""Station: a source that many watch: received, thinned and navigated with once for all of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable

from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import Cursor, LiveHistory, LiveState
from lab.live.source import Source, Status
from lab.live.thinned import Thinned
from lab.live.transport import TransportError
from lab.logs.sensor_log import SensorLog

MOST = 8
"""Most stations of a server at a time: each has threads, and a navigator at 1 kHz takes a tenth of a core."""
PERIOD = 0.05
"""Longest time between two turns of a station [s]: what is shown is late by no more."""


class Station:
    """A source with those who watch it; its threads end with `close`.

    Parameters
    ----------
    source
        The source, which the station starts and ends.
    navigator
        Navigates with its samples; used by the station's thread alone.
    name
        What people call it.
    """

    def __init__(self, source: Source, navigator: LiveNavigator, name: str) -> None:
        self.source = source
        self.name = name
        self.thinned = Thinned()
        self.begun = time.monotonic()
        self.failure = ""
        self._navigator = navigator
        self._state = navigator.state
        self._lock = threading.Lock()  # of the navigator
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"station {name}", daemon=True)
        source.start()
        self._thread.start()

    @property
    def status(self) -> Status:
        """The state of the source."""
        return self.source.status

    @property
    def state(self) -> LiveState:
        """What the navigator knew after the last samples."""
        return self._state

    def history(self, cursor: Cursor) -> tuple[Cursor, LiveHistory]:
        """Return what the navigator showed since a cursor, and the next cursor."""
        with self._lock:
            return self._navigator.since(cursor)

    def log(self) -> SensorLog:
        """Return the samples that the navigator keeps as a log; raises `ValueError` if there are too few."""
        with self._lock:
            if not self._state.fixes_used:
                raise ValueError("no fix has been used yet")
            return self._navigator.log()

    def _run(self) -> None:
        cursor = None
        while not self._ending.is_set():
            read = self.source.since(cursor)
            cursor = read.cursor
            self.thinned.add(read.imu)
            self._navigate(read.imu, read.fix)
            if self.source.ended and self.source.end == cursor:
                return
            self.source.wait(cursor, PERIOD)
            # Samples are taken together: a turn for each would cost ten times as much.
            self._ending.wait(PERIOD)

    def _navigate(self, imu: object, fix: object) -> None:
        """Feed the navigator; if it fails, the samples are still shown and recorded."""
        if self.failure:
            return
        try:
            with self._lock:
                self._navigator.feed(imu, fix)  # type: ignore[arg-type]
                self._state = self._navigator.state
        except Exception as error:
            self.failure = f"The navigator failed: {type(error).__name__}: {error}"
            raise

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
        self._open: dict[str, tuple[Station, set[Hashable]]] = {}

    def names(self) -> dict[str, str]:
        """Return the names of the open stations, by their keys."""
        with self._lock:
            return {key: station.name for key, (station, _) in self._open.items()}

    def watch(self, key: str, watcher: Hashable, make: Callable[[], Station]) -> Station:
        """Return the station of a key, opened if it is not open, and count someone who watches it.

        Parameters
        ----------
        key
            What it reads, such as its address.
        watcher
            Who watches.
        make
            Makes the station; called by the first who watches.

        Raises
        ------
        TransportError
            If too many are open.
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
        made = make()
        with self._lock:
            if key not in self._open and len(self._open) < self._most:
                self._open[key] = made, {watcher}
                return made
        made.close()  # someone else was faster
        return self.watch(key, watcher, make)

    def leave(self, key: str, watcher: Hashable) -> None:
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
