"""FlightGear: files of its generic protocols insgns-gps and insgns-imu, both or the first alone.

Numbers between tabs, no header; the formats of the protocols distinguish the two. insgns-gps has time,
latitude and longitude [rad], the negative of the altitude above sea level [m] and the velocity north, east,
down [m/s]; insgns-imu has time, the inertial rates p, q, r [rad/s] and the specific force at the pilot's
head [m/s²]. Neither holds an attitude. With both files it is reconstructed: the rates integrate to it up
to one rotation, which follows from specific force and velocity (`lab.data.files.inertial_attitude`). The
rates are those of JSBSim and stay zero under another flight model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.clock.faults import increasing
from lab.data.files.fields import SEA_LEVEL, Columns, Field, raw_flight, read_columns
from lab.data.files.inertial_attitude import inertial_attitude
from lab.data.files.table import Header, head_lines, plain
from lab.data.files.unit_names import refuse_unknown
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames.rotation import euler_from_C_nb

NAME = "FlightGear insgns-gps and insgns-imu"

MOST_UNCERTAIN = np.radians(3.0)
"""Largest uncertainty of the heading with which a reconstructed attitude is used [rad]."""

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
"""Decimals of each column, as the protocols' own formats write them."""
_LINE = {
    header: re.compile("\t".join(rf"\s*-?\d+\.\d{{{count}}}" for count in decimals) + r"\s*")
    for header, decimals in _DECIMALS.items()
}


def recognises(head: bytes) -> bool:
    """Return whether a file begins with a line in the format of one of the two protocols."""
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
            "The two protocols record no attitude.",
        ),
    )


def _with_rates(flight: RawFlight, path: Path, units: Mapping[str, str]) -> RawFlight:
    """Return the flight with rates and attitude at its times, as far as both files go."""
    imu = _columns(path, IMU, units)
    imu_time = imu.values["time"]
    increases = increasing(imu_time)
    imu_time = imu_time[increases]
    both = (flight.time >= imu_time[0]) & (flight.time <= imu_time[-1])
    kept = both & increasing(flight.time)
    if kept.sum() < MIN_SAMPLES:
        raise MissionError(
            f"{path}: goes from {imu_time[0]:.4f} to {imu_time[-1]:.4f} s, and the file of insgns-gps from "
            f"{flight.time[0]:.4f} to {flight.time[-1]:.4f} s; accepted are files of the same flight"
        )
    dropped = imu.dropped
    for reason, lost in (("outside the time of insgns-imu", ~both), ("back in time", both & ~kept)):
        dropped += Dropped.of(reason, lost)
    flight = flight.rows(kept, dropped)
    rate = np.column_stack([imu.values[key][increases] for key in ("p", "q", "r")])
    force = np.column_stack([imu.values[key][increases] for key in ("fx", "fy", "fz")])
    return replace(
        _with_attitude(flight, imu_time, rate, force),
        body_rate=_at(flight.time, imu_time, rate) if rate.any() else None,
        units=(*flight.units, *imu.units.values()),
    )


def _at(times: FloatArray, time: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(times, time, column) for column in vectors.T])


def _with_attitude(flight: RawFlight, imu_time: FloatArray, rate: FloatArray, force: FloatArray) -> RawFlight:
    """Return the flight with the attitude reconstructed from rates and forces, and a remark on it."""
    place = flight.position
    assert place is not None and flight.velocity_n is not None
    found = None
    if rate.any() and force.any():
        found = inertial_attitude(flight.time, place, flight.velocity_n, imu_time, rate, force)
    if found is None or not found.heading_uncertainty < MOST_UNCERTAIN:
        remark = (
            "The attitude cannot be reconstructed from the rates and accelerations either: they are too "
            "few, zero, without turns or climbs, or not of this flight."
        )
        return replace(flight, remarks=(*flight.remarks, remark))
    remark = (
        "The attitude is reconstructed: the recorded inertial rates, integrated, and turned so that the "
        f"accelerations fit the velocity, to {found.residual:.2g} m/s in a second."
    )
    return replace(flight, euler=euler_from_C_nb(found.C_nb), remarks=(*flight.remarks, remark))
