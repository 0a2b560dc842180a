"""Exercise: a question with the check of its answer. The check says no more than a hint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import ClassVar

from lab.notebook_card import NotebookCard

LONGEST = 200
"""Longest text that is compared with the choices of a question [characters]."""


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
        """Return what there is to say of an answer."""
        if answer is None:
            return Outcome(None, self.question)
        value = _finite(answer)
        if math.isnan(value):
            return Outcome(False, f"The answer is a number. {self.question}")
        if abs(value - self.right) <= self.tolerance:
            return Outcome(True, self.because)
        for mistake, help_for_it in self.mistakes.items():
            if math.isclose(value, mistake, rel_tol=0.05):
                return Outcome(False, help_for_it)
        return Outcome(False, self.hint)

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
        word = answer[:LONGEST].strip().casefold() if isinstance(answer, str) else None
        if word == self.right.casefold():
            return Outcome(True, self.because)
        for mistake, hint in self.mistakes.items():
            if word == mistake.casefold():
                return Outcome(False, hint)
        return Outcome(False, offered)

    def wrong(self) -> list[str]:
        """Return the other words."""
        return list(self.mistakes)


Exercise = Number | Choice


def _finite(answer: object) -> float:
    """Return an answer as a number; NaN if it is none, not finite, or too large."""
    if isinstance(answer, bool) or not isinstance(answer, Real):
        return math.nan
    try:
        value = float(answer)
    except OverflowError:
        return math.nan
    return value if math.isfinite(value) else math.nan
