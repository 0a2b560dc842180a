"""Algorithms of a user's own: run and compared like the built-in ones, their faults reported as their own."""

from __future__ import annotations

import numpy as np
import pytest

from lab import Estimate, Experiment, compare
from lab.navigation.algorithm import AlgorithmError
from lab.navigation.navigator import navigate
from lab.navigation.solution import Belief, Fixes, Imu, Start

MISSION = "los_angeles"


class Builtin:
    """The lab's own filter behind the interface."""

    def __init__(self, belief: Belief) -> None:
        self.belief = belief

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Navigate with the model phi."""
        found = navigate(imu, fixes, start, self.belief)
        return Estimate(found.position, found.velocity_n, found.q_nb, np.sqrt(found.variance[:, :9]))


class LastFix:
    """Holds the last fix and the first attitude: thirty lines are enough for an algorithm."""

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Hold what was last known."""
        n = imu.time.size
        last = np.searchsorted(fixes.time, imu.time, side="right") - 1
        held = np.maximum(last, 0)
        position, velocity = fixes.position[held].copy(), fixes.velocity_n[held].copy()
        position[last < 0], velocity[last < 0] = start.position, start.velocity_n
        sigma = np.tile([20.0, 20.0, 5.0, 2.0, 2.0, 2.0, 0.5, 0.5, 3.0], (n, 1))
        return Estimate(position, velocity, np.tile(start.q_nb, (n, 1)), sigma)


class Faulty:
    """Returns what it is told to return."""

    def __init__(self, change: dict[str, object]) -> None:
        self.change = change

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Return a solution with the change."""
        return LastFix().navigate(imu, fixes, start)._replace(**self.change)


class Broken:
    """Writes where it may not."""

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Fail."""
        imu.dtheta[:] = 0.0
        raise AssertionError


def test_the_built_in_filter_behind_the_interface_gives_the_same_result() -> None:
    experiment = Experiment(mission=MISSION, seed=3)
    result = experiment.run()
    own = experiment.run(algorithm=Builtin(result.belief))
    np.testing.assert_array_equal(own.errors["position"], result.errors["position"])
    np.testing.assert_allclose(own.errors["attitude"], result.errors["attitude"], atol=1e-9)
    np.testing.assert_allclose(own.sigma["velocity"], result.sigma["velocity"], rtol=1e-12)
    assert experiment.run().solution_arrays is result.solution_arrays


def test_an_algorithm_stands_beside_the_models() -> None:
    rows = compare(Experiment(mission=MISSION), ["phi"], seeds=2, algorithms={"last fix": LastFix()})
    assert [row.model for row in rows] == ["phi", "last fix"]
    assert rows[1].refusal == ""
    assert rows[1].position > 10 * rows[0].position
    assert rows[1].seconds > 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": np.zeros((3, 3))}, r"Faulty: position has shape \(3, 3\)"),
        ({"velocity_n": None}, "velocity_n"),
        ({"sigma": "wide"}, "no array 'sigma'"),
    ],
)
def test_what_is_no_solution_is_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(AlgorithmError, match=words):
        Experiment(mission=MISSION).run(algorithm=Faulty(change))


@pytest.mark.parametrize(("part", "value"), [("position", np.nan), ("sigma", -1.0), ("q_nb", 2.0)])
def test_numbers_that_cannot_be_are_named(part: str, value: float) -> None:
    class Off(LastFix):
        def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
            estimate = super().navigate(imu, fixes, start)
            getattr(estimate, part)[100:] = value
            return estimate

    with pytest.raises(AlgorithmError, match=f"Off: .*{'σ' if part == 'sigma' else part}"):
        Experiment(mission=MISSION).run(algorithm=Off())


def test_a_fault_of_its_own_is_reported_as_its_own_and_harms_nobody() -> None:
    experiment = Experiment(mission=MISSION, seed=9)
    before = experiment.run()
    with pytest.raises(AlgorithmError, match="Broken: failed by itself: ValueError"):
        experiment.run(algorithm=Broken())
    assert experiment.run().solution_arrays is before.solution_arrays
    (row, fault) = compare(experiment, ["phi"], algorithms={"mine": Broken()})
    assert row.refusal == ""
    assert fault.refusal.startswith("Broken: failed by itself")
