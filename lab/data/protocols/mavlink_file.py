"""MAVLink telemetry log (.tlog): the estimator's solution as a flight, raw IMU and GPS as a sensor log.

A ground station writes its time, eight bytes of microseconds since 1970, before each frame it received.
The velocity comes from LOCAL_POSITION_NED or GLOBAL_POSITION_INT, the position from the latter, the
attitude from ATTITUDE_QUATERNION or ATTITUDE. Without a solution the flight is the track of GPS_RAW_INT.

References
----------
MAVLink, *Common Message Set*, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files import streams
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import FIX_3D, TIME, Messages, Stream
from lab.data.files.track import Track
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Series
from lab.data.log.sensor_log import SINCE_1970, GnssLog, SensorLog
from lab.data.log.vehicle import MAV_TYPES
from lab.data.protocols.mavlink import (
    ACCELEROMETER,
    ARMS,
    DELAYS,
    GYRO,
    LONGEST_STEP,
    MESSAGES,
    ONE_G,
    RECEIVERS,
    STAMP,
    Telemetry,
    Vehicle,
    frame_size,
)
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "MAVLink tlog"

MIN_IMU_RATE = 10.0
"""Fewest samples of the IMU a second accepted [Hz]: between point samples further apart a vehicle that turns
within half a second, as they do, is not seen to turn."""

_STAMPS = (9.5e14, 4.1e15)
"""Times of a ground station [µs since 1970]: of the years 2000 to 2099."""
_FRAMES_TO_SEE = 3
"""Frames in a row by which a log is recognised."""
_IMUS = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU")
"""Messages of an IMU that are looked at."""
_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID, of what is no autopilot."""
_GROUND_STATION = 6
"""MAV_TYPE_GCS."""
_UNITS = {"lat, lon": "°", "alt": "m", "vx, vy, vz": "m/s", "roll, pitch, yaw": "rad"}
_TRACK_UNITS = {"lat": "°", "lon": "°", "alt": "m", "vel": "m/s", "cog": "°"}


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file are frames with times of this century before them."""
    at = seen = 0
    while seen < _FRAMES_TO_SEE and at < len(head):
        stamp = int.from_bytes(head[at : at + STAMP], "big")
        size = frame_size(head[at + STAMP : at + STAMP + 3])
        at, seen = at + STAMP + size, seen + 1
        if size <= 0 or at > len(head) or not _STAMPS[0] <= stamp <= _STAMPS[1]:
            return False
    return seen > 0


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight; without one, the track of its GPS.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no position that can be used, or pymavlink is not
        installed.
    """
    path = one_file(paths, NAME, fixed=units)
    log, vehicle = _vehicle(path)
    geoid = _geoid(vehicle)
    velocity, position = _velocity(vehicle), _position(vehicle, geoid)
    remarks = _remarks(log, geoid)
    kind = _kind(vehicle)
    if velocity is None or position is None:
        flight = _gps_track(path, vehicle, geoid, remarks, kind).flight()
    else:
        flight = streams.make_flight(
            path,
            NAME,
            velocity,
            position,
            _attitude(vehicle),
            units=units_of_the_format(_UNITS),
            remarks=remarks,
            vehicle=kind,
        )
    return replace(flight, dropped=(*flight.dropped, *_report_other_vehicles(log, vehicle)))


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the vehicle sent.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, they cannot be navigated with, or
        pymavlink is not installed.
    """
    _, vehicle = _vehicle(path)
    gps, imu = _messages(vehicle, "GPS_RAW_INT"), _imu(vehicle)
    if gps is None or imu is None:
        missing = "a GPS (GPS_RAW_INT)" if gps is None else f"an IMU ({', '.join(_IMUS)})"
        raise MissionError(
            f"{path}: the vehicle did not send {missing} that can be used; accepted are logs with both. It "
            f"has {_list_vehicle(vehicle)}"
        )
    if imu.rate < MIN_IMU_RATE:
        raise MissionError(
            f"{path}: the IMU was sent {imu.rate:.2g} times a second; accepted are at least "
            f"{MIN_IMU_RATE:g} times, since the motion between fewer samples is unknown. The autopilot is "
            "told how often to send each message"
        )
    fixes = _gnss(vehicle, gps)
    if not len(fixes.time):
        raise MissionError(f"{path}: {_no_fix(vehicle)}")
    auxiliary = AuxiliaryData(_kind(vehicle), headings=_headings(vehicle), odometer=_wheels(vehicle))
    return streams.checked_log(path, imu, fixes, auxiliary)


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    said = f"the vehicle did not send an IMU ({', '.join(_IMUS)})"
    return streams.usable_imu(path, _imu(_vehicle(path)[1]), said)


def _vehicle(path: Path) -> tuple[Telemetry, Vehicle]:
    """Return the content of a file, and the vehicle with most position messages between two starts."""
    data = read_whole(path, streams.MAX_LOG_BYTES)
    if not recognises(data):
        raise MissionError(f"{path}: is no {NAME}")
    try:
        log = Telemetry.of(data)
    except ImportError as error:
        raise MissionError(f"{path}: is a MAVLink telemetry log. {error}") from None
    vehicles = [vehicle for vehicle in log.vehicles.values() if not _on_the_ground(vehicle)]
    if not vehicles:
        raise MissionError(
            f"{path}: holds no message of a vehicle that can be used ({count_noun(log.lost, 'byte')} in no "
            f"sound message); accepted are {', '.join(MESSAGES)}"
        )
    where = ("GLOBAL_POSITION_INT", "GPS_RAW_INT")
    best = max(
        vehicles, key=lambda one: (sum(one.counts.get(name, 0) for name in where), one.count, -one.first)
    )
    return log, best


def _on_the_ground(vehicle: Vehicle) -> bool:
    """Return whether a sender is a ground station, a camera or the like."""
    beat = vehicle.numbers("HEARTBEAT")
    return beat is not None and bool(
        (beat["autopilot"] == _NO_AUTOPILOT).all() or (beat["type"] == _GROUND_STATION).all()
    )


def _kind(vehicle: Vehicle) -> str:
    beat = vehicle.numbers("HEARTBEAT")
    return "" if beat is None else MAV_TYPES.get(int(beat["type"][-1]), "")


def _report_other_vehicles(log: Telemetry, vehicle: Vehicle) -> tuple[Dropped, ...]:
    """Return the report on messages of other vehicles, or of another start of the autopilot."""
    others = [one for one in log.vehicles.values() if one is not vehicle and not _on_the_ground(one)]
    count = sum(one.count for one in others) + log.others
    if not count:
        return ()
    first = min((one.first for one in others), default=1)
    return (Dropped("messages of another vehicle or of another start of the autopilot", count, first),)


def _remarks(log: Telemetry, geoid: float | None) -> tuple[str, ...]:
    began = f"{datetime.fromtimestamp(log.started, UTC):%Y-%m-%d %H:%M} UTC"
    above = "Heights are above the ellipsoid: altitude plus the geoid's separation of the receiver"
    remarks = [f"{streams.SWITCHED_ON} The log begins at {began}."]
    remarks.append(SEA_LEVEL if geoid is None else f"{above} ({geoid:.1f} m).")
    if log.lost:
        remarks.append(
            f"{count_noun(log.lost, 'byte')} of the file belong to no sound message, and are left out."
        )
    return tuple(remarks)


def _list_vehicle(vehicle: Vehicle) -> str:
    return ", ".join(f"{count} {name}" for name, count in vehicle.counts.items())


def _messages(vehicle: Vehicle, name: str) -> Messages | None:
    """Return messages with the time since the autopilot was switched on [s]; NaN where it is not known."""
    messages = vehicle.numbers(name)
    if messages is None or "time_boot_ms" in messages:
        return messages and {**messages, TIME: messages["time_boot_ms"]}
    time = messages["time_usec"].copy()
    of_day = time > SINCE_1970
    if of_day.any():
        # Either is allowed; the autopilot's own clock says how far they are apart.
        clock = vehicle.numbers("SYSTEM_TIME")
        known = np.empty(0) if clock is None else clock["time_unix_usec"] - clock["time_boot_ms"]
        known = known[known > SINCE_1970]
        time[of_day] -= np.median(known) if known.size else np.nan
    return {**messages, TIME: np.where(messages["time_usec"] > 0, time, np.nan)}


def _read_place(messages: Messages) -> FloatArray:
    """Return latitude, longitude [rad] and height above sea level [m], (n, 3), of messages."""
    return np.column_stack([messages[name] for name in ("lat", "lon", "alt")])


def _mask_fixed(gps: Messages) -> Flags:
    """Return which messages of GPS_RAW_INT have a three-dimensional fix."""
    return (gps["fix_type"] >= FIX_3D) & streams.is_position(_read_place(gps))


def _geoid(vehicle: Vehicle) -> float | None:
    """Return the height of the geoid over the ellipsoid from the receiver [m]; None if it gives none."""
    gps = vehicle.numbers("GPS_RAW_INT")
    if gps is None:
        return None
    return streams.geoid_height(
        (gps["alt_ellipsoid"] - gps["alt"])[_mask_fixed(gps) & np.isfinite(gps["alt_ellipsoid"])]
    )


def _imu(vehicle: Vehicle) -> Stream | None:
    """Return angular rate [rad/s] and specific force [m/s²], from the message that is sent most often."""
    found = []
    for name in _IMUS:
        messages = _messages(vehicle, name) or {}
        first = messages["id"] == messages["id"].min() if "id" in messages else None
        stream = Stream.of_fields("IMU", messages, *GYRO, *ACCELEROMETER, valid=first)
        if stream is None:
            continue
        # Raw numbers may be counts of any size; those of ArduPilot are mrad/s and thousandths of g.
        size = float(np.median(np.linalg.norm(stream.values[:, 3:], axis=1))) if stream.usable else 0.0
        if ONE_G[0] < size / STANDARD_GRAVITY < ONE_G[1]:
            found.append(stream)
    return max(found, key=lambda one: len(one.time), default=None)


def _gnss(vehicle: Vehicle, gps: Messages) -> GnssLog:
    """Return the fixes of GPS_RAW_INT; it has no vertical velocity."""
    place, speed, course = _read_place(gps), gps["vel"], gps["cog"]
    place[:, 2] += _geoid(vehicle) or 0.0
    velocity = np.column_stack((speed * np.cos(course), speed * np.sin(course), np.full(len(speed), np.nan)))
    sigmas = [gps[name] for name in ("h_acc", "v_acc", "vel_acc")]
    delay = streams.gps_delay(1e-3 * max(vehicle.parameters.get(name, 0.0) for name in DELAYS))
    arm = streams.read_lever_arm(vehicle.parameters, ARMS)
    return streams.make_gnss_log(gps[TIME], place, velocity, sigmas, gps["fix_type"] >= FIX_3D, arm, delay)


def _headings(vehicle: Vehicle) -> Headings | None:
    """Return the headings of the first receiver with two antennas that has any."""
    for name in RECEIVERS:
        gps = _messages(vehicle, name)
        if gps is not None:
            values = np.column_stack((gps["yaw"], np.nan_to_num(gps["hdg_acc"])))
            found = Stream.of("heading", gps[TIME], values)
            if len(found.time):
                heading, sigma = found.values.T
                return Headings(found.time, heading, np.where(sigma > 0, sigma, np.nan))
    return None


def _wheels(vehicle: Vehicle) -> Series | None:
    """Return the mean speed of the wheels between two messages, at the time in the middle."""
    messages = _messages(vehicle, "WHEEL_DISTANCE")
    distances = streams.stack_fields(messages, *MESSAGES["WHEEL_DISTANCE"][2:])
    if messages is None or distances is None:
        return None
    count = messages["count"]
    turning = np.arange(distances.shape[1]) < count[:, None]
    mean = np.where(turning, distances, 0.0).sum(axis=1) / np.maximum(count, 1)
    moved = Stream.of("wheels", messages[TIME], mean, count > 0)
    step, way = np.diff(moved.time), np.diff(moved.values[:, 0])
    near = step < LONGEST_STEP
    return Series((moved.time[1:] - step / 2)[near], (way / step)[near]) if near.any() else None


def _velocity(vehicle: Vehicle) -> Stream | None:
    """Return velocity north, east, down [m/s], from the message that is sent more often."""
    found = [
        Stream.of_fields(what, _messages(vehicle, name), "vx", "vy", "vz")
        # The local one is no whole number of cm/s, so it is taken when both come as often.
        for what, name in (("local velocity", "LOCAL_POSITION_NED"), ("velocity", "GLOBAL_POSITION_INT"))
    ]
    return streams.most_frequent(found)


def _position(vehicle: Vehicle, geoid: float | None) -> Stream | None:
    messages = _messages(vehicle, "GLOBAL_POSITION_INT")
    if messages is None:
        return None
    place = _read_place(messages)
    valid = streams.is_position(place)
    place[:, 2] += geoid or 0.0
    return streams.first_usable((Stream.of("position", messages[TIME], place, valid),))


def _attitude(vehicle: Vehicle) -> Stream | None:
    """Return the attitude as quaternions, from the message that is sent more often."""
    quaternions = _messages(vehicle, "ATTITUDE_QUATERNION")
    angles = Stream.of_fields("attitude", _messages(vehicle, "ATTITUDE"), "roll", "pitch", "yaw")
    return streams.most_frequent(
        (
            streams.make_attitude_stream(Stream.of_fields("attitude", quaternions, "q1", "q2", "q3", "q4")),
            streams.attitude_of_angles(angles),
        )
    )


def _no_fix(vehicle: Vehicle) -> str:
    """Return why a vehicle has no position, in words."""
    gps = vehicle.numbers("GPS_RAW_INT")
    said = "GLOBAL_POSITION_INT gives no position that can be used, and "
    if gps is None:
        said += "no GPS_RAW_INT was sent"
    else:
        said += streams.without_fix("messages GPS_RAW_INT", len(gps["lat"]), "fix_type", gps["fix_type"])
    return f"{said}; accepted are logs with positions. It has {_list_vehicle(vehicle)}"


def _gps_track(
    path: Path, vehicle: Vehicle, geoid: float | None, remarks: tuple[str, ...], kind: str
) -> Track:
    gps = _messages(vehicle, "GPS_RAW_INT")
    if gps is None or not _mask_fixed(gps).any():
        raise MissionError(f"{path}: {_no_fix(vehicle)}")
    known, place = _mask_fixed(gps), _read_place(gps)
    lines = np.arange(1, len(known) + 1)
    return Track(
        path=path,
        format=NAME,
        time=gps[TIME][known],
        latitude=np.degrees(place[known, 0]),
        longitude=np.degrees(place[known, 1]),
        height=place[known, 2] + (geoid or 0.0),
        speed=gps["vel"][known],
        course=np.degrees(gps["cog"][known]),
        lines=lines[known],
        columns=units_of_the_format(_TRACK_UNITS),
        rows_read=len(known),
        dropped=Dropped.of("without a fix", ~known),
        remarks=("The vehicle sent no solution of its estimator: the track of its GPS is used.", *remarks),
        vehicle=kind,
    )
