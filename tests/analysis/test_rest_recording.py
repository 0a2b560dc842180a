"""Rest recordings as people have them: lost samples, stamps that jitter, polling, knocks and turns."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lab.analysis import rest
from lab.missions import MissionError

CASES = Path(os.environ.get("INS_LAB_CASES", Path(__file__).parents[3] / "shared" / "cases"))
GYRO, FORCE = 0.005, 1e-3
"""White noise [°/s/√Hz] and [m/s²/√Hz]."""
Damage = Callable[[np.random.Generator, np.ndarray, float], np.ndarray]


def _recording(rng: np.random.Generator, samples: int, dt: float) -> np.ndarray:
    rate = GYRO / np.sqrt(dt) * rng.standard_normal((samples, 3)) + (0.1, -0.2, 0.3)
    force = FORCE / np.sqrt(dt) * rng.standard_normal((samples, 3)) - (0, 0.1, 9.8)
    return np.column_stack((dt * np.arange(samples), rate, force))


def _read(
    path: Path, table: np.ndarray, names: str = "t_s,gx_deg_s,gy_deg_s,gz_deg_s,fx_m_s2,fy_m_s2,fz_m_s2"
):
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.9g")
    return rest.read_log(path)


def _lost(rng: np.random.Generator, table: np.ndarray, _dt: float) -> np.ndarray:
    return np.delete(table, [1301, *range(3000, 3020)], axis=0)


def _jitter(rng: np.random.Generator, table: np.ndarray, dt: float) -> np.ndarray:
    table[:, 0] += dt * rng.uniform(-0.3, 0.3, len(table))
    return _lost(rng, table, dt)


def _bursts(_rng: np.random.Generator, table: np.ndarray, dt: float) -> np.ndarray:
    table[:, 0] = np.ceil(table[:, 0] / (10 * dt) - 1e-9) * 10 * dt + np.arange(len(table)) % 10 * dt * 0.01
    return table


def _polled(ratio: float) -> Damage:
    def repeat(_rng: np.random.Generator, table: np.ndarray, _dt: float) -> np.ndarray:
        time = np.linspace(table[0, 0], table[-1, 0], int(len(table) * ratio))
        held = table[np.searchsorted(table[:, 0], time, side="right") - 1]
        held[:, 0] = time
        return held

    return repeat


def _knock(rng: np.random.Generator, table: np.ndarray, _dt: float) -> np.ndarray:
    table[5000:5010, 1:] += rng.standard_normal((10, 6)) * (20, 20, 20, 3, 3, 3)
    return table


def _turn(_rng: np.random.Generator, table: np.ndarray, dt: float) -> np.ndarray:
    turning = np.s_[5000 : 5000 + round(3 / dt)]
    table[turning, 3] += 30
    table[5000:, 4] += 0.3
    return table


def _set_back(_rng: np.random.Generator, table: np.ndarray, _dt: float) -> np.ndarray:
    table[6000:, 0] -= 0.192
    return table


def _empty_cell(_rng: np.random.Generator, table: np.ndarray, _dt: float) -> np.ndarray:
    table[700, 5] = np.nan
    return table


@pytest.mark.parametrize("dt", [0.1, 0.01])
@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_lost, "21 samples in 2 gaps are missing"),
        (_jitter, "jitter"),
        (_bursts, "jitter"),
        (_polled(1.37), "rows repeat the one before"),
        (_polled(2.0), "rows repeat the one before"),
        (_knock, "was knocked or turned"),
        (_turn, "level of the accelerometers changed"),
        (_set_back, "set back by 0.192 s"),
        (_empty_cell, "1 row without a number"),
    ],
)
def test_noise_is_right_in_a_recording_with_faults(
    damage: Damage, said: str, dt: float, tmp_path: Path
) -> None:
    """σ of white noise from 10,000 samples is 0.7 %, and of the half of them 1 %."""
    rng = np.random.default_rng(8)
    records = _read(tmp_path / "a.csv", damage(rng, _recording(rng, 10_000, dt), dt))
    terms = rest.noise_terms(records)
    assert np.degrees(terms["gyro"].N) == pytest.approx([GYRO] * 3, rel=0.045)
    assert pytest.approx([FORCE] * 3, rel=0.045) == terms["accelerometer"].N
    assert records["gyro"].dt == pytest.approx(dt, rel=0.01)
    assert said in " ".join(records.remarks)
    assert "low-pass" not in rest.about_fit(terms)


def test_samples_of_few_steps_are_no_polling_and_too_few_steps_show_no_noise(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    table = _recording(rng, 10_000, 0.01)
    table[:, 1:4] = 0.05 * np.round(table[:, 1:4] / 0.05)  # a step of one σ
    records = _read(tmp_path / "a.csv", table)
    assert len(records["gyro"].rates) == 10_000
    table[:, 1:4] = 0.3 * np.round(table[:, 1:4] / 0.3)  # of six
    terms = rest.noise_terms(_read(tmp_path / "a.csv", table))
    assert np.isnan(terms["gyro"].N).any()
    assert "rounded too coarsely" in rest.about_fit(terms)
    card = rest.card_of("coarse", {"gyro": _read(tmp_path / "a.csv", table)["gyro"]} | {
        "accelerometer": records["accelerometer"]
    }, "a.csv")  # fmt: skip
    assert "noise_density" not in card.terms["gyro"]


def test_accelerometers_alone_and_a_long_gap(tmp_path: Path) -> None:
    rng = np.random.default_rng(10)
    table = _recording(rng, 10_000, 0.01)[:, [0, 4, 5, 6]]
    table[7000:, 0] += 1024 * 7 * 86400  # a week number of ten bits
    records = _read(tmp_path / "a.csv", table, "t_s,fx_m_s2,fy_m_s2,fz_m_s2")
    assert set(records) == {"accelerometer"}
    assert records["accelerometer"].duration == pytest.approx(70, abs=3)
    assert "the longest piece" in " ".join(records.remarks)


@pytest.mark.skipif(not CASES.is_dir(), reason=f"no cases at {CASES} (INS_LAB_CASES)")
@pytest.mark.parametrize("case", ["04", "06", "08"])
def test_the_cases_have_the_noise_that_they_say(case: str) -> None:
    for path in sorted(next(CASES.glob(f"{case}-*")).glob("*.csv")):
        terms = rest.noise_terms(rest.read_log(path))
        assert np.degrees(terms["gyro"].N) == pytest.approx([GYRO] * 3, rel=0.05), path
        if "accelerometer" in terms:
            assert pytest.approx([FORCE] * 3, rel=0.05) == terms["accelerometer"].N, path


def test_a_flight_is_no_rest(tmp_path: Path) -> None:
    table = _recording(np.random.default_rng(11), 5000, 0.01)
    table[1000:4500, 1] += 20 * np.sin(0.02 * np.arange(3500))
    with pytest.raises(MissionError, match="at rest"):
        _read(tmp_path / "a.csv", table)
