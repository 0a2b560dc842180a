"""Frames of X-Plane: pairing, hostile packets, and what breaks a flight."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turning_flight import Turning
from xplane_simulator import STEP, packets

from lab.data.protocols.xplane import LOOKED_AT, POSITION, REFERENCES
from lab.live.xplane.frames import BRIDGED, BrokenFlightError, XPlaneFrames
from lab.motion.frames.displacement import displaced, displacement
from lab.motion.recordings.recording import Frame


@cache
def flown(count: int, start: float = 100.0) -> list[Frame]:
    return [frame._replace(time=start + frame.time) for frame in Turning().frames(STEP * np.arange(count))]


class Wire:
    """Feeds packets with times of arrival, frame by frame."""

    def __init__(self, *, clock_first: bool = True) -> None:
        self.frames = XPlaneFrames()
        self.now = 50.0
        self.clock_first = clock_first

    def send(self, *packets: bytes, wait: float = STEP) -> list[Frame]:
        """Send the packets of one frame, 0.2 ms apart, and wait; return the frames that they make."""
        found = [self.frames.accept(packet, self.now + 2e-4 * k) for k, packet in enumerate(packets)]
        self.now += wait
        return [frame for some in found for frame, _ in some]

    def fly(self, frames: Iterable[Frame]) -> list[Frame]:
        """Send frames; return what they make."""
        found = []
        for frame in frames:
            position, clock = packets(frame)
            found += self.send(*((clock, position) if self.clock_first else (position, clock)))
        return found


def begun(**how: bool) -> tuple[Wire, list[Frame]]:
    """Return a wire on which a flight goes on, and the frames that come next."""
    wire, frames = Wire(**how), flown(200)
    wire.fly(frames[: LOOKED_AT + 8])
    return wire, frames[LOOKED_AT + 8 :]


@pytest.mark.parametrize("clock_first", [True, False])
def test_a_frame_has_the_clock_of_its_position(clock_first: bool) -> None:
    wire, sent = Wire(clock_first=clock_first), flown(60)
    found = wire.fly(sent)
    assert len(found) >= 60 - LOOKED_AT - 1
    for mine, true in zip(found, sent[-len(found) :], strict=True):
        assert mine.time == pytest.approx(true.time, abs=1e-5)  # single precision at 100 s
        assert np.abs(displacement(true.position[None], mine.position[None])).max() < 1e-6
        assert mine.velocity_n == pytest.approx(true.velocity_n, abs=1e-5)
        assert np.exp(1j * mine.euler) == pytest.approx(np.exp(1j * true.euler), abs=1e-6)
    assert wire.frames.remarks(wire.now) == []


@pytest.mark.parametrize("clock_first", [True, False])
def test_a_lost_packet_costs_its_frame_and_gives_no_other_a_wrong_clock(clock_first: bool) -> None:
    wire, coming = begun(clock_first=clock_first)
    found = []
    for k, frame in enumerate(coming):
        position, clock = packets(frame)
        both = [clock, position] if clock_first else [position, clock]
        if k % 10 == 3:
            both.remove(clock)
        if k % 10 == 7:
            both.remove(position)
        found += wire.send(*both)
    clocks = {round(frame.time, 4): frame for frame in coming}
    for mine in found:
        true = clocks[round(mine.time, 4)]
        assert np.abs(displacement(true.position[None], mine.position[None])).max() < 0.01
    assert len(found) >= 0.79 * len(coming)


def test_positions_without_a_clock_are_told() -> None:
    wire = Wire()
    for frame in flown(60):
        assert wire.send(packets(frame)[0]) == []
    assert "without its clock" in wire.frames.remarks(wire.now)[0]


HOSTILE = [
    b"", b"R", b"RPOS", b"RPOS4", b"RPOS4" + bytes(POSITION.itemsize - 1), b"RPOS4" + bytes(99),
    b"RREF,", b"RREF,1234567", b"BECN\0" + bytes(40), b"XPLM" * 400, bytes(65507),
]  # fmt: skip


@pytest.mark.parametrize("packet", HOSTILE, ids=[f"{len(one)} {one[:4]!r}" for one in HOSTILE])
def test_other_packets_change_nothing(packet: bytes) -> None:
    wire, coming = begun()
    position, clock = packets(coming[0])
    assert wire.send(packet, clock, packet, position, packet)
    assert wire.frames.packets.ignored == 3
    assert "3 packets of other kinds" in " ".join(wire.frames.remarks(wire.now))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1e300, 1e38])
@pytest.mark.parametrize("field", [*POSITION.names, "clock", "X", "Z"])
def test_numbers_of_no_flight_are_refused(field: str, bad: float) -> None:
    wire, coming = begun()
    position, clock = packets(coming[0])
    row = np.frombuffer(position[5:], POSITION).copy()
    rows = np.frombuffer(clock[5:], [("index", "<i4"), ("value", "<f4")]).copy()
    with np.errstate(over="ignore"):
        if field in row.dtype.names:
            row[field] = bad
        else:
            rows["value"][
                [name.lower() for name, *_ in REFERENCES].index({"clock": "time"}.get(field, field).lower())
            ] = bad
    unused = field == "above_ground"
    found = wire.send(b"RREF," + rows.tobytes(), b"RPOS4" + row.tobytes())
    assert len(found) == unused
    assert wire.frames.unbelievable + wire.frames.untimed == (not unused)  # a clock of NaN is none
    assert len(wire.fly(coming[1:4])) == 3  # the flight goes on


@pytest.mark.proof
@settings(max_examples=50, deadline=None)
@given(st.lists(st.binary(max_size=120) | st.binary(min_size=64, max_size=64).map(lambda b: b"RPOS4" + b)
                | st.binary(min_size=48, max_size=48).map(lambda b: b"RREF," + b), max_size=60))  # fmt: skip
def test_any_bytes_are_taken(sent: list[bytes]) -> None:
    wire, coming = begun()
    for packet in sent:
        try:
            wire.send(packet)
        except BrokenFlightError:
            wire.frames.begin_anew()
    wire.frames.begin_anew()
    assert len(wire.fly(coming[:60])) >= 60 - LOOKED_AT - 1
    assert all(isinstance(remark, str) for remark in wire.frames.remarks(wire.now))


def moved(frame: Frame, **changes: object) -> Frame:
    return frame._replace(**changes)


BREAKS = {
    "moved by 12.0 km": lambda f: moved(f, position=displaced(f.position[None], np.array([[0, 12e3, 0]]))[0]),
    "moved by": lambda f: moved(f, position=f.position + np.array((0, 0, 30.0))),
    "velocity of the aircraft was changed by 40 m/s": lambda f: moved(
        f, velocity_n=f.velocity_n + np.array((0, 0, 40.0))
    ),
    "turned by": lambda f: moved(f, euler=f.euler + np.array((0, 0, 1.5))),
    "clock went back by 80.0 s: another flight was loaded": lambda f: moved(f, time=f.time - 80.0),
    "3.0 s of the flight did not come": lambda f: moved(f, time=f.time + 3.0),
}


@pytest.mark.parametrize("why", BREAKS)
def test_what_breaks_a_flight_is_named(why: str) -> None:
    wire, coming = begun()
    broken = BREAKS[why](coming[0])
    with pytest.raises(BrokenFlightError, match=why):
        wire.fly([broken])
    wire.frames.begin_anew()
    assert len(wire.fly([moved(f, time=f.time + 500) for f in coming[1:40]])) >= 39 - LOOKED_AT - 1


def test_a_turn_at_the_limit_of_aerobatics_is_no_break() -> None:
    """A roll at 400°/s and 8 g at 20 frames a second."""
    wire = Wire()
    turning = Turning(radius=60.0, speed=70.0, bank=1.4)
    frames = turning.frames(0.05 * np.arange(80))
    rolled = [f._replace(euler=f.euler + np.array((np.radians(400) * f.time, 0, 0))) for f in frames]
    assert len(wire.fly(rolled)) >= 80 - LOOKED_AT - 1


def test_gaps_up_to_a_second_are_bridged_and_told() -> None:
    wire, coming = begun()
    wire.fly(coming[:5])
    gap = int(0.9 * BRIDGED / STEP)
    assert wire.fly(coming[5 + gap : 10 + gap])
    assert wire.frames.bridged == 1
    assert "1 gap of up to 0.92 s between frames was bridged" in wire.frames.remarks(wire.now)[-1]


def test_a_pause_is_told_and_adds_no_time() -> None:
    wire, coming = begun()
    wire.fly(coming[:5])
    for _ in range(200):
        assert wire.fly([coming[4]]) == []
    assert wire.frames.remarks(wire.now) == ["X-Plane is paused: its clock has stood still for 4 s."]
    again = wire.fly(coming[5:8])
    assert [frame.time for frame in again] == pytest.approx([f.time for f in coming[5:8]], abs=1e-5)
    assert wire.frames.remarks(wire.now) == []


def test_a_move_on_the_map_of_a_paused_simulator_breaks_the_flight() -> None:
    wire, coming = begun()
    wire.fly(coming[:5])
    wire.fly([coming[4]] * 40)
    with pytest.raises(BrokenFlightError, match="moved by"):
        wire.fly([coming[4]._replace(position=coming[4].position + np.array((1e-4, 0, 0)))])


@pytest.mark.parametrize("pace", [2.0, 0.5])
def test_another_pace_is_told(pace: float) -> None:
    wire = Wire()
    for frame in flown(300):
        position, clock = packets(frame)
        wire.send(clock, position, wait=STEP / pace)
    assert wire.frames.remarks(wire.now) == [
        f"The simulator's clock runs {pace} times as fast as that of this computer."
    ]


def test_frames_that_come_in_a_rush_keep_their_clocks() -> None:
    """The computer was busy for a second: fifty frames are read at once."""
    wire, coming = begun()
    found = []
    for frame in coming[:50]:
        position, clock = packets(frame)
        found += wire.send(clock, position, wait=0.0)
    assert [f.time for f in found] == pytest.approx([f.time for f in coming[:50]], abs=1e-5)


def test_a_frame_that_comes_late_is_left_out_and_a_clock_set_back_breaks() -> None:
    wire, coming = begun()
    found = wire.fly([coming[0], coming[2], coming[1], coming[3]])
    assert [f.time for f in found] == pytest.approx([coming[k].time for k in (0, 2, 3)], abs=1e-5)
    assert "1 packet too late" in " ".join(wire.frames.remarks(wire.now))
    with pytest.raises(BrokenFlightError, match=r"clock went back by 0\.1 s"):
        wire.fly(frame._replace(time=frame.time - 0.2) for frame in coming[4:40])
