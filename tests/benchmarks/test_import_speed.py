"""Speed and memory of reading flights: a million rows of our own csv, and a megabyte of each format.

Speed is time on the processor, which other programs on the machine disturb least.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from lab.data.formats import read_raw
from lab.missions import Recording, mission, prepare_import, write_flight_csv

TESTS = Path(__file__).parents[1]
sys.path.append(str(TESTS))

from writers import WRITERS  # noqa: E402 - the writers stand beside the tests of missions

pytestmark = pytest.mark.benchmark

ROWS = 1_000_000
MOST_SECONDS = 3.0
MOST_MEMORY = 10.0
MOST_SECONDS_PER_MEGABYTE = 5.0

PEAK = """
import sys
from pathlib import Path
from lab.missions import prepare_import
def peak():  # not of getrusage, which remembers the process that started this one
    return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
prepare_import(sys.argv[1])
before = peak()
flight = prepare_import(sys.argv[2])
assert len(flight.recording.time) == int(sys.argv[3])
print(peak() - before)
"""


def flight(samples: int) -> Recording:
    """Return circles at 60 m/s, at 200 Hz, with all columns."""
    time_ = np.arange(samples) * 0.005
    turn = 2 * np.pi * time_ / 400.0
    radius = 60.0 * 400.0 / (2 * np.pi)
    nothing = np.zeros(samples)
    climb = -30.0 * np.cos(3 * turn) * 2 * np.pi / 400.0
    return Recording(
        time=time_,
        latitude=np.radians(45.0) + radius * np.sin(turn) / 6.367e6,
        longitude=radius * (1 - np.cos(turn)) / (6.389e6 * np.cos(np.radians(45.0))),
        height=300.0 + 10.0 * np.sin(3 * turn),
        velocity_n=np.column_stack((60.0 * np.cos(turn), 60.0 * np.sin(turn), climb)),
        euler=np.column_stack((nothing + 0.09, 0.02 * np.sin(turn), np.angle(np.exp(1j * turn)))),
        airspeed=nothing + 60.0,
        alpha=nothing + 0.05,
        beta=nothing,
    )


def test_a_million_rows_of_our_csv(tmp_path: Path) -> None:
    path, small = tmp_path / "million.csv", tmp_path / "small.csv"
    write_flight_csv(path, flight(ROWS))
    write_flight_csv(small, flight(1000))
    megabytes = path.stat().st_size / 1e6
    for name, work in {"reading": read_raw, "reading, rebuilding and judging": prepare_import}.items():
        work(small)
        seconds = []
        for _ in range(5):
            begin = time.process_time()
            work(path)
            seconds.append(time.process_time() - begin)
        print(
            f"\n{name} a million rows of our csv, {megabytes:.0f} MB: {np.median(seconds):.2f} s, minimum "
            f"{min(seconds):.2f} s, bar {MOST_SECONDS:.0f} s"
        )
        assert np.median(seconds) <= MOST_SECONDS


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system tells no peak memory so")
def test_memory_of_a_million_rows(tmp_path: Path) -> None:
    path, small = tmp_path / "million.csv", tmp_path / "small.csv"
    write_flight_csv(path, flight(ROWS))
    write_flight_csv(small, flight(1000))
    answer = subprocess.run(
        [sys.executable, "-c", PEAK, str(small), str(path), str(ROWS)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    ratio = int(answer.stdout) / path.stat().st_size
    print(f"\nmemory for it: {ratio:.1f} times the file, bar {MOST_MEMORY:.0f}")
    assert ratio <= MOST_MEMORY


@pytest.mark.parametrize("name", WRITERS)
def test_a_megabyte_of_each_format(name: str, tmp_path: Path) -> None:
    content = WRITERS[name](mission("montreal").recording)
    files = content if isinstance(content, dict) else {"recording.dat": content}
    paths = [tmp_path / file for file in files]
    for path, data in zip(paths, files.values(), strict=True):
        path.write_bytes(data)
    read_raw(paths)
    seconds = []
    for _ in range(5):
        begin = time.process_time()
        read_raw(paths)
        seconds.append(time.process_time() - begin)
    megabytes = sum(map(len, files.values())) / 1e6
    print(f"\n{name}: {1e3 * np.median(seconds) / megabytes:.0f} ms per megabyte")
    assert np.median(seconds) <= MOST_SECONDS_PER_MEGABYTE * megabytes
