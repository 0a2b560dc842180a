"""The alignment before a flight: closed forms of levelling and gyro-compassing, and errors against its P."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from lab import Experiment, earth
from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY, si
from lab.motion.frames.rotation import quaternion_from_euler
from lab.navigation.alignment.rest_alignment import Means, align, align_simulated, usual_covariance
from lab.navigation.belief import belief
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS
from lab.navigation.solution import Start
from lab.sensors import imu
from lab.sensors.cards import card

LATITUDE, HEIGHT = np.radians(50.0), 300.0
OMEGA_IE = earth.RATE * np.array([np.cos(LATITUDE), 0.0, -np.sin(LATITUDE)])
G = float(earth.gravity(np.sin(LATITUDE), HEIGHT))
DEGREE_AN_HOUR = np.radians(1 / 3600)


def at(*euler: float) -> Start:
    """Return a place with an attitude by roll, pitch, heading [°]."""
    return Start(
        np.array([LATITUDE, 0.2, HEIGHT]), np.zeros(3), quaternion_from_euler(np.radians(np.array(euler)))
    )


def into_body(start: Start) -> FloatArray:
    return Rotation.from_quat(start.q_nb, scalar_first=True).as_matrix().T


def error(start: Start, true: Start) -> FloatArray:
    """Return φ (3,) of Ĉ_nb = exp(−[φ×]) C_nb."""
    found, right = (Rotation.from_quat(one.q_nb, scalar_first=True) for one in (start, true))
    return -(found * right.inv()).as_rotvec()


def off(true: Start, phi: FloatArray) -> Start:
    q_nb = Rotation.from_rotvec(-phi) * Rotation.from_quat(true.q_nb, scalar_first=True)
    return true._replace(q_nb=q_nb.as_quat(scalar_first=True))


def prior(attitude: float, gyro_bias: float, accelerometer_bias: float) -> FloatArray:
    """Return the covariance of errors with these σ [rad], [rad/s], [m/s²]; nothing else errs."""
    sigma = np.zeros(21)
    sigma[ATT], sigma[GYRO_BIAS], sigma[ACCEL_BIAS] = attitude, gyro_bias, accelerometer_bias
    return np.diag(sigma**2)


def means(true: Start, gyro_bias: FloatArray, accelerometer_bias: FloatArray) -> Means:
    to_b = into_body(true)
    nothing = np.zeros((3, 3))
    return Means(to_b @ [0.0, 0.0, -G] + accelerometer_bias, to_b @ OMEGA_IE + gyro_bias, nothing, nothing)


@pytest.mark.parametrize("euler", [(0, 0, 0), (5, -8, 130), (-40, 20, -100)])
def test_levelling_leaves_the_accelerometer_biases_over_g(euler: tuple[float, float, float]) -> None:
    """Groves 5.6.1: each level axis is off by the bias across it over g, as the σ says."""
    true, bias = at(*euler), np.array([0.02, -0.03, 0.01])
    before = off(true, np.radians([3.0, -2.0, 0.0]))
    found = align(before, prior(np.radians(5.0), 0.1, 0.02), means(true, np.zeros(3), bias))
    north, east, _ = into_body(true).T @ bias
    # Heading is as it was: the Earth's rate is nothing beside the gyros' biases.
    np.testing.assert_allclose(error(found.start, true)[:2], [east / G, -north / G], rtol=0.02, atol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(found.P)[6:8]), 0.02 / G, rtol=0.01)
    # A tilt that comes from a bias comes with it: their correlation is all but complete.
    correlation = found.P / np.sqrt(np.outer(np.diag(found.P), np.diag(found.P)) + 1e-300)
    assert np.abs(correlation[6:8, ACCEL_BIAS]).max() > 0.7


@pytest.mark.parametrize("heading", [0.0, 75.0, -160.0])
def test_gyros_that_are_good_enough_find_north(heading: float) -> None:
    """Groves 5.6.2: the heading is as sure as the east gyro over the level part of the Earth's rate."""
    true, sigma = at(0, 0, heading), 0.01 * DEGREE_AN_HOUR
    before = off(true, np.radians([0.5, 0.5, 20.0]))
    found = align(before, prior(np.radians(20.0), sigma, 1e-5), means(true, np.zeros(3), np.zeros(3)))
    expected = sigma / (earth.RATE * np.cos(LATITUDE))
    np.testing.assert_allclose(np.sqrt(found.P[8, 8]), expected, rtol=0.01)
    assert abs(error(found.start, true)[2]) < 0.1 * expected


