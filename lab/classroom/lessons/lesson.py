"""Lesson: a title and a few steps, each with a text, settings, a question, and a check of the result.

`lab.classroom.lessons.lesson_file` makes one of a TOML file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from lab.classroom.exercises.exercise import Outcome
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.lessons.check import Check
from lab.classroom.lessons.quantities import QUANTITIES
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

PAGES = (
    "Missions",
    "Overview",
    "Errors",
    "Covariance",
    "Innovations",
    "Verdict",
    "States",
    "Cards",
    "Allan",
    "Numbers",
    "Calibration",
    "Ground track",
    "Flight",
    "3-D",
    "Budget",
    "Microscope",
    "Other filters",
    "Compare",
    "Live",
)
"""Titles of the pages that a step may show."""
RENAMED = {
    "Summary": "Compare",
    "Models": "Compare",
    "Height": "Flight",
    "Consistency": "Verdict",
    "Sensor errors": "States",
}
"""Titles of older lessons, and the pages that took their place."""
NOT_YET = "The check does not accept your result yet."
NO_ANSWER = "Give an answer first."
NO_NUMBER = "The answer is a number without its unit, such as 0.5."
NO_RESULT = "There is no result yet. Wait until it is computed."

Answer = str | float | None


@dataclass(frozen=True)
class Step:
    """One step of a lesson.

    Attributes
    ----------
    title : str
        Its title.
    text : str
        Its text, as in `lab.classroom.lessons.text`.
    settings : mapping or None
        Settings besides those of the lesson, in nested tables. None leaves what the student has.
    page : str
        Title of the page to look at; empty if none is named.
    time : float or None
        Time to look at [s].
    question : str
        The question; empty if there is none.
    choices : tuple of str
        The answers to choose from; empty if the answer is a number.
    answer : str, float or None
        The right answer; None if there is no question.
    tolerance : float
        Largest accepted distance of a number from it.
    check : Check or None
        The condition on the student's result.
    hint : str
        What helps after a wrong answer or result.
    because : str
        Why the right one is right.
    solution : mapping or None
        Settings, besides those of the step, with which the check accepts a result; not shown.
    wrong : tuple of mapping
        Settings with which the check refuses it; not shown.
    """

    title: str
    text: str
    settings: Mapping[str, Any] | None = None
    page: str = ""
    time: float | None = None
    question: str = ""
    choices: tuple[str, ...] = ()
    answer: Answer = None
    tolerance: float = 0.0
    check: Check | None = None
    hint: str = ""
    because: str = ""
    solution: Mapping[str, Any] | None = None
    wrong: tuple[Mapping[str, Any], ...] = ()

    @property
    def asks(self) -> bool:
        """Whether there is anything to solve."""
        return self.answer is not None or self.check is not None

    def judge(self, answer: Answer, result: Result | None) -> Outcome:
        """Return what there is to say of an answer, and of a result.

        Parameters
        ----------
        answer
            The student's answer; None without one. A text where a number is asked is read as one.
        result
            The student's result; None without one.
        """
        if self.answer is not None:
            if answer is None or answer == "":
                return Outcome(None, NO_ANSWER)
            if self._lacks_number(answer):
                return Outcome(None, NO_NUMBER)
            if not self._is_right(answer):
                return Outcome(False, self.hint)
        if self.check is not None:
            if result is None:
                return Outcome(None, NO_RESULT)
            if not self.check.accepts(result):
                return Outcome(False, f"{NOT_YET} {self.hint}".rstrip())
        return Outcome(True, self.because)

    def _lacks_number(self, answer: str | float) -> bool:
        return not isinstance(self.answer, str) and not math.isfinite(number_typed(answer))

    def _is_right(self, answer: str | float) -> bool:
        if isinstance(self.answer, str):
            return answer == self.answer
        value = number_typed(answer)
        return self.answer is not None and math.isfinite(value) and abs(value - self.answer) <= self.tolerance


@dataclass(frozen=True)
class Lesson:
    """A lesson.

    Attributes
    ----------
    name : str
        Its name, that of its file.
    title : str
        Its title.
    summary : str
        What it is about, in a sentence.
    steps : tuple of Step
        Its steps.
    settings : mapping
        Settings of all steps, in nested tables.
    fault : str
        Name of the fault of the gallery that is hidden in all its runs; empty without one.
    """

    name: str
    title: str
    summary: str
    steps: tuple[Step, ...]
    settings: Mapping[str, Any]
    fault: str = ""

    def experiment(self, step: Step) -> Experiment:
        """Return the experiment with which a step begins.

        Raises
        ------
        SettingError
            If a setting is not accepted.
        """
        begun = FaultyExperiment(FAULTS[self.fault]) if self.fault else Experiment()
        return begun.update(self.settings).update(step.settings or {})


def number_typed(answer: str | float) -> float:
    """Return a number that was typed, with a point or a comma; NaN if it is none."""
    try:
        return float(answer.replace(",", ".").replace("−", "-") if isinstance(answer, str) else answer)
    except ValueError:
        return math.nan


class Trial(NamedTuple):
    """One run of a check.

    Attributes
    ----------
    step : int
        Number of the step, from 1.
    what : str
        What was run: the solution, wrong settings, or the step as it begins.
    accepted : bool
        Whether the check accepted the result.
    is_right : bool
        Whether it should have.
    values : dict of str to float
        The quantities that the check names.
    """

    step: int
    what: str
    accepted: bool
    is_right: bool
    values: dict[str, float]


def trials(lesson: Lesson, progress: Callable[[str, float], None] | None = None) -> list[Trial]:
    """Run the checks of a lesson.

    Each is run on its solution, on each of its wrong settings, and on the step as it begins: a student who
    changes nothing has solved nothing, unless there is no solution because the beginning is right.

    Parameters
    ----------
    lesson
        The lesson.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    ValueError
        If a run fails; see `lab.experiment.experiment.Experiment.run`.
    """
    found = []
    for number, step in enumerate(lesson.steps, 1):
        if progress is not None:
            progress(f"step {number}", (number - 1) / len(lesson.steps))
        if step.check is not None:
            found += _of_step(lesson, number, step)
    return found


def _of_step(lesson: Lesson, number: int, step: Step) -> list[Trial]:
    assert step.check is not None
    cases: list[tuple[str, Mapping[str, Any], bool]] = [("the step as it begins", {}, step.solution is None)]
    if step.solution is not None:
        cases.append(("the solution", step.solution, True))
    cases += [(f"the wrong settings {place}", wrong, False) for place, wrong in enumerate(step.wrong, 1)]
    found = []
    for what, settings, wanted in cases:
        result = lesson.experiment(step).update(settings).run()
        accepted = step.check.accepts(result)
        values = {name: QUANTITIES[name].of(result) for name in step.check.quantities}
        found.append(Trial(number, what, accepted, accepted == wanted, values))
    return found
