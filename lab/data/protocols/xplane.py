"""X-Plane over the network: the requests to it, and its answers as positions with the clock of their frame.

RPOS has position, attitude and velocity, but no time. The simulator's own clock, the place in its local frame
and the air data are asked for as data references (RREF) at a rate above any frame rate: X-Plane then sends
both in the same frame, one right after the other. Which one comes first, the waits between the first packets
show; a position takes the references of its frame. Recorded and live flights are made of the same positions.

References
----------
Laminar Research, *Exchanging data with X-Plane* (folder ``Instructions`` of X-Plane): RPOS, RREF.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.units import DEGREE
from lab.data.sheets.flight_columns import LIMITS
from lab.data.sheets.xplane_data import velocity_at_aircraft

REFERENCES = (
    ("time", "sim/time/total_flight_time_sec", "time", "s"),
    ("X", "sim/flightmodel/position/local_x", "local", "m"),
    ("Z", "sim/flightmodel/position/local_z", "local", "m"),
    ("airspeed", "sim/flightmodel/position/true_airspeed", "speed", "m/s"),
    ("alpha", "sim/flightmodel/position/alpha", "angle", "°"),
    ("beta", "sim/flightmodel/position/beta", "angle", "°"),
)
"""Data references that are requested: our name, X-Plane's, the limits and the unit."""
POSITION = np.dtype(
    [("longitude", "<f8"), ("latitude", "<f8"), ("height", "<f8"), ("above_ground", "<f4")]
    + [(name, "<f4") for name in ("pitch", "heading", "roll", "east", "up", "south", "p", "q", "r")]
)
"""An RPOS packet after its five letters."""
FIELDS = (
    ("longitude", "angle", "°"), ("latitude", "latitude", "°"), ("height", "length", "m"),
    ("pitch", "angle", "°"), ("heading", "angle", "°"), ("roll", "angle", "°"), ("east", "speed", "m/s"),
    ("up", "speed", "m/s"), ("south", "speed", "m/s"), ("p", "angular rate", "rad/s"),
    ("q", "angular rate", "rad/s"), ("r", "angular rate", "rad/s"),
)  # fmt: skip
"""What is read of it: name, limits and unit."""
LOOKED_AT = 12
"""Positions whose packets show which of the two comes first: 0.24 s at 50 Hz."""

_LIMITS = {name: LIMITS[kind] for name, *_, kind, _ in (*FIELDS, *REFERENCES)}
_SI = {name: DEGREE if unit == "°" else 1.0 for name, *_, unit in (*FIELDS, *REFERENCES)}
"""Units in SI."""
_UNTIMED = (math.nan,) * len(REFERENCES)
_LETTERS = 5
"""Letters at the start of a packet that name its kind."""
_EVERY_FRAME = 500
"""Rate asked for that is above any frame rate, so that references come with each frame [Hz]."""
_MOST = 4096
"""Most packets that wait until it is known which comes first: 12 positions at 1 Hz among clocks at 300 Hz."""


class Position(NamedTuple):
    """A position that X-Plane sent.

    Attributes
    ----------
    arrival : float
        When it came, by the host's clock [s].
    record : bytes
        A record of `POSITION`.
    references : tuple of float
        The values of `REFERENCES` in its frame, in their units; NaN if its frame has no clock.
    """

    arrival: float
    record: bytes
    references: tuple[float, ...]


