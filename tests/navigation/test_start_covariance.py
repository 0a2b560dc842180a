"""P0 of a start by fixes and accelerometers: closed forms, random starts, and drives with sensor cards."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from carded_logs import RTK, STANDALONE, carded, loaded
from live_batch import solution_of
from live_rows import feed
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.log.vehicle import vehicle_of
from lab.data.streams.live_log import make_log
from lab.live.live_navigator import LiveNavigator
from lab.motion.frames import earth
from lab.motion.frames.displacement import displaced, displacement
from lab.motion.frames.rotation import euler_from_quaternion, quaternion_from_euler
from lab.navigation.alignment.alignment import Alignment, align
from lab.navigation.alignment.initial_heading import UNKNOWN, Hints
from lab.navigation.alignment.start_covariance import start_covariance
from lab.navigation.belief import belief
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, POS, VEL
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Fixes, Imu, Start
from lab.sensors.suite import SensorSuite

PLACE = np.array([np.radians(50.0), 0.2, 300.0])
G = float(earth.gravity(np.sin(PLACE[0]), PLACE[2]))
NOISE = np.array([0.02, 0.03, 0.04])  # σ of a fix, north, east, down [m]
ARM = (1.2, -0.6, -1.5)


def sensors(bias: float = 15.0) -> SensorSuite:
    """Return sensors with an accelerometer bias [mg]."""
    suite = SensorSuite()
    suite.accelerometer.bias_sigma = (bias,) * 3
    return suite


def found(euler, sigma: float, *, tilt: float = 0.0, rate=(0.0, 0.0, 0.0), rest: float = 10.0) -> Alignment:
    """Return a start with an attitude by roll, pitch, heading and the σ of the heading [rad]."""
    q_nb = quaternion_from_euler(np.array(euler))
    return Alignment(
        start=Start(PLACE, np.zeros(3), q_nb), gyro_bias=np.zeros(3),
        attitude_sigma=np.array((tilt, tilt, sigma)), gyro_bias_sigma=np.full(3, 1e-4),
        velocity_sigma=np.full(3, 0.1), rate=np.array(rate), force_n=np.array((0.0, 0.0, -G)), rest=rest,
        heading=UNKNOWN,
    )  # fmt: skip


def covariance(start: Alignment, arm=(0.0, 0.0, 0.0), names=(), suite=None, **settings) -> np.ndarray:
    navigator = NavigatorSettings(**settings)
    assumed = belief(suite or sensors(), navigator)._replace(lever_arm=np.array(arm))
    return start_covariance(assumed, navigator, names, start, NOISE**2)


def test_levelled_tilts_are_the_biases_of_the_accelerometers():
    """Level and to the north, φ_N = −b_E / g and φ_E = b_N / g for the error of the estimate b."""
    variance = (15e-3 * STANDARD_GRAVITY) ** 2
    P = covariance(found((0, 0, 0), 1e-6, tilt=1e-4))
    tilt, across = P[ATT, ATT], P[ATT, ACCEL_BIAS]
    np.testing.assert_allclose(np.diag(tilt)[:2], variance / G**2 + 1e-8, rtol=1e-9)
    np.testing.assert_allclose(across[:2, :2], [[0, -variance / G], [variance / G, 0]], atol=1e-12)
    np.testing.assert_allclose(across[:, 2], 0, atol=1e-12)
    # To the east, forward is east.
    across = covariance(found((0, 0, np.pi / 2), 1e-6))[ATT, ACCEL_BIAS]
    np.testing.assert_allclose(across[:2, :2], [[-variance / G, 0], [0, -variance / G]], atol=1e-12)


def test_an_arm_that_points_anywhere():
    """Without a heading, north and east err by 1/√2 of the level part, and up by the tilts."""
    P = covariance(found((0, 0, 0.7), np.pi), ARM)
    level = np.hypot(*ARM[:2])
    tilt = 15e-3 * STANDARD_GRAVITY / G
    level_variance = NOISE[:2] ** 2 + level**2 / 2 + (ARM[2] * tilt) ** 2
    np.testing.assert_allclose(np.diag(P)[:2], level_variance, rtol=2e-3)
    np.testing.assert_allclose(P[2, 2], NOISE[2] ** 2 + (level * tilt) ** 2, rtol=1e-6)


@pytest.mark.parametrize("sigma", [0.02, 0.3, 1.0])
def test_an_arm_that_is_turned_by_an_uncertain_heading(sigma):
    """Moments of a vector that is turned by a normal angle, in closed form."""
    P = covariance(found((0, 0, 0), sigma), (2.0, 0.0, 0.0), suite=sensors(1e-6))
    cosine, sine = np.exp(-(sigma**2) / 2), (1 - np.exp(-2 * sigma**2)) / 2
    along = (1 + np.exp(-2 * sigma**2)) / 2 - cosine**2
    np.testing.assert_allclose(P[0, 0] - NOISE[0] ** 2, 4 * along, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(P[1, 1] - NOISE[1] ** 2, 4 * sine, rtol=1e-6)
    np.testing.assert_allclose(P[1, 8], 2 * sigma**2 * cosine, rtol=1e-6)
    np.testing.assert_allclose(P[8, 8], sigma**2, rtol=1e-9)


def test_what_the_filter_estimates_of_the_receiver_displaces_the_start():
    names = blocks.in_order((blocks.LEVER_ARM, blocks.LATENCY, blocks.GPS_DRIFT))
    suite = sensors()
    suite.gps.correlated_sigma = (1.5, 1.5, 3.0)
    settings = {"estimate_lever_arm": True, "estimate_latency": True, "estimate_gps_drift": True}
    start = found((0, 0, 0), 1e-6)
    start = start._replace(start=start.start._replace(velocity_n=np.array([8.0, 0.0, 0.0])))
    P = covariance(start, names=names, suite=suite, **settings)
    own = {
        name: P[np.ix_(range(3), range(*blocks.find_states(names, name).indices(len(P))))] for name in names
    }
    drift, arm, late = (
        np.diag(P)[blocks.find_states(names, name)]
        for name in (blocks.GPS_DRIFT, blocks.LEVER_ARM, blocks.LATENCY)
    )
    np.testing.assert_allclose(own[blocks.GPS_DRIFT], -np.diag(drift), atol=1e-9)
    np.testing.assert_allclose(own[blocks.LEVER_ARM], -np.diag(arm), atol=1e-5)
    np.testing.assert_allclose(own[blocks.LATENCY][:, 0], [8 * late[0], 0, 0], atol=1e-9)
    level = NOISE**2 + drift + arm
    level[0] += 64 * late[0]
    np.testing.assert_allclose(np.diag(P)[POS], level, rtol=1e-6)


def turning_start(rng: np.random.Generator, sigma: float, *, rest: bool) -> float:
    """Return the square of the error of a start in the metric of its P0, per state.

    The vehicle stands, or turns on a circle at 8 m/s. Its attitude, the arm, the biases and the error of the
    heading with some σ [rad] are drawn.
    """
    turning, speed = (0.0, 0.0) if rest else (0.3, 8.0)
    arm, bias = rng.normal(size=3) * 1.5, rng.normal(size=3) * 8e-3 * STANDARD_GRAVITY
    heading, (roll, pitch) = rng.uniform(-3, 3), rng.normal(size=2) * 0.1 * rest
    C_nb = Rotation.from_euler("ZYX", (heading, pitch, roll))
    time, times = np.arange(301) / 50, np.arange(0.0, 6.0, 0.5)
    # The force on a circle is constant in b.
    force = C_nb.inv().apply((0.0, 0.0, -G)) + np.array((0.0, speed * turning, 0.0)) + bias
    imu = Imu(time, np.tile((0.0, 0.0, turning / 50), (300, 1)), np.tile(force / 50, (300, 1)))
    turned = turning * times
    course, across = heading + turned, 0.5 * turned
    velocity = speed * np.stack((np.cos(course), np.sin(course), 0 * times), axis=-1)
    chord = speed * times * np.sinc(across / np.pi)
    path = chord[:, None] * np.stack((np.cos(heading + across), np.sin(heading + across), 0 * times), axis=-1)
    C = Rotation.from_rotvec(np.outer(turned, (0, 0, 1))) * C_nb
    place = displaced(np.tile(PLACE, (times.size, 1)), path + C.apply(arm))
    place = displaced(place, rng.normal(size=place.shape) * NOISE)
    measured = velocity + C.apply(np.cross((0.0, 0.0, turning), arm)) + rng.normal(size=place.shape) * 0.03
    hints = Hints(vehicle_of("car"), float(heading + rng.normal() * sigma), sigma)
    settings = NavigatorSettings()
    assumed = belief(sensors(8.0), settings)._replace(lever_arm=arm)
    start = align(imu, Fixes(times, place, measured), np.full(place.shape, 0.03), hints, assumed)
    assert bool(start.rest) == rest
    P = start_covariance(assumed, settings, (), start, NOISE**2)
    error = np.zeros(15)
    error[POS] = displacement(PLACE[None], start.start.position[None])[0]
    error[VEL] = start.start.velocity_n - velocity[0]
    error[ATT] = (C_nb * Rotation.from_quat(start.start.q_nb, scalar_first=True).inv()).as_rotvec()
    error[ACCEL_BIAS] = -bias
    seen = np.r_[0:9, 12:15]
    return float(error[seen] @ np.linalg.solve(P[np.ix_(seen, seen)], error[seen]) / seen.size)


@pytest.mark.proof
@pytest.mark.parametrize("sigma", np.radians([3.0, 25.0]))
@pytest.mark.parametrize("rest", [True, False])
def test_random_starts_err_as_p0_says(rest, sigma):
    """In motion, P0 allows for an acceleration that the fixes do not show, which a steady turn lacks."""
    rng, count = np.random.default_rng(1001), 60
    mean = np.mean([turning_start(rng, sigma, rest=rest) for _ in range(count)])
    low, high = chi2.interval(0.999, 12 * count) / np.array(12 * count)
    assert (low if rest else 0.5) < mean < high


def tilts(
    name: str,
    seed: int,
    begin: float,
    end: float,
    *,
    live: bool = False,
    model: str = "phi",
    receiver: tuple[float, float, float] = STANDALONE,
    drawn: bool = False,
) -> np.ndarray:
    """Return the errors of roll and pitch 10 s after the start, in their σ; the vehicle is almost level.

    With `drawn`, the constant errors of the sensors are random; otherwise each is as large as its σ.
    """
    experiment = loaded(name)
    experiment.navigator.model = model
    experiment.navigator.vehicle = "car"
    sensors, rng = experiment.sensors.copy(), np.random.default_rng(seed)
    if drawn:
        for triad in (sensors.gyro, sensors.accelerometer):
            triad.misalignment = tuple(np.array(triad.misalignment) * rng.normal(size=6))
        sensors.gyro.g_sensitivity = tuple(np.array(sensors.gyro.g_sensitivity) * rng.normal(size=3))
    imu, fixes, truth = carded(sensors, seed, begin=begin, end=end, receiver=receiver)
    if live:
        navigator = LiveNavigator(experiment.sensors, experiment.navigator, kept=1e6)
        feed(navigator, imu, fixes, repeat(50))
        time, made = solution_of(navigator).time, solution_of(navigator)
    else:
        log = make_log("drive", imu, fixes, vehicle="car")
        run = navigate_log(log, experiment.sensors, experiment.navigator)
        time, made = run.imu.time, run.solution
    at = int(np.searchsorted(time, time[0] + 10.0))
    true = int(np.argmin(np.abs(imu["time"] - imu["time"][0] - time[at])))
    error = euler_from_quaternion(made.q_nb[at])[:2] - truth.euler[true, :2]
    return error / np.sqrt(made.variance[at, 6:8])


@pytest.mark.proof
@pytest.mark.parametrize("name", ["ADIS16470", "BMI088"])
@pytest.mark.parametrize(("live", "seeds"), [(False, 20), (True, 8)])
def test_tilts_of_a_start_at_rest_err_as_the_card_says(name, live, seeds):
    """Their accelerometers err by 15 and 20 mg."""
    ratios = [tilts(name, 1001 + seed, 0.0, 28.0, live=live) for seed in range(seeds)]
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.proof
def test_tilts_of_a_start_without_any_heading_err_as_the_card_says():
    """The log ends before the car moves; of a σ of 180°, the model phi cannot make anything."""
    ratios = [tilts("ADIS16470", 1001 + seed, 0.0, 11.0, model="invariant") for seed in range(20)]
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.proof
@pytest.mark.parametrize("name", ["ADIS16470", "BMI088"])
def test_tilts_of_a_start_in_motion_err_as_the_card_says(name):
    """It begins on a straight road, in turns, and with the brakes on."""
    begins = (22.0, 26.0, 29.0, 38.0, 46.0)
    ratios = [tilts(name, 1001 + k, begins[k % 5], begins[k % 5] + 11.0) for k in range(40)]
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.proof
def test_tilts_of_a_stream_that_starts_in_turns_err_as_the_card_says():
    """With RTK, on a straight road, in turns, and with the brakes on; 1.6 if corrections do not turn P."""
    begins = (22.0, 26.0, 29.0, 38.0, 46.0)
    ratios = [
        tilts("BMI088", 1001 + k, begins[k % 5], begins[k % 5] + 11.0, live=True, receiver=RTK, drawn=True)
        for k in range(40)
    ]
    print(f"\nerrors of roll and pitch over σ: {np.sqrt(np.mean(np.square(ratios))):.2f}")
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.proof
def test_a_live_stream_has_the_states_of_its_card():
    """Scale factors, misalignments and g-sensitivity of a BMI088, with RTK, in turns: 10 s later."""
    ratios = [
        tilts("BMI088", seed, 22.0, 34.0, live=True, receiver=RTK, drawn=True) for seed in range(1001, 1013)
    ]
    print(f"\nerrors of roll and pitch over σ: {np.sqrt(np.mean(np.square(ratios))):.2f}")
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0  # 6.8 without these states


@pytest.mark.proof
@pytest.mark.parametrize("arm", [ARM, (0.0, 0.0, -2.0), (-4.0, 3.0, 1.0)])
@pytest.mark.parametrize("begin", [0.0, 31.0])
def test_a_precise_receiver_away_from_the_imu(arm, begin):
    """The start is that of the IMU within its σ, and the first fixes are what the filter expects."""
    experiment = loaded("ADIS16470")
    experiment.navigator.vehicle = "car"
    errors, squares = [], []
    for seed in range(1001, 1005):
        imu, fixes, truth = carded(
            experiment.sensors, seed, begin=begin, end=begin + 25.0, arm=arm, receiver=RTK
        )
        log = make_log("drive", imu, fixes, np.array(arm), vehicle="car")
        run = navigate_log(log, experiment.sensors, experiment.navigator)
        error = displacement(truth.position[:1], run.alignment.start.position[None])[0]
        errors.append(error / np.sqrt(np.diag(run.belief.P0)[POS]))
        seen, S = run.solution.innovation[:8], run.solution.innovation_covariance[:8]
        squares.append(np.einsum("ni,nij,nj->n", seen, np.linalg.inv(S), seen).mean() / 6)
    assert np.abs(errors).max() < 3.5
    assert 0.5 < np.mean(squares) < 1.5
