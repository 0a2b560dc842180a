"""FlightGear: the files of its generic protocols insgns-gps and insgns-imu, together or the first alone.

Numbers between tabs, no header; the protocols' own formats tell the two apart. insgns-gps has time, latitude
and longitude [rad], the negative of the altitude above the sea [m] and the velocity north, east, down [m/s];
insgns-imu has time, the inertial rates p, q, r [rad/s] and the specific force at the pilot's head [m/s²].
Neither holds an attitude. The rates are those of JSBSim and stay zero under another flight model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.missions.errors import MissionError
from lab.missions.named_columns import MAX_BYTES
from lab.missions.raw_flight import Dropped, RawFlight
from lab.missions.readers.fields import SEA_LEVEL, Columns, Field, raw_flight, read_columns
from lab.missions.readers.table import MIN_ROWS, Header, head_lines, plain
from lab.missions.readers.unit_names import refuse_unknown
from lab.missions.text_blocks import TextBlocks

FloatArray = NDArray[np.float64]

NAME = "FlightGear insgns-gps and insgns-imu"

GPS = Header(
    "\t",
    (
        "time (sec)", "latitude (rad)", "longitude (rad)", "negative altitude (m)", "Velocity North (mps)",
        "Velocity East (mps)", "Velocity Down (mps)",
    ),
)  # fmt: skip
"""Columns of insgns-gps, by the names the protocol gives them."""
IMU = Header(
    "\t",
    (
        "time (sec)", "roll rate (rad/sec)", "pitch rate (rad/sec)", "yaw rate (rad/sec)",
        "X accel (mps2)", "Y accel (mps2)", "Z accel (mps2)",
    ),
)  # fmt: skip
"""Columns of insgns-imu."""

_KEYS = {
    GPS: (
        ("time", "time", "s"), ("latitude", "angle", "rad"), ("longitude", "angle", "rad"),
        ("depth", "length", "m"), ("north", "speed", "m/s"), ("east", "speed", "m/s"),
        ("down", "speed", "m/s"),
    ),
    IMU: (
        ("time", "time", "s"), ("p", "angular rate", "rad/s"), ("q", "angular rate", "rad/s"),
        ("r", "angular rate", "rad/s"), ("fx", "acceleration", "m/s²"), ("fy", "acceleration", "m/s²"),
        ("fz", "acceleration", "m/s²"),
    ),
}  # fmt: skip
_DECIMALS = {GPS: (4, 10, 10, 3, 8, 8, 8), IMU: (4, 6, 6, 6, 5, 5, 5)}
_LINE = {
    header: re.compile("\t".join(rf"\s*-?\d+\.\d{{{count}}}" for count in decimals) + r"\s*")
    for header, decimals in _DECIMALS.items()
}


def recognises(head: bytes) -> bool:
    """Tell whether a file begins with a line in the format of one of the two protocols."""
    return _protocol(head_lines(head)) is not None


def _protocol(lines: Sequence[str]) -> Header | None:
    # The first line may be what is left of an earlier one.
    for line in lines[:3]:
        for header, pattern in _LINE.items():
            if pattern.fullmatch(line):
                return header
    return None


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the file of insgns-gps, or the files of both protocols in any order.

    Raises
    ------
    MissionError
        For whatever is wrong with a file, or if insgns-gps is missing.
    """
    files: dict[Header, Path] = {}
    for path in paths:
        header = _protocol_of(path)
        if header in files:
            raise MissionError(
                f"{path}: is of the same protocol as {files[header]}; accepted are one file of insgns-gps "
                "and one of insgns-imu"
            )
        files[header] = path
    if GPS not in files:
        raise MissionError(
            f"{files[IMU]}: has the rates and accelerations of insgns-imu only; give the file of insgns-gps "
            "of the same flight with it, which has position and velocity"
        )
    refuse_unknown(files[GPS], units, [name for header in files for name in header.cells])
    flight = _gps(files[GPS], units)
    return _with_rates(flight, files[IMU], units) if IMU in files else flight


def _protocol_of(path: Path) -> Header:
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        header = _protocol([line for line, _ in zip(text.lines(), range(3), strict=False)])
    if header is None:
        raise MissionError(f"{path}: does not begin as insgns-gps or insgns-imu writes it")
    return header


def _columns(path: Path, header: Header, units: Mapping[str, str]) -> Columns:
    fields = [
        Field(key, (plain(name),), quantity, unit)
        for name, (key, quantity, unit) in zip(header.cells, _KEYS[header], strict=True)
    ]
    known = {name: unit for name, unit in units.items() if name in header.cells}
    return read_columns(path, fields, known, [field.names for field in fields], header)


def _gps(path: Path, units: Mapping[str, str]) -> RawFlight:
    columns = _columns(path, GPS, units)
    columns.values["height"] = -columns.values["depth"]
    return raw_flight(
        NAME,
        columns,
        velocity_n=columns.vector("north", "east", "down"),
        remarks=(
            SEA_LEVEL,
            "The two protocols record no attitude: it has to be reconstructed from the velocity.",
        ),
    )


def _with_rates(flight: RawFlight, path: Path, units: Mapping[str, str]) -> RawFlight:
    """Return the flight with the recorded rates at its times, as far as both files go."""
    imu = _columns(path, IMU, units)
    time = imu.values["time"]
    forward = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1])
    time = time[forward]
    both = (flight.time >= time[0]) & (flight.time <= time[-1])
    if both.sum() < MIN_ROWS:
        raise MissionError(
            f"{path}: goes from {time[0]:.4f} to {time[-1]:.4f} s, and the file of insgns-gps from "
            f"{flight.time[0]:.4f} to {flight.time[-1]:.4f} s; accepted are files of the same flight"
        )
    dropped = imu.dropped
    if not both.all():
        dropped += (Dropped("outside the time of insgns-imu", int((~both).sum()), int(np.argmin(both)) + 1),)
    flight = flight.rows(both, dropped)
    rate = np.column_stack(
        [np.interp(flight.time, time, imu.values[key][forward]) for key in ("p", "q", "r")]
    )
    return replace(
        flight,
        body_rate=rate if rate.any() else None,
        units=(*flight.units, *(imu.units[key] for key in ("p", "q", "r"))),
    )
