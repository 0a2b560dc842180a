"""Gap noise: the spread of the motion about a gap over its length, whatever happens elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from lab.navigation.log_navigation import AROUND, gap_noise
from lab.navigation.solution import Imu

STEP = 0.01


def turning(amplitude: float, seconds: float = 60.0) -> Imu:
    """Return increments of a rate about x that swings at 1 Hz [rad/s]; ten times more from 40 s on."""
    time = np.arange(round(seconds / STEP) + 1) * STEP
    rate = amplitude * np.sin(2 * np.pi * time[1:]) * np.where(time[1:] > 40, 10, 1)
    dtheta = np.zeros((rate.size, 3))
    dtheta[:, 0] = rate * STEP
    return Imu(time, dtheta, np.zeros((rate.size, 3)))


@pytest.mark.parametrize("length", [0.1, 1.0])
def test_it_is_the_variance_about_the_gap_times_its_length(length):
    noise = gap_noise(turning(0.2), 20.0, 20.0 + length)
    # The variance of a sine is half the square of its amplitude; the window holds whole periods.
    assert noise[0] == pytest.approx(0.2**2 / 2 * length, rel=0.02)
    assert (noise[1:] == 0).all()


def test_motion_that_begins_in_the_gap_counts():
    quiet, begins = gap_noise(turning(0.2), 30.0, 31.0)[0], gap_noise(turning(0.2), 39.5, 40.5)[0]
    assert begins > 20 * quiet
    assert gap_noise(turning(0.2), 40 - AROUND - 1.5, 40 - AROUND - 0.5)[0] == pytest.approx(quiet, rel=0.02)


def test_a_gap_at_an_end_of_the_log_has_a_noise():
    imu = turning(0.2)
    for start, end in ((-1.0, 0.02), (0.0, 0.03), (59.97, 60.0)):
        assert np.isfinite(gap_noise(imu, start, end)).all()
