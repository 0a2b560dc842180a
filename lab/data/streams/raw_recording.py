"""Raw recording: the bytes of a device with the times of their arrival, in a file that survives any end.

The file is a line of text, a line of JSON that describes the source, and records: kind, time of
arrival, number of bytes, bytes. What was being written when the program ended is left out when it is read.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import struct
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from lab.data.clock.limits import LIMITS
from lab.data.protocols.json_rows import parse_json
from lab.data.streams.transport import Chunk

SUFFIX = ".inslab"
"""How names of raw recordings end."""
MAGIC = b"INS Lab raw recording 1\n"
"""First line of the file."""
FLUSH = 1.0
"""Longest time for which bytes stay in the program [s]: what is lost if it is killed."""
LARGEST = 4 * 2**30
"""Largest recording [bytes]: a day and a half at 30 kB/s, a device with 1 kHz."""
SPARE = 200 * 2**20
"""Free space on the disk at which a recording ends, so that others can go on [bytes]."""
WARNING = 2**30
"""Free space, or room in the recording, at which it warns [bytes]: ten hours at 30 kB/s."""
DATA, EVENT = 0, 1
"""Kinds of records: bytes of the device; text in JSON about what happened."""
DEVICE_LOST, NEW_AXES = "lost", "axes"
"""Keys of events: the device was lost, with the reason; another axis map holds from here on."""
NEW_UNIT, NEW_COLUMNS = "rate unit", "columns"
"""Keys of events: all angular rates have this unit; text has these columns from here on."""

_RECORD = struct.Struct("<BdI")
_MAX_HEADER = 2**16  # [bytes]
_MAX_RECORD = 2**24
"""Largest record that is believed [bytes]: far more than arrives at once."""


class RecordingError(OSError):
    """A recording cannot be written or read; the message says why."""


class RawWriter:
    """Writes a raw recording; one thread uses it.

    Attributes
    ----------
    failure : str
        Why its last bytes could not be written when it ended; empty if they are.

    Parameters
    ----------
    path
        The new file.
    header
        The description of the source; ``started`` (UTC) and ``monotonic``, the host's clock at that time, are
        added.
    clock
        The host's monotonic clock.

    Raises
    ------
    RecordingError
        If the file exists or cannot be made.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        header: Mapping[str, Any],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self.path = Path(path)
        self.bytes = 0
        self.warning = ""
        self.failure = ""
        known = {"started": time.time(), "monotonic": time.monotonic(), **header}
        try:
            self._file: BinaryIO | None = self.path.open("xb", buffering=2**16)
        except FileExistsError as error:
            raise RecordingError(f"{path}: is there already; accepted is the name of a new file") from error
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
        self._flushed = -float("inf")
        self._write_bytes(MAGIC + json.dumps(known).encode() + b"\n")
        self._flush_file()

    def accept(self, chunk: Chunk) -> None:
        """Write bytes that arrived.

        Raises
        ------
        RecordingError
            If the disk is full, the recording too large, or the file cannot be written. What was written
            stays, and the recording has ended.
        """
        if chunk.data:
            self._record(DATA, chunk.arrival, chunk.data)
        # By the own clock: the bytes may be those of a replay, which arrived long ago.
        if self._clock() - self._flushed >= FLUSH:
            self._flush_file()

    def tell(self, arrival: float, event: Mapping[str, Any]) -> None:
        """Write what happened at a time, such as that the device was lost; raises as `take`."""
        self._record(EVENT, arrival, json.dumps(event).encode())
        self._flush_file()

    def _record(self, kind: int, arrival: float, data: bytes) -> None:
        if self.bytes + len(data) > LARGEST:
            self.close()
            raise RecordingError(
                f"{self.path}: has {self.bytes / 2**30:.1f} GiB and is ended; accepted are recordings up to "
                f"{LARGEST / 2**30:.0f} GiB"
            )
        self._write_bytes(_RECORD.pack(kind, arrival, len(data)) + data)

    def _write_bytes(self, data: bytes) -> None:
        if self._file is None:
            raise RecordingError(f"{self.path}: the recording has ended")
        try:
            self._file.write(data)
        except OSError as error:
            self._fail(error)
        self.bytes += len(data)

    def _flush_file(self) -> None:
        """Hand over to the system what is written, and look at the space that is left."""
        self._flushed = self._clock()
        if self._file is None:
            return
        try:
            self._file.flush()
            free = shutil.disk_usage(self.path.parent).free
        except OSError as error:
            self._fail(error)
        if free < SPARE:
            self.close()
            raise RecordingError(
                f"{self.path}: {free / 2**20:.0f} MiB are free on the disk, so the recording is ended; what "
                f"was written stays; needed are {SPARE / 2**20:.0f} MiB"
            )
        left = min(free - SPARE, LARGEST - self.bytes)
        self.warning = f"{left / 2**20:.0f} MiB are left for the recording." if left < WARNING else ""

    def _fail(self, error: OSError) -> None:
        self.close()
        raise RecordingError(self._describe(error)) from error

    def _describe(self, error: OSError) -> str:
        return f"{self.path}: cannot be written any more: {error.strerror or error}; what was written stays"

    def close(self) -> None:
        """End the recording; may be repeated."""
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError as error:  # the disk is full, for one
                self.failure = self._describe(error)


