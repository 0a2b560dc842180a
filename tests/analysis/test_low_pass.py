"""Low-pass: found in simulated sensors with filters of `scipy.signal`, and never in those without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from lab.analysis import allan, low_pass, rest

DT = 0.01


def _noise(seed: int, samples: int, flicker: float = 0.0, walk: float = 0.0) -> np.ndarray:
    """Return white noise of density 1 with flicker B and random walk K: B²/(2πf) and K²/(2πf)²."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(samples, DT)
    f[0] = np.inf
    shape = np.sqrt(1 + flicker**2 / (2 * np.pi * f) + walk**2 / (2 * np.pi * f) ** 2)
    spectrum = np.fft.rfft(rng.standard_normal((samples, 3)), axis=0) * shape[:, None]
    return np.fft.irfft(spectrum, samples, axis=0) / np.sqrt(DT)


def _smoothing(cut: float) -> tuple[list[float], list[float]]:
    a = np.exp(-2 * np.pi * cut)
    return [1 - a], [1, -a]


FILTERS = {
    "first order 0.05": _smoothing(0.05),
    "first order 0.2": _smoothing(0.2),
    "first order 0.4": _smoothing(0.4),
    "bilinear 0.15": signal.butter(1, 0.3),
    "second order 0.1": signal.butter(2, 0.2),
    "second order 0.3": signal.butter(2, 0.6),
    "second order 0.4": signal.butter(2, 0.8),
}


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("flicker", [0.0, 0.3])
def test_white_noise_before_a_filter_is_right_and_its_sigma_covers_it(name: str, flicker: float) -> None:
    """Chance exceeds 3.5 σ once in 2,000; 14 sets of six values are tested."""
    for seed in range(2):
        rates = signal.lfilter(*FILTERS[name], _noise(seed, 21_000, flicker), axis=0)[1000:]
        terms = rest.noise_terms({"gyro": rest.Record(rates, DT)})["gyro"]
        assert terms.low_pass is not None
        assert terms.low_pass.explains
        assert pytest.approx([1.0] * 3, rel=0.05) == terms.N
        assert (np.abs(terms.N - 1) < 3.5 * terms.N_sigma).all()


@pytest.mark.parametrize(
    ("flicker", "walk"),
    [
        (0, 0),
        (1, 0.5),
        *(
            pytest.param(*one, marks=pytest.mark.proof)
            for one in [(0.3, 0), (1, 0), (3, 0), (0, 0.1), (0, 2)]
        ),
    ],
)
def test_a_sensor_without_a_filter_is_never_said_to_have_one(flicker: float, walk: float) -> None:
    for seed, samples in enumerate((300, 1000, 3000, 10_000)):
        noise = _noise(seed, samples, flicker, walk)
        assert low_pass.find(noise, DT).low_pass is None
        assert low_pass.find(5 * np.round(noise / 5), DT).low_pass is None
        warm = 1e3 * np.exp(-np.arange(samples) / samples * 5)[:, None]
        assert low_pass.find(noise + warm, DT).low_pass is None


def test_a_line_of_vibration_is_no_filter() -> None:
    for line in (0.03, 0.1, 0.23):
        rates = _noise(1, 20_000) + 30 * np.sin(2 * np.pi * line * np.arange(20_000))[:, None]
        assert low_pass.find(rates, DT).low_pass is None


@pytest.mark.parametrize(
    "taps", [(np.ones(3) / 3, [1.0]), signal.butter(4, 0.4)], ids=["mean of three", "fourth order"]
)
def test_a_filter_of_another_shape_leaves_long_averaging_times(taps: tuple[np.ndarray, np.ndarray]) -> None:
    rates = signal.lfilter(*taps, _noise(3, 101_000), axis=0)[1000:]
    terms = rest.noise_terms({"gyro": rest.Record(rates, DT)})["gyro"]
    assert terms.low_pass is not None
    assert not terms.low_pass.explains
    assert pytest.approx([1.0] * 3, rel=0.05) == terms.N
    assert "low-pass" in rest.about_fit({"gyro": terms})


def test_undoing_a_filter_gives_the_noise_before_it() -> None:
    """The deviation is that of the white noise that went in, also at one sample."""
    white = _noise(4, 50_000)
    rates = signal.lfilter(*_smoothing(0.1), white, axis=0)
    found = low_pass.find(rates, DT).low_pass
    assert found is not None
    assert found.cut_off == pytest.approx(0.1 / DT, rel=0.03)
    before = allan.deviation(found.undone(rates, DT), DT)
    assert before.deviation[:10] == pytest.approx(allan.deviation(white, DT).deviation[:10], rel=0.03)
