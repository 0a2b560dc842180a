"""Homework: a scenario with a text, and what a student is asked; and how answers are judged."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lab.classroom.gallery.faults import FAULTS
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.homework.scenario import Scenario
from lab.classroom.lessons.check import Check
from lab.classroom.lessons.lesson import number_typed
from lab.experiment.experiment import Experiment

LONGEST_ANSWER = 100
"""Longest answer [characters], that of a choice."""


def fault_titles() -> tuple[str, ...]:
    """Return the faults that a student may name, in alphabetical order."""
    return tuple(sorted(fault.title for fault in FAULTS.values()))


@dataclass(frozen=True)
class Question:
    """A question, as the student sees it.

    Attributes
    ----------
    text : str
        The question, as in `lab.classroom.lessons.text`.
    choices : tuple of str
        The answers to choose from; empty if the answer is a number.
    points : float
        What a right answer is worth.
    """

    text: str
    choices: tuple[str, ...] = ()
    points: float = 1.0


@dataclass(frozen=True)
class Solution:
    """The right answer to a question.

    Attributes
    ----------
    answer : str or float
        The answer.
    tolerance : float
        Largest accepted distance of a number from it.
    """

    answer: str | float
    tolerance: float = 0.0

    def accepts(self, answer: str) -> bool:
        """Return whether an answer, as it was typed or chosen, is right."""
        if isinstance(self.answer, str):
            return answer == self.answer
        value = number_typed(answer)
        return math.isfinite(value) and abs(value - self.answer) <= self.tolerance


@dataclass(frozen=True)
class Goal:
    """A condition on the result of the student's settings.

    Attributes
    ----------
    text : str
        What the student reads of it; empty if he reads nothing.
    points : float
        What it is worth.
    """

    text: str = ""
    points: float = 1.0


@dataclass(frozen=True)
class Homework:
    """A homework, as the student's lab opens it.

    Attributes
    ----------
    scenario : Scenario
        Its settings.
    text : str
        Its text, as in `lab.classroom.lessons.text`.
    public : bytes
        The teacher's public keys.
    names_faults : bool
        Whether the student is asked which faults are hidden.
    fault_points : float
        What the right faults are worth.
    questions : tuple of Question
        Further questions.
    goals : tuple of Goal
        What is asked of the result.
    student : str
        Name of the only student whose homework this is; empty if it is that of all.
    variant : str
        Tag of the student's variant; see `lab.classroom.homework.variant`.
    """

    scenario: Scenario
    text: str
    public: bytes = field(repr=False)
    names_faults: bool = True
    fault_points: float = 1.0
    questions: tuple[Question, ...] = ()
    goals: tuple[Goal, ...] = ()
    student: str = ""
    variant: str = ""

    @property
    def title(self) -> str:
        """Its title."""
        return self.scenario.title

    @property
    def name(self) -> str:
        """Its name, a digest of the teacher's public keys."""
        return self.scenario.name

    @property
    def link(self) -> str:
        """What names it in an address of the teacher's server; of a variant, with the tag and the student."""
        if not self.variant:
            return self.name
        student = base64.urlsafe_b64encode(self.student.encode()).decode().rstrip("=")
        return f"{self.name}.{self.variant}.{student}"

    @property
    def best(self) -> float:
        """All points together."""
        points = [question.points for question in self.questions] + [goal.points for goal in self.goals]
        return sum(points) + self.fault_points * self.names_faults

    def experiment(self) -> HiddenExperiment:
        """Return the experiment as the homework shows it at first."""
        return HiddenExperiment(self.scenario).update(self.scenario.settings)

    def experiment_with(self, changes: Mapping[str, Any]) -> HiddenExperiment:
        """Return the experiment with changes of a student.

        Parameters
        ----------
        changes
            Values by the path of their settings.

        Raises
        ------
        SettingError
            If the student may not change a setting, or it does not accept the value.
        """
        begun = self.experiment()
        for path, value in changes.items():
            begun.check_change(path)
            begun.set(path, value)
        return begun

    def taking(self, other: Experiment) -> HiddenExperiment:
        """Return the experiment with those settings of another one that the student may change."""
        allowed = [path for path, _, _ in other.leaves() if self.scenario.allows(path)]
        return self.experiment_with({path: other.get(path) for path in allowed})


@dataclass(frozen=True, repr=False)
class Judge:
    """What a teacher knows of a homework besides the homework.

    Attributes
    ----------
    homework : Homework
        The homework.
    solutions : tuple of Solution
        The right answer to each question.
    checks : tuple of Check
        The condition of each goal.
    """

    homework: Homework
    solutions: tuple[Solution, ...]
    checks: tuple[Check, ...]

    def points_of_faults(self, named: tuple[str, ...]) -> float:
        """Return the points for the faults that were named, by their titles.

        Each wrong one takes back the points of a right one. If no fault is hidden, naming none is right.
        """
        homework = self.homework
        real = {fault.title for fault in homework.scenario.hidden.found}
        right, wrong = len(real & set(named)), len(set(named) - real)
        if not real:
            return 0.0 if named else homework.fault_points
        return homework.fault_points * max(right - wrong, 0) / len(real)
