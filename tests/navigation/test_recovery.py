"""What a filter does that its fixes contradict: it recovers; and how it weighs fixes that stand out."""

from __future__ import annotations

import numpy as np
import pytest

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.navigation.belief import schedule_filter
from lab.navigation.filters import kalman
from lab.navigation.filters.kalman import HUBER, HUBER_NIS, RECOVERED, REJECTED, STUDENT_T, USED, gate, weight
from lab.navigation.filters.schedule import Schedule
from lab.navigation.kernels.generation import interpret_kernel
from lab.navigation.settings import NavigatorSettings


def run(seed: int = 1, **settings: object) -> Result:
    experiment = Experiment(mission="montreal", seed=seed)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    return experiment.run()


ASTRAY = {
    "far off": {"navigator__position_error": (300.0, -200.0, 50.0), "navigator__p0": [0.1] * 6 + [1e-4] * 9},
    "accelerometers far noisier than assumed": {
        "sensors__accelerometer__noise_density": 10000.0,
        "navigator__q": [1e-7] * 3 + [1e-5] * 3 + [1e-10] * 6,
    },
}


@pytest.mark.parametrize("model", ["phi", "invariant", "nonlinear"])
@pytest.mark.parametrize("settings", ASTRAY.values(), ids=ASTRAY)
def test_a_filter_that_is_wrong_comes_back(settings: dict[str, object], model: str) -> None:
    result = run(**settings, navigator__gate=0.999, navigator__model=model)
    recovered = int(result.solution_arrays.fix_recovered.sum())
    late = np.linalg.norm(result.errors.position.values[10000:], axis=1)
    print(f"\nrecovered {recovered} times, last errors up to {late.max():.1f} m")
    assert recovered > 0
    assert late.max() < 30
    assert any("recovered" in remark for remark in result.remarks)


@pytest.mark.parametrize("probability", [0.99, 0.999, 0.9999])
def test_a_matched_filter_recovers_from_nothing(probability: float) -> None:
    recovered = [
        run(seed, navigator__gate=probability).solution_arrays.fix_recovered.sum() for seed in range(1, 11)
    ]
    assert sum(recovered) == 0


def test_scattered_outliers_do_not_accuse_the_filter() -> None:
    for seed in range(1, 6):
        settings = {"sensors__gps__outlier_rate": 0.1, "sensors__gps__outlier_size": 50.0}
        result = run(seed, navigator__gate=0.999, **settings)
        assert result.solution_arrays.fix_recovered.sum() <= 1
        assert np.abs(result.errors.position.values[4000:]).max() < 10


@pytest.mark.parametrize("robust", ["huber", "student-t"])
def test_a_robust_update_withstands_outliers(robust: str) -> None:
    settings = {"sensors__gps__outlier_rate": 0.1, "sensors__gps__outlier_size": 50.0}
    plain, weighed = (
        np.mean(
            [
                np.sqrt(
                    np.mean(run(seed, navigator__robust=kind, **settings).errors.position.values[4000:] ** 2)
                )
                for seed in range(1, 6)
            ]
        )
        for kind in ("none", robust)
    )
    print(f"\nrms position with 10 % outliers: {plain:.2f} m, {robust} {weighed:.2f} m")
    assert weighed < 0.5 * plain


def test_weights_are_those_of_their_densities() -> None:
    """Huber's ψ(d) = w d is d, then constant; Student's is (ν + n) d / (ν + d²)."""
    d = np.linspace(0.1, 30, 50)
    huber = np.array([weight(HUBER, x**2) * x for x in d])
    np.testing.assert_allclose(huber, np.minimum(d, np.sqrt(HUBER_NIS)), rtol=1e-12)
    student = np.array([weight(STUDENT_T, x**2) for x in d])
    np.testing.assert_allclose(student, np.minimum(1, 10 / (4 + d**2)), rtol=1e-12)
    assert weight(0, 1e9) == 1
    assert gate(0.95) == pytest.approx(HUBER_NIS, abs=0.05)


