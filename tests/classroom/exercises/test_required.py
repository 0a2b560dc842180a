"""Checks that raise, for graders of notebooks."""

from __future__ import annotations

import numpy as np
import pytest

from lab.classroom.exercises.exercise import EXERCISES
from lab.classroom.exercises.required import NotRightError, require, require_answer, require_close
from lab.classroom.lessons.check import CheckError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result


@pytest.fixture(scope="module")
def result() -> Result:
    return Experiment(mission="los_angeles").update({"trajectory": {"imu_rate": 20}}).run()


def test_a_result_that_meets_the_condition_passes_in_silence(result: Result) -> None:
    require(result, "nees < 100 and navigator.r_scale < 2")


def test_one_that_does_not_raises_with_what_it_has(result: Result) -> None:
    with pytest.raises(NotRightError, match=r"nees > 100: not yet; nees is \d") as raised:
        require(result, "nees > 100")
    assert isinstance(raised.value, AssertionError)
    with pytest.raises(NotRightError, match=r"^look at R$"):
        require(result, "nees > 100", "look at R")
    with pytest.raises(NotRightError, match="type Experiment"):
        require(Experiment(), "nees > 1")  # type: ignore[arg-type]
    with pytest.raises(CheckError, match="no_such"):
        require(result, "no_such < 1")


@pytest.mark.parametrize("number", EXERCISES)
def test_every_exercise_passes_with_its_answer_and_raises_for_wrong_ones(number: str) -> None:
    exercise = EXERCISES[number]
    require_answer(number, exercise.right)
    for wrong in (None, *exercise.wrong()):
        with pytest.raises(NotRightError):
            require_answer(number, wrong)


@pytest.mark.parametrize("answer", [1.0, np.array([1.05]), np.float32(0.95), "1.05"])
def test_a_number_within_the_tolerance_passes(answer: object) -> None:
    require_close(answer, 1.0, 0.1)


@pytest.mark.parametrize("answer", [1.2, float("nan"), None, "one", [1.0, 2.0], np.array([1.0, 1.0])])
def test_anything_else_raises(answer: object) -> None:
    with pytest.raises(NotRightError):
        require_close(answer, 1.0, 0.1)
