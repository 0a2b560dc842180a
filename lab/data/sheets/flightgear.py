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

from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.clock.faults import increasing
from lab.data.files.fields import OF_THE_FORMAT, SEA_LEVEL
from lab.data.files.inertial_attitude import inertial_attitude
from lab.data.files.profile import Profile
from lab.data.files.unit_names import refuse_unknown
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.data.sheets.flight_columns import Columns, raw_flight, read_columns
from lab.motion.frames.rotation import euler_from_C_nb

NAME = "FlightGear insgns-gps and insgns-imu"

MOST_UNCERTAIN = np.radians(3.0)
"""Largest uncertainty of the heading with which a reconstructed attitude is used [rad]."""


def _protocol(columns: Mapping[str, str]) -> Profile:
    needs = tuple((heading,) for heading in columns)
    return Profile(Path(__file__), NAME, columns, needs, source=OF_THE_FORMAT, simulator=True)


GPS = _protocol(
    {
        "time (sec)": "time[s]", "latitude (rad)": "latitude[rad]", "longitude (rad)": "longitude[rad]",
        "negative altitude (m)": "depth[m]", "Velocity North (mps)": "north[m/s]",
        "Velocity East (mps)": "east[m/s]", "Velocity Down (mps)": "down[m/s]",
    }
)  # fmt: skip
"""Columns of insgns-gps, by the names the protocol gives them."""
IMU = _protocol(
    {
        "time (sec)": "time[s]", "roll rate (rad/sec)": "rate_x[rad/s]",
        "pitch rate (rad/sec)": "rate_y[rad/s]", "yaw rate (rad/sec)": "rate_z[rad/s]",
        "X accel (mps2)": "force_x[m/s²]",
        "Y accel (mps2)": "force_y[m/s²]", "Z accel (mps2)": "force_z[m/s²]",
    }
)  # fmt: skip
"""Columns of insgns-imu."""

_DECIMALS = ((GPS, (4, 10, 10, 3, 8, 8, 8)), (IMU, (4, 6, 6, 6, 5, 5, 5)))
"""Decimals of each column, as the protocols' own formats write them."""
_LINES = tuple(
    (protocol, re.compile("\t".join(rf"\s*-?\d+\.\d{{{count}}}" for count in decimals) + r"\s*"))
    for protocol, decimals in _DECIMALS
)


def recognises(head: bytes) -> bool:
    """Return whether a file begins with a line in the format of one of the two protocols."""
    return _find_protocol(head[:_FIRST].decode("utf-8", "replace").splitlines()) is not None


_FIRST = 4096
"""Bytes at the start with the first lines."""


def _find_protocol(lines: Sequence[str]) -> Profile | None:
    # The first line may be what is left of an earlier one.
    for line in lines[:3]:
        for protocol, pattern in _LINES:
            if pattern.fullmatch(line):
                return protocol
    return None


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the file of insgns-gps, or the files of both protocols in any order.

    Raises
    ------
    MissionError
        For whatever is wrong with a file, or if insgns-gps is missing.
    """
    gps: Path | None = None
    imu: Path | None = None
    for path in paths:
        with TextBlocks(path, MAX_BYTES, strict=False) as text:
            protocol = _find_protocol([line for line, _ in zip(text.lines(), range(3), strict=False)])
        if protocol is None:
            raise MissionError(f"{path}: does not begin as insgns-gps or insgns-imu writes it")
        same = gps if protocol is GPS else imu
        if same is not None:
            raise MissionError(
                f"{path}: is of the same protocol as {same}; accepted are one file of insgns-gps "
                "and one of insgns-imu"
            )
        gps, imu = (path, imu) if protocol is GPS else (gps, path)
    if gps is None:
        raise MissionError(
            f"{imu}: has the rates and accelerations of insgns-imu only; give the file of insgns-gps "
            "of the same flight with it, which has position and velocity"
        )
    refuse_unknown(gps, units, [*GPS.columns, *(IMU.columns if imu else ())])
    flight = _gps(gps, units)
    return _with_rates(flight, imu, units) if imu else flight


def _columns(path: Path, protocol: Profile, units: Mapping[str, str]) -> Columns:
    known = {name: unit for name, unit in units.items() if name in protocol.columns}
    return read_columns(path, protocol, known, "\t")


def _gps(path: Path, units: Mapping[str, str]) -> RawFlight:
    columns = _columns(path, GPS, units)
    columns.values["height"] = -columns.values["depth"]
    return raw_flight(
        NAME,
        columns,
        velocity_n=columns.vector("north", "east", "down"),
        remarks=(SEA_LEVEL, "The two protocols record no attitude."),
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
    rate = np.column_stack([imu.values[key][increases] for key in ("rate_x", "rate_y", "rate_z")])
    force = np.column_stack([imu.values[key][increases] for key in ("force_x", "force_y", "force_z")])
    return replace(
        _with_attitude(flight, imu_time, rate, force),
        body_rate=interpolate_columns(flight.time, imu_time, rate) if rate.any() else None,
        units=(*flight.units, *imu.units.values()),
    )


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
