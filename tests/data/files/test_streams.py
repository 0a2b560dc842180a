"""Streams of an autopilot: they are cut at resets of its filter, and slow ones are reported as slow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from raw_flights import weave
from scipy.spatial.transform import Rotation

from lab.data.files.streams import (
    Stream,
    make_attitude_stream,
    make_flight,
    make_gnss_log,
    most_frequent,
    read_lever_arm,
)
from lab.data.rebuild.derived_motion import body_rates
from lab.missions.flight_import import prepare_flight
from lab.motion.frames.rotation import quaternion_from_euler

SECONDS, RESET = 60.0, 10.04


def streams(
    velocity_rate: float = 10.0, attitude_rate: float = 25.0, position_rate: float = 5.0
) -> tuple[Stream, Stream, Stream]:
    """Return velocity, position and attitude of a flight that weaves."""
    v, p, a = (
        weave(np.arange(0.0, SECONDS, 1 / rate)) for rate in (velocity_rate, position_rate, attitude_rate)
    )
    place = np.column_stack((p.latitude, p.longitude, p.height))
    return (
        Stream.of("velocity", v.time, v.velocity_n),
        Stream.of("position", p.time, place),
        Stream.of("attitude", a.time, quaternion_from_euler(a.euler)),
    )


def flight(velocity: Stream, position: Stream, attitude: Stream):
    return make_flight(
        Path("log"), "test", velocity, position, attitude, units=(), remarks=(), vehicle="rotary wing"
    )


def turned(stream: Stream, degrees: float, counted: bool) -> Stream:
    """Return the attitude with a heading that was wrong by some degrees before the reset."""
    before = stream.time < RESET
    wrong = Rotation.from_euler("z", -degrees, degrees=True) * Rotation.from_quat(
        stream.values, scalar_first=True
    )
    values = np.where(before[:, None], wrong.as_quat(scalar_first=True), stream.values)
    return replace(stream, values=values, counter=(~before).astype(float) if counted else None)


@pytest.mark.parametrize(("degrees", "counted"), [(12.0, False), (170.0, False), (12.0, True), (2.0, True)])
def test_a_reset_of_the_heading_is_no_rotation(degrees, counted):
    velocity, position, attitude = streams()
    raw = flight(velocity, position, turned(attitude, degrees, counted))
    assert [round(reset.time, 3) for reset in raw.resets] == [RESET]
    made = prepare_flight(raw)
    assert made.flight.started == pytest.approx(RESET)
    said = next(row.value for row in made.report.rows if row.name == "Resets")
    assert float(said.split("the attitude by ")[1].split("°")[0]) == pytest.approx(degrees, abs=0.5)
    assert made.report.verdict == "plausible", made.report
    rates = np.degrees(np.linalg.norm(body_rates(made.recording.time, made.recording.euler), axis=1))
    truth = weave(made.flight.raw.time + RESET)
    assert rates.max() < 1.1 * np.degrees(np.linalg.norm(body_rates(truth.time, truth.euler), axis=1)).max()


@pytest.mark.parametrize("counted", [False, True])
def test_a_reset_of_velocity_and_position_rings_on_neither_side(counted):
    velocity, position, attitude = streams()
    late, there = velocity.time >= RESET, position.time >= RESET
    velocity = replace(
        velocity,
        values=velocity.values + np.where(late, 0.0, 8.0)[:, None] * (1.0, 0.0, 0.0),
        counter=late.astype(float) if counted else None,
    )
    position = replace(
        position,
        values=position.values + np.where(there, 0.0, 60.0 / 6.4e6)[:, None] * (1.0, 0.0, 0.0),
        counter=there.astype(float) if counted else None,
    )
    raw = flight(velocity, position, attitude)
    assert {reset.change.split(" by ")[0] for reset in raw.resets} == {"the velocity", "the position"}
    truth = weave(raw.time)
    off = raw.velocity_n[:, 0] - truth.velocity_n[:, 0]
    np.testing.assert_allclose(np.where(raw.time < RESET, off - 8.0, off), 0.0, atol=0.02)
    made = prepare_flight(raw)
    assert made.flight.started >= RESET
    assert made.report.verdict == "plausible"


def test_a_lively_flight_and_a_hard_landing_are_no_resets():
    rng = np.random.default_rng(6)
    velocity, position, attitude = streams()
    shaking = Rotation.from_rotvec(np.radians(rng.normal(scale=3.0, size=(len(attitude.time), 3))))
    values = (Rotation.from_quat(attitude.values, scalar_first=True) * shaking).as_quat(scalar_first=True)
    landed = velocity.values + np.where(velocity.time < 50.0, 0.0, 2.0)[:, None] * (0.0, 0.0, 1.0)
    assert not flight(replace(velocity, values=landed), position, replace(attitude, values=values)).resets


def test_what_is_interpolated_is_told_with_its_own_rate_and_noise():
    velocity, position, attitude = streams(velocity_rate=5.0, attitude_rate=200.0)
    rng = np.random.default_rng(2)
    noisy = velocity.values + rng.normal(scale=0.2, size=velocity.values.shape)
    raw = flight(replace(velocity, what="GPS velocity", values=noisy), position, attitude)
    assert dict(raw.rates) == pytest.approx({"velocity": 5.0, "position": 5.0})
    report = prepare_flight(raw).report
    rate = next(row.value for row in report.rows if row.name == "Rate")
    assert "200 Hz" in rate and "the velocity (recorded at 5 Hz)" in rate
    # White noise of 0.2 m/s five times a second: differentiated it is some 0.2 · 5 · √2 m/s², not 0.
    rough = next(row.value for row in report.rows if row.name == "From velocity")
    assert 0.5 < float(rough.removeprefix("noise of the acceleration ").split()[0]) < 10


def test_what_cannot_be_an_attitude_or_a_fix_is_left_out():
    time = np.array((0.0, 1.0, 1.0, 0.5, 2.0, np.nan, 3.0, 4.0))
    q = np.tile((1.0, 0.0, 0.0, 0.0), (time.size, 1))
    q[4] *= 2
    assert make_attitude_stream(Stream.of("attitude", time, q)).time.tolist() == [0.0, 1.0, 3.0, 4.0]
    place = np.tile((0.5, 0.1, 100.0), (time.size, 1))
    place[6, 1], place[7, :2] = 7.0, 0.0  # beyond a turn, and of a receiver without a fix
    sigmas = np.full(time.size, 2.0), np.zeros(time.size), None
    given = time, place, None, sigmas, np.arange(time.size) > 0, np.zeros(3), 0.1
    assert make_gnss_log(*given).time.tolist() == [1.0, 1.0, 0.5, 2.0]
    once = make_gnss_log(*given, once=True)
    assert once.time.tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(once.position_sigma, [(2.0, 2.0, np.nan)] * 2)
    assert np.isnan(once.velocity_n).all() and np.isnan(once.velocity_sigma).all()


def test_a_lever_arm_is_that_of_the_first_antenna_that_has_one():
    parameters = {"GPS2_POS_X": 1.0, "GPS2_POS_Z": -2.0, "INS_POS1_X": 0.25, "GPS3_POS_Y": 9.0}
    pairs = [(f"GPS{number}_POS_", "INS_POS1_") for number in (1, 2, 3)]
    assert read_lever_arm(parameters, pairs).tolist() == [0.75, 0.0, -2.0]
    assert not read_lever_arm(parameters, pairs[:1]).any()


def test_of_streams_the_one_that_comes_most_often_is_taken():
    slow, fast, as_fast = (Stream.of("x", np.arange(0, 5, dt), np.arange(0, 5, dt)) for dt in (1, 0.1, 0.1))
    assert most_frequent((slow, None, fast, as_fast)) is fast
    assert most_frequent((None,)) is None
