"""Each lesson that ships: its checks accept the solution, and refuse three wrong results or more."""

from __future__ import annotations

from collections import Counter

import pytest

from lab.classroom.lessons.catalogue import Catalogue, gallery_lessons
from lab.classroom.lessons.lesson import Lesson, trials
from lab.classroom.lessons.quantities import QUANTITIES

SHIPPED = [entry.lesson for entry in Catalogue().entries if entry.origin == "shipped"]
GALLERY = gallery_lessons()
ALL = [lesson for lesson in (*SHIPPED, *GALLERY) if lesson is not None]
MANY = 0.28
"""Correlation of innovations that a student sees: four σ of 205 fixes."""


def test_at_least_ten_lessons_and_ten_faults_ship() -> None:
    assert None not in SHIPPED
    assert len(SHIPPED) >= 10
    assert len({lesson.fault for lesson in GALLERY}) == 10


@pytest.mark.parametrize("lesson", ALL, ids=lambda lesson: lesson.name)
def test_steps_ask_something_and_answers_are_judged(lesson: Lesson) -> None:
    assert 3 <= len(lesson.steps) <= 6
    for step in lesson.steps:
        assert step.asks
        assert step.hint
        assert step.because
        if step.check is not None:
            assert len(step.wrong) >= 3
        elif step.choices:
            wrong = [choice for choice in step.choices if choice != step.answer]
            assert len(wrong) >= 3
            assert step.judge(step.answer, None).right
            assert not any(step.judge(choice, None).right for choice in wrong)
        else:
            answer, tolerance = float(step.answer or 0.0), step.tolerance
            assert step.judge(str(answer + 0.9 * tolerance), None).right
            for wrong_number in (answer + 1.1 * tolerance, answer - 1.1 * tolerance, -answer):
                assert not step.judge(wrong_number, None).right


@pytest.mark.proof
@pytest.mark.parametrize("lesson", ALL, ids=lambda lesson: lesson.name)
def test_each_check_accepts_the_solution_and_refuses_what_is_wrong(lesson: Lesson) -> None:
    tried = trials(lesson)
    assert [trial for trial in tried if not trial.is_right] == []
    for step in {trial.step for trial in tried}:
        assert sum(not trial.accepted for trial in tried if trial.step == step) >= 3


@pytest.mark.parametrize("lesson", GALLERY, ids=lambda lesson: lesson.fault)
def test_the_answers_of_the_gallery_are_what_its_runs_show(lesson: Lesson) -> None:
    result = lesson.experiment(lesson.steps[0]).run()
    names = ("nis_position", "nis_velocity", "correlation", "nees")
    position, velocity, correlation, nees = (QUANTITIES[name].of(result) for name in names)
    if position > 100:
        seen = "hundreds of times"
    elif correlation > MANY:
        seen = "correlated"
    elif position > 5:
        seen = "white, but positions" if velocity > 5 else "the positions"
    else:
        seen = "white, and as large"
    assert str(lesson.steps[0].answer).startswith(seen)
    sizes = {
        "about 1": (0, 2),
        "2 to 10": (2, 10),
        "20 to 300": (20, 300),
        "more than a million": (1e6, 1e12),
    }
    assert [size for size, (low, high) in sizes.items() if low <= nees < high] == [lesson.steps[1].answer]


FORMULAS = {
    ("02-alone", 1): 0.5 * 0.00980665 * 105**2,
    ("02-alone", 2): 9.80665 * 0.01 * 3.141592653589793 / 180 * 105**3 / 6,
    ("03-random-walk", 0): 0.05 * 105**0.5,
    ("08-late-fixes", 0): 45 * 0.3,
}


@pytest.mark.parametrize(("place", "value"), FORMULAS.items())
def test_numbers_are_those_of_their_formulas(place: tuple[str, int], value: float) -> None:
    lesson = next(lesson for lesson in ALL if lesson.name == place[0])
    assert lesson.steps[place[1]].judge(value, None).right


MEASURED = {("01-first-look", 1): "heading_rms", ("06-outage", 0): "outage_max"}


@pytest.mark.parametrize(("place", "quantity"), MEASURED.items())
def test_numbers_that_a_student_reads_are_those_of_the_run(place: tuple[str, int], quantity: str) -> None:
    lesson = next(lesson for lesson in ALL if lesson.name == place[0])
    step = lesson.steps[place[1]]
    assert step.judge(QUANTITIES[quantity].of(lesson.experiment(step).run()), None).right


def test_the_right_choice_is_not_found_by_its_place() -> None:
    steps = [step for lesson in SHIPPED if lesson is not None for step in lesson.steps if step.choices]
    questions = [(step.choices, str(step.answer)) for step in steps]
    places = Counter(choices.index(answer) for choices, answer in questions)
    assert len(questions) >= 10
    assert max(places.values()) <= len(questions) / 3, places