def test_gyros_that_are_not_leave_the_heading_and_lose_their_biases() -> None:
    true, bias = at(2, 3, 45), np.radians([0.5, -0.3, 0.8])
    before = off(true, np.radians([0.0, 0.0, 2.0]))
    found = align(before, prior(np.radians(2.0), np.radians(0.5), 1e-4), means(true, bias, np.zeros(3)))
    assert error(found.start, true)[2] == pytest.approx(np.radians(2.0), rel=1e-3)
    # What is left is the Earth's rate seen in the wrong direction.
    assert np.abs(found.gyro_bias - bias).max() < 1.1 * earth.RATE * np.radians(2.0)
    left = np.diag(found.P)[GYRO_BIAS].sum()
    assert np.sqrt(left) == pytest.approx(earth.RATE * np.cos(LATITUDE) * np.radians(2.0), rel=0.01)


def test_the_variances_shown_before_a_run_are_about_those_of_the_run() -> None:
    experiment = Experiment(mission="los_angeles")
    card("ICM-20948").load(experiment)
    shown = usual_covariance(experiment.sensors, experiment.navigator)
    assert shown is not None
    found = experiment.run().aligned
    assert found is not None
    # Of the level gyros' biases, a pitched vehicle leaves what they feel of its specific force.
    level = np.isin(np.arange(shown.shape[0]), np.r_[GYRO_BIAS][:2])
    shown, left = np.diag(shown), np.diag(found.P)
    np.testing.assert_allclose(shown[~level], left[~level], rtol=0.15)
    np.testing.assert_allclose(shown[level], left[level], rtol=0.5)
    experiment.set("navigator.alignment", 0.0)
    assert usual_covariance(experiment.sensors, experiment.navigator) is None


SEEDS = 60


@pytest.mark.proof
@pytest.mark.parametrize("sigma", [(0.5, 0.5, 2.0), (2.0, 2.0, 10.0), (5.0, 5.0, 40.0)])
@pytest.mark.parametrize("name", ["ICM-20948", "BMI088", "STIM300", "HG4930", "HG1700", "iIMU-FSAS"])
def test_the_errors_left_are_as_large_as_p_says(name: str, sigma: tuple[float, float, float]) -> None:
    """Attitude, gyro biases and what goes with them, over seeds; with turn-on biases from 1 °/h to 5 °/s.

    The error before is drawn from σ of the tilt and of the heading [°].
    """
    experiment = Experiment()
    card(name, assumed=False).load(experiment)
    experiment.set("navigator.attitude_sigma", sigma)
    true, total, kept = at(4, -3, 60), 0.0, np.r_[6:15]
    for seed in range(SEEDS):
        rng = np.random.default_rng([seed, 7])
        before = off(true, np.radians(rng.normal(size=3) * sigma))
        found = align_simulated(before, true, experiment.sensors, experiment.navigator, seed)
        gyro, accelerometer = biases(experiment, seed)
        x = np.concatenate((error(found.start, true), found.gyro_bias - gyro, -accelerometer))
        P = found.P[np.ix_(kept, kept)]
        scale = np.sqrt(np.diag(P))
        total += (x / scale) @ np.linalg.solve(P / np.outer(scale, scale), x / scale)
    low, high = chi2.ppf([0.0005, 0.9995], kept.size * SEEDS)
    print(f"\n{name}: NEES per degree of freedom {total / kept.size / SEEDS:.2f}")
    assert low < total < high


