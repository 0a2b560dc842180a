"""GPS: variances by axis, frames and metres, times and outages, and all that is not white."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.missions import Recording
from lab.motion.frames.earth import RATE
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.sensors.gps import GpsDraws, GpsErrors, GpsFixes, antenna, fix_times, measure

FIXES = 20_000
VARIANCES = np.array((1.0, 4.0, 9.0))


def truth(latitude: float = 45.0, fixes: int = FIXES, longitude: float = -73.7) -> Truth:
    """Return the truth of a vehicle that stands still in one place but has a velocity, a fix a second."""
    return Truth(
        time=np.arange(1.0, fixes + 1),
        latitude=np.full(fixes, np.radians(latitude)),
        longitude=np.full(fixes, np.radians(longitude)),
        height=np.full(fixes, 1000.0),
        velocity_n=np.tile((10.0, 20.0, -3.0), (fixes, 1)),
        q_nb=np.tile((1.0, 0.0, 0.0, 0.0), (fixes, 1)),
        euler=np.zeros((fixes, 3)),
    )


def receive(there: Truth, seed: int = 1, **settings: object) -> GpsFixes:
    """Return the fixes of a receiver."""
    return measure(there, GpsErrors(**settings), GpsDraws.of(seed, there.time.size))


def in_metres(fixes: GpsFixes, there: Truth) -> np.ndarray:
    """Return fix minus truth east, north, up [m] by pymap3d."""
    latitude, longitude, height = fixes.position.T
    enu = pymap3d.geodetic2enu(
        latitude, longitude, height, there.latitude, there.longitude, there.height, deg=False
    )
    return np.stack(enu, axis=-1)


def test_position_variances_belong_to_east_north_up():
    there = truth()
    error = in_metres(receive(there, position_variance=tuple(VARIANCES)), there)
    assert np.allclose(error.var(axis=0) / VARIANCES, 1, atol=5 * np.sqrt(2 / FIXES))
    assert (np.abs(error.mean(axis=0)) < 5 * np.sqrt(VARIANCES / FIXES)).all()
    assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 5 / np.sqrt(FIXES)


def test_velocity_variances_belong_to_east_north_up():
    there = truth()
    north, east, down = (receive(there, velocity_variance=tuple(VARIANCES)).velocity_n - (10, 20, -3)).T
    variances = np.var((east, north, down), axis=1)
    assert np.allclose(variances / VARIANCES, 1, atol=5 * np.sqrt(2 / FIXES))


@pytest.mark.parametrize("latitude", [-75.0, -33.9, 0.0, 45.0, 80.0])
def test_errors_in_metres_are_those_reported(latitude):
    """Up to the curvature of the Earth: 1 µm at a few metres."""
    there = truth(latitude, 500)
    fixes = receive(there, position_variance=(1, 4, 9))
    assert np.allclose(in_metres(fixes, there), fixes.position_error, atol=2e-5)
    assert np.abs(fixes.position_error).max() > 5


def test_a_reported_velocity_error_is_fix_minus_truth_east_north_up():
    there = truth(fixes=50)
    fixes = receive(there)
    east, north, up = fixes.velocity_error.T
    assert np.allclose(fixes.velocity_n - there.velocity_n, np.stack((north, east, -up), axis=-1), atol=1e-12)
    assert np.abs(fixes.velocity_error).max() > 0.1


def test_four_times_the_variance_doubles_the_same_errors():
    there = truth(fixes=100)
    one, four = (receive(there, position_variance=v, velocity_variance=v) for v in (0.5, 2.0))
    assert np.allclose(four.position_error, 2 * one.position_error, rtol=1e-12)
    assert np.allclose(four.velocity_error, 2 * one.velocity_error, rtol=1e-12)


@pytest.mark.parametrize(
    ("period", "duration", "count"),
    # 0.3 / 0.1 is 2.9999999999999996: the last fix comes at the end all the same.
    [(1, 205.04, 205), (0.3, 10, 33), (0.1, 10, 100), (60, 59.9, 0), (5, 5, 1), (0.1, 0.3, 3), (0.7, 4.9, 7)],
)
def test_fixes_come_at_whole_periods_up_to_the_end(period, duration, count):
    times = fix_times(GpsErrors(period=period), duration)
    assert times.shape == (count,)
    assert np.allclose(times, [period * k for k in range(1, count + 1)], rtol=1e-15)


def test_no_fix_comes_in_an_outage_and_the_others_stay_the_same():
    there = truth(fixes=100)
    whole = receive(there)
    broken = receive(there, outages=[[10, 20], [15.5, 30.5], [99.5, 1000]])
    kept = np.array([t for t in whole.time if t < 10 or 30.5 < t < 99.5])
    assert np.array_equal(broken.time, kept)
    assert 10 not in broken.time
    index = kept.astype(int) - 1
    for all_fixes, fixes in zip(whole, broken, strict=True):
        assert np.array_equal(fixes, all_fixes[index])


def test_an_outage_over_the_whole_flight_leaves_no_fix():
    fixes = receive(truth(fixes=10), outages=[[0, 1e6]])
    assert [part.shape[0] for part in fixes] == [0] * 5


def test_position_and_velocity_errors_are_independent():
    fixes = receive(truth())
    columns = np.concatenate((fixes.position_error, fixes.velocity_error), axis=1).T
    assert np.abs(np.corrcoef(columns) - np.eye(6)).max() < 5 / np.sqrt(FIXES)


# Correlated errors, bad constellations, outliers

SILENT = {"position_variance": 1e-6, "velocity_variance": 1e-8}


def extra(there: Truth, seed: int = 1, **settings: object) -> np.ndarray:
    """Return the position errors that settings add to those of a nearly perfect receiver."""
    plain = receive(there, seed, **SILENT)
    return receive(there, seed, **SILENT, **settings).position_error - plain.position_error


@pytest.mark.parametrize(("period", "time"), [(1.0, 20.0), (0.2, 5.0)])
def test_a_correlated_error_has_the_covariance_of_a_gauss_markov_process(period, time):
    """σ² exp(−τ / T), east, north, up apart."""
    there, sigma = truth(), np.array((1.0, 2.0, 4.0))
    error = extra(there, correlated_sigma=tuple(sigma), correlation_time=time, period=period) / sigma
    independent = FIXES * period / time
    for lag in (0, 1, 10, round(time / period), round(3 * time / period)):
        covariance = error[lag:].T @ error[: FIXES - lag] / (FIXES - lag)
        expected = np.exp(-lag * period / time) * np.eye(3)
        assert np.allclose(covariance, expected, atol=5 * np.sqrt(2 / independent))


def test_a_correlated_error_is_there_from_the_first_fix_and_rescales():
    there = truth(fixes=2)
    firsts = np.array([extra(there, seed, correlated_sigma=3)[0] for seed in range(600)])
    assert np.allclose(firsts.std(axis=0) / 3, 1, atol=5 / np.sqrt(1200))
    assert np.allclose(extra(there, correlated_sigma=6), 2 * extra(there, correlated_sigma=3), rtol=1e-9)


def test_a_correlated_error_goes_on_through_an_outage():
    there = truth(fixes=100)
    whole = receive(there, correlated_sigma=3)
    broken = receive(there, correlated_sigma=3, outages=[[20, 40]])
    assert np.array_equal(broken.position_error, whole.position_error[broken.time.astype(int) - 1])


def test_a_bad_constellation_multiplies_the_errors_while_it_lasts():
    there = truth(fixes=60)
    good = receive(there, correlated_sigma=2)
    bad = receive(there, correlated_sigma=2, quality_steps=[[10, 20], [40, 1000]], quality_factor=2.5)
    factor = np.where(((there.time >= 10) & (there.time <= 20)) | (there.time >= 40), 2.5, 1)[:, None]
    assert np.allclose(bad.position_error, factor * good.position_error, rtol=1e-12)
    assert np.allclose(bad.velocity_error, factor * good.velocity_error, rtol=1e-12)


def test_outliers_come_at_their_rate_and_with_their_size():
    there = truth()
    jump = extra(there, outlier_rate=0.1, outlier_size=50)
    out = jump.any(axis=1)
    assert out.mean() == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / FIXES))
    assert np.allclose(jump[out].std(axis=0) / 50, 1, atol=5 / np.sqrt(2 * 0.1 * FIXES))
    # They come independently: the fix after one is no more likely to be one.
    assert np.mean(out[1:][out[:-1]]) == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / (0.1 * FIXES)))
    assert not extra(there, outlier_rate=0, outlier_size=50).any()
    assert extra(there, outlier_rate=1, outlier_size=50).all()


@given(st.floats(0.01, 0.5), st.floats(0.01, 0.5))
def test_more_outliers_keep_those_there_are(one, other):
    low, high = sorted((one, other))
    there = truth(fixes=200)
    few, many = (extra(there, outlier_rate=rate) for rate in (low, high))
    chosen = few.any(axis=1)
    assert np.array_equal(few[chosen], many[chosen])


def test_outliers_leave_the_velocity_alone():
    there = truth(fixes=200)
    plain, wild = receive(there), receive(there, outlier_rate=0.5)
    assert np.array_equal(plain.velocity_n, wild.velocity_n)


def test_every_position_error_has_its_own_draws():
    columns = [
        extra(truth(), correlated_sigma=1, correlation_time=0.1),
        extra(truth(), outlier_rate=1, outlier_size=1),
        receive(truth(), position_variance=1).position_error,
    ]
    assert np.abs(np.corrcoef(np.concatenate(columns, axis=1).T) - np.eye(9)).max() < 5 / np.sqrt(FIXES)


def test_a_receiver_without_fixes_has_no_errors_to_correlate():
    assert receive(truth(fixes=0), correlated_sigma=3, outlier_rate=0.5).time.size == 0


# Latency and lever arm


def turning(latitude: float = 45.0) -> Trajectory:
    """Return an aerobatic flight of 40 s: steep banks, pitching, fast turns."""
    time = np.arange(0, 40.05, 0.1)
    course = 0.5 + 0.25 * time
    speed = 60 * np.stack((np.cos(course), np.sin(course), 0.1 * np.sin(0.3 * time)), axis=-1)
    steps = np.vstack((np.zeros((1, 3)), np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1, axis=0)))
    lat, lon, height = pymap3d.ned2geodetic(*steps.T, latitude, 9.0, 500.0)
    euler = np.stack((0.9 * np.sin(0.5 * time), 0.3 * np.cos(0.4 * time), course), axis=-1)
    recording = Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=height,
        velocity_n=speed,
        euler=euler,
    )
    return Trajectory.from_recording(recording, 100)


def ecef(there: Truth) -> np.ndarray:
    """Return positions (n, 3) in the Earth frame [m]."""
    return np.stack(pymap3d.geodetic2ecef(there.latitude, there.longitude, there.height, deg=False), axis=-1)


def antenna_ecef(trajectory: Trajectory, times: np.ndarray, lever_arm: np.ndarray) -> np.ndarray:
    """Return antenna positions (n, 3) in the Earth frame, each vector taken there by pymap3d [m]."""
    there = trajectory.at(times)
    w, x, y, z = there.q_nb.T
    forward = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)))
    right = np.stack((2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)))
    down = np.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
    ned = lever_arm[0] * forward + lever_arm[1] * right + lever_arm[2] * down
    moved = pymap3d.ned2ecef(*ned, there.latitude, there.longitude, there.height, deg=False)
    return np.stack(moved, axis=-1)


LEVER_ARMS = [(3.0, 0.0, 0.0), (0.0, -2.0, 0.0), (0.5, 1.0, -4.0)]


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 45.0, 80.0])
@pytest.mark.parametrize("lever_arm", LEVER_ARMS)
def test_a_lever_arm_moves_the_position_to_the_antenna(latitude, lever_arm):
    trajectory, times = turning(latitude), np.arange(1.0, 40)
    seen = antenna(trajectory, GpsErrors(lever_arm=lever_arm), times)
    expected = antenna_ecef(trajectory, times, np.array(lever_arm))
    assert np.allclose(ecef(seen), expected, rtol=0, atol=2e-5)
    assert np.linalg.norm(expected - ecef(trajectory.at(times)), axis=1).min() > 1.9


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 45.0, 80.0])
@pytest.mark.parametrize("lever_arm", LEVER_ARMS)
def test_a_lever_arm_gives_the_antenna_the_velocity_of_its_positions(latitude, lever_arm):
    """Finite differences of the antenna's path in the Earth frame, over 2 ms."""
    trajectory, times, step = turning(latitude), np.arange(1.0, 39) + 0.003, 1e-3
    seen = antenna(trajectory, GpsErrors(lever_arm=lever_arm), times)
    after, before = (antenna_ecef(trajectory, times + sign * step, np.array(lever_arm)) for sign in (1, -1))
    velocity = (after - before) / (2 * step)
    there = trajectory.at(times)
    east_north_up = pymap3d.ecef2enuv(*velocity.T, np.degrees(there.latitude), np.degrees(there.longitude))
    east, north, up = (np.asarray(part) for part in east_north_up)
    assert np.allclose(seen.velocity_n, np.stack((north, east, -up), axis=-1), rtol=0, atol=2e-5)
    # The swing itself is a thousand times the tolerance and more.
    assert np.abs(seen.velocity_n - there.velocity_n).max() > 0.5


