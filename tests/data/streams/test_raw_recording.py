"""Raw recording: survives any end; what it cannot hold is said."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.streams import raw_recording
from lab.data.streams.raw_recording import DATA, EVENT, MAGIC, RawWriter, RecordingError, read_header, records
from lab.data.streams.transport import Chunk

CHUNKS = [Chunk(100.0 + 0.01 * k, bytes([k % 256]) * (k % 40 + 1)) for k in range(500)]


def written(path: Path) -> Path:
    writer = RawWriter(path, {"protocol": "text", "axes": "x,y,z"})
    for chunk in CHUNKS:
        writer.accept(chunk)
    writer.tell(CHUNKS[-1].arrival, {"lost": "unplugged"})
    writer.close()
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("raw") / "one.inslab")


def test_what_was_written_is_read_back(recording: Path) -> None:
    found = list(records(recording))
    assert [chunk for kind, chunk in found if kind == DATA] == CHUNKS
    assert found[-1][0] == EVENT
    header = read_header(recording)
    assert header["protocol"] == "text"
    assert abs(header["started"] - time.time()) < 3600


@given(st.integers(0, 20_000))
def test_a_file_cut_anywhere_gives_what_stands_before(recording: Path, size: int) -> None:
    data = recording.read_bytes()
    size = min(size, len(data))
    cut = recording.with_name(f"cut{size}.inslab")
    cut.write_bytes(data[:size])
    try:
        found = [chunk for kind, chunk in records(cut) if kind == DATA]
    except RecordingError:
        assert size < data.index(b"\n", len(MAGIC)) + 1
    else:
        assert found == CHUNKS[: len(found)]
        passed = sum(13 + len(chunk.data) for chunk in found)
        assert size - passed - data.index(b"\n", len(MAGIC)) - 1 < 13 + 41 + 30
    finally:
        cut.unlink()


@given(st.binary(max_size=300), st.integers(0, 10_000))
def test_damage_raises_nothing_but_recording_errors(recording: Path, noise: bytes, at: int) -> None:
    data = bytearray(recording.read_bytes())
    data[at : at + len(noise)] = noise
    hurt = recording.with_name("hurt.inslab")
    hurt.write_bytes(data)
    try:
        for _, chunk in records(hurt):
            assert len(chunk.data) <= len(data)
    except RecordingError as error:
        assert "hurt.inslab" in str(error)


KILLED = """
import sys, time
from lab.data.streams.raw_recording import RawWriter
from lab.data.streams.transport import Chunk
now = begin = time.monotonic()
writer = RawWriter(sys.argv[1], {}, clock=lambda: now)  # of a computer that is never busy in between
while True:
    now = time.monotonic()
    writer.accept(Chunk(now, b"%d " % int(1000 * (now - begin))))
    print(int(1000 * (now - begin)), flush=True)
    time.sleep(0.005)
"""


@pytest.mark.proof
def test_a_killed_program_loses_a_second_at_most(tmp_path: Path) -> None:
    path = tmp_path / "killed.inslab"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        told = 0
        while told < 2500:
            told = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    kept = b"".join(chunk.data for _, chunk in records(path)).split()
    assert told - int(kept[-1]) <= 1000 * raw_recording.FLUSH + 100


def test_an_existing_file_is_never_written(recording: Path) -> None:
    before = recording.read_bytes()
    with pytest.raises(RecordingError, match="is there already"):
        RawWriter(recording, {})
    assert recording.read_bytes() == before


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nowhere.*No such file"):
        RawWriter(tmp_path / "nowhere" / "one.inslab", {})


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here, which is a full disk")
def test_a_full_disk_is_told_and_what_was_written_stays(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "full.inslab", {})
    for chunk in CHUNKS[:200]:
        writer.accept(chunk)
    writer._flush_file()
    # From here on the disk is full.
    full = os.open("/dev/full", os.O_WRONLY)
    assert writer._file is not None
    os.dup2(full, writer._file.fileno())
    os.close(full)
    with pytest.raises(RecordingError, match=r"No space left.*what was written stays"):
        for chunk in CHUNKS[200:]:
            writer.accept(Chunk(chunk.arrival, chunk.data * 100))
    assert [chunk for _, chunk in records(tmp_path / "full.inslab")] == CHUNKS[:200]
    with pytest.raises(RecordingError, match="has ended"):
        writer.accept(CHUNKS[0])


def test_little_space_warns_first_and_ends_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    free = raw_recording.SPARE + 2**20
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=free))
    now = 0.0
    writer = RawWriter(tmp_path / "warned.inslab", {}, clock=lambda: now)
    writer.accept(CHUNKS[0])
    assert "1 MiB are left" in writer.warning
    free, now = raw_recording.SPARE - 2**20, 2.0
    with pytest.raises(RecordingError, match="199 MiB are free on the disk, so the recording is ended"):
        writer.accept(Chunk(CHUNKS[0].arrival, b"x"))
    assert [chunk.data for _, chunk in records(tmp_path / "warned.inslab")] == [CHUNKS[0].data, b"x"]


def test_a_recording_has_an_upper_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw_recording, "LARGEST", 2000)
    writer = RawWriter(tmp_path / "long.inslab", {})
    with pytest.raises(RecordingError, match="is ended; accepted are recordings up to"):
        for chunk in CHUNKS:
            writer.accept(chunk)
    assert (tmp_path / "long.inslab").stat().st_size <= 2000 + 13 + 41


@pytest.mark.parametrize("content", [b"", b"hello\n", MAGIC, MAGIC + b"[1]\n", MAGIC + b"{" * 5000 + b"\n"])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "no.inslab"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"no\.inslab"):
        list(records(path))
