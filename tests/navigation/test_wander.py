"""The wander-azimuth navigator: over both poles to millimetres, elsewhere the same as the north-slaved."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from apart import apart
from flown import Flown, fly
from motions import NO_FILTER, NO_FIXES
from polar_flights import FLIGHTS, over_the_pole
from scipy.spatial.transform import Rotation

from lab.analysis.consistency import chi_square_interval
from lab.analysis.errors import position_error
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import start
from lab.motion.frames import ecef
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.filters import wander_models
from lab.navigation.filters.filter import Filter
from lab.navigation.navigator import Fixes, Imu, Schedule, Solution, Start, advance, navigate

WANDER = "wander azimuth"


@functools.cache
def fly_over_the_pole(name: str) -> Flown:
    """Return one of the `FLIGHTS`, at 200 Hz."""
    trajectory = Trajectory.from_recording(over_the_pole(**FLIGHTS[name]), 200)
    ideal = trajectory.increments()
    return Flown(trajectory, trajectory.at(ideal.time), Imu(ideal.time, ideal.dtheta, ideal.dvelocity))


def unaided(flight: Flown) -> Solution:
    """Navigate without fixes, from the true start."""
    begin = Start.off(flight.truth, *np.zeros((3, 3)))
    return navigate(flight.imu, NO_FIXES, begin, NO_FILTER, model=wander_models.PHI)


def in_earth_axes(position: FloatArray, velocity_n: FloatArray, q_nb: FloatArray) -> tuple[FloatArray, ...]:
    """Return velocity (n, 3) and attitude in e, where no pole is special."""
    C_en = ecef.axes(position[:, 0], position[:, 1])
    C_eb = Rotation.from_matrix(C_en) * Rotation.from_quat(q_nb, scalar_first=True)
    return np.einsum("nij,nj->ni", C_en, velocity_n), C_eb.as_matrix()


@pytest.mark.proof
@pytest.mark.parametrize("name", FLIGHTS)
def test_flights_over_the_poles_close(name: str) -> None:
    flight = fly_over_the_pole(name)
    truth = flight.truth
    solution = unaided(flight)
    metres = np.abs(position_error(solution.position, truth)).max()
    velocity, attitude = in_earth_axes(solution.position, solution.velocity_n, solution.q_nb)
    true_velocity, true_attitude = in_earth_axes(truth.position, truth.velocity_n, truth.q_nb)
    faster, turned = np.abs(velocity - true_velocity).max(), np.abs(attitude - true_attitude).max()
    closest = 6.4e6 * (np.pi / 2 - np.abs(truth.latitude).max())
    print(
        f"\n{name}, {truth.time[-1]:.0f} s, {closest:.1f} m from the pole: {1e3 * metres:.3f} mm, "
        f"{1e3 * faster:.3f} mm/s, {np.degrees(turned):.1e}°"
    )
    assert closest < 301
    assert metres <= 5e-3
    assert faster <= 1e-3
    assert turned <= np.radians(1e-6)


def test_it_is_the_north_slaved_navigator_elsewhere() -> None:
    flight = fly("montreal")
    start = Start.off(flight.truth, *np.zeros((3, 3)))
    other = navigate(flight.imu, NO_FIXES, start, NO_FILTER)
    solution = unaided(flight)
    apart = position_error(solution.position, flight.truth) - position_error(other.position, flight.truth)
    turned = (
        Rotation.from_quat(solution.q_nb, scalar_first=True)
        * Rotation.from_quat(other.q_nb, scalar_first=True).inv()
    )
    print(
        f"\nmontreal: wander − north-slaved {1e3 * np.abs(apart).max():.4f} mm, "
        f"{np.abs(solution.velocity_n - other.velocity_n).max():.1e} m/s, {turned.magnitude().max():.1e} rad"
    )
    assert np.abs(position_error(solution.position, flight.truth)).max() <= 5e-3
    assert 0 < np.abs(apart).max() <= 1e-3
    assert np.abs(solution.velocity_n - other.velocity_n).max() <= 1e-5
    assert turned.magnitude().max() <= 1e-8


def test_a_north_slaved_navigator_goes_over_the_pole_in_the_other_frame(tmp_path: Path) -> None:
    """From 88.85° over the limit and back on the other side: filter and smoother are those of that frame."""
    path = tmp_path / "pole.csv"
    write_flight_csv(path, over_the_pole(40.0, duration=270.0, speed=950.0))
    for smoother in (False, True):
        settings = GOOD_SENSORS | {"navigator__smoother": smoother, "trajectory__imu_rate": 50.0}
        one, other = (
            run(str(path), **settings, **more) for more in ({}, {"navigator__mechanization": WANDER})
        )
        a, b = one.solution_arrays, other.solution_arrays
        assert np.abs(a.position[[0, -1], 0]).max() < np.radians(88.9)
        far = ecef.displacement(b.position, a.position) / np.sqrt(b.variance[:, :3])
        sigma = np.sqrt(a.variance / b.variance)
        print(f"\nsmoother {smoother}: {np.abs(far).max():.1e} σ, σ within {np.abs(sigma - 1).max():.1e}")
        assert 0 < np.abs(far).max() < 0.05
        np.testing.assert_allclose(sigma, 1, atol=0.02)


def run(mission: str, seed: int = 1, **settings: object) -> Result:
    """Run an experiment, with settings by path, their dots as double underscores."""
    experiment = Experiment(mission=mission, seed=seed)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    return experiment.run()


@pytest.mark.proof
@pytest.mark.parametrize(("model", "states"), [*((name, 15) for name in wander_models.MODELS), ("psi", 21)])
def test_filters_of_both_mechanizations_agree(model: str, states: int) -> None:
    """On the same realisation: solution, σ, innovations and their covariances, in north, east, down."""
    settings = {
        "navigator__model": model,
        "navigator__states": states,
        "navigator__gate": 0.95,
        "navigator__correction_period": 3.0,
        "sensors__gyro__scale_factor_sigma": 1.0 if states == 21 else 0.0,
        "sensors__accelerometer__scale_factor_sigma": 1.0 if states == 21 else 0.0,
    }
    one, other = run("montreal", **settings), run("montreal", **settings, navigator__mechanization=WANDER)
    a, b = one.solution_arrays, other.solution_arrays
    most = apart(one, other).max()
    print(f"\n{model}, {states} states: wander − north-slaved {most:.1e} σ at most")
    assert 0 < most <= 1e-3
    assert a.fix_rejected.any()
    np.testing.assert_array_equal(a.fix_rejected, b.fix_rejected)
    np.testing.assert_allclose(b.variance, a.variance, rtol=1e-4)
    np.testing.assert_allclose(b.innovation, a.innovation, rtol=0, atol=1e-3)
    np.testing.assert_allclose(b.innovation_covariance, a.innovation_covariance, rtol=0, atol=1e-4)
    size = np.sqrt(np.diagonal(a.fix_covariance, axis1=1, axis2=2))
    difference = (b.fix_covariance - a.fix_covariance) / size[:, :, None] / size[:, None, :]
    assert np.nanmax(np.abs(difference)) <= 1e-4


GOOD_SENSORS = {
    "sensors__gyro__noise_density": 0.001,
    "sensors__gyro__bias_sigma": 0.001,
    "sensors__accelerometer__noise_density": 35.0,
    "sensors__accelerometer__bias_sigma": 0.02,
    "navigator__attitude_sigma": 0.01,
    "navigator__position_sigma": 0.1,
    "navigator__velocity_sigma": 0.01,
}


@pytest.fixture
def polar_csv(tmp_path: Path) -> str:
    """Return the path of a flight in a curve over the north pole."""
    path = tmp_path / "pole.csv"
    write_flight_csv(path, over_the_pole(**FLIGHTS["in a curve over the north pole"]))
    return str(path)


def in_earth(result: Result) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and attitude of a solution in e."""
    solution = result.solution_arrays
    axes = in_earth_axes(solution.position, solution.velocity_n, solution.q_nb)
    return ecef.position(solution.position), *axes


