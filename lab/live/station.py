"""Station: a source that many watch: received, thinned and navigated with once for all of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from lab.base.files.mission_error import MissionError
from lab.data.clock.timed_samples import NO_READINGS
from lab.data.log.sensor_log import SensorLog
from lab.data.streams.ring import Read
from lab.data.streams.rolling import ThinnedSamples
from lab.data.streams.source import Source
from lab.data.streams.source_status import Status
from lab.live.bench.growing_allan import GrowingAllan
from lab.live.beside.own_algorithm import OwnAlgorithm
from lab.live.live_navigator import STEP, LiveNavigator
from lab.live.live_state import COASTING, NAVIGATING, HistoryCursor, LiveHistory, LiveState
from lab.live.live_verdict import judge_stream
from lab.live.owner import Owner
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

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
        What people call it; others may have the same.
    step
        Shortest time of samples that is navigated with at once [s].
    tell
        Called by the navigator's thread with each new state; it must not wait.

    Attributes
    ----------
    sensors : SensorSuite
    settings : NavigatorSettings
        The assumptions of the live navigator.
    zero, newest : float
        Times of the first sample or fix, and of the newest one [s].
    begun : int
        How often it has begun to navigate with all samples: whoever shows them begins anew, too.
    failure : str
        Why the navigator has ended; empty while it has not.
    verdict : str
        What the innovations say so far; empty while there are too few.
    recorded : str
        What became of the last recording, in a sentence, for all who watch.
    owner : Owner
        Who opened it; set by `lab.live.stations.Stations`.
    """

    def __init__(
        self,
        source: Source,
        sensors: SensorSuite,
        navigator: NavigatorSettings,
        name: str,
        step: float = STEP,
        tell: Callable[[LiveState], None] | None = None,
    ) -> None:
        self.source = source
        self.name = name
        self.thinned = ThinnedSamples()
        self.zero = self.newest = 0.0
        self.begun = 1
        self.failure = ""
        self.verdict = ""
        self.recorded = ""
        self.owner = Owner()
        self.sensors, self.settings = sensors, navigator
        self._assumed = navigator.copy()
        if self._assumed.vehicle == "auto" and source.vehicle:
            self._assumed.vehicle = source.vehicle
        self._step, self._tell = step, tell
        self._navigator: LiveNavigator | None = LiveNavigator(sensors, self._assumed, step=step)
        self._state = self._navigator.state
        self._lock = threading.Lock()  # of the navigator
        self._beside: dict[str, OwnAlgorithm] = {}
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

    def history(self, cursor: HistoryCursor) -> tuple[HistoryCursor, LiveHistory] | None:
        """Return the next cursor, and what the navigator showed since one; None while it computes.

        To start may take a second, in which no page waits.
        """
        # A page asks again in a moment; it must not block the loop of the server meanwhile.
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
        with self._lend_navigator() as navigator:
            return navigator.log()

    @contextmanager
    def _lend_navigator(self) -> Iterator[LiveNavigator]:
        """Lend the navigator to one thread at a time; raises `MissionError` if the station has closed."""
        with self._lock:
            if self._navigator is None:
                raise MissionError("The source has ended, and its samples are not kept any more")
            yield self._navigator

    def beside(self, name: str, given: object) -> OwnAlgorithm:
        """Return the algorithm of a name that follows the source; it begins when somebody first asks for it.

        Parameters
        ----------
        name
            What people call it.
        given
            Its place or source, as of `lab.live.beside.algorithm_process.AlgorithmProcess`.
        """
        with self._growing_lock:
            if name not in self._beside:
                self._beside[name] = OwnAlgorithm(self.source, name, given)
            return self._beside[name]

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
        cursor, axes, rescaled = None, self.source.axes, self.source.rescaled
        held: list[NDArray[np.void]] = []
        shown = time.monotonic()
        while not self._ending.is_set():
            ended = self.source.ended  # before the last samples are taken
            if self.source.axes != axes:
                axes, cursor = self.source.axes, self.source.end
                self._restart("The axes were changed")
            if self.source.rescaled != rescaled:
                rescaled, cursor = self.source.rescaled, None
                self._begin_anew()
                held.clear()
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
            # `ended` was asked before the samples were taken, so nothing can have come in between.
            if ended and self.source.end == cursor:
                self._finish()
                return
            navigator = self._navigator
            self.source.wait(cursor, PERIOD, -np.inf if navigator is None else navigator.due)

    def _begin_anew(self) -> None:
        """Navigate with all samples that are kept again: their angular rates have another unit."""
        with self._lock, self._growing_lock:
            if self._navigator is not None:
                self._navigator = LiveNavigator(self.sensors, self._assumed, step=self._step)
                self._state = self._navigator.state
            if self._growing is not None:
                self._growing = GrowingAllan()
            self.thinned = ThinnedSamples()
            self.zero = self.newest = 0.0
            self.failure = self.verdict = ""
            self.begun += 1

    def _restart(self, why: str) -> None:
        with self._lend_navigator() as navigator:
            navigator.restart(why)

    def _finish(self) -> None:
        """Navigate with what waited for later samples."""
        with self._lend_navigator() as navigator:
            navigator.finish()
            self._state = navigator.state
        if self._tell is not None:
            self._tell(self._state)

    def _note(self, read: Read) -> None:
        """Take note of the times of the first and the newest sample or fix."""
        for rows in (read.imu, read.fix):
            if len(rows):
                # The host's monotonic clock is never at zero when samples come.
                self.zero = self.zero or float(rows["time"][0])
                self.newest = max(self.newest, float(rows["time"][-1]))

    def _judge(self) -> None:
        """Ask now and then what the innovations say."""
        judged = 0
        while not self._ending.wait(JUDGED):
            used = self._state.fixes_used
            if self._state.phase not in (NAVIGATING, COASTING):
                judged, self.verdict = used, ""  # it was on a solution that is no more
            if used - judged < FEWEST:
                continue
            judged = used
            try:
                self.verdict = str(judge_stream(self.log(), self.sensors, self._assumed))
            except ValueError as error:  # too few fixes for a batch run, or it diverges
                self.verdict = f"None yet: {error}"

    def _navigate(self, read: Read) -> None:
        """Feed the navigator; if it fails, the samples are still shown and recorded."""
        if self.failure:
            return
        try:
            # Fixes and readings go with the last piece: each is used at its own time, if the samples up to
            # it are there.
            *first, last = self._split_samples(read.imu)
            for piece in first:
                self._feed(piece)
            self._feed(last, read.fix, read.reading)
        except Exception as error:
            self.failure = f"The navigator failed: {type(error).__name__}: {error}"
            raise

    def _split_samples(self, imu: NDArray[np.void]) -> list[NDArray[np.void]]:
        """Return samples in pieces of a step, if somebody is told each state and they came together.

        Those that came one by one and waited are processed at once: a computer that is behind must not fall
        back further.
        """
        if self._tell is None or imu.size < 2 or imu["time"][-1] - imu["time"][0] < self._step:
            return [imu]
        if imu["arrival"][-1] - imu["arrival"][0] > self._step:
            return [imu]
        return list(np.split(imu, np.flatnonzero(np.diff(np.floor(imu["time"] / self._step))) + 1))

    def _feed(
        self,
        imu: NDArray[np.void],
        fixes: NDArray[np.void] | None = None,
        readings: NDArray[np.void] = NO_READINGS,
    ) -> None:
        with self._lend_navigator() as navigator:
            navigator.losses = self.source.losses  # after the samples, so that it explains them
            if not navigator.feed(imu, fixes, readings):
                return
            self._state = navigator.state
        if self._tell is not None:
            self._tell(self._state)

    def wait(self) -> None:
        """Wait until all samples of a source that has ended are navigated with."""
        if self.source.ended:
            self._threads[0].join()

    def close(self) -> None:
        """End the threads, free the port, and forget all samples; may be repeated.

        Pages that have ended refer to their station until a search for garbage finds them.
        """
        self._ending.set()
        for own in self._beside.values():
            own.close()
        # First the source: it wakes the threads that wait for its samples.
        self.source.close()
        for thread in self._threads:
            thread.join()
        # Only now: the threads have read the ring until they ended.
        self.source.forget()
        with self._lock, self._growing_lock:
            self._navigator = self._growing = None
            self._beside.clear()
            self.thinned = ThinnedSamples(kept=1)
