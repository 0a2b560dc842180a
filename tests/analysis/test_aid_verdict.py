"""The verdict on the noise of measurements other than fixes."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.verdicts.aid_verdict import aid_squares, judge_aids
from lab.analysis.verdicts.sums import Squares
from lab.navigation.aids import HEIGHT, NAMES, SENSORS, VERTICAL
from lab.navigation.solution import Solution


def judged(kind: int, ratio: float, number: float = 200.0) -> list[str]:
    """Return what is found if the mean square of one kind is `ratio`, and that of all others one."""
    count = np.full(len(NAMES), number)
    total = count.copy()
    total[kind] *= ratio
    return [f"{one.finding.quantity} {one.finding.direction}" for one in judge_aids(Squares(total, count))]


@pytest.mark.parametrize("kind", range(len(NAMES)), ids=lambda kind: NAMES[kind])
def test_each_kind_is_judged_by_its_own_innovations(kind: int) -> None:
    assert judged(kind, 1.1) == []
    assert judged(kind, 4.0) == [f"R {NAMES[kind]} too small"]
    # A condition may hold better than assumed: a vehicle at rest stands still.
    assert judged(kind, 0.25) == ([f"R {NAMES[kind]} too large"] if kind in SENSORS else [])


def test_what_was_not_measured_is_not_judged() -> None:
    assert judge_aids(Squares(np.zeros(len(NAMES)), np.zeros(len(NAMES)))) == []
    (found,) = judge_aids(Squares(4.0 * np.eye(len(NAMES))[HEIGHT] * 100, 100 * np.eye(len(NAMES))[HEIGHT]))
    assert "the height are 2 times as large" in found.finding.sentence
    assert "sensors.barometer.noise" in found.finding.advice


def test_squares_are_those_of_each_kind_and_of_known_innovations() -> None:
    solution = Solution.empty(1, 0, aids=4)
    solution.aid_innovation[:] = 2.0, np.nan, 3.0, 1.0
    solution.aid_variance[:] = 4.0, 1.0, 1.0, 1.0
    found = aid_squares(solution, np.array([HEIGHT, HEIGHT, VERTICAL, VERTICAL]))
    assert (found.total[HEIGHT], found.number[HEIGHT]) == (1.0, 1.0)
    assert (found.total[VERTICAL], found.number[VERTICAL]) == (10.0, 2.0)
    assert found.number.sum() == 3
