"""Innovations of other sensors beside a gate: what it passes tells the noise, what it rejects does not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lab.analysis.verdicts.aid_verdict import aid_squares, judge_aids
from lab.analysis.verdicts.sums import Squares
from lab.navigation.aids import FORWARD, HEIGHT

NUMBER = 20_000
"""Innovations of each trial: the σ of their mean square is 1 % without a gate."""


def squares_of(innovation: np.ndarray, gate: float, kind: int = FORWARD) -> Squares:
    """Return the squares for innovations of one kind, whose σ the filter says is 1."""
    solution: Any = SimpleNamespace(aid_innovation=innovation, aid_variance=np.ones(innovation.size))
    return aid_squares(solution, np.full(innovation.size, kind), gate)


@pytest.mark.parametrize("gate", [0.0, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("sigma", [0.1, 1.0, 2.0, 6.0])
def test_the_noise_is_found_through_any_gate(gate: float, sigma: float) -> None:
    """Six times the assumed σ fill any gate evenly: all innovations count then."""
    noise = sigma * np.random.default_rng(1).normal(size=NUMBER)
    found = squares_of(noise, gate)
    # A gate of 0.9 at twice the assumed σ passes what is nearly uniform: its width tells σ to some 5 %.
    bound = 0.25 if sigma == 2.0 and gate == 0.9 else 0.06
    assert found.total[FORWARD] / found.number[FORWARD] == pytest.approx(sigma**2, rel=bound)


def test_slips_that_the_gate_rejects_are_not_called_noise() -> None:
    draws = np.random.default_rng(2)
    innovation = draws.normal(size=NUMBER)
    innovation[draws.random(NUMBER) < 0.05] += 40.0
    assert [found.finding.quantity for found in judge_aids(squares_of(innovation, 0.0))] == [
        "R speed forward"
    ]
    assert judge_aids(squares_of(innovation, 0.999)) == []


def test_noise_assumed_too_small_is_still_named_beside_a_gate() -> None:
    innovation = 1.5 * np.random.default_rng(3).normal(size=NUMBER)
    (found,) = judge_aids(squares_of(innovation, 0.999, HEIGHT))
    assert found.finding.quantity == "R height"


def test_no_accepted_innovation_and_none_at_all() -> None:
    assert squares_of(np.full(50, 9.0), 0.999).total[FORWARD] == 50 * 81.0
    assert squares_of(np.zeros(50), 0.999).total[FORWARD] == 0.0
    assert squares_of(np.full(50, np.nan), 0.999).number[FORWARD] == 0.0
