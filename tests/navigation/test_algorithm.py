"""Algorithms of a user's own: run and compared like the built-in ones, their faults reported as their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lab import Estimate, Experiment, compare, run_ensemble
from lab.analysis.errors import attitude_error, position_error
from lab.base.parameters.setting_error import SettingError
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


class Informed(Builtin):
    """The lab's own filter with all it knows at the fixes, its covariances multiplied by factors."""

    def __init__(self, belief: Belief, covariance: float = 1.0, innovation: float = 1.0) -> None:
        super().__init__(belief)
        self.factors = covariance, innovation

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Navigate with the model phi."""
        found = navigate(imu, fixes, start, self.belief)
        return Estimate(
            *super().navigate(imu, fixes, start)[:4],
            covariance=self.factors[0] * found.fix_covariance[:, :9, :9],
            innovation=found.innovation,
            innovation_covariance=self.factors[1] * found.innovation_covariance,
        )


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
        ({"sigma": "wide"}, "no numeric array 'sigma'"),
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
    with pytest.raises(
        AlgorithmError,
        match=r"Broken: raised an exception: test_algorithm\.py, line \d+, in navigate: ValueError",
    ):
        experiment.run(algorithm=Broken())
    assert experiment.run().solution_arrays is before.solution_arrays
    (row, fault) = compare(experiment, ["phi"], algorithms={"mine": Broken()})
    assert row.refusal == ""
    assert fault.refusal.startswith("Broken: raised an exception")


def test_nees_of_nine_states_and_nis_come_of_the_covariances_it_gives() -> None:
    experiment = Experiment(mission=MISSION, seed=3)
    result = experiment.run()
    own = experiment.run(algorithm=Informed(result.belief))
    np.testing.assert_array_equal(own.innovations["nis"], result.innovations["nis"])
    np.testing.assert_allclose(own.autocorrelation["position"], result.autocorrelation["position"])
    solution, truth = result.solution_arrays, result.truth_arrays
    at = solution.fix_sample
    error = np.concatenate(
        (
            position_error(solution.position, truth)[at],
            (solution.velocity_n - truth.velocity_n)[at],
            attitude_error(solution.q_nb[at], truth.q_nb[at]),
        ),
        axis=1,
    )
    P = solution.fix_covariance[:, :9, :9]
    nees = np.einsum("mi,mij,mj->m", error, np.linalg.inv(P), error)
    np.testing.assert_allclose(own.consistency["nees"], nees, rtol=1e-6)
    assert own.consistency["nees"].attrs["degrees"] == 9
    assert own.verdict.consistent
    assert own.verdict.headline == "Consistent: errors and innovations are as large as the algorithm states."


@pytest.mark.parametrize(
    ("factors", "quantity", "direction"),
    [
        ((0.1, 1.0), "covariance", "too small"),
        ((10.0, 1.0), "covariance", "too large"),
        ((1.0, 0.1), "innovation covariance", "too small"),
        ((1.0, 10.0), "innovation covariance", "too large"),
    ],
)
def test_an_algorithm_that_lies_of_itself_is_told_so_by_its_own_numbers(
    factors: tuple[float, float], quantity: str, direction: str
) -> None:
    experiment = Experiment(mission=MISSION, seed=3)
    belief = experiment.run().belief
    verdict = run_ensemble(experiment, 3, algorithm=Informed(belief, *factors)).verdict
    (finding,) = verdict.findings
    assert (finding.quantity, finding.direction) == (quantity, direction)
    assert finding.factor == pytest.approx(10, rel=0.5)
    assert "navigator." not in f"{verdict.headline} {finding.advice}"


@pytest.mark.parametrize(("scale", "words"), [(1e-3, "corrects too little"), (1e3, "corrects too much")])
def test_a_gain_that_is_wrong_shows_in_the_innovations(scale: float, words: str) -> None:
    experiment = Experiment(mission=MISSION, seed=3)
    belief = experiment.run().belief
    algorithm = Informed(belief._replace(noise=scale * belief.noise))
    verdict = run_ensemble(experiment, 3, algorithm=algorithm).verdict
    assert any(words in finding.sentence for finding in verdict.findings)


def test_an_algorithm_corrects_its_own_navigator() -> None:
    """A period of corrections, or feedforward, is none of its settings."""
    experiment = Experiment(mission=MISSION, seed=3)
    algorithm = Informed(experiment.run().belief, 0.1)
    plain = run_ensemble(experiment, 2, algorithm=algorithm)
    for changes in ({"navigator.correction_period": 30.0}, {"navigator.correction": "feedforward"}):
        changed = experiment.copy().update(changes)
        many, one = run_ensemble(changed, 2, algorithm=algorithm), changed.run(algorithm=algorithm)
        assert many.verdict.headline == plain.verdict.headline
        assert many.remark == ""
        assert one.verdict.headline == plain.verdicts[0].headline
        assert not any("linear" in remark for remark in one.remarks)


def test_the_settings_of_the_navigator_say_nothing_of_an_algorithm() -> None:
    """What is wrong with the filter of the settings must not be held against one that does not use them."""
    experiment = Experiment(mission=MISSION, seed=3)
    belief = experiment.run().belief
    experiment.navigator.r_scale = experiment.navigator.p0_scale = experiment.navigator.q_scale = 100.0
    assert experiment.run().verdict.consistent is False
    assert experiment.run(algorithm=Informed(belief)).verdict.consistent is True


def test_what_an_algorithm_does_not_give_is_not_known() -> None:
    result = Experiment(mission=MISSION).run(algorithm=LastFix())
    assert result.verdict.consistent is None
    assert result.verdict.headline.startswith("Unknown")
    assert np.isnan(result.consistency["nees"]).all()
    assert result.consistency["nees"].attrs["degrees"] == 0
    assert np.isnan(result.innovations["nis"]).all()
    assert result.whiteness[["mean", "variance", "p white"]].isna().all().all()
    assert result.coverage["within ±3σ [%]"].notna().all()
    for part in ("gyro_bias", "accelerometer_bias_sigma"):
        assert np.isnan(result.sensor_errors[part]).all()
    for analysis in ("budget", "observability"):
        with pytest.raises(SettingError, match="LastFix: this analysis needs the gains"):
            getattr(result, analysis)
    ensemble = run_ensemble(Experiment(mission=MISSION), 2, algorithm=LastFix())
    assert ensemble.verdict.consistent is None
    assert np.isnan(ensemble.inside()).all()
    assert ensemble.coverage["within ±3σ [%]"].notna().all()


def test_of_errors_alone_only_the_errors_are_judged() -> None:
    class Quiet(Informed):
        def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
            return super().navigate(imu, fixes, start)._replace(innovation=None, innovation_covariance=None)

    experiment = Experiment(mission=MISSION, seed=3)
    verdict = experiment.run(algorithm=Quiet(experiment.run().belief)).verdict
    assert verdict.headline == "Consistent: errors are as large as the algorithm states."
    assert verdict.basis == "1 run, errors only"


def test_fixes_an_algorithm_did_not_use_count_for_nothing() -> None:
    class Choosy(Informed):
        def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
            estimate = super().navigate(imu, fixes, start)
            for array in (estimate.covariance, estimate.innovation, estimate.innovation_covariance):
                array[::2] = np.nan
            return estimate

    experiment = Experiment(mission=MISSION, seed=3)
    result = experiment.run()
    own = experiment.run(algorithm=Choosy(result.belief))
    assert np.isnan(own.innovations["nis"][::2]).all()
    np.testing.assert_array_equal(own.innovations["nis"][1::2], result.innovations["nis"][1::2])
    assert own.verdict.consistent


@pytest.mark.parametrize(
    ("part", "change", "words"),
    [
        ("covariance", lambda P: P[:-1], r"covariance has shape \(\d+, 9, 9\), expected"),
        ("covariance", lambda P: -P, "covariance at fix 0 is not a covariance"),
        ("covariance", lambda P: P + np.eye(9, k=1), "covariance at fix 0 is not a covariance"),
        (
            "innovation_covariance",
            lambda S: 0 * S + 1.0,
            "innovation_covariance at fix 0 is not a covariance",
        ),
        ("innovation_covariance", lambda S: None, ".*belong together"),
        (
            "innovation",
            lambda nu: np.where(np.arange(6) < 3, nu, np.nan),
            "innovation is not finite at fix 0",
        ),
    ],
)
def test_covariances_that_are_none_are_named(part: str, change: Callable[[Any], Any], words: str) -> None:
    class Odd(Informed):
        def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
            estimate = super().navigate(imu, fixes, start)
            return estimate._replace(**{part: change(getattr(estimate, part))})

    experiment = Experiment(mission=MISSION, seed=3)
    with pytest.raises(AlgorithmError, match=f"Odd: {words}"):
        experiment.run(algorithm=Odd(experiment.run().belief))


def test_a_flight_without_fixes_is_navigated_too() -> None:
    experiment = Experiment(mission=MISSION)
    belief = experiment.run().belief
    experiment.sensors.gps.outages = [(0, 1e4)]
    result = experiment.run(algorithm=Informed(belief))
    assert result.verdict.consistent is None
