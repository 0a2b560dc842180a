"""Computing: long computations in threads, so that no page waits for another."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import partial
from threading import Lock
from typing import Any, Generic, TypeVar
from weakref import WeakValueDictionary

from dashboards.upload import without_folder
from lab.base.blas_threads import keep_one_blas_thread
from lab.base.parameters.setting_error import SettingError
from lab.base.processors import processors
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions import Mission, MissionError

log = logging.getLogger(__name__)

TURN = 0.001
"""How long a page waits for the interpreter while a run works in Python [s]; Python's 5 ms add up over a
change."""

POOL = ThreadPoolExecutor(max_workers=processors(), thread_name_prefix="experiment")
"""Pool for the runs of all sessions; the kernels release the interpreter lock, so all cores are used."""
LONG = ThreadPoolExecutor(max_workers=processors(), thread_name_prefix="long")
"""Pool for work that takes longer than a run, so that no run waits for it."""
WRITING = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writing")
"""Pool for changes of missions, one at a time because of the lock of their folder; no other pool waits for
it."""

T = TypeVar("T")

_shown: WeakValueDictionary[int, Result] = WeakValueDictionary()
"""Results that pages show, by the identity of their solution, which all runs of the same settings share."""
_in_line: set[LatestWins[Any]] = set()
"""What waits for a thread of its pool."""
_last_run = [-math.inf]
"""When a run of any session was last begun or ended [s, monotonic]."""


def rested() -> float:
    """Return how long no run of any session has begun or ended [s]: nobody moves a slider."""
    return time.monotonic() - _last_run[0]


def share_interpreter() -> None:
    """Make the threads of this process take turns more often, one for each run, for a server of pages."""
    sys.setswitchinterval(TURN)
    keep_one_blas_thread()


class SupersededError(Exception):
    """Ends a computation that is no longer needed; raised when the computation reports its progress."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a computation: its content, or a sentence about the problem."""

    result: Any = None
    problem: str = ""


class LatestWins(Generic[T]):
    """Works on one item at a time; a newer item replaces the waiting one.

    Work that nobody sees goes to the back of the line of its pool while work that somebody sees waits there,
    and begins anew after it.

    Parameters
    ----------
    work
        Called in a thread of the pool with the submitted item, and with a function that takes progress.
    deliver
        Called in a thread of the pool with the submitted item and the outcome.
    pool
        Pool that does the work.
    at_once
        Whether a newer item also ends the current work, when that next reports its progress.
    turn
        What has `deliver` called elsewhere than in that thread, such as `sending.turns_of_page`.

    Attributes
    ----------
    stage : tuple of str, float
        Description of the current work, and the fraction done.
    is_seen : bool
        Whether somebody sees what this works on, or for other reasons waits for it.
    """

    def __init__(
        self,
        work: Callable[[T, Progress], Outcome],
        deliver: Callable[[T, Outcome], None],
        pool: ThreadPoolExecutor = POOL,
        *,
        at_once: bool = False,
        turn: Callable[[Callable[[], None]], None] = lambda deliver: deliver(),
    ) -> None:
        self._work = work
        self._turn = turn
        self._deliver = deliver
        self._pool = pool
        self._at_once = at_once
        self._lock = Lock()
        self._waiting: T | None = None
        self._running = False
        self._closed = self._cancelled = False
        self._begun = 0.0
        self.stage = ("", 0.0)
        self.is_seen = True

    @property
    def busy(self) -> bool:
        """Whether an item is being worked on or waiting."""
        return self._running

    @property
    def busy_for(self) -> float:
        """Time since the current work started, or started to wait for a core [s]."""
        return time.monotonic() - self._begun if self._running else 0.0

    def submit(self, thing: T) -> None:
        """Work on an item as soon as the current work has ended."""
        with self._lock:
            self._waiting = thing
            # A thread that works takes this item by itself when it has ended.
            if self._running or self._closed:
                return
            self._running = True
        self._next()

    def cancel(self) -> None:
        """Drop the waiting item, and end the current work as if there were a newer item."""
        with self._lock:
            self._waiting, self._cancelled = None, True

    def close(self) -> None:
        """Deliver no further outcomes."""
        with self._lock:
            self._closed, self._waiting = True, None

    def _next(self) -> None:
        with self._lock:
            # One step under the lock: between reading and clearing, an item could be submitted and lost.
            thing, self._waiting, self._cancelled = self._waiting, None, False
            if thing is None or self._closed:
                self._running = False
                return
        self.stage, self._begun = ("Waiting for a free core", 0.0), time.monotonic()
        _in_line.add(self)
        self._pool.submit(self._run, thing)

    @property
    def _must_yield(self) -> bool:
        """Whether nobody sees the work, and some work that is seen waits for a thread of the pool."""
        # A copy of the line, which other threads change meanwhile.
        return not self.is_seen and any(one.is_seen and one._pool is self._pool for one in list(_in_line))

    def _run(self, thing: T) -> None:
        # It no longer waits for a thread, so it is none that others must yield to.
        _in_line.discard(self)
        try:
            outcome = None if self._must_yield else self._work(thing, self._progress)
        except SupersededError:
            outcome = None
        with self._lock:
            if outcome is None and self._waiting is None and not self._cancelled:  # it yields
                self._waiting = thing
            # Read under the lock, used outside: `deliver` may take long, and may submit the next item
            # itself.
            closed = self._closed
        if outcome is not None and not closed:
            self._turn(partial(self._deliver, thing, outcome))
        self._next()

    def _progress(self, stage: str, fraction: float) -> None:
        # Read without the lock: an old value costs a stage more, a lock would cost each stage.
        stops = self._closed or self._cancelled or self._waiting is not None or self._must_yield
        if self._at_once and stops:
            raise SupersededError
        self.stage = (stage, fraction)


def run(
    experiment: Experiment,
    progress: Progress | None = None,
    prepare: Callable[[Result], None] | None = None,
    ready: Result | None = None,
) -> Outcome:
    """Run an experiment, unless its result is ready, and prepare the page; an error becomes a sentence."""

    def work() -> Result:
        _last_run[0] = time.monotonic()
        result = share_result(experiment.run(progress)) if ready is None else ready
        _last_run[0] = time.monotonic()
        if prepare is not None:
            prepare(result)
        return result

    return attempt(work)


def share_result(result: Result) -> Result:
    """Return the result of the same run that a page shows already, if one does, or else the given one.

    Most pages open with the same settings. What is derived of a result, as errors, σ and verdict, is kept
    with it, and made once for all of these pages. Results do not change. A run that hides something belongs
    to its lesson or homework alone, which says what may be changed.
    """
    mine = result.experiment
    # A result keeps its solution alive, so no other solution has this identity while its entry stands.
    other = result if mine.hidden else _shown.setdefault(id(result.solution_arrays), result)
    if other is result:
        return result
    its = other.experiment
    is_same = (
        all(getattr(result.mission, one.name) == getattr(other.mission, one.name) for one in fields(Mission))
        and mine.to_dict() == its.to_dict()
    )
    return other if is_same else result


def attempt(work: Callable[[], Any]) -> Outcome:
    """Return the content of a computation; an error becomes a sentence, never an exception."""
    try:
        return Outcome(result=work())
    except SupersededError:
        raise
    except (SettingError, MissionError, ValueError) as error:
        return Outcome(problem=without_folder(str(error)))
    except MemoryError:
        return Outcome(problem="This run needs more memory than is available. A lower IMU rate needs less.")
    except Exception as error:
        log.exception("a run failed")
        return Outcome(problem=f"This run failed: {type(error).__name__}: {error}")
