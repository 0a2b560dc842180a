"""Replay: a raw recording, or a capture of another program, as a transport."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lab.data.streams.address import Address
from lab.data.streams.capture import Records, header_of, iterate_records
from lab.data.streams.raw_recording import DATA, DEVICE_LOST, RecordingError, parse_event
from lab.data.streams.transport import Chunk, TransportError


class Replay:
    """The bytes of a recording at the pace at which they came, or faster; a `Transport`.

    Where the device was lost, it is lost again, and `open` goes on behind that.

    Attributes
    ----------
    header : dict
        What the recording says of its source.
    tell : callable
        Called with other events of the recording, in their order with the bytes. A `TransportError` ends the
        replay.

    Parameters
    ----------
    path
        The recording.
    speed
        How many times as fast; infinite for as fast as it goes.
    options
        As of `lab.data.streams.capture.iterate_records`.

    Raises
    ------
    TransportError
        If the file is neither a raw recording nor a capture.
    """

    reconnects = True

    def __init__(self, path: str | os.PathLike[str], speed: float = 1.0, **options: str) -> None:
        self.address = str(Address("replay", str(path), {"speed": f"{speed:g}", **options}))
        self.path = Path(path)
        self.speed = speed
        self.tell: Callable[[Mapping[str, Any]], None] = lambda event: None
        try:
            self.header = header_of(path, **options)
        except RecordingError as error:
            raise TransportError(str(error)) from error
        self._options = options
        self._records: Records | None = None
        self._end = "The recording has ended."
        self._next: tuple[int, Chunk] | None = None
        self._begin = (0.0, 0.0)

    def open(self) -> None:
        """Begin, or go on behind the place where the device was lost."""
        if self._records is None:
            try:
                self._records = iterate_records(self.path, **self._options)
            except RecordingError as error:  # a capture without times: to come back would not help
                self._end = str(error)
            else:
                self._next = self._next_record()
        if self._next is not None:
            self._begin = (time.monotonic(), self._next[1].arrival)

    def read(self, longest: float) -> Chunk:
        """Wait until the next bytes came in the recording.

        Raises
        ------
        OSError
            Where the device was lost, or if the file cannot be read on.
        EOFError
            At its end.
        """
        if self._next is None:
            raise EOFError(self._end)
        kind, chunk = self._next
        due = self._begin[0] + (chunk.arrival - self._begin[1]) / self.speed
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, longest))
        if wait > longest:
            return Chunk(chunk.arrival, b"")
        try:
            self._next = self._next_record()
        except RecordingError as error:
            raise EOFError(str(error)) from error
        if kind == DATA:
            return chunk
        event = parse_event(chunk.data)
        if DEVICE_LOST in event:
            raise ConnectionError(str(event[DEVICE_LOST]))
        try:
            self.tell(event)
        except TransportError as error:
            raise EOFError(f"{self.path}: damaged: {error}") from error
        return Chunk(chunk.arrival, b"")

    def _next_record(self) -> tuple[int, Chunk] | None:
        """Return the next record; None at the end, which may be amid a record."""
        assert self._records is not None
        try:
            return next(self._records)
        except StopIteration as stop:
            if stop.value:
                self._end = "The recording has ended: it was cut off within a record, which is left out."
            return None

    def close(self) -> None:
        """Nothing: the recording goes on with the next `open`."""

    def end(self) -> None:
        """Close the file."""
        if self._records is not None:
            self._records.close()
