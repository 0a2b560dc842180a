"""Exercise: a question with the check of its answer, and the exercises of all notebooks by number.

The check says no more than a hint.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from numbers import Real
from pathlib import Path
from typing import Any, ClassVar

from lab.base.notebook_card import NotebookCard
from lab.base.parameters.toml_file import parse_toml

LONGEST = 200
"""Longest text that is read as an answer [characters]."""
_UNIT = re.compile(r"\[([^],]+)[^]]*\]")
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D*)")
_BETWEEN_WORDS = re.compile(r"[\s_-]+")
_BETWEEN_NAMES = re.compile(r" and | & |, ?")
_ARTICLE = re.compile(r"^(?:an?|the) ")


@dataclass(frozen=True)
class Outcome(NotebookCard):
    """What a check says of an answer.

    Attributes
    ----------
    right : bool or None
        Whether the answer is right; None if there is no answer yet.
    text : str
        The explanation of a right answer, else a hint.
    """

    right: bool | None
    text: str

    CARD: ClassVar[str] = "outcome"

    def __str__(self) -> str:
        if self.right is None:
            return f"No answer yet. {self.text}"
        return f"{'Right.' if self.right else 'Not yet.'} {self.text}"

    __repr__ = __str__


@dataclass(frozen=True)
class Number:
    """A question whose answer is a number.

    Attributes
    ----------
    question : str
        The question, with the unit of its answer.
    right : float
        The answer.
    tolerance : float
        Largest accepted distance from it, in its unit.
    because : str
        Why the answer is right; shown once it is given.
    hint : str
        What helps after any wrong answer.
    mistakes : mapping of float to str
        Answers of usual mistakes, each with what helps. An answer within a twentieth of one counts as it.
    """

    question: str
    right: float
    tolerance: float
    because: str
    hint: str
    mistakes: Mapping[float, str] = field(default_factory=dict)

    def check(self, answer: object) -> Outcome:
        """Return what there is to say of an answer: a number, alone, in a text or in an array."""
        if answer is None:
            return Outcome(None, self.question)
        value, unit = finite_number(answer)
        if math.isnan(value):
            return Outcome(False, f"The answer is a number. {self.question}")
        if unit not in ("", self.unit):
            wanted = f"in {self.unit}" if self.unit else "a number without a unit"
            return Outcome(False, f"The answer is {wanted}.")
        if abs(value - self.right) <= self.tolerance:
            return Outcome(True, self.because)
        return Outcome(False, self._help(value))

    def _help(self, value: float) -> str:
        """Return what helps after a wrong number."""
        if abs(value + self.right) <= self.tolerance:
            return "The size is right, but not the sign."
        near = (text for mistake, text in self.mistakes.items() if math.isclose(value, mistake, rel_tol=0.05))
        return next(near, self.hint)

    @property
    def unit(self) -> str:
        """Return the unit of the answer, which the question names in square brackets; empty without one."""
        found = _UNIT.search(self.question)
        return found[1] if found else ""

    def wrong(self) -> list[float]:
        """Return three or more wrong answers: the usual mistakes, and some that are clearly off."""
        size = max(abs(self.right), self.tolerance)
        return [*self.mistakes, self.right + 3 * size, self.right - 3 * size, -self.right - 2 * size]


@dataclass(frozen=True)
class Choice:
    """A question whose answer is one of some words.

    Attributes
    ----------
    question : str
        The question.
    right : str
        The right word.
    because : str
        Why it is right; shown once it is given.
    mistakes : mapping of str to str
        The other words, three or more, each with a hint.
    """

    question: str
    right: str
    because: str
    mistakes: Mapping[str, str]

    @property
    def choices(self) -> list[str]:
        """Return all words, in the order of the alphabet."""
        return sorted([self.right, *self.mistakes])

    def check(self, answer: object) -> Outcome:
        """Return what there is to say of an answer."""
        offered = f"{self.question} Accepted are: {', '.join(self.choices)}."
        if answer is None:
            return Outcome(None, offered)
        word = _normalize_words(answer)
        if word == _normalize_words(self.right):
            return Outcome(True, self.because)
        for mistake, hint in self.mistakes.items():
            if word == _normalize_words(mistake):
                return Outcome(False, hint)
        return Outcome(False, offered)

    def wrong(self) -> list[str]:
        """Return the other words."""
        return list(self.mistakes)


Exercise = Number | Choice


def _unwrap_single(answer: object) -> object:
    """Return the only element of an array, DataArray, list or tuple; anything else unchanged."""
    if isinstance(answer, (list, tuple)) and len(answer) == 1:
        answer = answer[0]
    if getattr(answer, "size", None) == 1 and callable(item := getattr(answer, "item", None)):
        return item()
    return answer


def finite_number(answer: object) -> tuple[float, str]:
    """Return an answer as a number, and the unit behind it; NaN if it is none, not finite, or too large."""
    single, unit = _unwrap_single(answer), ""
    if isinstance(single, str) and len(single) <= LONGEST and (found := _NUMBER.fullmatch(single.strip())):
        single, unit = float(found[1]), found[2]
    if isinstance(single, bool) or not isinstance(single, (Real, Decimal)):
        return math.nan, ""
    try:
        value = float(single)
    except OverflowError:
        return math.nan, ""
    return (value if math.isfinite(value) else math.nan), unit


def _normalize_words(answer: object) -> frozenset[str]:
    """Return the names of an answer, without their order, case, articles, hyphens and plural."""
    names = answer if isinstance(answer, (list, tuple)) else [_unwrap_single(answer)]
    text = " and ".join(name[:LONGEST] for name in names[:LONGEST] if isinstance(name, str))
    words = (_BETWEEN_WORDS.sub(" ", part.strip(" .\t\n")) for part in _BETWEEN_NAMES.split(text.casefold()))
    return frozenset(_ARTICLE.sub("", word).removesuffix("s") for word in words)


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
