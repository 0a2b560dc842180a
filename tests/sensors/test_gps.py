"""GPS: variances by axis, frames and metres, times and outages."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from lab.sensors.gps import GpsDraws, GpsErrors, GpsFixes, fix_times, measure
from lab.trajectory import Truth

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
    [(1, 205.04, 205), (0.3, 10, 33), (0.1, 10, 100), (60, 59.9, 0), (5, 5, 1)],
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
