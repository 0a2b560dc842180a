"""Trial: the checks of a lesson run on their solutions, which they must accept, and on wrong settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from lab.classroom.lessons.lesson import Lesson, Step
from lab.classroom.lessons.quantities import QUANTITIES


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
