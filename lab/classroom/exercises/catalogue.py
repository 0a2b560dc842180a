"""Catalogue: the exercises of all notebooks by number, and the check of an answer."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.base.parameters.toml_file import parse_toml
from lab.classroom.exercises.exercise import Choice, Exercise, Number, Outcome


def _exercise(table: Mapping[str, Any]) -> Exercise:
    """Return the exercise of a table: with a number as the right answer, or with words."""
    if isinstance(table["right"], str):
        return Choice(**table)
    mistakes = {float(answer): hint for answer, hint in table["mistakes"].items()}
    return Number(**{**table, "mistakes": mistakes})


EXERCISES: dict[str, Exercise] = {
    number: _exercise(table)
    for number, table in parse_toml(Path(__file__).with_name("exercises.toml").read_text("utf-8")).items()
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
