"""Exercises accept the right answer, refuse wrong ones with a hint, and are those of the notebooks."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

import lab
from lab.exercises.catalogue import EXERCISES
from lab.exercises.exercise import Choice, Exercise, Number, Outcome

ROOT = Path(__file__).parent.parent
NUMBER = Number("How long? [min]", 84.4, 1.0, "It is.", "Longer or shorter.", {5064.0: "In minutes."})
CHOICE = Choice("Which?", "gyro", "It is.", {"GPS": "No.", "clock": "Not it.", "odometer": "There is none."})

each = pytest.mark.parametrize("number", EXERCISES)


@pytest.mark.parametrize("exercise", [NUMBER, CHOICE], ids=["number", "choice"])
@pytest.mark.parametrize(
    "answer", [True, math.nan, math.inf, 10**400, "", "x" * 10_000, [84.4], {}, object(), b"gyro", 1j]
)
def test_what_is_no_answer_is_refused_with_the_question(exercise: Exercise, answer: object) -> None:
    outcome = exercise.check(answer)
    assert outcome.right is False
    assert exercise.question in outcome.text


def test_without_an_answer_the_question_is_shown() -> None:
    assert NUMBER.check(None) == Outcome(None, NUMBER.question)
    assert all(word in str(CHOICE.check(None)) for word in CHOICE.choices)


def test_a_usual_mistake_has_its_own_hint() -> None:
    assert NUMBER.check(5100.0).text == "In minutes."
    assert NUMBER.check(30).text == "Longer or shorter."
    assert CHOICE.check(" gps ").text == "No."
    assert CHOICE.check("GYRO").right


def test_an_unknown_exercise_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"there is no exercise 99\.1"):
        lab.check("99.1", 1)


def test_an_outcome_is_a_card_that_knows_text_only() -> None:
    html = Outcome(False, "<script>")._repr_html_()
    assert html is not None
    assert "&lt;script&gt;" in html
    assert "<script>" not in html


@each
def test_the_right_answer_is_accepted_and_three_wrong_ones_are_not(number: str) -> None:
    exercise = EXERCISES[number]
    assert exercise.check(exercise.right) == Outcome(True, exercise.because)
    wrong = exercise.wrong()
    assert len(wrong) >= 3
    for answer in wrong:
        outcome = exercise.check(answer)
        assert outcome.right is False
        assert outcome.text
        assert outcome.text != exercise.because


@each
def test_an_exercise_is_in_its_notebook(number: str) -> None:
    (notebook,) = (ROOT / "notebooks").glob(f"{number.partition('.')[0]}_*.py")
    assert f'check("{number}"' in notebook.read_text("utf-8")


def test_a_notebook_has_no_other_exercises() -> None:
    for notebook in (ROOT / "notebooks").glob("*.py"):
        for number in re.findall(r'check\("([^"]+)"', notebook.read_text("utf-8")):
            assert number in EXERCISES
            assert notebook.name.startswith(number.partition(".")[0])
