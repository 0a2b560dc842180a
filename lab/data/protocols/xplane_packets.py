"""X-Plane packets: the requests sent to X-Plane, and the flight made of its answers.

RPOS has position, attitude and velocity, but no time. The simulator's own clock, the place in its local frame
and the air data are asked for as data references (RREF) at a rate above any frame rate: X-Plane then sends
both in the same frame, one right after the other, and a position takes the clock of its frame.

References
----------
Laminar Research, *Exchanging data with X-Plane* (folder ``Instructions`` of X-Plane): RPOS, RREF.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import LIMITS, NAMED, SEA_LEVEL
from lab.data.files.xplane_data import velocity_at_aircraft
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight
from lab.motion.recordings.recording import Frame

NAME = "X-Plane live"

REFERENCES = (
    ("time", "sim/time/total_flight_time_sec", "time", "s"),
    ("X", "sim/flightmodel/position/local_x", "X", "m"),
    ("Z", "sim/flightmodel/position/local_z", "Z", "m"),
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

_FIELDS = (
    ("longitude", "angle", "°"), ("latitude", "latitude", "°"), ("height", "length", "m"),
    ("pitch", "angle", "°"), ("heading", "angle", "°"), ("roll", "angle", "°"), ("east", "speed", "m/s"),
    ("up", "speed", "m/s"), ("south", "speed", "m/s"), ("p", "angular rate", "rad/s"),
    ("q", "angular rate", "rad/s"), ("r", "angular rate", "rad/s"),
)  # fmt: skip
_LETTERS = 5
"""Letters at the start of a packet that name its kind."""
_EVERY_FRAME = 500
"""Rate asked for that is above any frame rate, so that references come with each frame [Hz]."""


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


def flight(
    positions: bytes,
    arrivals: Sequence[float],
    clocks: Sequence[float],
    clock_arrivals: Sequence[float],
    remarks: Sequence[str] = (),
) -> RawFlight:
    """Return the flight made of packets.

    Parameters
    ----------
    positions
        The records of n RPOS packets.
    arrivals
        When they arrived [s].
    clocks, clock_arrivals
        The latest values of all references at each RREF packet with a clock, packet by packet, and when these
        arrived [s].
    remarks
        Further remarks.

    Raises
    ------
    MissionError
        If there are too few samples that can be used.
    """
    arrival = np.array(arrivals)
    known, limits, units = _fields(positions)
    values = _paired(arrival, np.array(clock_arrivals), np.reshape(clocks, (-1, len(REFERENCES))))
    remarks = [SEA_LEVEL, *remarks]
    timed = np.isfinite(values[:, 0])
    if 2 * timed.sum() > len(timed):
        for (name, _, kind, unit), column in zip(REFERENCES, values.T, strict=True):
            if 2 * np.isfinite(column).sum() > len(column):
                known[name], limits[name], units[name] = column, LIMITS[kind], unit
    else:
        timed[:] = True
        known["time"] = arrival - arrival[:1]
        limits["time"], units["time"] = LIMITS["time"], "s"
        remarks.append(
            "X-Plane did not send its own clock: time is that of arrival at this computer, which jitters."
        )
    _to_radians(known, units)
    kept, dropped = _believable(known, limits, timed)
    known = {name: column[kept] for name, column in known.items()}
    return RawFlight(
        format=NAME,
        time=known["time"],
        latitude=known["latitude"],
        longitude=known["longitude"],
        height=known["height"],
        velocity_n=_velocity_n(known),
        euler=_columns(known, "roll", "pitch", "heading"),
        body_rate=_columns(known, "p", "q", "r"),
        airspeed=known.get("airspeed"),
        alpha=known.get("alpha"),
        beta=known.get("beta"),
        rows_read=len(timed),
        dropped=dropped,
        units=tuple(ColumnUnit(name, unit, NAMED) for name, unit in units.items()),
        remarks=tuple(remarks),
        vehicle="aircraft",
    )


def frame(record: bytes, values: Sequence[float]) -> Frame | None:
    """Return the state of the aircraft in one frame, or None if its numbers are those of no flight.

    Parameters
    ----------
    record
        The record of an RPOS packet.
    values
        Values of all references in the same frame; the clock and the place in the local frame are needed.
    """
    known, limits, units = _fields(record)
    for (name, _, kind, unit), value in zip(REFERENCES[:3], values, strict=False):
        known[name], limits[name], units[name] = np.array([value]), LIMITS[kind], unit
    _to_radians(known, units)
    if not _within(known, limits).all():
        return None
    return Frame(
        float(known["time"][0]),
        _columns(known, "latitude", "longitude", "height")[0],
        _velocity_n(known)[0],
        _columns(known, "roll", "pitch", "heading")[0],
    )


def _fields(positions: bytes) -> tuple[dict[str, FloatArray], dict[str, tuple[float, float]], dict[str, str]]:
    """Return the columns of records as X-Plane sends them, their limits [SI] and their units."""
    records = np.frombuffer(positions, dtype=POSITION)
    with np.errstate(invalid="ignore"):  # a packet may hold any bits
        known = {name: np.asarray(records[name], dtype=np.float64) for name, _, _ in _FIELDS}
    return known, {name: LIMITS[kind] for name, kind, _ in _FIELDS}, {name: unit for name, _, unit in _FIELDS}


def _to_radians(known: dict[str, FloatArray], units: dict[str, str]) -> None:
    with np.errstate(invalid="ignore"):
        for name, unit in units.items():
            if unit == "°":
                known[name] = np.radians(known[name])


def _columns(known: dict[str, FloatArray], *names: str) -> FloatArray:
    return np.column_stack([known[name] for name in names])


def _velocity_n(known: dict[str, FloatArray]) -> FloatArray:
    """Return the velocity north, east, down at the aircraft (n, 3) [m/s]."""
    local = np.column_stack((-known["south"], known["east"], -known["up"]))
    offset = np.column_stack((-known["Z"], known["X"])) if "X" in known and "Z" in known else None
    return velocity_at_aircraft(local, _columns(known, "latitude", "longitude", "height"), offset)


def _within(known: dict[str, FloatArray], limits: dict[str, tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which samples have possible numbers."""
    within = [(column >= limits[name][0]) & (column <= limits[name][1]) for name, column in known.items()]
    return np.asarray(np.logical_and.reduce(within))


