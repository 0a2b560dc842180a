"""Exercises accept the right answer, refuse wrong ones with a hint, and are those of the notebooks."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import lab
from lab.classroom.exercises.exercise import EXERCISES, Choice, Exercise, Number, Outcome

ROOT = Path(__file__).parents[3]
NUMBER = Number("How long? [min]", 84.4, 1.0, "It is.", "Longer or shorter.", {5064.0: "In minutes."})
CHOICE = Choice("Which?", "gyro", "It is.", {"GPS": "No.", "clock": "Not it.", "odometer": "There is none."})

each = pytest.mark.parametrize("number", EXERCISES)


@pytest.mark.parametrize("exercise", [NUMBER, CHOICE], ids=["number", "choice"])
@pytest.mark.parametrize(
    "answer",
    [
        *(True, math.nan, math.inf, 10**400, "", "x" * 10_000, "1" * 10_000, {}, object(), b"gyro", 1j),
        *([], [84.4, 84.4], [[84.4]] * 2, np.zeros(0), np.array([84.4, 1])),
        *(
            np.array(True),
            np.array(None),
            xr.Dataset({"x": 84.4}),
            Decimal("nan"),
            "84.4 min 3",
            "nan",
            "84,400",
        ),
    ],
    ids=lambda answer: repr(answer)[:20],
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


@pytest.mark.parametrize(
    "answer",
    [
        *(84, "84.4", " 84.4 ", "84.4 min", "84.4min", "8.44e1", [84.4], (84.4,), Decimal("84.4")),
        *(
            Fraction(844, 10),
            np.float32(84.4),
            np.int64(84),
            np.array(84.4),
            np.array([[84.4]]),
            ["84.4"],
            np.array(["84.4 min"]),
        ),
        xr.DataArray(84.4),
    ],
    ids=repr,
)
def test_a_number_is_a_number_in_any_form(answer: object) -> None:
    assert NUMBER.check(answer).right


@pytest.mark.parametrize("number", [number for number, one in EXERCISES.items() if isinstance(one, Number)])
def test_three_digits_of_an_answer_are_enough(number: str) -> None:
    exercise = EXERCISES[number]
    assert isinstance(exercise, Number)
    assert exercise.check(float(f"{exercise.right:.3g}")).right
    assert exercise.check(f"{exercise.right:.3g}").right


def test_a_wrong_sign_and_another_unit_are_called_so() -> None:
    assert "sign" in NUMBER.check(-84.4).text
    assert "min" in NUMBER.check("84.4 s").text
    assert NUMBER.check("84.4 s").right is False
    assert "without a unit" in EXERCISES["06.2"].check("100 %").text


@pytest.mark.parametrize(
    "answer", ["PHI and PSI", "psi and phi", "phi, psi", "psi & phi", ("psi", "phi"), ["phi and psi"]]
)
def test_words_may_have_another_order(answer: object) -> None:
    assert EXERCISES["06.1"].check(answer).right


@pytest.mark.parametrize(
    ("number", "answer"),
    [
        *(
            ("07.4", "turn"),
            ("07.4", "A turn."),
            ("07.3", "the gyros"),
            ("07.3", "gyro"),
            ("07.3", ["gyros"]),
        ),
        *(("03.3", "Random  walk of the\tbias"), ("03.4", "scale_factor"), ("10.3", "luck cancels")),
        *(
            ("04.2", "velocity-from-tilt"),
            ("02.3", np.array("exponentially")),
            ("03.4", np.str_("scale factor")),
        ),
    ],
)
def test_a_word_is_known_without_its_article_and_in_other_spellings(number: str, answer: object) -> None:
    assert EXERCISES[number].check(answer).right


def test_no_two_choices_of_a_question_are_the_same_words() -> None:
    for exercise in EXERCISES.values():
        if isinstance(exercise, Choice):
            for word in exercise.wrong():
                assert exercise.check(word).text == exercise.mistakes[word]


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