class Recorder:
    """The recording of a source, if one runs: if it fails, the stream goes on without it.

    Parameters
    ----------
    note
        Called with a sentence about a recording that failed.

    Attributes
    ----------
    writer : RawWriter or None
        Writes the recording that runs.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        self.writer: RawWriter | None = None
        self._note = note
        self._last = ("", 0)
        self._failure = ""

    @property
    def path(self) -> Path | None:
        """The file of the recording; None if none runs."""
        writer = self.writer  # read once: another thread may end the recording meanwhile
        return None if writer is None else writer.path

    @property
    def recorded(self) -> tuple[str, int]:
        """Path and size [bytes] of the recording that runs, or of the last one."""
        writer = self.writer
        return self._last if writer is None else (str(writer.path), writer.bytes)

    @property
    def warning(self) -> str:
        """Why the last recording failed, or how little room is left; empty if nothing is wrong."""
        writer = self.writer
        return self._failure or ("" if writer is None else writer.warning)

    def begin(self, path: str | os.PathLike[str], header: Mapping[str, Any]) -> None:
        """Begin a recording; raises `RecordingError` as `RawWriter`, or if another one runs."""
        if self.writer is not None:
            raise RecordingError(f"{self.writer.path}: is being recorded; stop it first")
        self.writer = RawWriter(path, header)
        self._last, self._failure = (str(path), 0), ""

    def accept(self, chunk: Chunk) -> None:
        """Write bytes that arrived, if a recording runs."""
        self._write(lambda writer: writer.accept(chunk))

    def report(self, event: Mapping[str, Any], arrival: float) -> None:
        """Write what happened at a time, if a recording runs."""
        self._write(lambda writer: writer.tell(arrival, event))

    def end(self) -> Path | None:
        """End the recording; return its path, or None if none runs."""
        writer, self.writer = self.writer, None
        if writer is None:
            return None
        self._last = str(writer.path), writer.bytes
        writer.close()
        if writer.failure:
            self._fail(writer.failure)
        return writer.path

    def _write(self, write: Callable[[RawWriter], None]) -> None:
        if self.writer is None:
            return
        try:
            write(self.writer)
        except RecordingError as error:
            self.end()
            self._fail(str(error))

    def _fail(self, why: str) -> None:
        self._failure = why
        self._note(why)


def read_header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a raw recording says of its source.

    Raises
    ------
    RecordingError
        If it cannot be read, or is none.
    """
    with open_recording(path) as file:
        return _header(file, path)


@contextlib.contextmanager
def open_recording(path: str | os.PathLike[str]) -> Generator[BinaryIO, None, None]:
    """Open a file; raise `RecordingError` if it, or what is read of it then, cannot be read."""
    try:
        with Path(path).open("rb") as file:
            yield file
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error


def records(path: str | os.PathLike[str]) -> Generator[tuple[int, Chunk], None, bool]:
    """Yield the records of a raw recording: `DATA` or `EVENT`, and the bytes with their time.

    It ends where the file was cut off, and returns whether it was cut off within a record.

    Raises
    ------
    RecordingError
        If it cannot be read, or is none.
    """
    with open_recording(path) as file:
        _header(file, path)
        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            kind, arrival, size = _RECORD.unpack(head)
            if kind not in (DATA, EVENT) or size > _MAX_RECORD or not abs(arrival) < LIMITS.largest:
                where = f"{path}: damaged at byte {file.tell() - _RECORD.size}"
                raise RecordingError(f"{where}; what stands before it is read")
            data = file.read(size)
            if len(data) < size:
                return True
            yield kind, Chunk(arrival, data)
        return bool(head)


def parse_event(data: bytes) -> dict[str, Any]:
    """Return the event of a record; an empty one if the record is damaged."""
    event = parse_json(data)
    return event if isinstance(event, dict) else {}


def _header(file: BinaryIO, path: object) -> dict[str, Any]:
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(f"{path}: is no raw recording of this laboratory")
    header = parse_json(file.readline(_MAX_HEADER))
    if not isinstance(header, dict):
        raise RecordingError(f"{path}: its second line is damaged")
    return header
