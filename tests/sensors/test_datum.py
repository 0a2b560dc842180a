"""Datum: one-sided and two-sided densities of white noise, simulated and estimated by others."""

from __future__ import annotations

import allantools
import numpy as np
import pytest
from scipy import signal

from lab.sensors import cards, imu
from lab.sensors.datum import ONE_SIDED, TWO_SIDED, Datum
from lab.sensors.imu_errors import GyroErrors

RATE = 200.0
SAMPLES = 2**17


def _noise(datum: Datum) -> np.ndarray:
    """Return the rates of gyros at rest with the noise of a card's datum alone (n, 3) [°/s]."""
    errors = GyroErrors(noise_density=datum.in_unit("°/s/√Hz"), bias_sigma=0.0, range=10000.0)
    draws = imu.ImuDraws.of(7, "gyro", SAMPLES, instability=False)
    measured = imu.measure(np.zeros((SAMPLES, 3)), 1 / RATE, errors, draws)
    return np.degrees(measured.increments * RATE)


def _one_sided(rates: np.ndarray) -> float:
    """Return the root of the one-sided spectral density that Welch's method finds [°/s/√Hz]."""
    frequency, density = signal.welch(rates, RATE, nperseg=1024, axis=0, return_onesided=True)
    inside = (frequency > 1) & (frequency < 0.95 * RATE / 2)
    return float(np.sqrt(density[inside].mean()))


def _walk(rates: np.ndarray) -> float:
    """Return the Allan deviation at one second that allantools finds [°/√s]."""
    found = [
        allantools.oadev(axis, rate=RATE, data_type="freq", taus=np.array([1.0]))[1][0] for axis in rates.T
    ]
    return float(np.sqrt(np.mean(np.square(found))))


@pytest.mark.parametrize(
    ("datum", "density", "walk"),
    [
        (Datum(0.01, "°/s/√Hz", "sheet", ONE_SIDED), 0.01, 0.01 / np.sqrt(2)),
        (Datum(36.0, "°/h/√Hz", "sheet", ONE_SIDED), 0.01, 0.01 / np.sqrt(2)),
        (Datum(0.01, "°/s/√Hz", "sheet", TWO_SIDED), 0.01 * np.sqrt(2), 0.01),
        (Datum(0.01, "°/s/√Hz", "sheet"), 0.01 * np.sqrt(2), 0.01),
        (Datum(0.6, "°/√h", "sheet"), 0.01 * np.sqrt(2), 0.01),
    ],
)
def test_simulated_noise_has_the_density_of_the_sheet(datum: Datum, density: float, walk: float) -> None:
    """A sheet's one-sided density is what a spectrum shows, its random walk what an Allan deviation shows."""
    rates = _noise(datum)
    assert _one_sided(rates) == pytest.approx(density, rel=0.01)
    assert _walk(rates) == pytest.approx(walk, rel=0.03)
    band = signal.sosfilt(signal.butter(8, 20.0, fs=RATE, output="sos"), rates, axis=0)[1000:]
    assert band.std() == pytest.approx(density * np.sqrt(20.0), rel=0.03)  # rms in a band of 20 Hz


def test_a_sheet_that_has_both_agrees_with_itself() -> None:
    """0.05 °/s in 100 Hz and 0.005 °/s/√Hz of the MPU-6000; an Allan deviation of one has 0.003 °/√s."""
    datum = cards.card("MPU-6000").terms["gyro"]["noise_density"]
    rates = _noise(datum)
    band = signal.sosfilt(signal.butter(8, 50.0, fs=RATE, output="sos"), rates, axis=0)[1000:]
    assert band.std() * np.sqrt(100 / 50) == pytest.approx(0.05, rel=0.03)
    assert 0.003 < _walk(rates) < 0.004


@pytest.mark.parametrize(
    ("datum", "words"),
    [
        (Datum(1.0, "°/s/√Hz", "sheet", ONE_SIDED), ONE_SIDED),
        (Datum(1.0, "µg/√Hz", "sheet"), "not stated, taken as two-sided"),
        (Datum(1.0, "°/√h", "sheet"), ""),
        (Datum(1.0, "°/h", "sheet"), ""),
    ],
)
def test_the_convention_is_said_where_there_are_two(datum: Datum, words: str) -> None:
    assert datum.convention == words


def test_the_setting_says_which_convention_it_has() -> None:
    for declared in (GyroErrors, imu.AccelerometerErrors):
        assert "two-sided" in declared.param["noise_density"].doc
