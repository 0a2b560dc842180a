"""Vibration of known size and frequency, and noise without a line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lab.analysis.vibration import SLOWEST, vibration

DT = 0.005


@pytest.mark.parametrize("frequency", [7.3, 41.0, 88.0])
def test_a_line_has_its_frequency_and_its_size(frequency: float) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(20_000) * DT
    rates = 0.01 * rng.normal(size=(t.size, 3))
    rates[:, 1] += 2.0 * np.sin(2 * math.pi * frequency * t)
    found = vibration(rates, DT)
    assert found is not None
    assert found.line == pytest.approx(frequency, abs=1 / (512 * DT))
    assert found.rms == pytest.approx(2.0 / math.sqrt(2), rel=0.02)
    assert found.part > 0.98


def test_white_noise_has_the_power_of_its_band_and_no_line() -> None:
    lines = 0
    for seed in range(20):
        rates = np.random.default_rng(seed).normal(scale=0.3, size=(12_000, 3))
        found = vibration(rates, DT)
        assert found is not None
        band = 1 - SLOWEST / found.highest
        assert found.rms == pytest.approx(0.3 * math.sqrt(3 * band), rel=0.03)
        lines += not math.isnan(found.line)
    assert lines == 0


def test_slow_motion_is_no_vibration() -> None:
    t = np.arange(20_000) * DT
    rates = np.stack([3.0 * np.sin(2 * math.pi * f * t) for f in (0.2, 0.5, 1.0)], axis=-1)
    found = vibration(rates, DT)
    assert found is not None
    assert found.rms < 0.01


def test_slow_samples_show_none() -> None:
    assert vibration(np.zeros((5000, 3)), 0.06) is None
    assert vibration(np.zeros((100, 3)), DT) is None


def test_a_dead_sensor_has_none() -> None:
    found = vibration(np.zeros((5000, 3)), DT)
    assert found is not None
    assert found.rms == 0
