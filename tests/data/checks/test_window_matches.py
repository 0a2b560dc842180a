"""Matches of a log in other axes are those of its samples turned, and none is computed twice."""

from __future__ import annotations

import numpy as np
import pytest
from copter_logs import copter
from scipy.spatial.transform import Rotation

from lab.data.checks import window_matches
from lab.data.checks.velocity_matching import Window, choose_liveliest, match
from lab.data.checks.window_matches import WindowMatches

QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter of a turn about the vertical."""
ANY = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
SWAPPED = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@pytest.fixture(scope="module")
def windows() -> list[Window]:
    """Return the windows of a copter whose gyros have biases."""
    flown = copter(60)
    dt = np.diff(flown.imu[:, 0])[:, None]
    velocity_n = flown.gnss[:, 4:7]
    bias = np.array([0.01, -0.02, 0.005])
    found = choose_liveliest(
        (
            flown.imu[:, 0] - flown.imu[0, 0],
            (flown.imu[1:, 1:4] + bias) * dt,
            flown.imu[1:, 4:7] * dt,
            flown.gnss[:, 0] - flown.imu[0, 0],
            velocity_n,
            np.full_like(velocity_n, 0.1),
        ),
        2,
    )
    assert len(found) == 2
    return found


def in_axes(window: Window, gyros, forces) -> Window:
    return window._replace(dtheta=window.dtheta @ gyros.T, dvelocity=window.dvelocity @ forces.T)


@pytest.mark.parametrize("C", [np.eye(3), QUARTER, QUARTER @ QUARTER, ANY])
def test_a_match_in_other_axes_is_that_of_the_samples_turned(windows, C):
    turned = WindowMatches(windows).turned(QUARTER).turned(C @ QUARTER.T)
    for number, window in enumerate(windows):
        expected, found = match(in_axes(window, C, C), lags=(0.0,)), turned.match(number)
        assert (expected.C_nb.inv() * found.C_nb).magnitude() < 1e-6
        np.testing.assert_allclose(found.gyro_bias, expected.gyro_bias, rtol=0, atol=1e-6)
        assert found.misfit == pytest.approx(expected.misfit, rel=1e-4)
        assert found.lag == pytest.approx(expected.lag, abs=1e-4)
        assert found.heading_sigma == pytest.approx(expected.heading_sigma, rel=1e-3)
        if C is not ANY:  # the σ of turned axes leaves out how the axes belong together
            np.testing.assert_allclose(found.gyro_bias_sigma, expected.gyro_bias_sigma, rtol=1e-3)
        np.testing.assert_array_equal(
            turned.windows[number].dtheta, window.dtheta @ QUARTER.T @ (C @ QUARTER.T).T
        )


@pytest.mark.parametrize("C", [QUARTER, QUARTER.T])
@pytest.mark.parametrize("gyros", [np.eye(3), SWAPPED, np.diag([1.0, 1.0, -1.0])])
def test_a_misfit_with_other_gyros_is_that_of_the_samples_turned(windows, C, gyros):
    first = WindowMatches(windows)
    other = WindowMatches([in_axes(one, C, C) for one in windows])
    for number in range(2):
        assert first.turned(C).misfit(number, gyros) == pytest.approx(other.misfit(number, gyros), rel=1e-3)
        forces = np.diag([-1.0, 1.0, 1.0])
        assert first.turned(C).misfit(number, forces=forces) == pytest.approx(
            other.misfit(number, forces=forces), rel=1e-3
        )


def test_no_match_is_computed_twice(windows, monkeypatch):
    count = 0

    def counted(*arguments, **options):
        nonlocal count
        count += 1
        return match(*arguments, **options)

    monkeypatch.setattr(window_matches, "match", counted)
    first = WindowMatches(windows)
    for one in (first, first.turned(QUARTER), first.turned(QUARTER.T)):
        one.match(0)
        one.misfit(0)
        one.misfit(0, np.diag([1.0, 1.0, -1.0]))
    assert count == 3
