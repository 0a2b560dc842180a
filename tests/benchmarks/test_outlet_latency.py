"""Outlets: the time from the arrival of a sample to the read of its row, quiet and under load.

A device, the command and its readers are processes of their own. The arrival is that of the clock of the
device as mapped to the host, which no sample of the last second came before: the delays are not too short.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np
import psutil
import pytest

SECONDS = float(os.environ.get("INS_LAB_LIVE_SECONDS", "60"))
"""How long each case is measured [s]."""
RATE = 50
"""Rows per second [Hz]."""
LONGEST = 0.050
"""Longest delay of 95 % of the rows on a quiet machine [s]."""
pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300 + 2 * SECONDS)]


def free_ports(count: int) -> list[int]:
    probes = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def read(kind: str, port: int, seconds: float, answer: Connection) -> None:
    """Read rows in a process of its own; answer with their times and those of their reads [s]."""
    found = []
    if kind == "udp":
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        line.bind(("127.0.0.1", port))
        line.settimeout(60)
        take = lambda: line.recv(65536)  # noqa: E731
    elif kind == "tcp":
        stream = reached(port).makefile("rb")
        take = stream.readline
    else:
        from websockets.sync.client import connect

        reached(port).close()
        connection = connect(f"ws://127.0.0.1:{port}", proxy=None)
        take = lambda: str(connection.recv()).encode()  # noqa: E731
    first = None
    while first is None or time.monotonic() - first < seconds:
        row = take()
        now = time.monotonic()
        said = json.loads(row)
        if said["phase"] == "navigating":
            first = first or now
            found.append((said["time_s"], now))
    answer.send(found)


def reached(port: int) -> socket.socket:
    for _ in range(600):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.1)
    raise AssertionError("nobody listens")


def burn() -> None:
    while True:
        sum(range(100_000))


@contextmanager
def load(processes: int) -> Iterator[None]:
    busy = [multiprocessing.Process(target=burn, daemon=True) for _ in range(processes)]
    for one in busy:
        one.start()
    yield
    for one in busy:
        one.kill()


@pytest.mark.parametrize("busy", [0, 2 * (os.cpu_count() or 1)], ids=["quiet", "under load"])
def test_a_row_is_read_soon_after_its_sample_came(busy: int) -> None:
    device_port, *ports = free_ports(4)
    command = [sys.executable, "-m", "dashboards", "live"]
    simulate = [*command, "simulate", "montreal", "--rate", "200", "--to", f"tcp:{device_port}"]
    places = [f"udp:127.0.0.1:{ports[0]}", f"tcp:{ports[1]}", f"ws:{ports[2]}"]
    navigate = [*command, "navigate", f"tcp:127.0.0.1:{device_port}?protocol=vectornav", "--hz", str(RATE)]
    for place in places:
        navigate += ["--to", place]
    with subprocess.Popen(simulate, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as device:
        assert device.stdout is not None
        device.stdout.readline()
        with subprocess.Popen(navigate, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as lab:
            ends, readers = [], []
            for kind, port in zip(("udp", "tcp", "ws"), ports, strict=True):
                ours, theirs = multiprocessing.Pipe()
                ends.append(ours)
                readers.append(
                    multiprocessing.Process(target=read, args=(kind, port, SECONDS, theirs), daemon=True)
                )
                readers[-1].start()
            with load(busy):
                begun, cpu = time.monotonic(), psutil.Process(lab.pid).cpu_times()
                answers = [end.recv() for end in ends]
                spent, passed = psutil.Process(lab.pid).cpu_times(), time.monotonic() - begun
            lab.terminate()
            said = lab.stderr.read() if lab.stderr else ""
        device.kill()
    share = (spent.user + spent.system - cpu.user - cpu.system) / passed
    print(f"\n{busy} busy processes, load {os.getloadavg()[0]:.1f}; the command took {share:.0%} of a core")
    for kind, rows in zip(("udp", "tcp", "ws"), answers, strict=True):
        taken, came = np.array(rows).T
        delay = came - taken
        p50, p95, p99 = 1e3 * np.percentile(delay, (50, 95, 99))
        rate = (len(rows) - 1) / (came[-1] - came[0])
        print(f"{kind}: {len(rows)} rows at {rate:.1f} Hz, p50 {p50:.1f}, p95 {p95:.1f}, p99 {p99:.1f} ms")
        assert (np.diff(taken) > 0).all()
        if not busy:
            assert np.percentile(delay, 95) <= LONGEST, said
