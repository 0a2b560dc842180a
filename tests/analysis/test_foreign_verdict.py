"""The verdict on a filter that is not ours, on filters whose Q and R are known.

The filter here is the textbook's of a random walk, independent of the lab's navigator: its state moves by
noise of variance 1 from fix to fix, and it believes a Q and an R of its own.
"""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.verdicts.foreign_track import compare_positions, jumps
from lab.analysis.verdicts.foreign_verdict import ForeignVerdict, judge_foreign
from lab.data.log.filter_log import Event, FilterLog, Lane, Measured, Track, innovations_of
from lab.data.log.sensor_log import GnssLog
from lab.motion.frames.displacement import displaced

COUNT = 400
TIME = np.arange(COUNT) * 1.0
SEEDS = 100


def filtered(
    rng: np.random.Generator, q: float = 1.0, r: float = 1.0, errors: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return innovations (n, 2) and variances of two filters of a random walk that believe q and r.

    `errors` are those of the fixes, by default white with variance 1.
    """
    truth = np.cumsum(rng.normal(size=(COUNT, 2)), axis=0)
    measured = truth + (rng.normal(size=truth.shape) if errors is None else errors)
    x, P = np.zeros(2), 10.0
    innovations, variances = np.empty((COUNT, 2)), np.empty((COUNT, 2))
    for k in range(COUNT):
        P += q
        innovations[k], variances[k] = x - measured[k], P + r
        x, P = x - P / (P + r) * innovations[k], P * r / (P + r)
    return innovations, variances


def log_of(
    innovations: np.ndarray, variances: np.ndarray, *, gate: float = 0.0, events: tuple[Event, ...] = (),
    track: Track | None = None,
) -> FilterLog:  # fmt: skip
    ratio = (innovations**2 / variances).max(axis=1) / gate**2 if gate else None
    one = innovations_of(
        Measured("GPS position", ("north", "east"), "m"),
        TIME,
        innovations,
        "made",
        variance=variances,
        ratio=ratio,
    )
    assert one is not None
    return FilterLog("made", "a filter", (Lane("filter", (one,), track),), events=events, fusing=0.0)


def verdict(seed: int, q: float = 1.0, r: float = 1.0, errors: np.ndarray | None = None) -> ForeignVerdict:
    return judge_foreign(log_of(*filtered(np.random.default_rng(seed), q, r, errors)))


def test_a_matched_filter_is_hardly_ever_accused() -> None:
    accused = [seed for seed in range(4 * SEEDS) if verdict(seed).verdict.findings]
    assert len(accused) <= 0.02 * 4 * SEEDS


@pytest.mark.parametrize(
    ("q", "r", "quantity", "direction"),
    [(0.1, 1.0, "Q", "too small"), (1.0, 0.1, "R", "too small"), (10.0, 1.0, "Q", "too large")],
)
def test_q_and_r_are_told_apart(q: float, r: float, quantity: str, direction: str) -> None:
    named = wrong = 0
    for seed in range(SEEDS):
        found = verdict(seed, q, r)
        findings = found.verdict.findings
        said = "".join(one.sentence for one in (*findings, *found.remarks))
        right = (
            any(quantity in one.quantity.split() for one in findings) or f"{quantity} is {direction}" in said
        )
        other = {"Q": "R", "R": "Q"}[quantity]
        named += right
        wrong += f"{other} is" in said or any(other in one.quantity.split() for one in findings)
    assert wrong <= 0.02 * SEEDS
    assert named >= 0.8 * SEEDS


def test_an_r_too_large_is_named_without_an_accusation() -> None:
    for seed in range(20):
        found = verdict(seed, r=10.0)
        assert not found.verdict.findings
        assert "overstates" in found.remarks[0].sentence
        assert "R is too large" in found.remarks[1].sentence


def test_slow_errors_of_the_fixes_are_an_explanation_beside_q() -> None:
    rng = np.random.default_rng(1000)
    slow = np.empty((COUNT, 2))
    slow[0] = 0
    for k in range(1, COUNT):
        slow[k] = 0.95 * slow[k - 1] + rng.normal(scale=3.0, size=2)
    (finding,) = verdict(5, errors=slow + rng.normal(size=slow.shape)).verdict.findings
    assert "errors of the" in finding.sentence
    assert "R of" not in finding.sentence


def test_a_stretch_is_found_with_its_times() -> None:
    for seed in range(10):
        errors = np.random.default_rng(1000 + seed).normal(size=(COUNT, 2))
        errors[200:260] *= 6
        findings = verdict(seed, errors=errors).verdict.findings
        first = findings[0]
        begin, end = (float(word) for word in (first.sentence.split()[1], first.sentence.split()[4]))
        assert begin == pytest.approx(200, abs=15)
        assert end == pytest.approx(260, abs=15)


def test_a_bias_of_the_innovations_is_found() -> None:
    innovations, variances = filtered(np.random.default_rng(1))
    innovations[:, 1] += 1.5 * np.sqrt(variances[:, 1])
    found = judge_foreign(log_of(innovations, variances)).verdict.findings
    assert any(one.quantity == "GPS position bias" and "east" in one.sentence for one in found)
    assert not any("north" in one.sentence for one in found)


def test_resets_and_lanes_accuse_in_flight_only() -> None:
    position = "EKF2 reset the horizontal position at {}."
    cases = (
        (Event(200.0, "reset", position.format("200 s"), "counter"), True),
        (Event(3.0, "reset", position.format("3 s"), "counter"), False),
        (Event(200.0, "reset", "EKF2 reset the attitude at 200 s.", "counter"), False),
        (Event(200.0, "lane", "The autopilot changed from core 0 to core 1.", "PI"), True),
        (Event(200.0, "fault", "EKF3 reported a quaternion that is no number.", "FS"), True),
        (Event(200.0, "message", "The autopilot reported: EKF3 yaw alignment complete", "MSG"), False),
    )
    innovations, variances = filtered(np.random.default_rng(2))
    for event, accuses in cases:
        found = judge_foreign(log_of(innovations, variances, events=(event,)))
        assert bool(found.verdict.findings) == accuses, event
        if accuses:
            assert found.verdict.findings[0].evidence == event.source


def fixes(jump: float) -> GnssLog:
    """Return fixes of a receiver that moves north with 5 m/s and whose positions jump at 200 s."""
    rng = np.random.default_rng(3)
    offset = np.column_stack((5.0 * TIME, np.zeros(COUNT), np.zeros(COUNT))) + rng.normal(size=(COUNT, 3))
    offset[200:260, 1] += jump
    place = displaced(np.tile((0.8, 0.1, 100.0), (COUNT, 1)), offset)
    velocity = np.tile((5.0, 0.0, 0.0), (COUNT, 1)) + rng.normal(scale=0.1, size=(COUNT, 3))
    sigma = np.ones((COUNT, 3))
    return GnssLog(TIME, place, velocity, sigma, 0.1 * sigma, np.zeros(3), 0.0)


def test_jumps_are_those_of_the_position_alone() -> None:
    assert jumps(fixes(0.0), 0.0) == []
    found = jumps(fixes(30.0), 1000.0)
    assert [one.time for one in found] == [1200.0, 1260.0]
    assert found[0].size == pytest.approx(30.0, abs=5)


class _Sensors:
    """What a verdict needs of a sensor log."""

    def __init__(self, gnss: GnssLog) -> None:
        self.gnss, self.epoch = gnss, 0.0


@pytest.mark.parametrize("jump", [0.0, 30.0])
def test_rejected_fixes_are_explained_by_a_jump_of_the_receiver_only(jump: float) -> None:
    innovations, variances = filtered(np.random.default_rng(4))
    innovations[201:259, 1] += 30.0
    log = log_of(innovations, variances, gate=5.0)
    found = judge_foreign(log, _Sensors(fixes(jump)))  # type: ignore[arg-type]
    quantities = [one.quantity for one in found.verdict.findings]
    assert "gate" in quantities
    assert (quantities[0] == "GPS jump") == bool(jump)
    assert any("no jump of the receiver explains it" in one.sentence for one in found.remarks) != bool(jump)


def track(error: float, late: float = 0.0) -> Track:
    place = displaced(
        np.tile((0.8, 0.1, 100.0), (COUNT, 1)),
        np.column_stack((5.0 * (TIME - late), np.full(COUNT, error), np.zeros(COUNT))),
    )
    return Track(TIME, place, np.full((COUNT, 3), 0.5), "made")


def test_positions_are_compared_in_the_sigma_of_both() -> None:
    gnss = fixes(0.0)
    near, far = (
        compare_positions(
            track(error), "the fixes", TIME, gnss.position, gnss.position_sigma, gnss.velocity_n
        )
        for error in (0.0, 10.0)
    )
    assert near is not None and far is not None
    assert not near.weighed
    assert far.weighed[0].finding.factor == pytest.approx((1 + 100 + 1) / 2 / 1.25, rel=0.1)


def test_a_different_clock_is_no_error_of_the_position() -> None:
    gnss = fixes(0.0)
    gnss.velocity_n[:, 0] = 5.0 + 4.0 * np.sin(TIME / 10)
    way = 5.0 * TIME - 40.0 * np.cos(TIME / 10)
    base = np.tile((0.8, 0.1, 100.0), (COUNT, 1))
    nothing = np.zeros(COUNT)
    place = displaced(base, np.column_stack((way, nothing, nothing)))
    late = displaced(base, np.column_stack((way - 0.3 * gnss.velocity_n[:, 0], nothing, nothing)))
    one = Track(TIME, late, np.full((COUNT, 3), 0.2), "made")
    found = compare_positions(one, "the fixes", TIME, place, np.full((COUNT, 3), 0.2), gnss.velocity_n)
    assert found is not None
    assert not found.weighed
    assert "-0.30 s between the clocks" in found.statement.evidence


def test_single_outliers_that_were_rejected_are_a_matter_of_the_gate_alone() -> None:
    innovations, variances = filtered(np.random.default_rng(6))
    innovations[20::40] += 40 * np.sqrt(variances[20::40])
    found = judge_foreign(log_of(innovations, variances, gate=5.0)).verdict.findings
    assert [one.quantity for one in found] == ["gate"]
    assert "2.5 %" in found[0].sentence
