"""Straight flights: the heading is not observable, and the filter must know it.

Without information, heading and vertical gyro bias obey φ(t) = φ₀ + b t + N w(t) in closed form, with the
initial error φ₀, the bias b and the angular random walk N w.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from lab.analysis.observability import observability
from lab.base.arrays import FloatArray
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.motion.frames import earth
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording
from lab.navigation.filters import heading_observability
from tests.benchmarks.card_matrix import errors_at

RATE = 50.0
MODELS = ("phi", "psi", "invariant", "nonlinear")
ATTITUDE, BIAS, NOISE = 2.0, 0.1, 0.05
"""Default σ of heading [°] and gyro bias [°/s], and default noise density [°/s/√Hz]."""


def straight(kind: str, duration: float, turn_at: float | None = None) -> Recording:
    """Return a vehicle on one course: a cruise at 60 m/s, a road at 15 m/s, or a ship that heaves and rolls.

    With `turn_at`, it turns by 180° from then on, in 60 s.
    """
    step = 0.25
    t = np.arange(0.0, duration + step / 2, step)
    turn = np.zeros_like(t) if turn_at is None else np.radians(3.0) * np.clip(t - turn_at, 0.0, 60.0)
    course, speed = 0.6 + turn, {"cruise": 60.0, "road": 15.0, "ship": 5.0}[kind]
    velocity = np.stack((speed * np.cos(course), speed * np.sin(course), np.zeros_like(t)), axis=-1)
    euler = np.stack((np.zeros_like(t), np.full_like(t, 0.02), course), axis=-1)
    if kind == "ship":
        velocity[:, 2] = 0.5 * np.sin(2 * np.pi * t / 8)
        euler[:, 0], euler[:, 1] = 0.1 * np.sin(2 * np.pi * t / 11), 0.035 * np.sin(2 * np.pi * t / 7 + 1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * step, axis=0)))
    latitude = np.full_like(t, 0.78)
    for _ in range(3):  # the radius of the meridian where the vehicle is
        meridian, transverse = earth.radii(np.sin(latitude))
        latitude = 0.78 + _integral(velocity[:, 0] / (meridian + 500.0), step)
    longitude = 0.1 + _integral(velocity[:, 1] / ((transverse + 500.0) * np.cos(latitude)), step)
    return Recording(t, latitude, longitude, 500.0 - way[:, 2], velocity, euler)


def _integral(rate: FloatArray, step: float) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * step)))


def mission(folder: Path, *flight: object) -> str:
    """Return the path of a flight csv."""
    path = folder / "straight.csv"
    write_flight_csv(path, straight(*flight))  # type: ignore[arg-type]
    return str(path)


def run(path: str, seed: int, rate: float = RATE, **navigator: object) -> Result:
    """Return a run with settings of the navigator."""
    experiment = Experiment(mission=path, seed=seed)
    experiment.trajectory.imu_rate = rate
    for name, value in navigator.items():
        experiment.set(f"navigator.{name}", value)
    return experiment.run()


def heading(result: Result, time: float) -> tuple[float, float]:
    """Return the error of the heading at a time [s] and its σ [°]."""
    k = int(np.searchsorted(result.time, time))
    return (
        float(result.errors.attitude[k].sel(angle="heading")),
        float(result.sigma.attitude[k].sel(angle="heading")),
    )


def undisturbed(time: float) -> float:
    """Return σ of the heading [°] after a time [s] without information."""
    return float(np.sqrt(ATTITUDE**2 + (BIAS * time) ** 2 + NOISE**2 * time))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("kind", ["cruise", "road", "ship"])
def test_the_heading_drifts_as_without_fixes(tmp_path: Path, kind: str, model: str) -> None:
    result = run(mission(tmp_path, kind, 300.0), 1001, model=model)
    found = [heading(result, time)[1] for time in (60.0, 150.0, 299.0)]
    expected = [undisturbed(time) for time in (60.0, 150.0, 299.0)]
    print(f"\n{kind}, {model}: σ {np.round(found, 2)}°, without information {np.round(expected, 2)}°")
    # The Earth's rate and the manoeuvre of the start show a little; noise would have shown two thirds.
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize(
    ("model", "engine"), [*((model, "compiled") for model in MODELS), ("phi", "filterpy")]
)
def test_the_heading_is_held_only_if_it_shall_be(tmp_path: Path, model: str, engine: str) -> None:
    path = mission(tmp_path, "cruise", 30.0)
    held = [run(path, 1, model=model, engine=engine, hold_heading=hold) for hold in (True, False)]
    assert [bool(one.solution_arrays.fix_held.any()) for one in held] == [True, False]


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("cruise", {}),
        ("cruise", {"smoother": True}),
        *(
            pytest.param(kind, {"model": "nonlinear"}, marks=pytest.mark.proof)
            for kind in ("ship", "cruise", "road")
        ),
        *(pytest.param(kind, {"smoother": True}, marks=pytest.mark.proof) for kind in ("road", "ship")),
        pytest.param("cruise", {"smoother": True, "model": "invariant"}, marks=pytest.mark.proof),
    ],
)
def test_errors_of_the_heading_have_the_size_of_sigma(
    tmp_path: Path, kind: str, settings: dict[str, object]
) -> None:
    path = mission(tmp_path, kind, 900.0)
    runs = [run(path, seed, rate=10.0, **settings) for seed in range(1001, 1041)]
    for time in (300.0, 600.0, 895.0):
        errors = np.array([heading(one, time) for one in runs])
        ratio = float(np.sqrt(np.mean((errors[:, 0] / errors[:, 1]) ** 2)))
        print(f"\n{kind}, {settings}: error over σ after {time:g} s, 40 seeds: {ratio:.2f}")
        assert 0.8 <= ratio <= 1.2  # by chance: 1 ± 0.11


@pytest.mark.proof
def test_a_smoothed_cruise_knows_its_other_errors(tmp_path: Path) -> None:
    """The Earth's rate turns a navigator whose heading is radians off as level gyro biases do.

    The tilt is that of the vertical: the rotation vector of a tilt with a heading error ψ is turned by ψ/2.
    """
    path, level, n = mission(tmp_path, "cruise", 900.0), [9, 10], 40
    others = [state for state in range(15) if state not in (8, 11)]
    squares = []
    for seed in range(1001, 1001 + n):
        one = run(path, seed, rate=10.0, smoother=True)
        at = one.solution_arrays.fix_sample[[200, 600, 850]]
        x, P = errors_at(one, at), one.solution_arrays.fix_covariance[[200, 600, 850]]
        vertical = Rotation.from_rotvec(-x[:, 6:9]).as_matrix()[:, :, 2]
        x[:, 6], x[:, 7] = vertical[:, 1], -vertical[:, 0]
        squares.append(
            [
                [
                    float(e[part] @ np.linalg.solve(C[np.ix_(part, part)], e[part]))
                    for e, C in zip(x, P, strict=True)
                ]
                for part in (level, others)
            ]
        )
    found = np.mean(squares, axis=0) / [[len(level)], [len(others)]]
    print(f"\nNEES/n after 200, 600, 850 s: level gyro biases {found[0]}, all but the heading {found[1]}")
    assert found[0, 0] < chi2.ppf(0.99, 2 * n) / (2 * n)  # 1.8 without the Earth's rate
    assert found[1].max() < chi2.ppf(0.999, 13 * n) / (13 * n)


def test_a_smoother_knows_the_heading_of_a_straight_flight_from_the_turn_after_it(tmp_path: Path) -> None:
    path = mission(tmp_path, "cruise", 360.0, 240.0)
    errors = np.array([heading(run(path, seed, smoother=True), 200.0) for seed in range(1001, 1021)])
    print(f"\nbefore a turn: σ {errors[:, 1].mean():.2f}°, errors {np.round(errors[:, 0], 2)}")
    assert errors[:, 1].max() < 1.0 < undisturbed(200.0) / 10
    assert 0.5 < np.mean((errors[:, 0] / errors[:, 1]) ** 2) < 1.9  # χ² with 20 degrees of freedom: 99 %


def test_a_turn_after_a_straight_flight_shows_the_heading(tmp_path: Path) -> None:
    """What the filter knows of correlations is kept: nothing is lost when the vehicle turns."""
    path = mission(tmp_path, "cruise", 360.0, 240.0)
    errors = np.array([heading(run(path, seed), 300.0) for seed in range(1001, 1011)])
    print(f"\nafter a turn: σ {errors[:, 1].mean():.2f}°, errors {np.round(errors[:, 0], 2)}")
    assert undisturbed(240.0) > 24
    assert errors[:, 1].max() < 1.0
    assert np.mean((errors[:, 0] / errors[:, 1]) ** 2) < 2.1  # χ² with 10 degrees of freedom: 99 % below 2.3


def test_no_manoeuvre_is_credited_with_heading_and_vertical_gyro_bias(tmp_path: Path) -> None:
    result = run(mission(tmp_path, "cruise", 300.0), 1001)
    share = observability(result).share.sel(quantity=["heading", "gyro bias z"])
    assert (share == 0).all()


def test_a_remark_says_how_long_the_vehicle_goes_straight(tmp_path: Path) -> None:
    result = run(mission(tmp_path, "cruise", 300.0), 1001)
    said = [remark for remark in result.remarks if "straight" in remark]
    assert len(said) == 1
    assert "heading and vertical gyro bias are not observable" in said[0]
    assert not [remark for remark in run("montreal", 1001).remarks if "straight" in remark]


def test_what_is_put_back_makes_p_that_of_josephs_form() -> None:
    """Of a linear update with the gain K − Dᵀ D K, for random P, H and verticals."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        root = rng.normal(size=(15, 15))
        P, H, R = root @ root.T, rng.normal(size=(6, 15)), np.diag(rng.uniform(0.5, 2.0, 6))
        own, down = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        D, kept = np.empty((2, 15)), np.empty((2, 2))
        heading_observability.write_directions(tuple(own), tuple(down), P, D)
        heading_observability.take_covariance(P, D, kept)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        found = np.ascontiguousarray(P - K @ H @ P)
        heading_observability.put_back_covariance(found, D, kept)
        K -= D.T @ D @ K
        left = np.eye(15) - K @ H
        np.testing.assert_allclose(found, left @ P @ left.T + K @ R @ K.T, atol=1e-10)


def test_a_turn_shows_the_heading_and_level_flight_does_not() -> None:
    """By hand: beside velocities with σ of 0.1 m/s, a response of more than 0.25 m/s per radian counts."""
    D = np.empty((2, 15))
    heading_observability.write_directions((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), np.eye(15), D)
    H = np.eye(6, 15)
    for response, shown in ((0.1, False), (0.24, False), (0.26, True), (50.0, True)):
        P = np.diag(np.full(15, 0.01))
        P[3, 8] = P[8, 3] = response * P[8, 8]
        P[3, 3] += response**2 * P[8, 8]
        assert heading_observability.shows_heading(P, H, np.eye(6), 6, (0.0, 0.0, 1.0), D) is shown
