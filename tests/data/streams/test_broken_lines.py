"""Broken lines: wrong speeds, ports that vanish or are taken, peers that break off; each names its cause."""

from __future__ import annotations

import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from live_streams import RATE, fixes, motion
from scripted_source import Scripted, until

import lab.live
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.samples import FIX
from lab.data.streams import sample_watch
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.source import Source
from lab.data.streams.source_status import LOST, STALE, STREAMING, Status
from lab.data.streams.transport import Chunk

pseudo_terminals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
FRAMES = [ENCODERS["vectornav"]().encode(row[None], np.empty(0, FIX)) for row in motion(3000)]


def at_other_speed(data: bytes, sent: int, read: int) -> bytes:
    """Return what a UART reads of bytes sent at another speed: it samples each bit at its own pace."""
    bits = "".join(f"0{byte:08b}"[0] + f"{byte:08b}"[::-1] + "1" for byte in data) + "1" * 20
    seen, at, step = bytearray(), 0.0, sent / read
    while at < len(bits):
        if bits[int(at)] == "1":
            at += 0.1
            continue
        places = [int(at + (k + 1.5) * step) for k in range(8)]
        seen.append(sum((bits[place : place + 1] != "0") << k for k, place in enumerate(places)))
        at += 9.5 * step
    return bytes(seen)


@contextmanager
def sending(write: Callable[[bytes], object], change: Callable[[bytes], bytes] = bytes) -> Iterator[None]:
    """Send frames at the times that are in them, from a thread: later ones are a clock that was set."""
    ending, begin = threading.Event(), time.monotonic()

    def run() -> None:
        for number, frame in enumerate(FRAMES, 1):
            if ending.wait(max(0.0, begin + number / RATE - time.monotonic())):
                return
            try:
                write(change(frame))
            except OSError:
                return

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


class Port:
    """A pseudo-terminal under a lasting name, as udev gives a device one."""

    def __init__(self, name: Path) -> None:
        import pty
        import tty

        self._ours, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        self._name = name
        name.symlink_to(os.ttyname(self._theirs))

    def write(self, data: bytes) -> int:
        """Send bytes to who reads the port."""
        return os.write(self._ours, data)

    def vanish(self) -> None:
        """Unplug it."""
        self._name.unlink()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.mark.proof
@pseudo_terminals
@pytest.mark.parametrize("protocol", ["", "&protocol=vectornav"])
def test_a_wrong_speed_is_named_as_the_cause(protocol: str, tmp_path: Path) -> None:
    port = Port(tmp_path / "tty")
    with (
        lab.live.open(f"serial:{tmp_path / 'tty'}?baud=57600{protocol}") as source,
        sending(port.write, lambda frame: at_other_speed(frame, 115_200, 57_600)),
    ):
        until(lambda: source.status.statistics.bytes > 0 and source.status.state == STALE)
        until(lambda: "speed of the line" in source.status.sentence)
    port.vanish()


def fruitless(now: Status) -> bool:
    """Return whether a status says that bytes come, and none of them is a frame."""
    return now.state == STALE and "no frame of vectornav" in now.sentence


def test_a_device_that_changes_its_speed_is_stale_until_it_is_read_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sample_watch, "FRUITLESS", 0.3)
    wrong = threading.Event()
    change = lambda frame: at_other_speed(frame, 115_200, 57_600) if wrong.is_set() else frame  # noqa: E731
    with listening() as (server, address), lab.live.open(address) as source:
        peer, _ = server.accept()
        with peer, sending(peer.sendall, change):
            until(lambda: source.status.state == STREAMING and source.end.imu > 0)
            wrong.set()
            # Not for their absence: bytes come all the time.
            until(lambda: (now := source.status).silence < sample_watch.FRUITLESS and fruitless(now))
            wrong.clear()
            until(lambda: source.status.state == STREAMING)


def test_a_clock_that_stands_still_is_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample_watch, "FRUITLESS", 0.2)
    with listening() as (server, address), lab.live.open(f"{address}?protocol=vectornav") as source:
        peer, _ = server.accept()
        with peer:
            peer.sendall(b"".join(FRAMES[:50]))
            with sending(peer.sendall, lambda _: FRAMES[49]):
                until(lambda: source.status.state == STALE and "repeated" in source.status.sentence)
        assert source.end.imu == 50


