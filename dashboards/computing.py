"""Computing: runs of experiments in threads, so that no page ever waits for another."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock

from lab.experiment import Experiment
from lab.missions import MissionError
from lab.result import Result
from lab.settings import SettingError

log = logging.getLogger(__name__)

# While a run works in Python, pages wait this long for their turn; Python's own 5 ms add up over a change.
sys.setswitchinterval(0.001)

POOL = ThreadPoolExecutor(max_workers=os.cpu_count(), thread_name_prefix="experiment")
"""Computes for all sessions; the kernels release the interpreter, so each core is used."""


@dataclass(frozen=True)
class Outcome:
    """What became of a run: a result, or a sentence about what was wrong."""

    result: Result | None = None
    problem: str = ""


class LatestWins:
    """Runs experiments one at a time; a newer one replaces the one that waits.

    Parameters
    ----------
    prepare
        Called in a thread of the pool with each result, to work out there what will be shown of it.
    deliver
        Called in a thread of the pool with the outcome of each run.

    Attributes
    ----------
    stage : tuple of str, float
        What is being done, and the fraction done.
    """

    def __init__(self, prepare: Callable[[Result], None], deliver: Callable[[Outcome], None]) -> None:
        self._prepare = prepare
        self._deliver = deliver
        self._lock = Lock()
        self._waiting: Experiment | None = None
        self._running = False
        self._closed = False
        self._begun = 0.0
        self.stage = ("", 0.0)

    @property
    def busy(self) -> bool:
        """Whether an experiment runs or waits."""
        return self._running

    @property
    def busy_for(self) -> float:
        """How long the experiment that runs now has been running or waiting for a core [s]."""
        return time.monotonic() - self._begun if self._running else 0.0

    def submit(self, experiment: Experiment) -> None:
        """Run an experiment as soon as the one that runs now has ended."""
        with self._lock:
            self._waiting = experiment.copy()
            if self._running or self._closed:
                return
            self._running = True
        self._next()

    def close(self) -> None:
        """Deliver nothing more."""
        with self._lock:
            self._closed, self._waiting = True, None

    def _next(self) -> None:
        with self._lock:
            experiment, self._waiting = self._waiting, None
            if experiment is None or self._closed:
                self._running = False
                return
        self.stage, self._begun = ("Waiting for a free core", 0.0), time.monotonic()
        POOL.submit(self._run, experiment)

    def _run(self, experiment: Experiment) -> None:
        outcome = run(experiment, self._progress, self._prepare)
        with self._lock:
            closed = self._closed
        if not closed:
            self._deliver(outcome)
        self._next()

    def _progress(self, stage: str, fraction: float) -> None:
        self.stage = (stage, fraction)


def run(
    experiment: Experiment,
    progress: Callable[[str, float], None] | None = None,
    prepare: Callable[[Result], None] | None = None,
) -> Outcome:
    """Run an experiment; what goes wrong becomes a sentence for the page, never an exception."""
    try:
        result = experiment.run(progress)
        if prepare is not None:
            prepare(result)
        return Outcome(result=result)
    except (SettingError, MissionError, ValueError) as error:
        return Outcome(problem=str(error))
    except MemoryError:
        return Outcome(problem="This run needs more memory than there is; a lower IMU rate needs less.")
    except Exception as error:
        log.exception("a run failed")
        return Outcome(problem=f"This run failed: {type(error).__name__}: {error}")
