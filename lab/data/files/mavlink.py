"""MAVLink telemetry log (.tlog): the estimator's solution as a flight, raw IMU and GPS as a sensor log.

The velocity comes from LOCAL_POSITION_NED or GLOBAL_POSITION_INT, the position from the latter, the
attitude from ATTITUDE_QUATERNION or ATTITUDE. Without a solution the flight is the track of GPS_RAW_INT.
Frames are decoded by pymavlink, which is an extra.

References
----------
MAVLink, *Common Message Set*, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.file_content import whole
from lab.base.files.mission_error import MissionError
from lab.data.checks.log_check import check_log
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.mavlink_sensors import (
    FIELDS,
    IMUS,
    PARAMETERS,
    fixed,
    geoid_of,
    gnss_of,
    imu_of,
    over_ground,
    place_of,
    since_boot,
)
from lab.data.files.streams import MAX_LOG_BYTES, Stream, first_usable, flight_of, is_attitude, is_position
from lab.data.files.tlog_file import TlogFile, Vehicle, starts_like_a_log
from lab.data.files.track import Track
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import SensorLog, repaired
from lab.data.log.vehicle import MAV_TYPES
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames.rotation import quaternion_from_euler

NAME = "MAVLink tlog"

MIN_IMU_RATE = 10.0
"""Fewest samples of the IMU a second accepted [Hz]: between point samples further apart a vehicle that turns
within half a second, as they do, is not seen to turn."""

_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID, of what is no autopilot."""
_GROUND_STATION = 6
"""MAV_TYPE_GCS."""
_UNITS = {"lat, lon": "°", "alt": "m", "vx, vy, vz": "m/s", "roll, pitch, yaw": "rad"}
_TRACK_UNITS = {"lat": "°", "lon": "°", "alt": "m", "vel": "m/s", "cog": "°"}
_MISSING = "is a MAVLink telemetry log. Reading it needs pymavlink, which is not installed: "


def recognises(head: bytes) -> bool:
    """Return whether a file starts like a telemetry log."""
    return starts_like_a_log(head)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight; without one, the track of its GPS.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no position that can be used, or pymavlink is not
        installed.
    """
    path = one_file(paths, NAME, fixed=units)
    log, vehicle = _vehicle(path, FIELDS)
    geoid = geoid_of(vehicle)
    velocity, position = _velocity(vehicle), _position(vehicle, geoid)
    remarks = _remarks(log, geoid)
    kind = _kind(vehicle)
    if velocity is None or position is None:
        flight = _gps_track(path, vehicle, geoid, remarks, kind).flight()
    else:
        flight = flight_of(
            path,
            NAME,
            velocity,
            position,
            _attitude(vehicle),
            units=units_of_the_format(_UNITS),
            remarks=remarks,
            vehicle=kind,
        )
    return replace(flight, dropped=(*flight.dropped, *_others(log, vehicle)))


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the vehicle sent.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, they cannot be navigated with, or
        pymavlink is not installed.
    """
    _, vehicle = _vehicle(path, {**FIELDS, **IMUS})
    gps, imu = vehicle.numbers("GPS_RAW_INT"), imu_of(vehicle)
    if gps is None or imu is None:
        missing = "a GPS (GPS_RAW_INT)" if gps is None else f"an IMU ({', '.join(IMUS)})"
        raise MissionError(
            f"{path}: the vehicle did not send {missing} that can be used; accepted are logs with both. It "
            f"has {_listed(vehicle)}"
        )
    if imu.rate < MIN_IMU_RATE:
        raise MissionError(
            f"{path}: the IMU was sent {imu.rate:.2g} times a second; accepted are at least "
            f"{MIN_IMU_RATE:g} times, since the motion between fewer samples is unknown. The autopilot is "
            "told how often to send each message"
        )
    fixes = gnss_of(vehicle, gps)
    if not len(fixes.time):
        raise MissionError(f"{path}: {_no_fix(vehicle)}")
    made = repaired(str(path), imu.time, imu.values, fixes, auxiliary=AuxiliaryData(_kind(vehicle)))
    check_log(made)
    return made


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    imu = imu_of(_vehicle(path, {**FIELDS, **IMUS})[1])
    if imu is None:
        raise MissionError(f"{path}: the vehicle did not send an IMU ({', '.join(IMUS)})")
    return imu


