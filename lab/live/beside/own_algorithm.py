"""Own algorithm: a live algorithm that follows a source in a thread, with what it estimated and how it fares.

The navigator and the source do not know of it. If it is slow, its own pieces wait in the source, which keeps
two minutes or more; if it fails, that is said and nothing else happens.
"""

from __future__ import annotations

import threading
import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.counted import count_noun
from lab.data.streams.live_log import make_gnss_log, usable_fixes, usable_imu
from lab.data.streams.ring import Cursor
from lab.data.streams.rolling import Rolling
from lab.data.streams.source import Source
from lab.live.beside.algorithm_process import AlgorithmProcess
from lab.live.beside.live_algorithm import FixPiece, LiveAlgorithmError, cut_pieces
from lab.live.live_history import KEPT, RATE

STARTING: Final = "starting"
RUNNING: Final = "running"
ENDED: Final = "ended"
BEHIND: Final = 1.0
"""Delay after the newest sample from which an algorithm is said to be behind [s]: a person sees it."""
PIECE: Final = 0.5
"""Longest piece of a stream [s]: a person who looks at the curves sees two steps a second as a movement."""
_PERIOD: Final = 0.02
"""Longest wait for samples [s], and least time between two pieces: each costs 0.2 ms beside the step."""
_OF_PACE: Final = 10.0
"""Time over which the pace of an algorithm is measured [s]."""