@pseudo_terminals
def test_a_port_that_vanishes_comes_back_in_the_same_recording(tmp_path: Path) -> None:
    port, path = Port(tmp_path / "tty"), tmp_path / "vanished.inslab"
    source = lab.live.open(f"serial:{tmp_path / 'tty'}")
    source.record(path)
    with source:
        with sending(port.write):
            until(lambda: source.end.imu > 0)
        port.vanish()
        until(
            lambda: source.status.sentence.startswith("Lost: ") and "no such port" in source.status.sentence
        )
        before, port = source.end.imu, Port(tmp_path / "tty")
        with sending(port.write):
            until(lambda: source.end.imu > before and source.status.state == STREAMING)
    live = source.since().imu  # only now: the port holds frames after the last one is sent
    port.vanish()
    assert np.flatnonzero(live["gap"]).tolist() == [0, before]
    assert recorded_samples(path).imu.tobytes() == live.tobytes()


@pseudo_terminals
def test_a_port_that_is_taken_or_none_is_named(tmp_path: Path) -> None:
    from serial import Serial

    port = Port(tmp_path / "tty")
    with Serial(str(tmp_path / "tty"), exclusive=True), lab.live.open(f"serial:{tmp_path / 'tty'}") as source:
        until(lambda: "another program uses it" in source.status.sentence)
        assert source.status.state == LOST
    port.vanish()
    with lab.live.open("serial:/dev/null") as source:
        until(lambda: "no serial port" in source.status.sentence)


@pseudo_terminals
def test_a_port_that_is_forbidden_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refused)  # root may open everything
    source = lab.live.open("serial:/dev/ttyUSB7")
    with pytest.raises(OSError, match=r"/dev/ttyUSB7: the system does not allow it to this user"):
        source._transport.open()


@contextmanager
def listening() -> Iterator[tuple[socket.socket, str]]:
    """Yield a server, and the address that opens it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server, f"tcp:127.0.0.1:{server.getsockname()[1]}"


def resetting(peer: socket.socket) -> None:
    """End a connection with a reset."""
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()


def test_a_peer_that_resets_is_named_and_reached_again() -> None:
    with listening() as (server, address), lab.live.open(address) as source:
        peer, _ = server.accept()
        with sending(peer.sendall):
            until(lambda: source.end.imu > 0)
        resetting(peer)
        until(lambda: any("the other side broke" in event.text for event in source.status.events))
        before, (peer, _) = source.end.imu, server.accept()
        with peer, sending(peer.sendall):
            until(lambda: source.end.imu > before)
        assert source.since().imu["gap"].sum() == 2


def test_a_peer_that_accepts_and_ends_is_asked_at_longer_intervals() -> None:
    opened: list[float] = []
    with listening() as (server, address), lab.live.open(address):
        for _ in range(4):
            peer, _ = server.accept()
            opened.append(time.monotonic())
            resetting(peer)
    # 0.1, 0.2 and 0.4 s: a bound from below, which a slow computer does not break.
    assert opened[-1] - opened[0] > 0.6


def test_an_udp_port_in_use_is_named_and_another_sender_too() -> None:
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    place = taken.getsockname()
    with lab.live.open(f"udp:{place[1]}") as source:
        until(lambda: "another program listens on this port" in source.status.sentence)
        taken.close()
        one, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        with one, other, sending(lambda data: one.sendto(data, place)):
            until(lambda: source.end.imu > 0)
            with sending(lambda data: other.sendto(data, place)):
                until(lambda: "Another sender sends here too" in source.status.sentence)


def test_a_receiver_at_one_hertz_is_not_stale_between_fixes() -> None:
    now = [0.0]
    source = Source(Scripted(), Reception("nmea"), clock=lambda: now[0])
    encoder = ENCODERS["nmea"]()
    source._state = STREAMING
    for k, fix in enumerate(fixes(5)):
        now[0] = float(k)
        source._accept(Chunk(100.0 + k, encoder.encode(np.empty(0, motion(1).dtype), fix[None])))
    assert source.end.fix > 2
    now[0] += 0.9
    assert source.status.state == STREAMING
    now[0] += 2.0
    assert source.status.state == STALE
