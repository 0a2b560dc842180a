"""Publisher: real readers of each kind, slow ones, hostile ones, and pages of other origins."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pynmeagps import VALCKSUM, NMEAReader
from sent_solutions import state
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from lab.live.outlets.destination import Destination
from lab.live.outlets.listener import MOST_READERS, WAITING
from lab.live.outlets.publisher import QUEUE, Publisher


def publisher(*places: str, hz: float = 50.0) -> Publisher:
    return Publisher([Destination.of(place, hz) for place in places])


def port_of(place: str) -> int:
    return int(place.rpartition(":")[2])


def until(condition: Callable[[], bool]) -> None:
    """Wait for the event, at most 20 s."""
    for _ in range(2000):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("it did not happen")


def test_each_datagram_is_an_object() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        reader.bind(("127.0.0.1", 0))
        reader.settimeout(20)
        with publisher(f"udp:127.0.0.1:{reader.getsockname()[1]}") as out:
            for number in range(5):
                out.offer(state(number))
            rows = [json.loads(reader.recv(1400)) for _ in range(5)]
    assert [row["fixes_used"] for row in rows] == [0, 1, 2, 3, 4]
    assert rows[0]["latitude_deg"] == 45.5
    assert rows[0]["heading_deg"] == 300.0
    assert abs(rows[0]["unix_time_s"] - time.time()) < 20


def test_several_readers_of_a_port_get_whole_lines_from_their_coming_on() -> None:
    with publisher("tcp:0?protocol=nmea&geoid=-30") as out:
        readers = [socket.create_connection(("127.0.0.1", port_of(out.places[0]))) for _ in range(2)]
        until(lambda: out.counts[0][2] == 2)
        for number in range(10):
            out.offer(state(number))
        until(lambda: out.counts[0][0] == 20)
        out.close()
        for reader in readers:
            data = reader.makefile("rb").read()
            reader.close()
            found = [one for _, one in NMEAReader(io.BytesIO(data), validate=VALCKSUM, quitonerror=2)]
            assert [one.msgID for one in found] == 10 * ["GGA", "RMC", "VTG", "GST", "HDT"]
            assert found[0].alt == 130.0
            assert found[0].time == ""  # no fix has said it


def test_a_pseudo_terminal_gives_whole_lines_also_after_nobody_read() -> None:
    with publisher("pty?protocol=nmea") as out:
        for number in range(100):
            out.offer(state(number))
        until(lambda: sum(out.counts[0][:2]) == 100)
        assert out.counts[0][1] > 0
        port = os.open(
            out.places[0].removeprefix("the serial port "), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK
        )
        os.write(port, b"?" * 2000)  # programs ask a serial port who it is
        data = b""
        for number in range(100, 130):
            with contextlib.suppress(BlockingIOError):
                while True:
                    data += os.read(port, 4096)
            out.offer(state(number))
            until(lambda count=number: sum(out.counts[0][:2]) == count + 1)  # type: ignore[misc]
        os.close(port)
    lines = data.split(b"\r\n")[:-1]
    assert len(lines) > 20
    found = [one for _, one in NMEAReader(io.BytesIO(data), validate=VALCKSUM, quitonerror=0)]
    assert len(found) >= len(lines) - 1


def test_a_reader_that_does_not_read_loses_rows_and_holds_up_nobody() -> None:
    with publisher("tcp:0?hz=200", "tcp:0?hz=200", "ws:0?hz=200") as out:
        slow = socket.socket()
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", port_of(out.places[0])))
        idle = connect(f"ws://127.0.0.1:{port_of(out.places[2])}", max_queue=1, proxy=None)
        fast = socket.create_connection(("127.0.0.1", port_of(out.places[1])))
        lines, longest = fast.makefile("rb"), 0.0
        until(lambda: all(readers == 1 for _, _, readers in out.counts))
        count = 3000
        for number in range(count):
            begun = time.thread_time()
            out.offer(state(number))
            longest = max(longest, time.thread_time() - begun)
            assert json.loads(lines.readline())["fixes_used"] == number
        assert longest < 0.01  # the navigator's thread spends no more on it
        until(lambda: out.counts[1] == (count, 0, 1))
        assert out.counts[0][1] > count / 2
        slow.settimeout(20)
        slow_lines, last = slow.makefile("rb"), -1
        for _ in range(20):
            row = json.loads(slow_lines.readline())["fixes_used"]  # whole rows
            assert row > last
            last = row
        idle.close()
        slow_lines.close()
        slow.close()
        until(lambda: sum(out.counts[0][:2]) == count)
        assert out.counts[2][1] > 0


def test_states_that_come_faster_than_they_are_sent_are_lost_and_counted() -> None:
    out = publisher("udp:127.0.0.1:9", hz=50)
    for number in range(QUEUE + 30):  # its thread has not begun
        out.offer(state(number))
    assert out.behind == 30
    out.open()
    out.close()
    assert out.counts[0][0] + out.counts[0][1] == QUEUE
    out.offer(state())  # after its end
    out.close()


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_foxglove_asks_for_channels_and_gets_their_messages(protocol: str) -> None:
    with publisher("ws:0") as out:
        url = f"ws://127.0.0.1:{port_of(out.places[0])}"
        with connect(url, subprotocols=[protocol], proxy=None) as reader:  # type: ignore[list-item]
            assert reader.subprotocol == protocol
            assert json.loads(reader.recv(20))["op"] == "serverInfo"
            channels = {one["topic"]: one["id"] for one in json.loads(reader.recv(20))["channels"]}
            out.offer(state(0))  # nothing was asked for
            wanted = [{"id": 11, "channelId": channels["/ins_lab/location"]}]
            reader.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            frame = None
            for number in range(1, 200):
                out.offer(state(number))
                with contextlib.suppress(TimeoutError):
                    frame = reader.recv(0.1)
                    break
            assert isinstance(frame, bytes)
            assert frame[0] == 1
            assert int.from_bytes(frame[1:5], "little") == 11
            assert abs(int.from_bytes(frame[5:13], "little") / 1e9 - time.time()) < 20
            assert json.loads(frame[13:])["latitude"] == 45.5
            reader.send(b"\x00" * 60_000)
            reader.send("[" * 60_000)
            out.offer(state(300))
            assert reader.recv(20)


def test_other_programs_get_rows_as_messages() -> None:
    with publisher("ws:0", "ws:0?protocol=nmea") as out:
        for number, begin in enumerate(("{", "$INGGA")):
            with connect(f"ws://127.0.0.1:{port_of(out.places[number])}", proxy=None) as reader:
                until(lambda number=number: out.counts[number][2] == 1)  # type: ignore[misc]
                out.offer(state(10 * number))
                text = reader.recv(20)
                assert isinstance(text, str)
                assert text.startswith(begin)
                assert not text.endswith("\n")


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (None, True),
        ("https://app.foxglove.dev", True),
        ("HTTPS://APP.foxglove.dev", True),
        ("https://app.foxglove.dev.evil.example", False),
        ("http://app.foxglove.dev", False),
        ("http://127.0.0.1:8765", False),
        ("null", False),
        ("file://", False),
        ("", False),
    ],
)
def test_a_page_of_an_origin_that_nobody_named_is_refused(origin: str | None, allowed: bool) -> None:
    with publisher("ws:0?origin=https://app.foxglove.dev,https://other.example") as out:
        headers = {} if origin is None else {"Origin": origin}
        url = f"ws://127.0.0.1:{port_of(out.places[0])}"
        if allowed:
            with connect(url, additional_headers=headers, proxy=None):
                until(lambda: out.counts[0][2] == 1)
            return
        with pytest.raises(InvalidStatus) as refusal, connect(url, additional_headers=headers, proxy=None):
            pass
        assert refusal.value.response.status_code == 403
        assert out.refused == [origin]
        assert out.counts[0][2] == 0


def test_a_second_origin_does_not_hide_the_first() -> None:
    with publisher("ws:0?origin=https://app.foxglove.dev") as out:
        request = (
            "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Origin: https://app.foxglove.dev\r\nOrigin: https://evil.example\r\n\r\n"
        )
        with socket.create_connection(("127.0.0.1", port_of(out.places[0])), timeout=20) as line:
            line.sendall(request.encode())
            assert line.recv(100).startswith(b"HTTP/1.1 403")


def test_listeners_are_of_this_computer_only_and_their_readers_are_few() -> None:
    with publisher("tcp:0", "ws:0") as out:
        assert [place.rpartition(":")[0] for place in out.places] == ["tcp://127.0.0.1", "ws://127.0.0.1"]
        with contextlib.ExitStack() as stack:
            for _ in range(MOST_READERS):
                stack.enter_context(socket.create_connection(("127.0.0.1", port_of(out.places[0]))))
            until(lambda: out.counts[0][2] == MOST_READERS)
            more = stack.enter_context(socket.create_connection(("127.0.0.1", port_of(out.places[0]))))
            more.settimeout(20)
            assert more.recv(1) == b""
        until(lambda: out.counts[0][2] == MOST_READERS)
        with socket.create_connection(("127.0.0.1", port_of(out.places[1])), timeout=20) as line:
            line.sendall(os.urandom(5000))  # no handshake
            with contextlib.suppress(ConnectionError):
                while line.recv(4096):
                    pass
        with connect(f"ws://127.0.0.1:{port_of(out.places[1])}", proxy=None):
            pass


def test_the_end_frees_ports_threads_and_descriptors() -> None:
    folder = Path("/proc/self/fd")
    if not folder.is_dir():
        pytest.skip("descriptors are counted on Linux only")
    with publisher("tcp:0", "ws:0", "pty", "udp:127.0.0.1:9"):
        pass  # what is imported once
    before, threads = len(list(folder.iterdir())), threading.active_count()
    for _ in range(3):
        with publisher("tcp:0", "ws:0", "pty", "udp:127.0.0.1:9") as out:
            line = socket.create_connection(("127.0.0.1", port_of(out.places[0])))
            until(lambda one=out: one.counts[0][2] == 1)  # type: ignore[misc]
            out.offer(state())
        assert line.recv(4096)  # what waited was sent
        line.close()
    assert len(list(folder.iterdir())) == before
    assert threading.active_count() <= threads


def test_a_destination_that_cannot_be_opened_is_named_and_the_others_are_freed(tmp_path: Path) -> None:
    taken = socket.create_server(("127.0.0.1", 0))
    port = taken.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    with pytest.raises(OSError, match="in use") as error:
        publisher(f"tcp:{free}", f"tcp:{port}").open()
    assert error.value.__notes__ == [f"tcp:{port}"]
    socket.create_server(("127.0.0.1", free)).close()
    taken.close()
    (tmp_path / "old.mcap").write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        publisher(f"mcap:{tmp_path}/old.mcap").open()
    assert (tmp_path / "old.mcap").read_bytes() == b"mine"


class FullDisk:
    """A file on a disk that is full."""

    def write(self, *_: Any) -> None:
        """Fail."""
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_ends_the_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with publisher(f"mcap:{tmp_path}/a.mcap", "tcp:0") as out:
        with socket.create_connection(("127.0.0.1", port_of(out.places[1])), timeout=20) as line:
            until(lambda: out.counts[1][2] == 1)
            monkeypatch.setattr(out._outlets[0], "_file", FullDisk())
            out.offer(state(0))
            out.offer(state(1))
            assert line.makefile("rb").readline()
        until(lambda: out.counts[0][1] == 2)
        assert "No space left on device" in out.places[0]


def test_waiting_rows_are_few() -> None:
    assert WAITING / 50 <= 0.5  # [s]: what a slow reader gets is no older
