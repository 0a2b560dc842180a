"""Examination: the figures of the run with a student's settings, and the goals that it reaches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from lab.classroom.homework.homework import Judge
from lab.classroom.lessons.quantities import QUANTITIES
from lab.run.memory import TooLongError

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
