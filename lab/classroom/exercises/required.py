"""Required: checks that raise, for graders of notebooks such as nbgrader and Otter-Grader.

A cell of a grader passes unless it raises. So these functions return nothing if the answer is right, and else
raise an `AssertionError` that says what is missing, and not what would be right.
"""

from __future__ import annotations

import math

from lab.classroom.exercises.exercise import check, finite_number
from lab.classroom.lessons.check import CheckError, parse_check
from lab.classroom.lessons.lesson_file import numeric_in
from lab.classroom.lessons.quantities import QUANTITIES
from lab.experiment.result import Result


class NotRightError(AssertionError):
    """An answer or a result that is not right; the message helps."""


def require(result: Result, condition: str, hint: str = "") -> None:
    """Raise unless a result meets a condition.

    >>> from lab.classroom.exercises.required import require
    >>> from lab import Experiment
    >>> require(Experiment(mission="los_angeles").run(), "nees < 3 and position_rms < 2")

    Parameters
    ----------
    result
        The student's result.
    condition
        The condition, in the language of `lab.classroom.lessons.check`.
    hint
        What the student reads if it is not met; else the condition and what the result has.

    Raises
    ------
    NotRightError
        If the condition is not met, or this is no result.
    CheckError
        If the condition cannot be read: a mistake of the teacher.
    """
    if not isinstance(result, Result):
        raise NotRightError(
            f"this is of type {type(result).__name__}; accepted is the result of Experiment.run()"
        )
    parsed = parse_check(condition, numeric_in(result.experiment))
    if parsed.accepts(result):
        return
    values = (
        f"{name} is {_format_value(QUANTITIES[name].of(result), QUANTITIES[name].unit)}"
        for name in parsed.quantities
    )
    raise NotRightError(
        hint or f"{condition}: not yet; {', '.join(dict.fromkeys(values)) or 'the verdict differs'}"
    )


def require_answer(number: str, answer: object) -> None:
    """Raise unless the answer of an exercise of the notebooks is right.

    Parameters
    ----------
    number
        Number of the exercise, as ``"02.1"``.
    answer
        The answer.

    Raises
    ------
    NotRightError
        If it is not right, with the hint of the exercise; or if there is none.
    ValueError
        If there is no such exercise.
    """
    outcome = check(number, answer)
    if not outcome.right:
        raise NotRightError(str(outcome))


def require_close(answer: object, right: float, tolerance: float, hint: str = "") -> None:
    """Raise unless an answer is a number within a tolerance of another.

    Parameters
    ----------
    answer
        The answer: a number, alone or in an array of one.
    right, tolerance
        The right number, and the largest accepted distance from it, in the same unit.
    hint
        What the student reads if it is not right.

    Raises
    ------
    NotRightError
        If it is not.
    """
    value, unit = finite_number(answer)
    if math.isnan(value) or unit:
        raise NotRightError(f"{str(answer)[:60]!r} is no number; accepted is one, without a unit")
    if not abs(value - right) <= tolerance:  # NaN is not
        raise NotRightError(hint or "the number is not right yet")


def _format_value(value: float, unit: str) -> str:
    return "unknown" if math.isnan(value) else f"{value:.3g} {unit}".rstrip()


__all__ = ["CheckError", "NotRightError", "require", "require_answer", "require_close"]
