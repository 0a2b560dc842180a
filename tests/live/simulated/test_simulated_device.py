"""Simulated device: it loses nothing that it was not told to lose; what finds no room comes late."""

from __future__ import annotations

import os
import select
import socket
import sys

import numpy as np
import pytest
from scripted_source import until

import lab.live
from lab.data.protocols.catalogue import make_decoder
from lab.live.simulated import simulated_device
from lab.live.simulated.simulated_device import SimulatedDevice
from lab.live.simulated.simulated_flight import REST, SimulatedFlight
from lab.live.simulated.simulated_link import Link, PseudoTerminal, TcpServer

RATE = 1000.0


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    return SimulatedFlight.of(REST, RATE, rest=3.0)


class Narrow:
    """A line that takes few bytes at a time, and none while it is stopped."""

    address = "narrow"
    has_reader = True

    def __init__(self, most: int) -> None:
        self.most, self.taken = most, bytearray()

    def plug(self) -> None:
        """Nothing: it is there."""

    def unplug(self) -> None:
        """Nothing: it stays there."""

    def write(self, data: bytes) -> int:
        """Take the first bytes."""
        self.taken += data[: self.most]
        return min(len(data), self.most)


def assert_all_came(data: bytes, flight: SimulatedFlight) -> None:
    found = make_decoder("vectornav").feed(data)
    np.testing.assert_allclose(found.imu["time"], flight.imu["time"], atol=2e-9)
    np.testing.assert_allclose(found.imu["rate"], flight.imu["rate"], atol=1e-6)


@pytest.mark.proof
def test_what_finds_no_room_comes_late_and_in_order(flight):
    line = Narrow(0)
    with SimulatedDevice(flight, "vectornav", line) as device:
        until(lambda: device.late > 0.5)
        assert not line.taken
        line.most = 37  # less than a frame
        until(lambda: device.finished)
        assert device.late == 0.0
    assert device.latest > 0.5
    assert device.refused == 0
    assert_all_came(bytes(line.taken), flight)


@pytest.mark.proof
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_reader_that_is_held_up_gets_every_sample(flight):
    line, data = PseudoTerminal(), bytearray()
    with SimulatedDevice(flight, "vectornav", line) as device:
        reader = os.open(device.address.removeprefix("serial:"), os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        until(lambda: device.late > 0.2)  # the terminal is full

        def read() -> bool:
            over = device.finished
            try:
                data.extend(os.read(reader, 65536))
            except BlockingIOError:  # what was written last may still be on its way through the terminal
                return over and not select.select([reader], [], [], 2.0)[0]
            return False

        until(read)
        os.close(reader)
    assert device.refused == 0
    assert_all_came(bytes(data), flight)


def test_what_nobody_reads_is_gone_and_counted(flight, monkeypatch):
    monkeypatch.setattr(simulated_device, "PATIENCE", 0.2)
    lines: list[Link] = [Narrow(0), TcpServer()]
    for line in lines:
        with SimulatedDevice(flight, "vectornav", line) as device:
            until(lambda device=device: device.refused > 1000 and device.late < 1.0)
    with SimulatedDevice(flight, "vectornav", TcpServer()) as device:
        until(lambda: device.sent > 300)
        before = device.refused  # what is due is counted before it is delivered
        until(lambda: device.refused > before)
        host, port = device.address.removeprefix("tcp:").split(":")
        with socket.create_connection((host, int(port))) as client:
            found = make_decoder("vectornav").feed(client.recv(4096, socket.MSG_WAITALL))
    assert found.imu["time"][0] > 0.3  # nothing from before


def test_an_endless_flight_begins_again_while_time_goes_on():
    flight, line = SimulatedFlight.of(REST, 100.0, rest=1.0), Narrow(10**6)
    device = SimulatedDevice(flight, "vectornav", line, endless=True)
    with device:
        until(lambda: device.sent > 310)
        assert not device.finished
    found = make_decoder("vectornav").feed(bytes(line.taken))
    assert len(found.imu) > 310
    np.testing.assert_allclose(found.imu["time"], 0.01 * np.arange(1, len(found.imu) + 1), atol=2e-9)
    np.testing.assert_array_equal(found.imu["rate"][100:200], found.imu["rate"][:100])
    np.testing.assert_allclose(np.diff(found.fix["week_time"]), 1.0, atol=1e-6)
    assert found.fix["time"].tolist() == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    "wrong",
    [
        "axes=x,y",
        "protocol=nmae",
        "device=toaster",
        "over=udp:1",
        "corruption=2",
        "jitter_ms=-1",
        "columns=q",
    ],
)
def test_a_wrong_option_is_refused_before_a_flight_is_simulated(wrong, monkeypatch):
    monkeypatch.setattr(SimulatedFlight, "of", lambda *_, **__: pytest.fail("it has flown"))
    with pytest.raises(ValueError, match=wrong.partition("=")[2].partition(":")[0]):
        lab.live.open(f"simulated:montreal?{wrong}")