def test_rows_of_rejections_that_chance_explains_accuse_nobody() -> None:
    """Of good fixes a gate of 50 % rejects every second one: twenty in a row once in a million."""
    lengths = {p: schedule_filter(NavigatorSettings(gate=p), 0.005, 1000).agreeing for p in (0.5, 0.9, 0.999)}
    assert all((1 - p) ** n <= 1e-6 for p, n in lengths.items())
    assert lengths == {0.5: 20, 0.9: 6, 0.999: 4}


@pytest.mark.parametrize("least", [5e-324, 1e-300, 1e-12])
def test_a_gate_that_rejects_every_fix_leaves_all_rejections_to_chance(least: float) -> None:
    free = Experiment(mission="los_angeles")
    free.set("trajectory.imu_rate", 50.0)
    closed = free.copy()
    free.set("sensors.gps.outages", [[0, 1e6]])
    closed.set("navigator.gate", least)
    found = closed.run().solution_arrays
    assert (found.fix_sample < 0).all()
    np.testing.assert_array_equal(found.position, free.run().solution_arrays.position)


@pytest.mark.parametrize(("angle", "accused"), [(59.0, 4), (61.0, 10)])
def test_fixes_that_agree_accuse_the_filter_sooner(angle: float, accused: int) -> None:
    """Innovations that turn by less than 60° from one to the next, in the metric of S, agree."""
    is_outlier = interpret_kernel(kalman.is_outlier)
    A = np.random.default_rng(1).normal(size=(6, 6))
    streak = np.append([0.0, 3.0], 5 * A[:, 0])  # a streak that has ended is of no account
    for number in range(1, accused + 1):
        turn, size = np.radians(angle) * (number - 1), 5.0 + number % 3
        nu = size * A @ np.append([np.cos(turn), np.sin(turn)], np.zeros(4))
        assert is_outlier(streak, nu, A @ A.T, size**2, 4, 10) == (number == accused)


@pytest.mark.parametrize(
    ("speed", "elapsed", "tilt"),
    [(3.0, 2.0, np.sqrt(3) / 19.6), (3.0, 0.1, np.sqrt(3) / 9.8), (300.0, 2.0, 0.5)],
    ids=["a speed over its time", "at least a second", "at most 30°"],
)
def test_a_recovery_adds_the_error_that_the_innovation_shows(
    speed: float, elapsed: float, tilt: float
) -> None:
    """Per axis: a position 9 m off, a speed, and the tilt under which gravity gives such a speed."""
    P = np.random.default_rng(1).normal(size=(15, 24))
    expected = P[:, :15].copy()
    expected[np.diag_indices(9)] += np.repeat([27.0, speed**2 / 3, tilt**2], 3)
    expected[range(9, 15), range(9, 15)] *= 4
    nu = np.append([3.0, -6.0, 6.0], speed / 3 * np.array([2.0, 1.0, -2.0]))
    interpret_kernel(kalman.inflate)(P, nu, elapsed, 15)
    np.testing.assert_allclose(P[:, :15], expected, rtol=1e-12)


def test_a_plausible_fix_and_a_recovery_end_a_streak() -> None:
    schedule = Schedule(gate=20.0, implausible=25.0, agreeing=3, any_of=4)
    gate_fix = interpret_kernel(kalman.gate_fix)
    P, streak, clock = np.eye(15), np.zeros(8), np.zeros(3)
    nu = np.array([0.0, 0.0, 0.0, np.sqrt(30), 0.0, 0.0])
    squares = [30.0, 30.0, 25.0, 30.0, 30.0, 20.0, 30.0, 30.0, 30.0, 30.0, 30.0]
    found = [
        gate_fix(P, streak, clock, nu, np.eye(6), nis, float(time), schedule, 15)
        for time, nis in enumerate(squares, start=1)
    ]
    assert found == [REJECTED] * 5 + [USED] + [REJECTED] * 2 + [RECOVERED] + [REJECTED] * 2
    # The last plausible fix was three seconds before the recovery.
    assert P[6, 6] == pytest.approx(1 + 10 / (3 * 9.8) ** 2)
    assert clock[2] == 9
