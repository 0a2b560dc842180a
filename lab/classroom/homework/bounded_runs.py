"""Bounded runs: runs with students' settings in a process of their own, with bounds of time and memory.

A run gives the figures of its result, and the goals that it reaches. Settings that run for ever, take the
memory or end the process cost one row of the grades, not the others. The process serves one run after the
other, and is started again after a run that exceeded a bound. What is reported contains no measured number,
so that the same hand-ins give the same table.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from lab.classroom.homework.exported_run import REFUSED, Repeated, repeat
from lab.classroom.homework.homework import Judge
from lab.classroom.homework.homework_file import Keyed, key_text, parse_key
from lab.classroom.lessons.quantities import QUANTITIES
from lab.run.memory import TooLongError, limit_memory

FIGURES = ("position_rms", "position_max", "velocity_rms", "tilt_rms", "heading_rms", "nees", "nis")
"""Quantities of the result in the table of the grades; see `lab.classroom.lessons.quantities`."""


class Examined(NamedTuple):
    """What a run with a student's settings gave.

    Attributes
    ----------
    figures : dict
        The value of each of `FIGURES`; empty if the settings cannot be run.
    passed : list of bool
        Whether it reaches each goal.
    problem : str
        Why the settings cannot be run; empty if they can.
    is_memory : bool
        Whether they cannot be run because the memory does not suffice.
    """

    figures: dict[str, float]
    passed: list[bool]
    problem: str = ""
    is_memory: bool = False

    @classmethod
    def failed(cls, judge: Judge, problem: str, *, is_memory: bool = False) -> Examined:
        """Return that settings cannot be run, which reach no goal."""
        return cls({}, [False] * len(judge.checks), problem, is_memory)


def examine(judge: Judge, changes: Mapping[str, Any]) -> Examined:
    """Run a homework with the changes of a student, in this process and without bounds.

    Parameters
    ----------
    judge
        The homework with its solutions.
    changes
        Values by the path of their settings.
    """
    try:
        result = judge.homework.experiment_with(changes).run()
        figures = {name: QUANTITIES[name].of(result) for name in FIGURES}
        return Examined(figures, [check.accepts(result) for check in judge.checks])
    except Exception as error:  # whatever one hand-in does, the others are graded
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        short = isinstance(error, MemoryError | TooLongError)
        return Examined.failed(judge, f"cannot be run: {kind}{error}", is_memory=short)


SECONDS = 300
"""Longest run [s]; compiling the slowest filter, the nonlinear one, took 48 s on a busy computer."""
MEMORY = 4
"""Memory of a run [GB], beyond that of Python and its modules; `lab.run.memory` counts 1 GB for 4 h at
200 Hz."""
START = 120.0
"""Longest start of the process [s]: importing the lab takes 10 s on a busy computer."""


class StartError(RuntimeError):
    """The process for the runs does not start; no hand-in is the reason."""


Examining = Callable[[Judge, Mapping[str, Any]], Examined]


class BoundedRuns:
    """A process that runs a homework with the settings of students; a context manager.

    A script that uses it needs ``if __name__ == "__main__":``, because the process imports the script.

    Parameters
    ----------
    keyed
        The homework with its key.
    seconds
        Longest run [s].
    memory
        Most memory of a run [GB]; the system enforces it on Linux, elsewhere the lab only estimates it.
    examining
        What to call in the process.
    """

    def __init__(
        self,
        keyed: Keyed,
        seconds: float = SECONDS,
        memory: float = MEMORY,
        examining: Examining = examine,
    ) -> None:
        self._judge = keyed.judge
        self._seconds, self._memory = seconds, memory
        self._given = (key_text(keyed), int(memory * 1e9), examining)
        self._process: BaseProcess | None = None
        self._line: Connection | None = None

    def __enter__(self) -> Self:
        """Begin; the process starts with the first run."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self._end()

    def __call__(self, judge: Judge, changes: Mapping[str, Any]) -> Examined:
        """Run the homework with the changes of a student, whose variant it is if each has one."""
        found = self._ask((judge.homework.student, dict(changes)))
        return Examined.failed(self._judge, f"cannot be run: {found}") if isinstance(found, str) else found

    def repeat(self, path: Path) -> Repeated:
        """Run again what a student exported; see `lab.classroom.homework.exported_run`."""
        found = self._ask(path)
        return Repeated(REFUSED, found) if isinstance(found, str) else found

    def _ask(self, given: Any) -> Any:
        """Return what the process finds, or why it finds nothing."""
        line = self._ready()
        try:
            line.send(given)
            if not line.poll(self._seconds):
                self._end()
                return f"its run takes more than {self._seconds:g} s (--seconds), and was stopped"
            found = line.recv()
        except (EOFError, OSError):
            self._end()
            return f"its run ended the process; it may need more than {self._memory:g} GB (--memory)"
        if found.is_memory:
            self._end()
            return f"its run needs more than {self._memory:g} GB of memory (--memory)"
        return found

    def _ready(self) -> Connection:
        """Return the line to the process, which has imported all it needs.

        Raises
        ------
        StartError
            If the process ends before it is ready, or does not start in time.
        """
        if self._line is None:
            context = get_context("spawn")
            self._line, far = context.Pipe()
            self._process = context.Process(target=_serve, args=(far, *self._given), daemon=True)
            self._process.start()
            far.close()
            try:
                ready = self._line.poll(START) and self._line.recv()
            except (EOFError, OSError) as error:
                raise StartError("the process that runs the hand-ins ended at its start") from error
            if not ready:
                raise StartError(f"the process that runs the hand-ins did not start within {START:g} s")
        return self._line

    def _end(self) -> None:
        if self._process is not None and self._process.pid is not None:
            self._process.kill()
            self._process.join()
        if self._line is not None:
            self._line.close()
        self._process = self._line = None


def _serve(line: Connection, key: str, memory: int, examining: Examining) -> None:
    """Examine settings until the line is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C stops the grading, which ends this process
    keyed = parse_key(key)
    limit_memory(memory)
    line.send(True)
    while True:
        try:
            given = line.recv()
        except EOFError:
            return
        if isinstance(given, Path):
            line.send(repeat(keyed, given, FIGURES))
        else:
            student, changes = given
            line.send(examining(keyed.judge_for(student), changes))
