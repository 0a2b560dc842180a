"""Two clocks of a simulated drive, whose ratio is known, and drives with one clock."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.clock.two_clocks import clock_rate


def _drive(seed: int, seconds: float, rate: float, offset: float):
    """Return a drive at 12 m/s with turns; the IMU has axes askew, and its gyros have a bias."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, 0.02)
    turning = 0.2 * np.sin(time / 3) * np.sin(time / 17) + 0.1 * np.sin(time / 7.3)
    course = np.concatenate(([0.0], np.cumsum(turning[:-1] * 0.02)))
    axis = np.array((0.6, 0.0, 0.8))
    dtheta = np.outer(np.diff(course), axis) + 1e-5 * rng.standard_normal((time.size - 1, 3)) + 1e-5
    fixes = np.arange(1.0, seconds - 1)
    heading = np.interp(fixes, time, course)
    velocity = 12 * np.column_stack((np.cos(heading), np.sin(heading), 0 * heading))
    velocity += 0.05 * rng.standard_normal(velocity.shape)
    return time * (1 + rate) + offset, dtheta, fixes, np.zeros_like(velocity), velocity


@pytest.mark.parametrize(("rate", "seconds"), [(0.01, 120), (-0.02, 300), (0.003, 600), (0.001, 1500)])
def test_the_ratio_of_two_clocks_is_found(rate: float, seconds: float) -> None:
    found = clock_rate(*_drive(1, seconds, rate, 0.3))
    assert found is not None
    assert found.ratio == pytest.approx(1 + rate, abs=4 * found.sigma)
    assert found.sigma < abs(rate) / 6
    assert f"{found.ratio:.4f}" in found.remark
    assert ("fast" if rate > 0 else "slow") in found.remark


@pytest.mark.parametrize("offset", [-0.7, 0.0, 0.4])
def test_one_clock_is_said_to_be_no_two(offset: float) -> None:
    for seed, seconds in enumerate((60, 120, 600)):
        assert clock_rate(*_drive(seed, seconds, 0.0, offset)) is None


def test_a_straight_or_senseless_drive_says_nothing() -> None:
    time, dtheta, fixes, position, velocity = _drive(2, 120, 0.01, 0.0)
    assert clock_rate(time, dtheta, fixes, position, np.tile((12.0, 0, 0), (fixes.size, 1))) is None
    assert clock_rate(time, dtheta, fixes, position, np.zeros_like(velocity)) is None
    assert clock_rate(time, np.zeros_like(dtheta), fixes, position, velocity) is None
    assert clock_rate(time, dtheta, fixes[::-1], position, velocity) is None
    assert clock_rate(time[:2], dtheta[:1], fixes[:0], position[:0], velocity[:0]) is None
