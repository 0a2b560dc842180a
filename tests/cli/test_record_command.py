"""``ins-lab record``: what a replayed X-Plane sends becomes a mission, however the recording ends."""

from __future__ import annotations

import inspect
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from asking import ask, refused

from lab.cli import record
from lab.data.streams import xplane_live
from lab.missions import Recording, mission

sys.path.append(str(Path(__file__).parents[1]))
from xplane_sender import XPlaneSender


def flown(samples: int = 300) -> Recording:
    whole = mission("montreal").recording
    return Recording(*(getattr(whole, field.name)[2000 : 2000 + samples] for field in fields(Recording)))


def unpaced() -> int:
    """Let frames follow each other without waiting for the receiver, which the test cannot ask."""
    return 10**9


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(xplane_live, "SILENCE", 0.3)
    monkeypatch.setattr(record, "PATIENCE", 0.3)


def test_what_is_sent_becomes_a_mission(tmp_path, impatient):
    with XPlaneSender(flown()) as sender:
        sender.received = unpaced
        answer = ask(
            "record", "circuit", "--port", str(sender.port), "--out", str(tmp_path), "--title", "A circuit"
        )
    assert answer.exit_code == 0, answer.output
    assert "300 samples, 16.4 s recorded" in answer.stdout
    assert "above sea level" in answer.stderr
    made = mission(str(tmp_path / "circuit.toml"))
    assert made.title == "A circuit"
    assert "X-Plane live" in made.origin
    sent = flown()
    times = made.recording.time - made.recording.time[0]
    wanted = np.column_stack(
        [np.interp(times, sent.time - sent.time[0], column) for column in sent.velocity_n.T]
    )
    assert np.abs(made.recording.velocity_n - wanted).max() < 0.05


def test_it_ends_after_the_seconds_asked_for(tmp_path):
    with XPlaneSender(flown(2000 - 300)) as sender:
        sender.received = unpaced
        answer = ask(
            "record", "short", "--port", str(sender.port), "--out", str(tmp_path), "--seconds", "0.3"
        )
        assert answer.exit_code == 0, answer.output
        assert not sender.done.is_set()
    assert (tmp_path / "short.toml").exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot send Ctrl-C to one process")
def test_ctrl_c_keeps_what_was_recorded(tmp_path):
    with XPlaneSender(flown()) as sender:
        sender.received = unpaced
        running = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "dashboards",
                "record",
                "kept",
                "--port",
                str(sender.port),
                "--out",
                str(tmp_path),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert sender.done.wait(60)
        running.send_signal(signal.SIGINT)
        out, error = running.communicate(timeout=60)
    assert running.returncode == 0, error
    assert "samples" in out
    assert "Traceback" not in error
    assert (tmp_path / "kept.toml").exists()


def test_an_x_plane_that_does_not_answer_is_told_of(tmp_path, impatient):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        port = nobody.getsockname()[1]
        begin = time.monotonic()
        answer = ask("record", "none", "--port", str(port), "--out", str(tmp_path))
    refused(answer, "0 samples were received", "is X-Plane running with a flight loaded")
    assert time.monotonic() - begin < 30
    assert list(tmp_path.iterdir()) == []
    assert not any(thread.name == "X-Plane" for thread in threading.enumerate())


def test_what_cannot_be_is_refused_before_the_flight(tmp_path):
    (tmp_path / "mine.toml").write_text("")
    refused(ask("record", "mine", "--out", str(tmp_path)), "mine.toml exists", "--force")
    refused(ask("record", "a/b", "--out", str(tmp_path)), "a/b")
    refused(ask("record", "x", "--seconds", "0", "--out", str(tmp_path)), "--seconds 0")
    refused(ask("record", "x", "--rate", "0", "--out", str(tmp_path)), "accepted are 1 to 1000 Hz")
    refused(ask("record", "x", "--port", "99999", "--out", str(tmp_path)), "accepted are 1 to 65535")


def test_the_defaults_are_those_of_the_recorder():
    of_command, of_recorder = (
        inspect.signature(function).parameters for function in (record.record, xplane_live.XPlaneRecorder)
    )
    for name in ("host", "port", "rate"):
        assert of_command[name].default == of_recorder[name].default
