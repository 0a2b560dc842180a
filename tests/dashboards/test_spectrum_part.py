"""The live spectrum: the level of white noise, a line at its frequency, nothing across a gap."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.pages.live.spectrum_part import LENGTH, recent_spectrum
from lab.data.clock.timed_samples import TIMED_IMU
from lab.live.stream_statistics import SEGMENT
from lab.sensors.suite import TRIADS, SensorSuite
from lab.views.twin_comparison import promised_density

RATE = 200.0
DENSITY = 3e-4
"""Noise density of the gyros, two-sided as that of the settings [rad/√s]."""


@pytest.fixture
def imu() -> np.ndarray:
    """Return samples with white noise, and a vibration of 0.2 m/s² along the second axis at 40 Hz."""
    rows = np.zeros(round(LENGTH * RATE), TIMED_IMU)
    rows["time"] = np.arange(len(rows)) / RATE
    rows["rate"] = DENSITY * np.sqrt(RATE) * np.random.default_rng(1).standard_normal((len(rows), 3))
    rows["force"][:, 1] = 0.2 * np.sin(2 * np.pi * 40 * rows["time"])
    return rows


def test_the_level_is_that_of_the_settings_and_a_line_stands_at_its_frequency(imu: np.ndarray) -> None:
    found = recent_spectrum(imu)
    sensors = SensorSuite()
    sensors.gyro.update({"flicker": 0.0, "rate_random_walk": 0.0, "quantisation": 0.0})
    sensors.gyro.noise_density = (float(np.degrees(DENSITY)),) * 3
    promised = promised_density(sensors, "gyro", found.frequency)
    ratio = found.density["gyro"][2:-2].mean() / promised[2:-2].mean()
    assert ratio == pytest.approx(1, abs=0.05)  # 200 frequencies of 19 pieces of three axes
    assert found.frequency[found.density["accelerometer"][:, 1].argmax()] == pytest.approx(40)
    # What a line has in power is the mean square of the vibration.
    power = found.density["accelerometer"][:, 1].sum() * found.frequency[1]
    assert power == pytest.approx(0.2**2 / 2, rel=0.02)


def test_settings_promise_flicker_and_random_walk_at_low_frequencies() -> None:
    frequency = np.array([0.0, 0.1, 1.0, 100.0])
    sensors = SensorSuite()
    for triad in TRIADS:
        flat = promised_density(sensors, triad, frequency)
        sensors.groups()[triad].set("rate_random_walk", (5.0, 5.0, 5.0))
        steep = promised_density(sensors, triad, frequency) - flat
        assert np.isfinite(steep).all()
        np.testing.assert_allclose(steep[1] / steep[2], 100.0)  # f⁻²


def test_no_spectrum_across_a_gap(imu: np.ndarray) -> None:
    imu["gap"][-round(1.5 * SEGMENT * RATE)] = True
    with pytest.raises(ValueError, match="too short"):
        recent_spectrum(imu)
    with pytest.raises(ValueError, match="too short"):
        recent_spectrum(imu[:0])