def test_at_rest_on_the_earth_the_antenna_does_not_move():
    """ω_ib,b of the rotating Earth alone must not swing it."""
    time = np.arange(0, 20.05, 0.1)
    parked = Recording(
        time=time,
        latitude=np.full(time.size, 0.8),
        longitude=np.full(time.size, 0.2),
        height=np.full(time.size, 100.0),
        velocity_n=np.zeros((time.size, 3)),
        euler=np.tile((0.1, -0.2, 2.0), (time.size, 1)),
    )
    still = Trajectory.from_recording(parked, 100)
    seen = antenna(still, GpsErrors(lever_arm=(50, 20, -10)), np.arange(1.0, 20))
    assert np.abs(seen.velocity_n).max() < 1e-3 * RATE * 50


@pytest.mark.parametrize("latency", [0.01, 0.2, 1.0, 2.5])
def test_a_late_fix_is_the_truth_of_its_latency_ago(latency):
    trajectory, times = turning(), np.arange(0.5, 40, 0.5)
    errors = GpsErrors(latency=latency, period=0.5, **SILENT)
    late = measure(
        trajectory.at(times), errors, GpsDraws.of(1, times.size), antenna(trajectory, errors, times)
    )
    assert np.array_equal(late.time, times[times >= latency])
    then = trajectory.at(late.time - latency)
    apart = pymap3d.geodetic2enu(*late.position.T, then.latitude, then.longitude, then.height, deg=False)
    # What remains is the white noise of 1 mm and 0.1 mm/s.
    assert np.abs(apart).max() < 0.006
    assert np.abs(late.velocity_n - then.velocity_n).max() < 6e-4