def test_a_tilt_comes_with_the_misalignments_that_caused_it() -> None:
    """A levelled navigator sees no level force: tilt, bias and misalignments cancel, and P0 has to say so."""
    experiment = Experiment()
    card("BMI088", assumed=False).load(experiment)
    experiment.update({"navigator.states": 21, "navigator.estimate_misalignments": True})
    experiment.update(
        {"navigator.attitude_sigma": (0.5, 0.5, 0.05), "sensors.accelerometer.bias_sigma": 0.02}
    )
    true, total, tilts = at(4, -3, 60), 0.0, []
    C_nb, force = into_body(true).T, into_body(true) @ [0.0, 0.0, -G]
    mixing = np.zeros((3, 6))
    for k, (row, column) in enumerate(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))):
        mixing[row, k] = force[column]
    sight = np.zeros((2, 33))
    sight[:, ATT] = [[0, G, 0], [-G, 0, 0]]
    sight[:, ACCEL_BIAS], sight[:, 27:33] = -C_nb[:2], -(C_nb @ mixing)[:2]
    for seed in range(SEEDS):
        rng = np.random.default_rng([seed, 7])
        misalignment = 0.05 * rng.choice([-1.0, 1.0], 6)
        experiment.set("sensors.accelerometer.misalignment", tuple(misalignment.tolist()))
        before = off(true, np.radians(rng.normal(size=3) * (0.5, 0.5, 0.05)))
        found = align_simulated(before, true, experiment.sensors, experiment.navigator, seed)
        P0 = belief(experiment.sensors, experiment.navigator, found.P).P0
        x = np.zeros(33)
        x[ATT], x[ACCEL_BIAS] = error(found.start, true), -biases(experiment, seed)[1]
        x[27:33] = -np.radians(misalignment)
        seen = sight @ x
        total += seen @ np.linalg.solve(sight @ P0 @ sight.T, seen)
        tilts.append(x[ATT][:2] / np.sqrt(np.diag(P0)[6:8]))
    low, high = chi2.ppf([0.0005, 0.9995], 2 * SEEDS)
    print(f"\nlevel force in its σ, squared: {total / 2 / SEEDS:.2f}; tilt {np.mean(np.square(tilts)):.2f}")
    assert low < total < high
    assert low < np.sum(np.square(tilts)) < high


def biases(experiment: Experiment, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return the true constant biases of gyros and accelerometers, as they put them out, by formula."""
    found = []
    for name in ("gyro", "accelerometer"):
        errors = experiment.sensors.groups()[name]
        draws = imu.ImuDraws.of(seed, name, 0, instability=False)
        bias = si(errors, "bias") + si(errors, "bias_sigma") * draws.bias
        scale = si(errors, "scale_factor") + si(errors, "scale_factor_sigma") * draws.scale
        found.append(bias * (1 + scale))
    return found[0], found[1]


def test_a_bias_found_at_rest_comes_with_the_sensitivity_that_is_in_it() -> None:
    """The alignment takes b + G f off; P0 has to know that a bias of −G f is left, with its G."""
    experiment = Experiment()
    card("BMI088", assumed=False).load(experiment)
    experiment.update({"navigator.states": 21, "navigator.estimate_g_sensitivity": True})
    true, total = at(4, -3, 60), 0.0
    force = into_body(true) @ [0.0, 0.0, -G]
    felt = blocks.find_states((*blocks.SCALES, blocks.GYRO_G), blocks.GYRO_G)
    states = np.r_[GYRO_BIAS, felt]
    for seed in range(SEEDS):
        signs = np.random.default_rng([seed, 8]).choice([-1.0, 1.0], 3)
        experiment.set("sensors.gyro.g_sensitivity", tuple((0.05 * signs).tolist()))
        found = align_simulated(true, true, experiment.sensors, experiment.navigator, seed)
        P0 = belief(experiment.sensors, experiment.navigator, found.P).P0
        x = np.zeros(P0.shape[0])
        size = np.radians(0.05 * signs) / STANDARD_GRAVITY
        x[GYRO_BIAS] = found.gyro_bias - biases(experiment, seed)[0]
        x[felt] = -size
        seen = x[GYRO_BIAS] + x[felt] * force  # the error of the whole bias at rest: only the noise of it
        sight = np.hstack((np.eye(3), np.diag(force)))
        S = sight @ P0[np.ix_(states, states)] @ sight.T
        total += seen @ np.linalg.solve(S, seen)
        assert np.sqrt(np.diag(S)).max() < 0.2 * np.abs(size * force).max()
    low, high = chi2.ppf([0.0005, 0.9995], 3 * SEEDS)
    print(f"\nwhole bias at rest in its σ, squared: {total / 3 / SEEDS:.2f}")
    assert low < total < high
