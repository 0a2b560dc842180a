"""gpsd, where it is installed, reads the port and the pseudo-terminal."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import time

import pytest
from sent_solutions import state

from lab.live.outlets.destination import Destination
from lab.live.outlets.publisher import Publisher

GPSD = shutil.which("gpsd")


@pytest.mark.proof
@pytest.mark.skipif(GPSD is None, reason="gpsd is not installed")
@pytest.mark.parametrize("place", ["tcp:0", "pty"])
def test_gpsd_reads_position_height_and_course(place: str) -> None:
    with Publisher([Destination.of(f"{place}?protocol=nmea&geoid=-30&hz=10", 10)]) as out:
        with socket.create_server(("127.0.0.1", 0)) as probe:
            port = probe.getsockname()[1]
        device = out.places[0].removeprefix("the serial port ")
        command = [str(GPSD), "-N", "-n", "-b", "-S", str(port), device]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as daemon:
            found, deadline, line = {}, time.monotonic() + 60, None
            utc = time.time() - time.monotonic()
            while time.monotonic() < deadline and "altHAE" not in found:
                out.offer(state(utc_offset=utc))
                time.sleep(0.1)  # the pace of a receiver
                if line is None:
                    try:
                        line = socket.create_connection(("127.0.0.1", port))
                    except OSError:
                        continue
                    line.sendall(b'?WATCH={"enable":true,"json":true};\n')
                    line.setblocking(False)
                    data = b""
                try:
                    data += line.recv(65536)
                except BlockingIOError:
                    continue
                rows = [one for one in data.split(b"\n")[:-1] if b'"class":"TPV"' in one and b",," not in one]
                found = json.loads(rows[-1]) if rows else {}
            daemon.terminate()
            if line is not None:
                line.close()
    assert found["mode"] == 3
    assert (found["lat"], found["lon"]) == (45.5, -73.75)
    assert (found["altHAE"], found["altMSL"], found["geoidSep"]) == (100.0, 130.0, -30.0)
    assert found["track"] == pytest.approx(306.87)
    assert found["speed"] == pytest.approx(5.0, abs=0.001)
