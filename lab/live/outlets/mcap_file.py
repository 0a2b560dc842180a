"""MCAP file: messages with their times, for Foxglove and for the readers of the robot operating system.

References
----------
Foxglove, *MCAP format specification* (mcap.dev/spec): records of an opcode, a length and contents; messages
in chunks, each followed by an index; a summary at the end. A file that was cut off is read without it.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import IO, Final

from lab.data.protocols.foxglove import CHANNELS

MAGIC: Final = b"\x89MCAP0\r\n"
"""First and last bytes."""
CHUNK: Final = 2**18
"""Size from which a chunk is written [bytes]: six seconds at 50 Hz."""
LONGEST: Final = 1_000_000_000
"""Time after which a chunk is written [ns]: what is lost with the power."""
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
"""Opcodes of records."""
_STATISTICS, _DATA_END = 0x0B, 0x0F
"""Opcodes of records."""


class McapFile:
    """Writes a new file; `close` ends it.

    Parameters
    ----------
    path
        The file; it must not exist.

    Raises
    ------
    OSError
        If it exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._file: IO[bytes] = path.open("xb")
        self._at = 0
        self._parts: list[bytes] = []  # records of the chunk
        self._size = self._first = 0  # its size, and the time of its first record
        self._times: dict[int, list[tuple[int, int]]] = {}  # time and place in the chunk, by channel
        self._sequence = dict.fromkeys((one.number for one in CHANNELS), 0)
        self._chunks: list[bytes] = []  # their indexes
        self._span: tuple[int, int] | None = None
        self._declared = b""
        for one in CHANNELS:
            schema = struct.pack("<H", one.number) + _texts(one.schema_name, "jsonschema", one.schema)
            channel = struct.pack("<HH", one.number, one.number) + _texts(one.topic, "json", "")
            self._declared += _record(_SCHEMA, schema) + _record(_CHANNEL, channel)
        self._write_bytes(MAGIC + _record(_HEADER, _texts("", "INS Lab")) + self._declared)
        self._file.flush()

    def write(self, time: int, messages: dict[int, bytes]) -> None:
        """Append messages, by the numbers of their channels, with their time [ns since 1970]."""
        if not self._parts:
            self._first = time
        for number, data in messages.items():
            self._times.setdefault(number, []).append((time, self._size))
            head = struct.pack("<HIQQ", number, self._sequence[number] % 2**32, time, time)
            self._sequence[number] += 1
            self._parts.append(_record(_MESSAGE, head + data))
            self._size += len(self._parts[-1])
        if self._parts and (self._size >= CHUNK or not 0 <= time - self._first < LONGEST):
            self._end_chunk()

    def close(self) -> None:
        """Write what is left, the summary and the end; may be repeated."""
        if self._file.closed:
            return
        if self._parts:
            self._end_chunk()
        self._write_bytes(_record(_DATA_END, bytes(4)))
        start = self._at
        first, last = self._span or (0, 0)
        counts = b"".join(struct.pack("<HQ", number, count) for number, count in self._sequence.items())
        head = struct.pack(
            "<QHIIIIQQI", sum(self._sequence.values()), len(CHANNELS), len(CHANNELS), 0, 0, len(self._chunks),
            first, last, len(counts),
        )  # fmt: skip
        self._write_bytes(self._declared + b"".join(self._chunks) + _record(_STATISTICS, head + counts))
        self._write_bytes(_record(_FOOTER, struct.pack("<QQI", start, 0, 0)) + MAGIC)
        self._file.close()

    def _end_chunk(self) -> None:
        """Write the chunk, its index, and flush both."""
        times = [time for found in self._times.values() for time, _ in found]
        first, last = min(times), max(times)
        begun, ended = self._span or (first, last)
        self._span = min(begun, first), max(ended, last)
        records = b"".join(self._parts)
        start = self._at
        head = struct.pack("<QQQI", first, last, len(records), zlib.crc32(records))
        self._write_bytes(_record(_CHUNK, head + _texts("") + struct.pack("<Q", len(records)) + records))
        length, offsets = self._at - start, b""
        begun = self._at
        for number, found in self._times.items():
            offsets += struct.pack("<HQ", number, self._at)
            pairs = b"".join(struct.pack("<QQ", *pair) for pair in found)
            self._write_bytes(_record(_MESSAGE_INDEX, struct.pack("<HI", number, len(pairs)) + pairs))
        index = struct.pack("<QQQQI", first, last, start, length, len(offsets)) + offsets
        index += struct.pack("<Q", self._at - begun) + _texts("")
        index += struct.pack("<QQ", len(records), len(records))
        self._chunks.append(_record(_CHUNK_INDEX, index))
        self._parts, self._size, self._times = [], 0, {}
        self._file.flush()

    def _write_bytes(self, data: bytes) -> None:
        self._file.write(data)
        self._at += len(data)


def _record(opcode: int, contents: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(contents)) + contents


def _texts(*texts: str) -> bytes:
    """Return texts, or with none an empty one or map, each with its length."""
    return b"".join(struct.pack("<I", len(data)) + data for data in map(str.encode, texts))
