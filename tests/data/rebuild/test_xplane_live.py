"""Recording from X-Plane: a mission replayed over real UDP is the flight that was sent."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from dataclasses import fields
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from xplane_sender import CLOCK, XPlaneSender

from lab.data.protocols.xplane import XPlanePackets
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.streams import xplane_live
from lab.data.streams.xplane_live import XPlaneRecorder
from lab.missions import MissionError, Recording, mission


def part(start: int = 2000, samples: int = 300) -> Recording:
    """Return a piece of a turning climb of montreal."""
    whole = mission("montreal").recording
    kept = slice(start, start + samples)
    return Recording(*(getattr(whole, field.name)[kept] for field in fields(Recording)))


FLOWN = part()


def record(flown: Recording = FLOWN, **how: object) -> tuple[RawFlight, XPlaneSender]:
    """Return what a recorder makes of a replayed flight."""
    with (
        XPlaneSender(flown, **how) as sender,  # type: ignore[arg-type]
        XPlaneRecorder("localhost", sender.port, 40.0) as recorder,
    ):
        sender.received = partial(getattr, recorder, "samples")
        recorder.start()
        assert recorder.running
        assert sender.rate in {0, 40}
        assert sender.done.wait(60)
        assert recorder.problem == ""
        assert recorder.seconds > 0.0
        flight = recorder.stop()
        assert not recorder.running
        assert until(lambda: not sender.rate)
    return flight, sender


def until(what: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Wait for something to become true."""
    deadline = time.monotonic() + seconds
    while not what() and time.monotonic() < deadline:
        time.sleep(0.005)
    return what()


def same(flight: RawFlight, flown: Recording, **tolerance: float) -> None:
    for name, allowed in tolerance.items():
        value, wanted = getattr(flight, name), getattr(flown, name)
        assert value is not None
        off = value - wanted
        if name in {"euler", "latitude", "longitude"}:
            off = np.angle(np.exp(1j * off))
        assert np.abs(off).max() <= allowed, name


# Single precision of the velocity, attitude and air data; the clock has 61 µs at 1000 s.
PRECISION = {
    "latitude": 1e-12, "longitude": 1e-12, "height": 1e-9, "velocity_n": 2e-5, "euler": 4e-7,
    "airspeed": 1e-5, "alpha": 1e-7, "beta": 1e-7,
}  # fmt: skip


@pytest.mark.parametrize("clock_first", [True, False])
def test_what_x_plane_sends_is_the_flight(clock_first):
    flight, sender = record(clock_first=clock_first)
    same(flight, FLOWN, **PRECISION)
    np.testing.assert_allclose(flight.time - CLOCK, FLOWN.time - FLOWN.time[0], rtol=0, atol=4e-5)
    assert flight.rows_read == len(FLOWN.time)
    assert flight.dropped == ()
    assert flight.body_rate is not None
    assert any("above sea level" in remark for remark in flight.remarks)
    assert b"RPOS\x0040\0" in sender.requests


def test_each_position_takes_the_clock_of_its_frame():
    flight, _ = record(skip=3)
    np.testing.assert_allclose(flight.time - CLOCK, (FLOWN.time - FLOWN.time[0])[::3], rtol=0, atol=4e-5)


def test_x_plane_is_told_when_it_is_over():
    _, sender = record(part(samples=10))
    assert sender.requests[0] == b"RPOS\x0040\0"
    assert b"RPOS\x000\0" in sender.requests[7:]


def test_without_data_references_time_is_that_of_arrival():
    flight, _ = record(answers=False)
    assert flight.time[0] == 0.0
    assert (np.diff(flight.time) > 0).all()
    assert flight.airspeed is None
    assert any("time is that of arrival" in remark for remark in flight.remarks)
    # Without its place in the local frame the velocity is off by the 25 km to the reference point.
    same(flight, FLOWN, latitude=1e-12, euler=4e-7, velocity_n=0.5)


def test_other_packets_are_counted_and_do_no_harm():
    noise = (b"", b"RPOS", b"RPOS4" + bytes(63), b"RREF,", b"RREF,123", b"DATA*" + bytes(36), b"\xff" * 1400)
    noise += (b"RREF," + (99).to_bytes(4, "little") + bytes(4),)
    flight, _ = record(part(samples=20), noise=noise)
    same(flight, part(samples=20), **PRECISION)
    assert any("140 of other kinds were ignored" in remark for remark in flight.remarks)


