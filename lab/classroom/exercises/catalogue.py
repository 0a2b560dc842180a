"""Catalogue: the exercises of all notebooks by number, and the check of an answer."""

from __future__ import annotations

import difflib

from lab.classroom.exercises import (
    live_stream,
    many_runs,
    model_comparison,
    open_filter,
    outages,
    own_algorithm,
    own_flight,
    sensor_errors,
    strapdown,
    tour,
    tuning,
)
from lab.classroom.exercises.exercise import Exercise, Outcome

_NOTEBOOKS = (
    tour,
    strapdown,
    sensor_errors,
    open_filter,
    tuning,
    model_comparison,
    outages,
    own_flight,
    own_algorithm,
    many_runs,
    live_stream,
)
EXERCISES: dict[str, Exercise] = {
    number: exercise for notebook in _NOTEBOOKS for number, exercise in notebook.EXERCISES.items()
}
"""Exercises by number: of the notebook, a point, and of the exercise in it."""


def check(number: str, answer: object = None) -> Outcome:
    """Check the answer of an exercise.

    Parameters
    ----------
    number
        Number of the exercise, as ``"02.1"``.
    answer
        The answer; without one, the question is shown.

    Raises
    ------
    ValueError
        If there is no such exercise.
    """
    exercise = EXERCISES.get(str(number))
    if exercise is None:
        close = difflib.get_close_matches(str(number), EXERCISES, n=1)
        nearest = f"; the nearest is {close[0]}" if close else ""
        raise ValueError(f"there is no exercise {number}{nearest}; accepted are {', '.join(EXERCISES)}")
    return exercise.check(answer)