class XPlanePackets:
    """Makes positions of the packets of one X-Plane.

    Attributes
    ----------
    ignored : int
        Packets of other kinds.
    """

    def __init__(self) -> None:
        self.ignored = 0
        self._values = list(_UNTIMED)
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the packets that wait, and which one comes first."""
        self._first: list[tuple[float, bytes | None, tuple[float, ...]]] = []
        self._clock_first: bool | None = None
        self._waiting: tuple[float, bytes] | None = None  # a position that waits for its clock
        self._fresh = False  # whether the clock was not yet used

    def accept(self, packet: bytes, arrival: float) -> list[Position]:
        """Return the positions that a packet completes, in their order.

        Parameters
        ----------
        packet
            Any bytes.
        arrival
            When they came, by the host's monotonic clock [s].
        """
        record = position(packet)
        if record is None:
            found = references(packet)
            if found is None:
                self.ignored += 1
                return []
            for index, value in found.items():
                self._values[index] = value
            if 0 not in found:
                return []
        event = arrival, record, tuple(self._values)
        if self._clock_first is not None:
            return self._pair_packets(*event)
        self._first.append(event)
        seen = sum(one is not None for _, one, _ in self._first)
        return self._decide_order() if seen >= LOOKED_AT or len(self._first) >= _MOST else []

    def finish(self) -> list[Position]:
        """Return the positions that waited for further packets."""
        found = self._decide_order()
        if self._waiting is not None:
            found.append(Position(*self._waiting, _UNTIMED))
        self.begin_anew()
        return found

    def _decide_order(self) -> list[Position]:
        """Find out which packet comes first in a frame, from the shorter of the waits; return what waited."""
        first, self._first = self._first, []
        waits: dict[bool, list[float]] = {True: [], False: []}
        for (one, before, _), (other, after, _) in pairwise(first):
            if (before is None) != (after is None):
                waits[before is None].append(other - one)
        if not waits[True] and not waits[False]:
            # Packets of one kind only: without clocks, positions are timed by their arrival.
            return [Position(arrival, one, _UNTIMED) for arrival, one, _ in first if one is not None]
        clock, place = (float(np.median(one)) if one else math.inf for one in (waits[True], waits[False]))
        # Packets of one frame come at once, those of the next one later: the shorter wait is within a frame.
        self._clock_first = clock <= place
        return [found for event in first for found in self._pair_packets(*event)]

    def _pair_packets(
        self, arrival: float, record: bytes | None, values: tuple[float, ...]
    ) -> list[Position]:
        """Return the positions whose frame is complete by a packet; its record is None for a clock."""
        if self._clock_first:
            fresh, self._fresh = self._fresh, record is None
            return [] if record is None else [Position(arrival, record, values if fresh else _UNTIMED)]
        waiting, self._waiting = self._waiting, None if record is None else (arrival, record)
        return [] if waiting is None else [Position(*waiting, values if record is None else _UNTIMED)]


def requests(rate: float) -> list[bytes]:
    """Return the packets that ask for positions at a rate [Hz]; a rate of zero ends them."""
    each = _EVERY_FRAME if rate else 0
    return [
        b"RPOS\0" + f"{math.ceil(rate)}".encode() + b"\0",
        *(
            struct.pack("<5sii400s", b"RREF\0", each, index, name.encode())
            for index, (_, name, _, _) in enumerate(REFERENCES)
        ),
    ]


def position(packet: bytes) -> bytes | None:
    """Return the record in an RPOS packet, or None if it is none."""
    # The fifth letter is a zero or a digit, depending on the version.
    whole = packet[:4] == b"RPOS" and len(packet) == _LETTERS + POSITION.itemsize
    return packet[_LETTERS:] if whole else None


def references(packet: bytes) -> dict[int, float] | None:
    """Return the values in an RREF packet by their numbers, or None if it is none."""
    if packet[:4] != b"RREF" or len(packet) <= _LETTERS or (len(packet) - _LETTERS) % 8:
        return None
    values: dict[int, float] = dict(struct.iter_unpack("<if", packet[_LETTERS:]))
    return {index: value for index, value in values.items() if 0 <= index < len(REFERENCES)}


def columns(records: bytes, values: Sequence[float] | FloatArray) -> dict[str, FloatArray]:
    """Return what `FIELDS` and `REFERENCES` name, each (n,) [SI].

    Parameters
    ----------
    records
        The records of n positions, one after the other.
    values
        Their references.
    """
    rows, others = np.frombuffer(records, dtype=POSITION), np.reshape(values, (-1, len(REFERENCES)))
    sent = {name: rows[name] for name, _, _ in FIELDS}
    sent |= {name: column for (name, *_), column in zip(REFERENCES, others.T, strict=True)}
    with np.errstate(invalid="ignore", over="ignore"):  # a packet may hold any bits
        return {name: np.asarray(one, dtype=np.float64) * _SI[name] for name, one in sent.items()}


def mask_possible(known: dict[str, FloatArray]) -> Flags:
    """Return which rows (n,) of some columns have possible numbers."""
    fine = [(one >= _LIMITS[name][0]) & (one <= _LIMITS[name][1]) for name, one in known.items()]
    return np.asarray(np.logical_and.reduce(fine))


def matrix(known: dict[str, FloatArray], *names: str) -> FloatArray:
    """Return columns side by side, (n, k)."""
    return np.column_stack([known[name] for name in names])


def velocity_n(known: dict[str, FloatArray]) -> FloatArray:
    """Return the velocity north, east, down at the aircraft (n, 3) [m/s]."""
    # X-Plane's local axes are east, up and south.
    local = np.column_stack((-known["south"], known["east"], -known["up"]))
    offset = np.column_stack((-known["Z"], known["X"])) if "X" in known and "Z" in known else None
    return velocity_at_aircraft(local, matrix(known, "latitude", "longitude", "height"), offset)
