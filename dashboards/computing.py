"""Computing: what takes time, in threads, so that no page ever waits for another."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import Any, Generic, TypeVar

from lab.experiment import Experiment
from lab.missions import MissionError
from lab.result import Result
from lab.settings import SettingError

log = logging.getLogger(__name__)

# While a run works in Python, pages wait this long for their turn; Python's own 5 ms add up over a change.
sys.setswitchinterval(0.001)

POOL = ThreadPoolExecutor(max_workers=os.cpu_count(), thread_name_prefix="experiment")
"""Computes for all sessions; the kernels release the interpreter, so each core is used."""
LONG = ThreadPoolExecutor(max_workers=os.cpu_count(), thread_name_prefix="long")
"""Computes what takes longer than a run, so that no run has to wait for it."""
WRITING = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writing")
"""Changes missions, one at a time, as the lock of their folder wants it: no other pool waits for that."""

T = TypeVar("T")
Progress = Callable[[str, float], None]


class SupersededError(Exception):
    """Ends a computation nobody waits for any more; raised where it tells its progress."""


@dataclass(frozen=True)
class Outcome:
    """What became of a computation: its content, or a sentence about what was wrong."""

    result: Any = None
    problem: str = ""


class LatestWins(Generic[T]):
    """Works on one thing at a time; a newer one replaces the one that waits.

    Parameters
    ----------
    work
        Called in a thread of the pool with what was submitted, and with a function that takes progress.
    deliver
        Called in a thread of the pool with what was submitted and the outcome.
    pool
        Where the work is done.
    at_once
        Whether a newer thing also ends the work on the one before, the next time that tells its progress.

    Attributes
    ----------
    stage : tuple of str, float
        What is being done, and the fraction done.
    """

    def __init__(
        self,
        work: Callable[[T, Progress], Outcome],
        deliver: Callable[[T, Outcome], None],
        pool: ThreadPoolExecutor = POOL,
        *,
        at_once: bool = False,
    ) -> None:
        self._work = work
        self._deliver = deliver
        self._pool = pool
        self._at_once = at_once
        self._lock = Lock()
        self._waiting: T | None = None
        self._running = False
        self._closed = self._cancelled = False
        self._begun = 0.0
        self.stage = ("", 0.0)

    @property
    def busy(self) -> bool:
        """Whether something is being worked on or waits."""
        return self._running

    @property
    def busy_for(self) -> float:
        """How long what is worked on now has been so, or waiting for a core [s]."""
        return time.monotonic() - self._begun if self._running else 0.0

    def submit(self, thing: T) -> None:
        """Work on a thing as soon as the work on the present one has ended."""
        with self._lock:
            self._waiting = thing
            if self._running or self._closed:
                return
            self._running = True
        self._next()

    def cancel(self) -> None:
        """Let go what waits, and what is worked on as if there were a newer thing."""
        with self._lock:
            self._waiting, self._cancelled = None, True

    def close(self) -> None:
        """Deliver nothing more."""
        with self._lock:
            self._closed, self._waiting = True, None

    def _next(self) -> None:
        with self._lock:
            thing, self._waiting, self._cancelled = self._waiting, None, False
            if thing is None or self._closed:
                self._running = False
                return
        self.stage, self._begun = ("Waiting for a free core", 0.0), time.monotonic()
        self._pool.submit(self._run, thing)

    def _run(self, thing: T) -> None:
        try:
            outcome = self._work(thing, self._progress)
        except SupersededError:
            self._next()
            return
        with self._lock:
            closed = self._closed
        if not closed:
            self._deliver(thing, outcome)
        self._next()

    def _progress(self, stage: str, fraction: float) -> None:
        if self._at_once and (self._closed or self._cancelled or self._waiting is not None):
            raise SupersededError
        self.stage = (stage, fraction)


def run(
    experiment: Experiment,
    progress: Progress | None = None,
    prepare: Callable[[Result], None] | None = None,
) -> Outcome:
    """Run an experiment, and have what will be shown of it prepared; what goes wrong becomes a sentence."""

    def work() -> Result:
        result = experiment.run(progress)
        if prepare is not None:
            prepare(result)
        return result

    return attempt(work)


def attempt(work: Callable[[], Any]) -> Outcome:
    """Return the content of a computation; what goes wrong becomes a sentence, never an exception."""
    try:
        return Outcome(result=work())
    except SupersededError:
        raise
    except (SettingError, MissionError, ValueError) as error:
        return Outcome(problem=str(error))
    except MemoryError:
        return Outcome(problem="This run needs more memory than is available. A lower IMU rate needs less.")
    except Exception as error:
        log.exception("a run failed")
        return Outcome(problem=f"This run failed: {type(error).__name__}: {error}")
