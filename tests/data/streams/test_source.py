"""Source: states, unplugging, recording and replay, through real lines."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from live_streams import fixes, motion
from scripted_source import Scripted, streaming, until

import lab.live
from lab.base.files.mission_error import MissionError
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.samples import FIX
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.raw_recording import EVENT, RecordingError, read_header, records
from lab.data.streams.recorded_log import log_of_recording, recorded_samples
from lab.data.streams.source import Source
from lab.data.streams.source_status import ENDED, LOST, STALE, STREAMING
from lab.data.streams.transport import Chunk, TransportError
from lab.live.simulated.simulated_transport import SimulatedTransport

TCP = "&over=tcp:0"
LINES = ["", TCP] if sys.platform != "win32" else [TCP]


def device_of(source: Source):
    assert isinstance(source._transport, SimulatedTransport)
    return source._transport.device


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    until(lambda: set(threading.enumerate()) <= before)


def scripted(count: int = 200) -> tuple[Scripted, Source]:
    transport = Scripted()
    encoder = ENCODERS["vectornav"]()
    transport.steps = [
        Chunk(100 + float(row["time"]), encoder.encode(row[None], np.empty(0, FIX))) for row in motion(count)
    ]
    return transport, lab.live.open(transport, protocol="vectornav")


@pytest.mark.proof
@pytest.mark.parametrize("line", LINES)
def test_samples_come_and_are_recorded_and_replayed_bit_by_bit(line: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.inslab"
    source = lab.live.open(f"simulated:montreal?hz=200{line}")
    source.record(path)  # before anything comes
    with source:
        until(lambda: source.end.imu > 500 and source.end.fix > 0)
        status = streaming(source)
        assert status.protocol == "vectornav"
        assert 150 < status.rate < 250
        assert status.loss.missing == 0
    live = source.since()
    assert source.status.state == ENDED
    replayed = recorded_samples(path)
    assert replayed.imu.tobytes() == live.imu.tobytes()
    assert replayed.fix.tobytes() == live.fix.tobytes()
    with lab.live.open(f"replay:{path}?speed=max") as again:
        until(lambda: again.ended)
        read = again.since()
    assert again.status.sentence == "The recording has ended."
    assert read.imu.tobytes() == live.imu.tobytes()


@pytest.mark.proof
@pytest.mark.parametrize("device", ["vectornav", "memsense", "mip", "text"])
@pytest.mark.parametrize("before", [1, 30])
def test_a_recording_that_begins_before_the_first_sample_has_the_same_bits(
    device: str, before: int, tmp_path: Path
) -> None:
    """Protocol, rate and clock are found in the first second: its bytes are recorded too."""
    transport, encoder, path = Scripted(), ENCODERS[device](), tmp_path / "late.inslab"
    rng = np.random.default_rng(1)
    steps = [
        Chunk(100 + float(row["time"]) + rng.exponential(2e-3), encoder.encode(row[None], np.empty(0, FIX)))
        for row in motion(1000)
    ]
    transport.steps = steps[:before]
    with lab.live.open(transport) as source:
        until(lambda: not transport.steps)
        assert source.end.imu == 0
        source.record(path)
        transport.steps = steps[before:]
        until(lambda: not transport.steps)
        until(lambda: source.end.imu > 900)
    live, replayed = source.since(), recorded_samples(path)
    assert len(live.imu) > 900
    assert replayed.imu.tobytes() == live.imu.tobytes()


def test_what_comes_is_what_the_simulated_sensors_measured() -> None:
    with lab.live.open("simulated:montreal?hz=200&device=mip&mounted=y,x,-z&axes=y,x,-z") as source:
        until(lambda: source.end.imu > 300)
        flight = device_of(source).flight
        read = source.since()
    assert (
        np.abs(read.imu["rate"] - AxisMap.of("y,x,-z").mapped(flight.imu["rate"])[: len(read.imu)]).max()
        < 1e-6
    )
    true = flight.result.gyro.increments[: len(read.imu)] * 200
    assert np.abs(read.imu["rate"] - true).max() < 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("line", LINES)
def test_unplugging_is_shown_and_survived(line: str, tmp_path: Path) -> None:
    path = tmp_path / "unplugged.inslab"
    source = lab.live.open(f"simulated:montreal?hz=200{line}")
    source.record(path)  # before anything comes
    with source:
        until(lambda: source.end.imu > 200)
        device_of(source).unplug()
        until(lambda: source.status.state == LOST)
        assert "it is tried again" in source.status.sentence
        before = source.end.imu
        time.sleep(0.4)
        device_of(source).plug()
        until(lambda: source.end.imu > before + 100)
    live = source.since().imu
    assert live["gap"].sum() == 2
    assert np.diff(live["time"]).max() > 0.3
    assert [kind for kind, _ in records(path)].count(EVENT) == 1
    assert recorded_samples(path).imu.tobytes() == live.tobytes()


def test_who_waits_for_a_sample_is_woken_by_it_and_by_no_other() -> None:
    transport, source = scripted()
    chunks, transport.steps = transport.steps, []
    waiting, woken = threading.Event(), threading.Event()
    with source:
        transport.steps.append(chunks[0])
        until(lambda: source.end.imu == 1)
        cursor = source.end
        first = float(source.since().imu["time"][0])

        def wait() -> None:
            waiting.set()
            source.wait(cursor, 60.0, first + 0.095)
            woken.set()

        thread = threading.Thread(target=wait)
        thread.start()
        waiting.wait()
        until(lambda: source._awaited == [first + 0.095])
        step = float(np.diff(motion(2)["time"])[0])
        early = int(0.09 / step)
        for number, chunk in enumerate(chunks[1 : early + 1], 2):
            transport.steps.append(chunk)
            until(lambda end=number: source.end.imu == end)
        assert not woken.is_set()
        for chunk in chunks[early + 1 : early + 10]:
            transport.steps.append(chunk)
        thread.join()
        assert woken.is_set()
        assert source._newest >= first + 0.095
        # What came meanwhile is not waited for.
        assert source.wait(cursor, 60.0, first + 0.095)


def test_silence_is_stale() -> None:
    _, source = scripted(50)
    with source:
        until(lambda: source.end.imu == 50)
        until(lambda: source.status.state == STALE)
        assert "No data for" in source.status.sentence


def test_a_device_that_is_not_there_is_waited_for() -> None:
    transport, source = scripted()
    transport.openings = [FileNotFoundError(2, "No such file or directory")] * 3
    with source:
        until(lambda: source.end.imu > 0)
    assert transport.opened == 4
    texts = [event.text for event in source.status.events]
    assert texts[0] == "Not reached: there is no such port; it is tried again."
    assert sum("Not reached" in text for text in texts) == 1
    assert transport.closed >= 4


def test_a_loss_in_the_middle_of_a_frame_costs_that_frame() -> None:
    transport, source = scripted()
    whole = list(transport.steps)
    transport.steps[100] = Chunk(whole[100].arrival, whole[100].data[:20])
    transport.steps.insert(101, OSError("gone"))
    with source:
        until(lambda: source.end.imu == 199)
    gap = source.since().imu["gap"]
    assert np.flatnonzero(gap).tolist() == [0, 100]


def test_an_error_of_the_laboratory_ends_the_source_with_a_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    transport, source = scripted()
    transport.steps.insert(20, RuntimeError("boom"))
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    with source:
        until(lambda: source.ended)
    assert source.status.sentence == "The laboratory failed: RuntimeError: boom"
    assert transport.closed


def test_closing_is_quick_whatever_it_does() -> None:
    transport, source = scripted()
    transport.openings = [OSError("no")] * 1000
    source.start()
    until(lambda: transport.opened > 1)
    begin = time.monotonic()
    for _ in range(3):
        source.close()
    assert time.monotonic() - begin < 5
    assert source.ended
    never_started = scripted()[1]
    never_started.close()


def test_a_recording_that_fails_leaves_the_stream(tmp_path: Path) -> None:
    transport, source = scripted(400)
    held, transport.steps = transport.steps, []
    source.record(tmp_path / "full.inslab")
    with pytest.raises(RecordingError, match="is being recorded"):
        source.record(tmp_path / "other.inslab")
    assert source._recorder.writer is not None
    source._recorder.writer._file.close()  # type: ignore[union-attr]  # as if the disk were gone
    source._recorder.writer._file = Path("/dev/full").open("wb", buffering=0)  # type: ignore[assignment]  # noqa: SIM115
    transport.steps = held
    with source:
        until(lambda: source.end.imu == 400)
        assert "No space left" in source.status.warning
        assert not source.recording


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here, which is a full disk")
def test_a_stop_while_the_disk_is_full_is_told_and_what_was_written_stays(tmp_path: Path) -> None:
    path = tmp_path / "full.inslab"
    _, source = scripted(40)
    source.record(path)
    with source:
        until(lambda: source.end.imu == 40)  # in the buffer, but for the first: a second has not passed
        assert source._recorder.writer is not None
        assert source._recorder.writer._file is not None
        with Path("/dev/full").open("wb") as full:
            os.dup2(full.fileno(), source._recorder.writer._file.fileno())
        source._recorder.writer._file.write(
            b"\0"
        )  # there is something to write at the end, however slow this is
        assert source.stop_recording() == path
        assert "No space left" in source.status.warning
        assert "what was written stays" in source.status.events[-1].text
    assert read_header(path)["protocol"] == "vectornav"


def test_axes_may_change_while_it_records(tmp_path: Path) -> None:
    path = tmp_path / "axes.inslab"
    transport, source = scripted(200)
    later = [transport.steps.pop() for _ in range(100)][::-1]
    source.record(path)
    with source:
        until(lambda: source.end.imu == 100)
        source.axes = AxisMap.of("y,x,-z")
        transport.steps += later
        until(lambda: source.end.imu == 200)
    live = source.since().imu
    assert recorded_samples(path).imu.tobytes() == live.tobytes()
    assert np.allclose(live["force"][150], motion(200)["force"][150][[1, 0, 2]] * [1, 1, -1], atol=1e-3)
    with lab.live.open(f"replay:{path}?speed=max") as again:
        until(lambda: again.ended)
    assert again.since().imu.tobytes() == live.tobytes()


def test_a_recording_becomes_a_log_or_says_what_lacks(tmp_path: Path) -> None:
    path = tmp_path / "short.inslab"
    _, source = scripted()
    source.record(path)
    with source:
        until(lambda: source.end.imu == 200)
    with pytest.raises(MissionError, match=r"short\.inslab.*no fix of a receiver"):
        log_of_recording(path)


def rewritten(path: Path, header: dict[str, object]) -> Path:
    """Return a copy of a recording with other words about its source."""
    magic, known, rest = path.read_bytes().split(b"\n", 2)
    copy = path.with_name("rewritten.inslab")
    copy.write_bytes(b"\n".join((magic, json.dumps({**json.loads(known), **header}).encode(), rest)))
    return copy


def test_a_recording_never_executes_a_decoder_that_it_names(tmp_path: Path) -> None:
    _, source = scripted(20)
    source.record(tmp_path / "fine.inslab")
    with source:
        until(lambda: source.end.imu == 20)
    evil = tmp_path / "evil.py"
    evil.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\nclass D:\n    def feed(self, data): ...\n")
    path = rewritten(tmp_path / "fine.inslab", {"protocol": f"{evil}:D"})
    for open_it in (lambda: lab.live.open(f"replay:{path}"), lambda: recorded_samples(path)):
        with pytest.raises(TransportError, match="not executed"):
            open_it()
    assert not (tmp_path / "ran").exists()
    assert len(recorded_samples(path, protocol="vectornav").imu) == 20


@pytest.mark.parametrize(
    "clock", [None, 5, [], [1] * 7, ["x"] * 7, [10**400] * 7, [None] * 7, [0, 0, 0, 1, -1, 0, 0], {"a": 1}]
)
def test_a_damaged_clock_in_a_recording_is_left_out(tmp_path: Path, clock: object) -> None:
    _, source = scripted(20)
    source.record(tmp_path / "fine.inslab")
    with source:
        until(lambda: source.end.imu == 20)
    imu = recorded_samples(rewritten(tmp_path / "fine.inslab", {"clock": clock})).imu
    assert len(imu) == 20
    assert (np.diff(imu["time"]) > 0).all()


def test_axes_that_were_changed_hold_for_the_whole_mission(tmp_path: Path) -> None:
    path = tmp_path / "late.inslab"
    sent, fix = motion(1500), fixes(14)
    encoder = ENCODERS["vectornav"]()
    transport = Scripted()
    for begin in range(0, 1500, 10):
        rows = sent[begin : begin + 10]
        due = fix[(fix["time"] > rows["time"][0] - 0.01) & (fix["time"] <= rows["time"][-1])]
        data = encoder.encode(rows, due[:0]) + (encoder.encode(rows[:0], due) if len(due) else b"")
        transport.steps.append(Chunk(100 + float(rows["time"][-1]), data))
    later, transport.steps = transport.steps[75:], transport.steps[:75]
    source = lab.live.open(transport, protocol="vectornav")
    source.record(path)
    with source:
        until(lambda: source.end.imu == 750)
        source.axes = AxisMap.of("y,x,-z")
        transport.steps += later
        until(lambda: source.end.imu == 1500)
    log = log_of_recording(path)
    assert "changed to y,x,-z" in " ".join(log.repairs)
    assert np.allclose(log.rates[1][20], sent["force"][21][[1, 0, 2]] * [1, 1, -1], atol=0.01)


def test_udp_is_listened_to_from_one_sender() -> None:
    encoder = ENCODERS["vectornav"]()
    frames = [encoder.encode(row[None], np.empty(0, FIX)) for row in motion(60)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with (
        lab.live.open(f"udp:{port}?protocol=vectornav") as source,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        until(lambda: source.status.state == STREAMING)
        for k, frame in enumerate(frames):
            one.sendto(frame, ("127.0.0.1", port))
            until(lambda k=k: source.end.imu == k + 1)
            other.sendto(b"\xfa" * 100, ("127.0.0.1", port))
        until(lambda: source._transport.foreign == 60)  # type: ignore[attr-defined]
        assert source.status.statistics.skipped == 0


@pytest.mark.proof
def test_simulated_devices_misbehave_as_told() -> None:
    wrong = "corruption=0.001&jitter_ms=5&drift_ppm=300"
    with lab.live.open(f"simulated:rest?hz=200&rest=60&{wrong}") as source:
        until(lambda: source.end.imu > 600)
        status = source.status
    assert status.statistics.failed > 0
    assert status.loss.missing > 0
    read = source.since().imu
    assert np.abs(np.linalg.norm(read["force"], axis=1) - 9.8).max() < 0.5


def test_many_readers_get_the_same(tmp_path: Path) -> None:
    _, source = scripted(2000)
    found: list[list[float]] = [[] for _ in range(8)]

    def read(mine: list[float]) -> None:
        cursor = None
        while True:
            over = source.ended
            part = source.since(cursor)
            cursor = part.cursor
            mine += part.imu["time"].tolist()
            if over or len(mine) == 2000:
                return
            source.wait(cursor, 0.1)

    with source:
        threads = [threading.Thread(target=read, args=(mine,)) for mine in found]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert all(len(mine) == 2000 and mine == found[0] for mine in found)