class OwnAlgorithm:
    """A live algorithm beside a source; its thread and its process end with `close`, or with the source.

    Parameters
    ----------
    source
        The source, which somebody else starts and ends.
    name
        What people call the algorithm.
    given
        As of `AlgorithmProcess`.

    Attributes
    ----------
    state : str
        `STARTING`, `RUNNING` or `ENDED`.
    failure : str
        Why it ended; empty unless it failed.
    """

    def __init__(self, source: Source, name: str, given: object) -> None:
        self.name = name
        self.state, self.failure = STARTING, ""
        self._refusal = ""  # why it could not be loaded
        self._source = source
        self._lock = threading.Lock()
        self._rows = Rolling({"time": (), "q_nb": (4,)})
        self._next = -np.inf  # time from which the next row is kept
        self._done = np.nan  # time of the last sample that it has stepped over
        self._lost = 0
        self._pace: list[tuple[float, float]] = []  # time that steps took, and time of their samples [s]
        self._ending = threading.Event()
        self._loaded = threading.Event()
        self._process = AlgorithmProcess(name, given, lambda: not self._ending.is_set())
        self._thread = threading.Thread(target=self._run, name=f"beside {name}", daemon=True)
        self._thread.start()

    def wait_until_loaded(self) -> None:
        """Wait until the algorithm is loaded.

        Raises
        ------
        LiveAlgorithmError
            If it cannot be loaded.
        """
        self._loaded.wait()
        if self._refusal:
            raise LiveAlgorithmError(self._refusal)

    @property
    def reached(self) -> float:
        """Time up to which all attitudes are known [s]; infinite once no more come, minus so before any."""
        if self.state == ENDED:
            return np.inf
        return -np.inf if np.isnan(self._done) else self._done

    @property
    def sentence(self) -> str:
        """How it fares, in a sentence."""
        if self.state == STARTING:
            return f"{self.name} is being loaded."
        lost = f" {count_noun(self._lost, 'sample')} were lost to it." if self._lost else ""
        if self.state == ENDED:
            return f"{self.failure}. It is ended; the navigator goes on.{lost}" if self.failure else ""
        behind = self.behind
        if behind > BEHIND:
            return (
                f"{self.name} is {behind:.1f} s behind: it takes {self._slowness():.2g} s for each second of "
                f"the stream.{lost}"
            )
        return f"{self.name} follows.{lost}"

    @property
    def behind(self) -> float:
        """How much later than its last sample the newest one is [s]; 0 before there is one."""
        newest = self._source.last(PIECE).imu["time"][-1:]
        return max(float(newest[0]) - self._done, 0.0) if newest.size and np.isfinite(self._done) else 0.0

    def since(self, row: int) -> tuple[int, FloatArray, FloatArray]:
        """Return the number of the next row, and times (n,) [s] and attitudes (n, 4) from a row on."""
        with self._lock:
            start = min(max(row, self._rows.first), self._rows.end)
            # Copies, because rows move once the lock is free.
            part = (self._rows.rows(name, start, self._rows.end).copy() for name in ("time", "q_nb"))
            return self._rows.end, next(part), next(part)

    def close(self) -> None:
        """End thread and process; may be repeated."""
        self._ending.set()
        self._thread.join()

    def wait(self, longest: float | None = None) -> None:
        """Wait, at most a time [s], until it has ended: with its source, or because it failed."""
        self._thread.join(longest)

    def _run(self) -> None:
        cursor = Cursor()
        try:
            while True:
                self._load()
                again = self._follow(cursor)
                if again is None:
                    return
                self._process.end()
                self.state, cursor = STARTING, again
        except LiveAlgorithmError as error:
            if not self._ending.is_set():
                self.failure = str(error)
        except Exception as error:
            self.failure = f"{self.name}: the laboratory failed: {type(error).__name__}: {error}"
            raise
        finally:
            self._process.end()
            self.state = ENDED
            self._loaded.set()

    def _load(self) -> None:
        try:
            self._process.start()
        except LiveAlgorithmError as error:
            self._refusal = str(error)
            raise
        self.state = RUNNING
        self._loaded.set()

    def _follow(self, cursor: Cursor) -> Cursor | None:
        """Step over the stream from a cursor on, until it ends.

        Returns
        -------
        Cursor or None
            Where to begin anew, because axes or units became others; None at the end.
        """
        source = self._source
        axes, rescaled = source.axes, source.rescaled
        while not self._ending.is_set():
            ended = source.ended  # before the last samples are taken
            # The unit of the rates was another one: all attitudes so far are wrong.
            if source.rescaled != rescaled:
                with self._lock:
                    self._rows.forget(self._rows.end)
                self._next, self._done = -np.inf, np.nan
                return Cursor()
            if source.axes != axes:
                return source.end
            read = source.since(cursor)
            cursor = read.cursor
            self._lost += read.lost
            self._step_over(read.imu, read.fix)
            if ended and source.end == cursor:
                return None
            # A pause between pieces, which would else be single samples; then a wait for the next sample.
            self._ending.wait(_PERIOD)
            source.wait(cursor, _PERIOD)
        return None

    def _step_over(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> None:
        gnss = make_gnss_log(fix[usable_fixes(fix)])
        fixes = FixPiece(gnss.time, gnss.position, gnss.velocity_n, gnss.position_sigma)
        for piece in cut_pieces(imu[usable_imu(imu)], fixes, self._done, PIECE):
            begin = time.monotonic()
            q_nb = self._process.step(piece)
            last = float(piece.imu.time[-1])
            self._pace.append((time.monotonic() - begin, float(piece.imu.dt.sum())))
            while sum(length for _, length in self._pace[1:]) > _OF_PACE:
                del self._pace[0]
            if q_nb.size:
                self._keep(piece.imu.time[-len(q_nb) :], q_nb)
            self._done = last

    def _keep(self, times: FloatArray, q_nb: FloatArray) -> None:
        """Keep attitudes, at the rate of the history of the navigator."""
        step = np.floor(times * RATE)
        rows = np.flatnonzero((np.diff(step, prepend=step[0] - 1) > 0) & (times >= self._next))
        if not rows.size:
            return
        self._next = float(step[rows[-1]] + 1) / RATE
        with self._lock:
            self._rows.append(time=times[rows], q_nb=q_nb[rows])
            self._rows.forget(self._rows.end - KEPT)

    def _slowness(self) -> float:
        took, length = (sum(part) for part in zip(*self._pace, strict=True)) if self._pace else (0.0, 0.0)
        return took / length if length > 0 else 0.0
