"""Fix update: the numbers of one update are those of the filter, and those of the textbook."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lab.analysis.fix_update import RECOVERED, REJECTED, USED, directions, fix_update
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.navigation.filters.kalman import inflate
from lab.run.run import ResultError
from tests.simulated_logs import log_of


def made(**navigator: object) -> Experiment:
    experiment = Experiment(mission="los_angeles")
    return experiment.update({"trajectory": {"imu_rate": 20}, "navigator": navigator})


@pytest.fixture(scope="module")
def result() -> Result:
    return made().run()


def without(result: Result, fix: int) -> Result:
    """Return the run whose receiver has an outage at one fix."""
    time = float(result.fixes.time[fix])
    return (
        result.experiment.copy().update({"sensors": {"gps": {"outages": [(time - 0.1, time + 0.1)]}}}).run()
    )


@pytest.mark.parametrize("fix", [0, 30, 90])
def test_p_before_and_the_correction_are_those_of_a_run_without_the_fix(result: Result, fix: int) -> None:
    update = fix_update(result, fix)
    at = result.solution_arrays.fix_sample[fix]
    here, there = result.solution_arrays, without(result, fix).solution_arrays
    np.testing.assert_allclose(np.diagonal(update.before), there.variance[at], rtol=1e-12)
    np.testing.assert_allclose(update.before[6:9, 6:9][np.triu_indices(3, 1)], there.covariance[at, 1])
    for name, states in (("velocity_n", slice(3, 6)), ("bias", slice(9, 15))):
        moved = getattr(there, name)[at] - getattr(here, name)[at]
        sigma = np.sqrt(np.diagonal(update.before)[states])
        np.testing.assert_allclose(update.correction[states] / sigma, moved / sigma, atol=1e-12)


@pytest.mark.parametrize("fix", [0, 30, 90])
def test_gain_s_and_p_after_are_those_of_the_textbook(result: Result, fix: int) -> None:
    update, solution = fix_update(result, fix), result.solution_arrays
    P, H, R = update.before, update.H, update.R
    S = H @ P @ H.T + R
    np.testing.assert_allclose(S, solution.innovation_covariance[fix], rtol=1e-12, atol=1e-14)
    K = P @ H.T @ np.linalg.inv(S)
    if update.held:  # Schmidt: heading and vertical gyro bias keep their estimates
        kept = np.zeros((2, 15))
        kept[0, 8], kept[1, 9:12] = 1.0, solution.fix_held[fix]
        K -= kept.T @ kept @ K
    scale = np.sqrt(np.diagonal(P))
    np.testing.assert_allclose(update.gain / scale[:, None], K / scale[:, None], atol=1e-12)
    rest = np.eye(15) - K @ H
    after = rest @ P @ rest.T + K @ R @ K.T
    off = (solution.fix_covariance[fix] - after) / np.outer(scale, scale)
    assert np.abs(off).max() < 1e-12
    y = solution.innovation[fix]
    assert update.nis == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-12)
    assert update.nis == pytest.approx(float(result.innovations.nis[fix]), rel=1e-12)


@pytest.mark.parametrize("model", ["psi", "invariant", "nonlinear"])
def test_other_models_give_the_s_of_their_run(model: str) -> None:
    """The nonlinear filter leaves out of H how its velocity turns with a position error.

    At 60 m/s and one metre off on the Earth, that is 10⁻⁵ m/s, or 2 · 10⁻⁵ σ.
    """
    run = made(model=model).run()
    update = fix_update(run, 30)
    sigma = np.sqrt(np.diagonal(update.S))
    off = update.H @ update.before @ update.H.T + update.R - run.solution_arrays.innovation_covariance[30]
    assert np.abs(off / np.outer(sigma, sigma)).max() < (2e-5 if model == "nonlinear" else 1e-11)
    without_it = without(run, 30).solution_arrays
    at = run.solution_arrays.fix_sample[30]
    np.testing.assert_allclose(np.diagonal(update.before), without_it.variance[at], rtol=1e-8)


def test_the_dataset_keeps_the_equations_in_its_units(result: Result) -> None:
    time = float(result.fixes.time[30])
    found = result.update_at(time + 0.4)
    assert found.attrs["time"] == time
    assert found.attrs["outcome"] == USED
    H, P, S = found.H.values, found.before.values, found.S.values
    np.testing.assert_allclose(H @ P @ H.T + found.R.values, S, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.gain.values @ found.innovation.values, found.correction.values)
    at = result.solution_arrays.fix_sample[30]
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.after)), result.state_sigma.sigma.values[at])


def test_a_rejected_fix_updates_nothing() -> None:
    run = made(gate=0.5).run()
    fix = int(np.flatnonzero(run.solution_arrays.fix_rejected)[0])
    update = fix_update(run, fix)
    assert update.outcome == REJECTED
    assert not update.gain.any()
    assert not update.correction.any()
    np.testing.assert_array_equal(update.before, update.after)
    at = int(np.searchsorted(run.time, run.fixes.time[fix] - 1e-9))
    np.testing.assert_allclose(np.diagonal(update.after), run.solution_arrays.variance[at], rtol=1e-12)


def test_the_gain_of_a_recovery_is_that_of_the_raised_p() -> None:
    wrong = {"position_error": [300.0, -200.0, 50.0], "p0": [0.1] * 6 + [1e-4] * 9}
    run = made(gate=0.999, **wrong).run()
    fix = int(np.flatnonzero(run.solution_arrays.fix_recovered)[0])
    assert run.solution_arrays.fix_rejected[:fix].all()
    update = fix_update(run, fix)
    assert update.outcome == RECOVERED
    P, H = update.before.copy(), update.H
    inflate(P, update.innovation, float(run.fixes.time[fix] - run.time[0]), 15)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + update.R)
    np.testing.assert_allclose(update.gain, K, atol=1e-10)


def test_a_log_gives_the_update_of_its_filter(result: Result, tmp_path: Path) -> None:
    run = log_of(result, tmp_path / "log").run()
    update = fix_update(run, 30)
    S = update.H @ update.before @ update.H.T + update.R
    np.testing.assert_allclose(S, run.solution_arrays.innovation_covariance[30], rtol=1e-8, atol=1e-10)
    after = (np.eye(15) - update.gain @ update.H) @ update.before
    scale = np.sqrt(np.diagonal(update.before))
    assert np.abs((after - update.after) / np.outer(scale, scale)).max() < 1e-8
    assert update.nis == pytest.approx(float(run.innovations.nis[30]))


def test_what_is_hidden_has_no_update() -> None:
    run = FaultyExperiment(FAULTS["latency"]).update({"mission": "los_angeles"}).run()
    with pytest.raises(ResultError, match="hidden"):
        run.update_at(30.0)


def test_before_the_first_fix_there_is_no_update(result: Result) -> None:
    with pytest.raises(ResultError, match="the first one is at"):
        result.update_at(-1.0)


def test_directions_are_those_of_the_eigenvalues_relative_to_the_start() -> None:
    start = np.diag([4.0, 1.0, 0.0, 9.0])
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    now = np.zeros((4, 4))
    sigma = np.array([2.0, 1.0])
    now[:2, :2] = np.outer(sigma, sigma) * (turn @ np.diag([1.0, 0.01]) @ turn.T)
    now[3, 3] = 9.0 * 0.25
    ratio, along = directions(now, start)
    np.testing.assert_allclose(ratio, [1.0, 0.5, 0.1])
    np.testing.assert_allclose(np.abs(along[0]), [np.cos(0.3), np.sin(0.3), 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.abs(along[1]), [0, 0, 0, 1], atol=1e-12)