def _vehicle(path: Path, fields: Mapping[str, Sequence[str]]) -> tuple[TlogFile, Vehicle]:
    """Return the content of a file, and the vehicle with most position messages between two starts."""
    data = whole(path, MAX_LOG_BYTES)
    if not recognises(data):
        raise MissionError(f"{path}: is no {NAME}")
    numbers, decode = _decoder(path, (*fields, "PARAM_VALUE"))
    wanted = {numbers[name]: (name, names) for name, names in fields.items()}
    wanted[numbers["PARAM_VALUE"]] = ("PARAM_VALUE", ())
    log = TlogFile.of(data, wanted, PARAMETERS, decode)
    vehicles = [vehicle for vehicle in log.vehicles.values() if not _on_the_ground(vehicle)]
    if not vehicles:
        raise MissionError(
            f"{path}: holds no message of a vehicle that can be used ({log.broken} with a wrong checksum, "
            f"{log.lost_bytes} bytes cannot be decoded); accepted are {', '.join(fields)}"
        )
    where = ("GLOBAL_POSITION_INT", "GPS_RAW_INT")
    best = max(
        vehicles, key=lambda one: (sum(one.counts.get(name, 0) for name in where), one.count, -one.first)
    )
    return log, best


def _decoder(path: Path, names: Sequence[str]) -> tuple[dict[str, int], Callable[[bytearray], Any | None]]:
    """Return the numbers of messages, and what decodes a frame."""
    try:
        from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - an extra
    except ImportError:
        raise MissionError(f"{path}: {_MISSING}pip install 'ins-lab[mavlink]'") from None
    link = dialect.MAVLink(None)

    def decode(frame: bytearray) -> Any | None:
        try:
            return link.decode(frame)
        except dialect.MAVError:
            return None

    return {name: getattr(dialect, f"MAVLINK_MSG_ID_{name}") for name in names}, decode


def _on_the_ground(vehicle: Vehicle) -> bool:
    """Return whether a sender is a ground station, a camera or the like."""
    beat = vehicle.numbers("HEARTBEAT")
    return beat is not None and bool(
        (beat["autopilot"] == _NO_AUTOPILOT).all() or (beat["type"] == _GROUND_STATION).all()
    )


def _kind(vehicle: Vehicle) -> str:
    beat = vehicle.numbers("HEARTBEAT")
    return "" if beat is None else MAV_TYPES.get(int(beat["type"][-1]), "")


def _others(log: TlogFile, vehicle: Vehicle) -> tuple[Dropped, ...]:
    """Return the report on messages of other vehicles, or of another start of the autopilot."""
    others = [one for one in log.vehicles.values() if one is not vehicle and not _on_the_ground(one)]
    count = sum(one.count for one in others) + log.others
    if not count:
        return ()
    first = min((one.first for one in others), default=1)
    return (Dropped("messages of another vehicle or of another start of the autopilot", count, first),)


def _remarks(log: TlogFile, geoid: float | None) -> tuple[str, ...]:
    began = f"{datetime.fromtimestamp(log.started, UTC):%Y-%m-%d %H:%M} UTC"
    remarks = [f"Time counts from when the autopilot was switched on. The log begins at {began}."]
    remarks.append(
        SEA_LEVEL
        if geoid is None
        else "Heights are above the ellipsoid: altitude plus the geoid's separation of the receiver "
        f"({geoid:.1f} m)."
    )
    if log.broken:
        remarks.append(f"{log.broken} messages with a wrong checksum are left out.")
    if log.lost_bytes:
        remarks.append(f"{log.lost_bytes} bytes of the file could not be decoded and are left out.")
    return tuple(remarks)