def test_across_a_pole_a_fix_is_where_the_antenna_is():
    """An IMU 11 m from the pole, an antenna 11 m beyond it: half a turn of longitude apart."""
    imu, seen = (truth(90 - 1e-4, 5, longitude) for longitude in (-73.7, 106.3))
    fixes = measure(imu, GpsErrors(**SILENT), GpsDraws.of(1, 5), seen)
    place = np.stack(pymap3d.geodetic2ecef(*fixes.position.T, deg=False), axis=-1)
    # What remains is the white noise of 1 mm.
    assert np.allclose(place, ecef(seen), rtol=0, atol=0.006)
    assert np.linalg.norm(fixes.position_error, axis=1) == pytest.approx(22.3, abs=0.1)


def test_a_reported_error_counts_from_where_the_imu_is_now():
    trajectory, times = turning(), np.arange(1.0, 40)
    errors = GpsErrors(latency=0.3, lever_arm=(1, 2, -3), correlated_sigma=2)
    there = trajectory.at(times)
    fixes = measure(there, errors, GpsDraws.of(1, times.size), antenna(trajectory, errors, times))
    assert np.allclose(in_metres(fixes, there), fixes.position_error, atol=2e-4)
    east, north, up = fixes.velocity_error.T
    assert np.allclose(fixes.velocity_n - there.velocity_n, np.stack((north, east, -up), axis=-1), atol=1e-12)
    assert np.abs(fixes.position_error).max() > 15


def test_more_latency_keeps_the_noise_of_each_fix():
    trajectory, times = turning(), np.arange(1.0, 40)
    noise = []
    for latency in (0.0, 0.9, 1.1):
        errors = GpsErrors(latency=latency)
        seen = antenna(trajectory, errors, times)
        fixes = measure(trajectory.at(times), errors, GpsDraws.of(1, times.size), seen)
        late = fixes.time >= 2
        noise.append((fixes.velocity_n - trajectory.at(fixes.time - latency).velocity_n)[late])
    assert np.allclose(noise[0], noise[1], atol=1e-12)
    assert np.allclose(noise[0], noise[2], atol=1e-12)
