"""Live: samples lost, latency and CPU of a stream from a device in another process, and unplugging.

Each figure is printed; the asserted bars are those of a quiet machine.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

import lab.live
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.ring import ROOM
from lab.data.streams.source_status import LOST, STALE
from lab.live.live_navigator import STEP, LiveNavigator
from lab.live.simulated.simulated_transport import SimulatedTransport
from lab.live.station import Station
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

SECONDS = float(os.environ.get("INS_LAB_LIVE_SECONDS", "60"))
"""How long each stream runs [s]; the bar of the laboratory is 600."""
pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300 + 2 * SECONDS)]


@contextmanager
def device(rate: int, seconds: float = SECONDS + 120) -> Iterator[str]:
    """Run a simulated device on a table in another process for some time [s]; give its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "dashboards", "live", "simulate", "rest"]
    command += ["--rest", str(int(seconds)), "--rate", str(rate), "--to", f"tcp:{port}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield f"tcp:127.0.0.1:{port}?protocol=vectornav"
        process.kill()


def delays_of_navigator(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Return a list to which each call of a navigator appends the ages of the samples that it gets [s]."""
    delays: list[np.ndarray] = []
    feed = LiveNavigator.feed

    def timed_feed(self: LiveNavigator, imu: np.ndarray, *others: np.ndarray) -> bool:
        delays.append(time.monotonic() - imu["time"])
        return feed(self, imu, *others)

    monkeypatch.setattr(LiveNavigator, "feed", timed_feed)
    return delays


@pytest.mark.parametrize("rate", [200, 1000])
def test_no_sample_is_lost_and_the_navigator_gets_it_soon(
    rate: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    delays = delays_of_navigator(monkeypatch)
    with device(rate) as address:
        source = lab.live.open(address)
        source.record(tmp_path / "stream.inslab")
        station = Station(source, SensorSuite(), NavigatorSettings(), "bench")
        while source.end.imu < 10 * rate:  # the clocks have settled
            time.sleep(0.01)
        process, begin = psutil.Process(), time.monotonic()
        cpu, memory, solved = process.cpu_times(), [], []
        delays.clear()
        while time.monotonic() - begin < SECONDS:
            time.sleep(0.1)
            solved.append(time.monotonic() - station.state.time)
            memory.append(process.memory_info().rss / 2**20)
        spent = process.cpu_times()
        status = source.status
        source.close()
        received = source.since().imu
        station.close()
    delay = 1e3 * np.concatenate(delays)
    samples = recorded_samples(tmp_path / "stream.inslab")
    share = (spent.user + spent.system - cpu.user - cpu.system) / SECONDS
    print(
        f"\n{rate} Hz, {SECONDS:g} s: {len(samples.imu)} samples recorded, "
        f"{samples.reception.loss.missing} missing; "
        f"wire to navigator median {np.median(delay):.2f} ms, 99 % {np.percentile(delay, 99):.2f} ms; "
        f"age of the solution median {1e3 * np.median(solved):.1f} ms; "
        f"CPU of receiving, recording and navigating {share:.1%} of a core; memory in the last four fifths "
        f"{min(memory[len(memory) // 5 :]):.0f} to {max(memory[len(memory) // 5 :]):.0f} MB; "
        f"drift {1e6 * status.drift:.1f} ppm"
    )
    assert samples.reception.loss.missing == 0
    if len(samples.imu) <= ROOM[0]:
        assert samples.imu.tobytes() == received.tobytes()
    # A step of samples goes to the navigator at once, when its last sample is there.
    assert np.median(delay) <= 35.0
    assert np.percentile(delay, 99) <= 1e3 * STEP


def test_an_unplugged_device_is_shown_and_comes_back(tmp_path: Path) -> None:
    shown, back = [], []
    with lab.live.open("simulated:rest?rest=120&hz=200") as source:
        assert isinstance(source._transport, SimulatedTransport)
        simulated = source._transport.device
        source.record(tmp_path / "plug.inslab")
        for _ in range(5):
            while source.status.state != "streaming" or source.status.silence > 0.1:
                time.sleep(0.005)
            time.sleep(1.0)
            simulated.unplug()
            begin = time.monotonic()
            while source.status.state not in (LOST, STALE):
                time.sleep(0.001)
            shown.append(time.monotonic() - begin)
            time.sleep(3.0)
            simulated.plug()
            begin, reached = time.monotonic(), source.end.imu
            while source.end.imu == reached:
                time.sleep(0.001)
            back.append(time.monotonic() - begin)
    print(f"\nunplugged: shown after {max(shown):.3f} s, streaming again after {max(back):.3f} s (the most)")
    assert max(shown) <= 0.5
    assert max(back) <= 2.0
    assert recorded_samples(tmp_path / "plug.inslab").imu["gap"].sum() == 6