def _listed(vehicle: Vehicle) -> str:
    return ", ".join(f"{count} {name}" for name, count in vehicle.counts.items())


def _stream(
    what: str, vehicle: Vehicle, name: str, *fields: str, scale: float | FloatArray = 1.0
) -> Stream | None:
    messages = vehicle.numbers(name)
    if messages is None:
        return None
    values = np.column_stack([messages[key] for key in fields]) * scale
    return Stream.of(what, since_boot(vehicle, messages), values)


def _velocity(vehicle: Vehicle) -> Stream | None:
    """Return velocity north, east, down [m/s], from the message that is sent more often."""
    found = [
        _stream("local velocity", vehicle, "LOCAL_POSITION_NED", "vx", "vy", "vz"),
        _stream("velocity", vehicle, "GLOBAL_POSITION_INT", "vx", "vy", "vz", scale=1e-2),
    ]
    usable = [one for one in found if one is not None and one.usable]
    # The local one is no whole number of cm/s, so it is taken when both come as often.
    return max(usable, key=lambda one: round(one.rate), default=None)


def _position(vehicle: Vehicle, geoid: float | None) -> Stream | None:
    messages = vehicle.numbers("GLOBAL_POSITION_INT")
    if messages is None:
        return None
    place = place_of(messages)
    valid = is_position(place)
    place[:, 2] += geoid or 0.0
    return first_usable((Stream.of("position", since_boot(vehicle, messages), place, valid),))


def _attitude(vehicle: Vehicle) -> Stream | None:
    """Return the attitude as quaternions, from the message that is sent more often."""
    found = []
    euler = _stream("attitude", vehicle, "ATTITUDE", "roll", "pitch", "yaw")
    whole_turn = _stream("attitude", vehicle, "ATTITUDE_QUATERNION", "q1", "q2", "q3", "q4")
    if whole_turn is not None:
        fine = is_attitude(whole_turn.values)
        found.append(Stream.of("attitude", whole_turn.time, whole_turn.values, fine))
    if euler is not None:
        values = quaternion_from_euler(euler.values)
        found.append(Stream(euler.what, euler.time, values, euler.read, euler.first_lost))
    return max((one for one in found if one.usable), key=lambda one: round(one.rate), default=None)


def _no_fix(vehicle: Vehicle) -> str:
    """Return why a vehicle has no position, in words."""
    gps = vehicle.numbers("GPS_RAW_INT")
    said = "GLOBAL_POSITION_INT gives no position that can be used, and "
    if gps is None:
        said += "no GPS_RAW_INT was sent"
    else:
        said += (
            f"none of the {len(gps['lat'])} messages GPS_RAW_INT has a three-dimensional fix (fix_type is "
            f"{gps['fix_type'].max():.0f} at most)"
        )
    return f"{said}; accepted are logs with positions. It has {_listed(vehicle)}"


def _gps_track(
    path: Path, vehicle: Vehicle, geoid: float | None, remarks: tuple[str, ...], kind: str
) -> Track:
    gps = vehicle.numbers("GPS_RAW_INT")
    if gps is None or not fixed(gps).any():
        raise MissionError(f"{path}: {_no_fix(vehicle)}")
    known, place = fixed(gps), place_of(gps)
    speed, course = over_ground(gps)
    lines = np.arange(1, len(known) + 1)
    lost = int((~known).sum())
    return Track(
        path=path,
        format=NAME,
        time=since_boot(vehicle, gps)[known],
        latitude=np.degrees(place[known, 0]),
        longitude=np.degrees(place[known, 1]),
        height=place[known, 2] + (geoid or 0.0),
        speed=speed[known],
        course=course[known],
        lines=lines[known],
        columns=units_of_the_format(_TRACK_UNITS),
        rows_read=len(known),
        dropped=(Dropped("without a fix", lost, int(lines[~known][0])),) if lost else (),
        remarks=("The vehicle sent no solution of its estimator: the track of its GPS is used.", *remarks),
        vehicle=kind,
    )
