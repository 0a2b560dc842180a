"""MCAP file: the reader of its makers reads it, also one that was cut off; its records are of the form."""

from __future__ import annotations

import contextlib
import io
import json
import struct
import zlib
from pathlib import Path

import pytest
from sent_solutions import solution

from lab.data.protocols.foxglove import CHANNELS, make_messages, time_stamp
from lab.live.outlets.mcap_file import MAGIC, McapFile


def written(path: Path, rows: int) -> bytes:
    file = McapFile(path)
    for number in range(rows):
        one = solution(unix=1_767_312_016.0 + 0.02 * number, fixes_used=number)
        file.write(time_stamp(one), make_messages(one))
    file.close()
    file.close()  # may be repeated
    return path.read_bytes()


def records(data: bytes) -> list[tuple[int, int, bytes]]:
    """Return the opcodes, places and contents of all records."""
    assert data.startswith(MAGIC)
    assert data.endswith(MAGIC)
    found, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, size = struct.unpack_from("<BQ", data, at)
        found.append((opcode, at, data[at + 9 : at + 9 + size]))
        at += 9 + size
    assert at == len(data) - len(MAGIC)
    return found


def test_records_follow_the_specification(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap", 130)
    found = records(data)
    codes = [opcode for opcode, _, _ in found]
    assert codes[0] == 0x01
    assert codes[-1] == 0x02
    assert codes.count(0x06) == 3  # chunks: one a second
    messages = 0
    for _, _, contents in (one for one in found if one[0] == 0x06):
        first, last, size, crc = struct.unpack_from("<QQQI", contents)
        assert first <= last
        inside = contents[28 + 4 + 8 :]
        assert (len(inside), zlib.crc32(inside)) == (size, crc)
        messages += len(records(MAGIC + inside + MAGIC))
    assert messages == 3 * 130
    start = struct.unpack("<QQI", found[-1][2])[0]
    assert start in [at for _, at, _ in found]
    assert (
        struct.unpack_from("<Q", next(contents for opcode, _, contents in found if opcode == 0x0B))[0] == 390
    )


def test_the_reader_of_its_makers_reads_it(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    with io.BytesIO(written(tmp_path / "a.mcap", 130)) as file:
        found = reader.make_reader(file, validate_crcs=True)
        summary = found.get_summary()
        assert summary.statistics.message_count == 390
        assert {one.topic for one in summary.channels.values()} == {one.topic for one in CHANNELS}
        rows = [json.loads(one.data) for _, _, one in found.iter_messages(topics=["/ins_lab/solution"])]
        assert [row["fixes_used"] for row in rows] == list(range(130))
        times = [one.log_time for _, _, one in found.iter_messages(starting_at=1_767_312_018_000_000_000)]
        assert len(times) == 3 * 30


@pytest.mark.parametrize("rows", [0, 1])
def test_a_short_file_is_whole(tmp_path: Path, rows: int) -> None:
    data = written(tmp_path / "a.mcap", rows)
    records(data)
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    assert len(list(reader.make_reader(io.BytesIO(data)).iter_messages())) == 3 * rows


def test_what_was_written_before_a_crash_is_read(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "cut.mcap")
    for number in range(130):
        one = solution(unix=1_767_312_016.0 + 0.02 * number)
        file.write(time_stamp(one), make_messages(one))
    data = (tmp_path / "cut.mcap").read_bytes()  # of what has reached the disk
    file.close()
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    found = []
    cut_off = pytest.importorskip("mcap.exceptions").McapError
    with contextlib.suppress(struct.error, cut_off):
        for one in reader.NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False):
            found.append(one)  # noqa: PERF402 - what came before the error counts
    assert len(found) >= 3 * 100


def test_a_clock_that_is_set_back_ends_a_chunk(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "a.mcap")
    for unix in (1_767_312_016.0, 1_767_312_016.5, 1_767_312_000.0, 1_767_312_000.5):
        one = solution(unix=unix)
        file.write(time_stamp(one), make_messages(one))
    file.close()
    data = (tmp_path / "a.mcap").read_bytes()
    assert [opcode for opcode, _, _ in records(data)].count(0x06) == 2
