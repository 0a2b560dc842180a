"""A heading error is named from the innovations of a velocity, of a filter whose heading is known."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.analysis.verdicts.foreign_evidence import measure_innovations
from lab.analysis.verdicts.foreign_motion import heading_error, of_heading
from lab.data.files.ardupilot import open_log
from lab.data.files.streams import TIME as TIMES
from lab.data.log.filter_log import Measured, innovations_of
from lab.data.log.sensor_log import GnssLog
from lab.experiment.judged_log import judge

ROOT = Path(__file__).parents[2]

PERIOD = 0.2
TIME = PERIOD * np.arange(900)
NOISE = 0.1


def innovations(
    seed: int, *, heading: float = 0.0, scale: float = 0.0, late: int = 0, q: float = 1.0, r: float = 1.0
) -> tuple[object, GnssLog]:
    """Return innovations of a filter that turns and scales the acceleration, and the fixes of its log.

    Its velocity is corrected by fixes that are late by some periods; it believes q and r times the variances.
    """
    rng = np.random.default_rng(seed)
    phase = 0.15 * TIME + 2 * np.sin(0.05 * TIME)
    truth = np.column_stack((15 * np.cos(phase), 15 * np.sin(phase)))
    gained = np.diff(truth, axis=0, prepend=truth[:1])
    turned = (
        (1 + scale)
        * gained
        @ np.array(((np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))))
    )
    drift = 0.02 * rng.normal(size=truth.shape)
    seen = truth[np.maximum(np.arange(len(TIME)) - late, 0)] + NOISE * rng.normal(size=truth.shape)
    x, P, found, variances = truth[0], 0.1, [], []
    for gain, noise, fix in zip(turned, drift, seen, strict=True):
        x, P = x + gain + noise, P + q * 0.02**2
        S = P + r * NOISE**2
        found.append(x - fix)
        variances.append(np.full(2, S))
        x, P = x - P / S * (x - fix), P * r * NOISE**2 / S
    one = innovations_of(
        Measured("GPS velocity", ("north", "east"), "m/s"), TIME, np.array(found), "made",
        variance=np.array(variances),
    )  # fmt: skip
    assert one is not None
    three = np.column_stack((seen, np.zeros(len(TIME))))
    gnss = GnssLog(
        TIME, np.zeros_like(three), three, np.ones_like(three), np.ones_like(three), np.zeros(3), 0.0
    )
    return measure_innovations(one), gnss


@pytest.mark.parametrize("degrees", [-30.0, 15.0])
def test_a_wrong_heading_is_named_with_its_size(degrees: float) -> None:
    for seed in range(20):
        one, gnss = innovations(seed, heading=np.radians(degrees))
        found = heading_error(one, gnss, 0.0)
        assert found is not None
        assert 0.45 < np.degrees(found.size) / abs(degrees) < 2.0
        (named,) = of_heading(one, gnss, 0.0)
        assert "the heading was off" in named.finding.sentence
        assert "innovations" in named.finding.evidence


@pytest.mark.parametrize(
    "fault", [{}, {"scale": 0.05}, {"late": 1}, {"late": 2}, {"q": 0.1}, {"q": 10.0}, {"r": 0.1}, {"r": 10.0}]
)
def test_nothing_else_is_called_a_heading_error(fault: dict[str, float]) -> None:
    assert not any(of_heading(*innovations(seed, **fault), 0.0) for seed in range(40))


def test_straight_motion_shows_no_heading() -> None:
    one, gnss = innovations(1, heading=0.5)
    gnss.velocity_n[:] = gnss.velocity_n[0] + NOISE * np.random.default_rng(1).normal(size=(len(TIME), 3))
    assert heading_error(one, gnss, 0.0) is None


@pytest.mark.filterwarnings("error")
def test_damaged_fixes_and_innovations_of_zero_show_no_heading() -> None:
    one, gnss = innovations(1, heading=0.5)
    still = replace(gnss, time=np.zeros(len(TIME)))
    fast = replace(gnss, time=1e-7 * TIME)
    unknown = replace(gnss, velocity_n=np.full((len(TIME), 3), np.nan))
    for other in (still, fast, unknown):
        assert heading_error(one, other, 0.0) is None
    zero = replace(one.innovations, values=0 * one.innovations.values, normalised=0 * one.innovations.values)
    assert heading_error(replace(one, innovations=zero), gnss, 0.0) is None


def test_a_real_log_whose_simulator_logged_the_true_heading() -> None:
    """ArduPilot's simulator wrote the truth beside its filter, whose heading was off by 10.7° at first."""
    path = Path(os.environ.get("INS_LAB_LOGS", ROOT.parent / "shared" / "logs")) / "copter_delorean_92.bin"
    if not path.is_file():
        pytest.skip("no real logs here: name their folder in INS_LAB_LOGS")
    _, times = open_log(path, ("ATT", "SIM"))
    stated, truth = times.of("ATT"), times.of("SIM")
    assert stated is not None
    assert truth is not None
    true = np.interp(stated[TIMES], truth[TIMES], np.unwrap(np.radians(truth["Yaw"])))
    off = np.abs(np.angle(np.exp(1j * (np.radians(stated["Yaw"]) - true))))
    found = judge(path).verdict.findings
    assert [one.quantity for one in found] == ["heading"]
    assert found[0].factor == pytest.approx(off.max(), rel=1.0)
    assert off.max() > np.radians(10)