def _paired(arrival: FloatArray, clock_arrival: FloatArray, clocks: FloatArray) -> FloatArray:
    """Return for each position the references of its frame, NaN where there are none.

    Within a frame either may come first; the shorter of the two waits decides.
    """
    if not len(clocks):
        return np.full((len(arrival), len(REFERENCES)), np.nan)
    last = len(clocks) - 1
    after = np.searchsorted(clock_arrival, arrival, side="right")
    before = after - 1
    waited = arrival - clock_arrival[np.maximum(before, 0)]
    to_wait = clock_arrival[np.minimum(after, last)] - arrival
    both = (before >= 0) & (after <= last)
    clock_first = not both.any() or np.median(waited[both]) <= np.median(to_wait[both])
    of_frame = before if clock_first else after
    there = (of_frame >= 0) & (of_frame <= last)
    return np.where(there[:, None], clocks[np.clip(of_frame, 0, last)], np.nan)


def _believable(
    known: dict[str, FloatArray], limits: dict[str, tuple[float, float]], timed: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], tuple[Dropped, ...]]:
    """Return which samples have a clock and possible numbers, and the report on the others."""
    believed = timed & _within(known, limits)
    dropped = []
    for reason, lost in (
        ("without the simulator's clock", ~timed),
        ("with numbers no flight has", timed & ~believed),
    ):
        if lost.any():
            dropped.append(Dropped(reason, int(lost.sum()), int(np.argmax(lost)) + 1))
    if believed.sum() < MIN_SAMPLES:
        raise MissionError(
            f"X-Plane sent {len(timed)} samples, of which {believed.sum()} can be used; accepted are at "
            f"least {MIN_SAMPLES}"
        )
    return believed, tuple(dropped)
