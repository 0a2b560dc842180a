"""MissionError: the error of a mission that cannot be read, found, written or flown."""

from __future__ import annotations

from collections.abc import Mapping


class MissionError(ValueError):
    """A mission or its recording is not acceptable; the message says what, where, and what is accepted."""


class QuestionError(MissionError):
    """A file that can be read in two ways, between which its data do not decide: a person has to.

    Parameters
    ----------
    message
        What is unknown, and why the data do not show it.
    choices
        By the words of each answer, the unit or quantity of each column, as ``--unit`` takes them.
    """

    def __init__(self, message: str, choices: Mapping[str, Mapping[str, str]]) -> None:
        super().__init__(message)
        self.choices = choices
