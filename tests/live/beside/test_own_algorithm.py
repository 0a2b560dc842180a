"""Algorithms beside a stream: followed, slow, raising, without an end; and the navigator."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil
import pytest

import lab.live
from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.raw_recording import RawWriter
from lab.data.streams.source import Source
from lab.data.streams.transport import Chunk
from lab.experiment.experiment import Experiment
from lab.live.beside import algorithm_process
from lab.live.beside.live_algorithm import LiveAlgorithmError
from lab.live.beside.own_algorithm import ENDED, OwnAlgorithm
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.live.station import Station

RATE = 100
TEXT = """
import ctypes, os, sys, time
import numpy as np


class Counts:
    '''A quaternion that tells how many samples it has seen, and whether they hung together.'''
    def __init__(self):
        self.seen, self.whole = 0, 0.0
    def step(self, imu, fixes):
        self.seen += imu.time.size
        self.whole += imu.dt.sum()
        print("printed by the algorithm")
        angle = 1e-4 * self.seen
        return [np.cos(angle), np.sin(angle), 0, 0]


class Raises:
    def step(self, imu, fixes):
        raise ValueError("no idea")


class Spins:
    def step(self, imu, fixes):
        while True:
            pass


class Holds:
    '''Keeps the lock of the interpreter in one call of the C library, as some modules do for long.'''
    def step(self, imu, fixes):
        ctypes.PyDLL(None).sleep(3600)


class Dies:
    def step(self, imu, fixes):
        os._exit(3)


class Eats:
    def step(self, imu, fixes):
        self.kept = np.ones(10**10)


class Pid:
    def step(self, imu, fixes):
        open(os.environ["PID_FILE"], "w").write(str(os.getpid()))
        while True:
            pass
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(TEXT, encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a raw recording of twenty seconds on a table."""
    path = tmp_path_factory.mktemp("raw") / "rest.inslab"
    flight = SimulatedFlight.of("rest", float(RATE), rest=20.0)
    encoder, writer = ENCODERS["vectornav"](), RawWriter(path, {"address": "rest", "protocol": "vectornav"})
    for begin, end in pairwise(np.arange(0.0, 20.05, 0.1)):
        parts = [rows[(rows["time"] > begin) & (rows["time"] <= end)] for rows in (flight.imu, flight.fix)]
        writer.accept(Chunk(100.0 + end, encoder.encode(*parts)))
    writer.close()
    return path


@pytest.fixture
def replayed(recording: Path) -> Iterator[Source]:
    with lab.live.open(f"replay:{recording}?speed=max") as source:
        yield source


def test_every_sample_of_a_stream_reaches_the_algorithm_once(
    replayed: Source, file: str, capfd: pytest.CaptureFixture[str]
) -> None:
    own = OwnAlgorithm(replayed, "Counts", f"{file}:Counts")
    own.wait()
    assert (own.state, own.failure) == (ENDED, "")
    _, time, q_nb = own.since(0)
    seen = 2 * np.arctan2(q_nb[:, 1], q_nb[:, 0]) / 2e-4
    rows = replayed.since().imu
    assert seen[-1] == pytest.approx(len(rows), abs=0.01)
    assert time[-1] == rows["time"][-1]
    assert np.diff(seen) == pytest.approx(np.diff(time) * RATE, abs=1.5)
    assert "printed by the algorithm" not in capfd.readouterr().out


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Raises", "mine.py, line 20, in step: ValueError: no idea"),
        ("Dies", "its process ended by itself"),
        ("Eats", "MemoryError"),
    ],
)
def test_what_fails_is_said_and_ends_alone(replayed: Source, file: str, name: str, words: str) -> None:
    own = OwnAlgorithm(replayed, name, f"{file}:{name}")
    own.wait()
    assert words in own.sentence
    assert "the navigator goes on" in own.sentence
    own.wait_until_loaded()  # it was loaded: this is no refusal


@pytest.mark.parametrize(
    ("place", "words"),
    [("mine.py:No", "has no 'No'; live algorithms in the file: Counts"), ("x", "^'x': accepted is")],
)
def test_what_cannot_be_loaded_is_refused(replayed: Source, file: str, place: str, words: str) -> None:
    own = OwnAlgorithm(replayed, "No", place.replace("mine.py", file))
    with pytest.raises(LiveAlgorithmError, match=words):
        own.wait_until_loaded()


@pytest.mark.parametrize("name", ["Spins", "Holds"])
def test_one_that_never_returns_is_ended_and_the_navigator_is_that_without_it(
    recording: Path, file: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The navigator has taken all samples while the step runs, and ends with the same numbers."""
    monkeypatch.setattr(algorithm_process, "PATIENCE", 3.0)
    ends = []
    for place in (None, f"{file}:{name}"):
        source = lab.live.open(f"replay:{recording}?speed=max")
        experiment = Experiment()
        station = Station(source, experiment.sensors, experiment.navigator, "rest")
        own = None if place is None else station.beside(name, place)
        try:
            while not source.ended:
                source.wait(source.end, 1.0)
            station.wait()
            ends.append(station.state)
            if own is not None:
                own.wait()
                assert "one step took more than 3 s" in own.failure
        finally:
            station.close()
    alone, beside = ends
    assert np.isfinite(alone.euler).all()
    assert (alone.phase, alone.rows) == (beside.phase, beside.rows)
    for part in (
        "time",
        "euler",
        "euler_sigma",
        "bias",
        "bias_sigma",
        "position",
    ):
        assert getattr(alone, part) == pytest.approx(getattr(beside, part), rel=1e-5, abs=1e-9)


def test_closing_ends_the_process_in_the_middle_of_a_step(
    replayed: Source, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = tmp_path / "pid"
    monkeypatch.setenv("PID_FILE", str(told))
    own = OwnAlgorithm(replayed, "Pid", f"{file}:Pid")
    own.wait_until_loaded()
    while not (told.is_file() and told.read_text()):
        own.wait(0.05)
    process = psutil.Process(int(told.read_text()))
    own.close()
    process.wait(20)
    assert (own.state, own.failure, own.sentence) == (ENDED, "", "")
    own.close()


SCRIPT = """
import os, sys, time
import lab.live
from lab.live.beside.own_algorithm import OwnAlgorithm
if __name__ == "__main__":
    source = lab.live.open(sys.argv[1])
    source.start()
    OwnAlgorithm(source, "Pid", sys.argv[2])
    print("begun", flush=True)
    time.sleep(600)
"""


@pytest.mark.proof
def test_a_laboratory_that_is_killed_leaves_no_process(recording: Path, file: str, tmp_path: Path) -> None:
    script, told = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(SCRIPT, encoding="utf-8")
    running = subprocess.Popen(
        [sys.executable, str(script), f"replay:{recording}?speed=max", f"{file}:Pid"],
        env=os.environ | {"PID_FILE": str(told), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdout=subprocess.PIPE,
    )
    try:
        while not (told.is_file() and told.read_text()):
            assert running.poll() is None
        process = psutil.Process(int(told.read_text()))
        running.send_signal(signal.SIGKILL)
        running.wait(20)
        process.wait(20)
    finally:
        running.kill()
        running.wait()
