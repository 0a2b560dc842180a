"""Tlog file: the MAVLink messages that a ground station received, by vehicle, as arrays.

Each message is a frame of MAVLink 1 or 2 after the ground station's time, eight bytes of microseconds.
After bytes that cannot be decoded the reader looks for the next frame that is followed by another one or
by the end of the file. Pymavlink decodes the frames and checks their checksums.

References
----------
MAVLink, *Packet Serialization*, https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray

MAGICS = b"\xfd\xfe"
"""First bytes of a frame: of MAVLink 2 and of MAVLink 1."""
MAX_VEHICLES = 32
"""Most vehicles, restarts counted, whose messages are kept."""

_STAMP = 8
"""Bytes of the ground station's time before each frame."""
SHORTEST = {0xFD: 12, 0xFE: 8}
"""Bytes of a frame without its payload, by its first byte (MAVLink, Packet Serialization)."""
_HEAD = 3
"""Bytes of a frame by which its length is known: first byte, length of the payload, flags."""
SIGNED = 1
"""Flag of a frame with a signature."""
SIGNATURE = 13
"""Bytes of a signature."""
_MAGIC = re.compile(b"[\xfd\xfe]")
_STAMPS = (9.5e14, 4.1e15)
"""Times of a ground station [µs since 1970]: of the years 2000 to 2099."""
_FRAMES_TO_SEE = 3
"""Frames in a row by which a log is recognised."""
_RESTART = 10.0
"""How far the time since switching on has to fall back for a restart [s]: frames of a slow link come out
of order by less."""


@dataclass(eq=False)
class Vehicle:
    """What one vehicle sent between two starts of its autopilot.

    Attributes
    ----------
    first : int
        Number of its first message, among those that were wanted, counted from 1.
    count : int
        How many of its messages were wanted.
    parameters : dict
        The wanted parameters it sent, by name.
    """

    first: int
    count: int = 0
    parameters: dict[str, float] = field(default_factory=dict)
    _rows: dict[str, array[float]] = field(default_factory=dict)
    _fields: dict[str, Sequence[str]] = field(default_factory=dict)

    def add(self, name: str, fields: Sequence[str], message: Any) -> None:
        """Take the fields of a message."""
        rows = self._rows.setdefault(name, array("d"))
        self._fields[name] = fields
        rows.extend(float(getattr(message, key)) for key in fields)

    @property
    def counts(self) -> dict[str, int]:
        """How many messages there are, by name."""
        return {name: len(rows) // len(self._fields[name]) for name, rows in sorted(self._rows.items())}

    def numbers(self, name: str) -> dict[str, FloatArray] | None:
        """Return the fields of the messages of a name, as sent; None without any."""
        if name not in self._rows:
            return None
        fields = self._fields[name]
        table = np.frombuffer(self._rows[name], dtype=np.float64).reshape(-1, len(fields))
        return {key: table[:, place] for place, key in enumerate(fields)}


@dataclass(eq=False)
class TlogFile:
    """The content of a log.

    Attributes
    ----------
    started : float
        The ground station's time of the first frame, seconds since 1970 [s].
    vehicles : dict
        What each vehicle sent, by its system, its component and the number of its restarts.
    others : int
        Wanted messages beyond those of `MAX_VEHICLES`.
    broken : int
        Wanted messages with a wrong checksum.
    lost_bytes : int
        Bytes that could not be decoded.
    """

    started: float = 0.0
    vehicles: dict[tuple[int, int, int], Vehicle] = field(default_factory=dict)
    others: int = 0
    broken: int = 0
    lost_bytes: int = 0
    _boots: dict[tuple[int, int], tuple[int, float]] = field(default_factory=dict)
    _number: int = 0

    @classmethod
    def of(
        cls,
        data: bytes,
        wanted: Mapping[int, tuple[str, Sequence[str]]],
        parameters: Collection[str],
        decode: Callable[[bytearray], Any | None],
    ) -> TlogFile:
        """Return the content of the bytes of a file.

        Parameters
        ----------
        data
            All bytes.
        wanted
            Name and fields of the messages that are wanted, by their number.
        parameters
            Names of the parameters that are wanted of PARAM_VALUE.
        decode
            Returns the message in the bytes of a frame; None if its checksum is wrong.
        """
        log = cls(started=int.from_bytes(data[:_STAMP], "big") * 1e-6)
        at, last = 0, len(data)
        while at < last:
            end = frame_end(data, at)
            if end is None or not _followed(data, end):
                begin = at
                at = _next_frame(data, at + 1)
                log.lost_bytes += at - begin
                continue
            frame = data[at + _STAMP : end]
            number = int.from_bytes(frame[7:10], "little") if frame[0] == MAGICS[0] else frame[5]
            if number in wanted:
                message = decode(bytearray(frame))
                if message is None:
                    log.broken += 1
                else:
                    log._accept(message, *wanted[number], parameters)
            at = end
        return log

    def _accept(self, message: Any, name: str, fields: Sequence[str], parameters: Collection[str]) -> None:
        self._number += 1
        sender = (message.get_srcSystem(), message.get_srcComponent())
        boots, latest = self._boots.get(sender, (0, 0.0))
        if "time_boot_ms" in fields:
            now = 1e-3 * message.time_boot_ms
            boots += now < latest - _RESTART
            latest = now if now < latest - _RESTART else max(now, latest)
        vehicle = self.vehicles.get((*sender, boots))
        if vehicle is None:
            if len(self.vehicles) == MAX_VEHICLES:
                self.others += 1
                return
            vehicle = self.vehicles[*sender, boots] = Vehicle(self._number)
        self._boots[sender] = boots, latest
        vehicle.count += 1
        if name == "PARAM_VALUE":
            if message.param_id in parameters:
                vehicle.parameters[message.param_id] = float(message.param_value)
        else:
            vehicle.add(name, fields, message)


def frame_end(data: bytes, at: int) -> int | None:
    """Return where a frame that begins, with its time stamp, at a place ends; None if there is none."""
    head = data[at + _STAMP : at + _STAMP + _HEAD]
    if len(head) < _HEAD or head[0] not in MAGICS:
        return None
    end = at + _STAMP + head[1] + SHORTEST[head[0]]
    if head[0] == MAGICS[0] and head[2] & SIGNED:
        end += SIGNATURE
    return end if end <= len(data) else None


def starts_like_a_log(head: bytes) -> bool:
    """Return whether the first bytes of a file are frames with times of this century before them."""
    at = seen = 0
    while seen < _FRAMES_TO_SEE and at < len(head):
        stamp = int.from_bytes(head[at : at + _STAMP], "big")
        end = frame_end(head, at)
        if end is None or not _STAMPS[0] <= stamp <= _STAMPS[1]:
            return False
        at, seen = end, seen + 1
    return seen > 0


def _followed(data: bytes, end: int) -> bool:
    """Return whether a frame, or nothing more than part of one, follows."""
    return end + _STAMP >= len(data) or data[end + _STAMP] in MAGICS


def _next_frame(data: bytes, at: int) -> int:
    """Return the next place where a frame may begin with its time stamp, or the end of the file."""
    found = _MAGIC.search(data, at + _STAMP)
    return len(data) if found is None else found.start() - _STAMP