def test_feedforward_equals_feedback_over_the_pole(polar_csv: str) -> None:
    settings = {name: 0.1 * value for name, value in GOOD_SENSORS.items()} | {
        "navigator__mechanization": WANDER
    }
    back, forward = (run(polar_csv, **settings, navigator__correction=c) for c in ("feedback", "feedforward"))
    limits = (5e-3, 3e-4, 1e-6)
    for one, other, limit in zip(in_earth(back), in_earth(forward), limits, strict=True):
        print(f"\nfeedback − feedforward: {np.abs(one - other).max():.1e}", end="")
        assert 0 < np.abs(one - other).max() < limit


def test_pieces_give_the_same_bits_over_the_pole(polar_csv: str) -> None:
    result = run(polar_csv, navigator__mechanization=WANDER)
    experiment, whole = result.experiment, result.solution_arrays
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    fixes = Fixes(result.fixes.time, result.fixes.position, result.fixes.velocity_n)
    begin = start(result.truth_arrays, experiment.navigator, experiment.seed)
    out = Solution.empty(imu.time.size, fixes.time.size)
    state = Filter.begin(begin, result.belief, 0.0, wander_models.PHI)
    for first in range(0, imu.dtheta.shape[0], 1000):
        last = min(first + 1000, imu.dtheta.shape[0])
        part = Imu(imu.time[: last + 1], imu.dtheta[:last], imu.dvelocity[:last])
        advance(state, part, fixes, out, first, Schedule(), wander_models.PHI)
    for name, a, b in zip(Solution._fields, whole, out, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


SEEDS = 100


@pytest.mark.proof
def test_a_filter_over_the_pole_tells_the_truth_about_itself(tmp_path: Path) -> None:
    """NEES and NIS over the seeds; and σ of the heading grows towards the pole, as true north turns."""
    path = tmp_path / "pole.csv"
    write_flight_csv(path, over_the_pole(3.0, 2000.0, duration=120.0))
    nees, nis = [], []
    for seed in range(1, SEEDS + 1):
        result = run(str(path), seed, navigator__mechanization=WANDER, trajectory__imu_rate=100.0)
        late = result.fixes.time > 20
        nees.append(result.consistency.nees.values[late])
        nis.append(result.innovations.nis.values[late])
    for name, values, degrees in (("NEES", nees, 15), ("NIS", nis, 6)):
        low, high = chi_square_interval(degrees, SEEDS)
        mean = np.mean(values, axis=0)
        inside = float(np.mean((low < mean) & (mean < high)))
        print(f"\n{name} {mean.mean():.2f}, inside at {100 * inside:.1f} % of epochs", end="")
        assert inside >= 0.9
    away = 6.4e6 * (np.pi / 2 - result.truth_arrays.latitude)
    at = int(np.argmin(away))
    heading, position = result.sigma["attitude"].values[:, 2], result.sigma["position"].values[at, :2].mean()
    before = heading[at - 300]
    print(
        f"\nσ of the heading: {before:.2f}° at {away[at - 300]:.0f} m, {heading[at]:.1f}° at {away[at]:.1f} m"
    )
    assert heading[at] > 2 * before
    assert heading[at] == pytest.approx(np.hypot(before, np.degrees(position / away[at])), rel=0.1)


def test_the_reference_is_north_slaved_and_says_so(polar_csv: str) -> None:
    with pytest.raises(SettingError, match=r"navigator\.engine: .*accepted with it .*compiled"):
        run("los_angeles", navigator__engine="filterpy", navigator__mechanization=WANDER)
    with pytest.raises(SettingError, match=r"navigator\.engine: .* ends 1° from a pole; .* t = .*compiled"):
        run(polar_csv, navigator__engine="filterpy")
