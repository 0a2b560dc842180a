"""Station: a source that many watch: received, thinned and navigated with once for all of them."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.live.growing_allan import GrowingAllan
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import COASTING, NAVIGATING, HistoryCursor, LiveHistory, LiveState
from lab.live.live_verdict import verdict_of
from lab.live.ring import Read
from lab.live.source import Source
from lab.live.source_status import Status
from lab.live.thinned_samples import ThinnedSamples
from lab.live.transport import TransportError
from lab.logs.sensor_log import SensorLog
from lab.navigation.settings import NavigatorSettings
from lab.recordings.mission_error import MissionError
from lab.sensors.suite import SensorSuite

MOST = 8
"""Most stations of a server at a time: each has threads, and a navigator at 1 kHz takes a tenth of a core."""
PERIOD = 0.02
"""Longest time for which samples wait to be shown [s], a fifth of the time between two pictures; the
navigator gets them at once."""
JUDGED = 10.0
"""Time between two verdicts [s]: a batch run over two minutes and its verdict take half a second."""
FEWEST = 10
"""Fewest new fixes for a new verdict."""


class Station:
    """A source with those who watch it; its threads end with `close`.

    Parameters
    ----------
    source
        The source, which the station starts and ends.
    sensors, navigator
        The assumptions of the live navigator.
    name
        What people call it; `Stations` numbers those of one name.

    Attributes
    ----------
    sensors : SensorSuite
    settings : NavigatorSettings
        The assumptions of the live navigator.
    zero, newest : float
        Times of the first sample or fix, and of the newest one [s].
    failure : str
        Why the navigator has ended; empty while it has not.
    verdict : str
        What the innovations say so far; empty while there are too few.
    recorded : str
        What became of the last recording, in a sentence, for all who watch.
    """

    def __init__(self, source: Source, sensors: SensorSuite, navigator: NavigatorSettings, name: str) -> None:
        self.source = source
        self.name = name
        self.thinned = ThinnedSamples()
        self.zero = self.newest = 0.0
        self.failure = ""
        self.verdict = ""
        self.recorded = ""
        self._claimed: set[Path] = set()
        self.sensors, self.settings = sensors, navigator
        self._navigator: LiveNavigator | None = LiveNavigator(sensors, navigator)
        self._state = self._navigator.state
        self._lock = threading.Lock()  # of the navigator
        self._growing: GrowingAllan | None = None
        self._growing_lock = threading.Lock()
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=work, name=f"{word} {name}", daemon=True)
            for word, work in (("station", self._run), ("verdict", self._judge))
        ]
        source.start()
        for thread in self._threads:
            thread.start()

    @property
    def status(self) -> Status:
        """The state of the source."""
        return self.source.status

    @property
    def state(self) -> LiveState:
        """What the navigator knew after the last samples."""
        return self._state

    def claim(self, recording: Path) -> bool:
        """Return whether nobody else makes a mission of a recording; the first who asks does."""
        with self._growing_lock:
            first = recording not in self._claimed
            self._claimed.add(recording)
        return first

    def history(self, cursor: HistoryCursor) -> tuple[HistoryCursor, LiveHistory] | None:
        """Return the next cursor, and what the navigator showed since one; None while it computes.

        To start may take a second, in which no page waits.
        """
        if not self._lock.acquire(blocking=False):
            return None
        try:
            return None if self._navigator is None else self._navigator.since(cursor)
        finally:
            self._lock.release()

    def log(self) -> SensorLog:
        """Return the samples that the navigator keeps as a sensor log.

        Raises
        ------
        MissionError
            If nothing has come yet, or the station has closed.
        """
        with self._lent() as navigator:
            return navigator.log()

    @contextmanager
    def _lent(self) -> Iterator[LiveNavigator]:
        """Lend the navigator to one thread at a time; raises `MissionError` if the station has closed."""
        with self._lock:
            if self._navigator is None:
                raise MissionError("The source has ended, and its samples are not kept any more")
            yield self._navigator

    @contextmanager
    def growing(self) -> Iterator[GrowingAllan]:
        """Lend the record at rest for an Allan deviation; it begins when somebody first asks for it."""
        with self._growing_lock:
            if self._growing is None:
                self._growing = GrowingAllan()
            yield self._growing

    def _grow(self, imu: NDArray[np.void]) -> None:
        with self._growing_lock:
            if self._growing is not None:
                self._growing.add(imu)

    def _run(self) -> None:
        cursor, axes = None, self.source.axes
        held: list[NDArray[np.void]] = []
        shown = time.monotonic()
        while not self._ending.is_set():
            ended = self.source.ended  # before the last samples are taken
            if self.source.axes != axes:
                axes, cursor = self.source.axes, self.source.end
                self._restart("The axes were changed")
            read = self.source.since(cursor)
            cursor = read.cursor
            self._note(read)
            self._navigate(read)
            held.append(read.imu)
            # What is only shown is taken together: thinning one sample costs as much as thinning many.
            if time.monotonic() - shown >= PERIOD or ended:
                shown = time.monotonic()
                rows = np.concatenate(held)
                held.clear()
                self.thinned.add(rows)
                self._grow(rows)
            if ended and self.source.end == cursor:
                self._finish()
                return
            self.source.wait(cursor, PERIOD)

    def _restart(self, why: str) -> None:
        with self._lent() as navigator:
            navigator.restart(why)

    def _finish(self) -> None:
        """Navigate with what waited for later samples."""
        with self._lent() as navigator:
            navigator.finish()
            self._state = navigator.state

    def _note(self, read: Read) -> None:
        """Take note of the times of the first and the newest sample or fix."""
        for rows in (read.imu, read.fix):
            if len(rows):
                self.zero = self.zero or float(rows["time"][0])
                self.newest = max(self.newest, float(rows["time"][-1]))

    def _judge(self) -> None:
        """Ask now and then what the innovations say."""
        judged = 0
        while not self._ending.wait(JUDGED):
            used = self._state.fixes_used
            if used - judged < FEWEST or self._state.phase not in (NAVIGATING, COASTING):
                continue
            judged = used
            try:
                self.verdict = str(verdict_of(self.log(), self.sensors, self.settings))
            except ValueError as error:  # too few fixes for a batch run, or it diverges
                self.verdict = f"None yet: {error}"

    def _navigate(self, read: Read) -> None:
        """Feed the navigator; if it fails, the samples are still shown and recorded."""
        if self.failure:
            return
        try:
            with self._lent() as navigator:
                navigator.losses = self.source.losses  # after the samples, so that it explains them
                if navigator.feed(read.imu, read.fix, read.reading):
                    self._state = navigator.state
        except Exception as error:
            self.failure = f"The navigator failed: {type(error).__name__}: {error}"
            raise

    def wait(self) -> None:
        """Wait until all samples of a source that has ended are navigated with."""
        if self.source.ended:
            self._threads[0].join()

    def close(self) -> None:
        """End the threads, free the port, and forget all samples; may be repeated.

        Pages that have ended refer to their station until a search for garbage finds them.
        """
        self._ending.set()
        self.source.close()
        for thread in self._threads:
            thread.join()
        self.source.forget()
        with self._lock, self._growing_lock:
            self._navigator = self._growing = None
            self.thinned = ThinnedSamples(kept=1)


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

    def recordings(self) -> set[Path]:
        """Return the recordings that run."""
        with self._lock:
            running = [station.source.recording for station, _ in self._open.values()]
        return {path for path in running if path is not None}

    def watchers(self, key: str) -> int:
        """Return how many watch a station; 0 if it is not open."""
        with self._lock:
            return len(self._open[key][1]) if key in self._open else 0

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
                made.name = self._unlike(made.name)
                self._open[key] = made, {watcher}
                return made
        made.close()  # someone else was faster
        return self.watch(key, watcher, make)

    def _unlike(self, name: str) -> str:
        """Return a name that no open station has: people choose by names."""
        taken = {station.name for station, _ in self._open.values()}
        numbered = (name if number == 1 else f"{name} ({number})" for number in itertools.count(1))
        return next(one for one in numbered if one not in taken)

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