def test_packets_from_elsewhere_are_ignored():
    # 127.0.0.2 is this computer too, but not where X-Plane was said to be.
    elsewhere = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        elsewhere.bind(("127.0.0.2", 0))
    except OSError:
        pytest.skip("this system has no second loopback address")
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with elsewhere, server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(10)
        with XPlaneRecorder("127.0.0.1", server.getsockname()[1]) as recorder:
            recorder.start()
            client = server.recvfrom(2048)[1]
            for _ in range(20):
                elsewhere.sendto(b"RPOS4" + bytes(64), client)
            server.sendto(b"RPOS4" + bytes(64), client)
            assert until(lambda: recorder.samples == 1)
            assert recorder._link.foreign == 20


def test_a_flood_from_elsewhere_does_not_hold_a_reader(monkeypatch):
    end = time.monotonic() + 5.0

    class Flood:
        def settimeout(self, _seconds: float) -> None:
            assert time.monotonic() < end

        def recvfrom(self, _most: int) -> tuple[bytes, tuple[str, int]]:
            return b"RPOS4" + bytes(64), ("192.0.2.1", 49000)

    link = xplane_live.XPlaneLink("127.0.0.1", 49000, 50.0)
    monkeypatch.setattr(link, "_ask", lambda _rate: None)
    monkeypatch.setattr(link, "_udp", Flood())
    assert link.packet(0.01) is None
    assert link.foreign > 0


def test_silence_says_what_to_look_after(monkeypatch):
    monkeypatch.setattr(xplane_live, "SILENCE", 0.2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        with XPlaneRecorder(port=nobody.getsockname()[1]) as recorder:
            recorder.start()
            assert until(lambda: bool(recorder.problem))
            assert "is X-Plane running with a flight loaded" in recorder.problem
            # The request is repeated, for an X-Plane that starts later.
            nobody.settimeout(10)
            asked = [nobody.recvfrom(2048)[0][:4] for _ in range(14)]
            assert asked.count(b"RPOS") >= 2
            with pytest.raises(
                MissionError, match=r"0 samples were received.*does no firewall stand between"
            ):
                recorder.stop()


def test_a_recorder_can_record_again_and_ends_its_thread():
    before = threading.enumerate()
    recorder = None
    port = 0
    for count in (10, 20):
        with XPlaneSender(part(samples=count), port=port) as sender:
            port = sender.port
            recorder = recorder or XPlaneRecorder(port=port)
            sender.received = partial(getattr, recorder, "samples")
            recorder.start()
            with pytest.raises(MissionError, match="a recording is running"):
                recorder.start()
            assert sender.done.wait(30)
            assert len(recorder.stop().time) == count
    assert recorder is not None
    recorder.close()
    # Threads of earlier tests may end meanwhile.
    assert set(threading.enumerate()) <= set(before)


@pytest.mark.parametrize(
    ("host", "port", "rate", "words"),
    [
        ("127.0.0.1", 0, 50.0, "port 0 is not accepted"),
        ("127.0.0.1", 70000, 50.0, "accepted are 1 to 65535"),
        ("127.0.0.1", 49000, 0.0, "a rate of 0 Hz is not accepted"),
        ("127.0.0.1", 49000, float("nan"), "a rate of nan Hz is not accepted"),
        ("no such host\0", 49000, 50.0, "no computer of that name"),
        ("a" * 300, 49000, 50.0, "no computer of that name"),
    ],
)
def test_what_cannot_be_is_refused_at_once(host, port, rate, words):
    with pytest.raises(MissionError, match=words):
        XPlaneRecorder(host, port, rate)


@given(
    packets=st.lists(
        st.one_of(
            st.binary(max_size=80),
            st.binary(min_size=64, max_size=64).map(lambda body: b"RPOS4" + body),
            st.binary(min_size=16, max_size=16).map(lambda body: b"RREF," + body),
        ),
        max_size=20,
    )
)
def test_any_packets_give_a_flight_or_a_reason(packets):
    taken = XPlanePackets()
    found = [one for at, packet in enumerate(packets) for one in taken.accept(packet, float(at))]
    found += taken.finish()
    sent = [packet[5:] for packet in packets if packet[:4] == b"RPOS" and len(packet) == 69]
    assert [one.record for one in found] == sent
    values = [value for one in found for value in one.references]
    try:
        flight = xplane_live.flight(b"".join(sent), [one.arrival for one in found], values)
    except MissionError:
        return
    assert len(flight.time) >= 4
