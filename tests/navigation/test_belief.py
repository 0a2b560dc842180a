"""Belief: what the filter assumes of drifting sensors, against closed forms and over seeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are

from lab import Experiment
from lab.analysis import error_sources
from lab.base.parameters.units import si
from lab.navigation.belief import (
    FLICKER_AFTER_REST,
    FLICKER_FLOOR,
    FLICKER_PEAK,
    belief,
    bias_process,
    bias_processes,
    flicker_process,
    hidden_by_fixes,
)
from lab.navigation.settings import NavigatorSettings
from lab.sensors.cards import card
from lab.sensors.imu import GyroErrors
from lab.sensors.processes import flicker
from lab.sensors.suite import SensorSuite

DEGREE = np.pi / 180
QUIET = {"bias_sigma": 0}


def test_a_random_walk_drives_the_bias_and_does_not_let_it_decay():
    drive, decay = bias_process(GyroErrors(**QUIET, rate_random_walk=(1, 2, 3)))
    # After an hour the variance of a walk is that of its coefficient.
    assert np.allclose(drive * 3600, (np.array((1, 2, 3)) * DEGREE / 3600) ** 2, rtol=1e-12)
    assert not decay.any()


def test_a_random_walk_adds_to_the_drive_of_a_gauss_markov_process_and_leaves_its_decay():
    plain = bias_process(GyroErrors(**QUIET, instability=20, correlation_time=100))
    walking = bias_process(GyroErrors(**QUIET, instability=20, correlation_time=100, rate_random_walk=5))
    assert np.allclose(plain[1], 1 / 100, rtol=1e-12)
    assert np.array_equal(walking[1], plain[1])
    assert np.allclose((walking[0] - plain[0]) * 3600, (5 * DEGREE / 3600) ** 2, rtol=1e-12)


def test_an_instability_that_the_noise_hides_leaves_a_bias_known_to_its_variance():
    """By the Riccati equation of a rate whose integral is seen, here through SciPy."""
    noise, instability = 0.05, 30 / 3600
    drive, _ = bias_process(GyroErrors(noise_density=noise, instability=30, correlation_time=1))
    settled = solve_continuous_are(
        np.zeros((1, 1)), np.ones((1, 1)), drive[:1, None] / DEGREE**2, np.array([[noise**2]])
    )
    # The turn-on bias of 0.1 °/s adds the factor √(1 + σ²/C).
    assert settled[0, 0] == pytest.approx(np.sqrt(2 * (1 + (instability / 0.1) ** 2)) * instability**2)


@pytest.mark.parametrize("sigma", [0, 1e-6])
def test_without_a_constant_the_process_is_the_instability_itself(sigma):
    drive, decay = bias_process(GyroErrors(bias_sigma=sigma, instability=30, correlation_time=1))
    assert np.allclose(drive, 2 * (30 * DEGREE / 3600) ** 2, rtol=1e-6)
    assert np.allclose(decay, 1, rtol=1e-6)


def test_flicker_alone_is_the_process_that_stands_for_it():
    errors = GyroErrors(**QUIET, flicker=(5, 10, 20), noise_density=0.01)
    drive, decay = bias_process(errors)
    variance, time = flicker_process(errors)
    assert np.allclose(variance, 5 * (np.array((5, 10, 20)) * DEGREE / 3600) ** 2, rtol=1e-12)
    assert np.allclose(decay, 1 / time, rtol=1e-12)
    assert np.allclose(drive / (2 * decay), variance, rtol=1e-12)


def test_the_process_of_flicker_peaks_where_the_white_noise_meets_the_floor():
    """Allan variance of a Gauss-Markov process: (2 σ² T / τ) [1 − T / (2 τ) (3 − 4 e^(−τ/T) + e^(−2τ/T))]."""
    noise, B = 0.01, 10 / 3600
    T = flicker_process(GyroErrors(flicker=10, noise_density=noise))[1][0]
    tau = np.linspace(1, 500, 50_000)
    allan = 2 * T / tau * (1 - T / (2 * tau) * (3 - 4 * np.exp(-tau / T) + np.exp(-2 * tau / T)))
    peak = tau[np.argmax(allan)]
    assert noise / np.sqrt(peak) == pytest.approx(0.664 * B, rel=0.005)


def test_beside_what_an_alignment_leaves_a_gyro_changes_by_its_flicker_and_no_more():
    """Within the time of the largest Allan deviation; 900 B² are what a g-sensitivity leaves of a bias."""
    errors = GyroErrors(bias_sigma=30 * 10 / 3600, flicker=10, noise_density=0.01)
    drive, decay = bias_process(errors, aligned=True)
    variance, time = flicker_process(errors)
    total, T = drive / (2 * decay), FLICKER_PEAK * time
    assert np.allclose(total, variance + (30 * 10 * DEGREE / 3600) ** 2, rtol=1e-12)
    changes = 2 * total * -np.expm1(-decay * T)
    assert np.allclose(changes, 2 * variance * -np.expm1(-T / time), rtol=1e-9)


@pytest.mark.parametrize(("triad", "lowest", "size"), [("gyro", 2, 9.80665), ("accelerometer", 1, 1.0)])
@pytest.mark.parametrize(("position", "velocity"), [(0.01, 4.0), (25.0, 0.002)])
def test_fixes_hide_flicker_for_the_time_of_the_better_polynomial(triad, lowest, size, position, velocity):
    """Polynomials through fixes 50 ms apart by least squares: variance of the derivative that is the bias."""
    suite = SensorSuite()
    suite.set(f"{triad}.flicker", 8.0 if triad == "gyro" else 0.05)
    suite.gps.update({"period": 0.05, "position_variance": position, "velocity_variance": velocity})
    T = hidden_by_fixes(suite)[3 * (triad == "accelerometer")]
    found = []
    for variance, degree in ((velocity, lowest), (position, lowest + 1)):
        basis = np.polynomial.legendre.legvander(np.linspace(-1, 1, round(T / 0.05)), degree)
        last = variance * np.linalg.inv(basis.T @ basis)[-1, -1]
        # The highest derivative of a Legendre polynomial is (2k)! / (2^k k!), with ±1 at the ends.
        found.append(last * (math.perm(2 * degree, degree) / T**degree) ** 2)
    floor = FLICKER_FLOOR * size * si(getattr(suite, triad), "flicker")[0]
    assert np.sqrt(min(found)) == pytest.approx(floor, rel=0.02)


def test_vibration_is_noise_to_the_accelerometers():
    sensors = SensorSuite()
    sensors.accelerometer.noise_density = (300, 400, 0)
    sensors.accelerometer.vibration_density = (400, 0, 500)
    noise = belief(sensors, NavigatorSettings()).noise
    assert np.allclose(np.sqrt(noise[3:6]), np.array((500, 400, 500)) * 9.80665e-6, rtol=1e-12)


DRIFTS = {
    "flicker": {"gyro.flicker": 50, "gyro.bias_sigma": 0.02, "accelerometer.flicker": 0.5},
    "flicker of a good gyro": {"gyro.flicker": 5, "gyro.noise_density": 0.005, "gyro.bias_sigma": 0.002},
    "strong flicker": {"gyro.flicker": 200, "gyro.bias_sigma": 0.06},
    "random walk": {"gyro.rate_random_walk": 300, "accelerometer.rate_random_walk": 20},
    "fast instability": {"gyro.instability": 100, "gyro.correlation_time": 0.5},
    "vibration": {"accelerometer.vibration_density": 3000},
    "all": {
        "gyro.rate_random_walk": 100,
        "gyro.flicker": 20,
        "gyro.instability": 30,
        "accelerometer.flicker": 0.2,
        "accelerometer.vibration_density": 500,
    },
}


def nees(settings: dict[str, float], seeds: int) -> float:
    """Return the mean NEES for each degree of freedom after 20 s of montreal."""
    means = []
    for seed in range(seeds):
        one = Experiment(mission="montreal", seed=seed)
        one.update({"trajectory": {"imu_rate": 100}})
        for path, value in settings.items():
            one.set(path if path.startswith("navigator.") else f"sensors.{path}", value)
        found = one.run().consistency.nees
        means.append(float(found[20:].mean()) / found.attrs["degrees"])
    return float(np.mean(means))


@pytest.mark.parametrize("name", ["ICM-42688-P", "ADIS16470", "ADIS16488", "STIM300", "iIMU-FSAS", "HG9900"])
def test_between_fixes_of_metres_flicker_of_quiet_accelerometers_is_believed_as_it_is(name):
    """Height, velocity and bias, for 300 s with an outage: covariance of the errors against that believed.

    The errors are those under flicker with its exact covariance, a sum of many processes (`error_sources`).
    With the noise of the accelerometers alone, NEES per state was 0.6 to 0.8, 0.9 for the HG9900.
    """
    suite = SensorSuite().update(card(name).settings())
    dt, N = 0.1, si(suite.accelerometer, "noise_density")[2]
    drive, decay = (values[5] for values in bias_processes(suite))
    processes = error_sources.flicker("", 1, si(suite.accelerometer, "flicker"), dt, 300.0)
    times = np.array([one.time for one in processes])
    constant = float(si(suite.accelerometer, "bias_sigma")[2]) ** 2
    n = 4 + times.size  # height, velocity, estimate of the bias, constant, processes
    F, Q, truth = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    F[0, 1], F[1, 2], F[1, 3:], F[2, 2] = 1, -1, 1, -decay
    F[4:, 4:] = -np.diag(1 / times)
    Q[1, 1] = N**2 * dt
    Q[4:, 4:] = np.diag([0.0 if one.settled else one.drive(dt)[2] for one in processes])
    at_first = [one.variance[2] if one.settled else 0.0 for one in processes]
    truth[:] = np.diag([1.0, 0.09, 0.0, constant, *at_first])
    sight = np.zeros((3, n))  # the errors of the filter: of its bias, the estimate minus all parts
    sight[:, :3], sight[2, 3:] = np.eye(3), -1
    believed = np.diag([1.0, 0.09, sight[2] @ truth @ sight[2]])
    step, filter_step = expm(F * dt), expm(np.array([[0, 1, 0], [0, 0, -1], [0, 0, -decay]]) * dt)
    R, squares = np.diag([suite.gps.position_variance[2], suite.gps.velocity_variance[2]]), []
    for k in range(1, 3001):
        truth = step @ truth @ step.T + Q
        believed = filter_step @ believed @ filter_step.T + np.diag([0, N**2 * dt, drive * dt])
        if k % 10 or 1000 < k <= 1600:
            continue
        K = believed[:, :2] @ np.linalg.inv(believed[:2, :2] + R)
        believed = believed - K @ believed[:2]
        taken = np.eye(n)
        taken[:3, :2] -= K
        truth = taken @ truth @ taken.T
        truth[:3, :3] += K @ R @ K.T
        squares.append(np.trace(np.linalg.solve(believed, sight @ truth @ sight.T)) / 3)
    print(f"\n{name}: NEES per state {np.mean(squares):.2f}")
    assert np.mean(squares) == pytest.approx(1.0, abs=0.1)


@pytest.mark.proof
@pytest.mark.parametrize("name", DRIFTS)
def test_the_filter_of_a_drifting_sensor_is_consistent(name):
    """Flicker is modelled by a substitute, hence the quarter."""
    value = nees(DRIFTS[name], 12)
    print(f"\n{name}: NEES {value:.2f} of 1")
    assert value == pytest.approx(1, abs=0.25)


def test_an_alignment_leaves_flicker_less_its_mean():
    """The variance of 1,500 values has a relative σ of 4 %."""
    rng = np.random.default_rng(4)
    series = (flicker(rng.normal(size=(3000, 3))) for _ in range(500))
    left = [one[-1] - one.mean(axis=0) for one in series]
    assert np.mean(np.square(left)) == pytest.approx(FLICKER_AFTER_REST, rel=0.12)


@pytest.mark.proof
@pytest.mark.parametrize("name", ["iIMU-FSAS", "LN-200S"])
def test_flicker_as_large_as_the_turn_on_bias_counts_from_the_start(name):
    """Over 60 flights, NEES of the three gyro biases has a σ of 0.11."""
    one = Experiment(mission="los_angeles")
    card(name).load(one)
    one.update({"trajectory": {"imu_rate": 50}, "navigator": {"alignment": 0}})
    for triad in (one.sensors.gyro, one.sensors.accelerometer):
        triad.misalignment, triad.quantisation, triad.bandwidth = (0,) * 6, (0,) * 3, (0,) * 3
    one.sensors.gyro.g_sensitivity = (0,) * 3
    found = []
    for seed in range(60):
        result = one.copy().update({"seed": seed}).run()
        at = np.searchsorted(result.time, (5.0, 20.0))
        errors = result.sensor_errors
        error = errors.gyro_bias.values[at] - errors.gyro_bias_true.values[at]
        found.append((error / errors.gyro_bias_sigma.values[at]) ** 2)
    assert np.mean(found, axis=(0, 2)) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize(
    "settings",
    [
        {"gps.latency": 0.2, "navigator.latency": 0.0},
        {"gps.correlated_sigma": 3},
        {"gps.lever_arm": 2, "navigator.lever_arm": 0.0},
        {"gps.outlier_rate": 0.1},
        {"gyro.scale_factor_sigma": 3},
    ],
    ids=lambda settings: next(iter(settings)),
)
def test_what_the_filter_is_not_told_makes_it_inconsistent(settings):
    value = nees(settings, 4)
    print(f"\n{settings}: NEES {value:.2f} of 1")
    assert value > 3
