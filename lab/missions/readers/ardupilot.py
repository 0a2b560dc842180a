"""ArduPilot DataFlash log (.bin): the estimator's solution as a flight, IMU and GPS as a log.

Velocity is of the extended Kalman filter (XKF1, before it NKF1), position of POS, attitude of the filter's
quaternions (XKQ, NKQ) or of ATT. Of several instances or cores the first is taken.

References
----------
ArduPilot, *Onboard Message Log Messages*, https://ardupilot.org/plane/docs/logmessages.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.missions.content import whole
from lab.missions.errors import MissionError
from lab.missions.log_check import check_log
from lab.missions.raw_flight import ColumnUnit, RawFlight
from lab.missions.readers.dataflash_file import MAGIC, DataFlashFile
from lab.missions.readers.fields import OF_THE_FORMAT, SEA_LEVEL, one_file
from lab.missions.readers.streams import MAX_LOG_BYTES, Stream, first_usable, flight_of
from lab.missions.readers.track import refuse_units
from lab.missions.sensor_log import GnssLog, SensorLog, repaired
from lab.rotation import quaternion_from_euler

FloatArray = NDArray[np.float64]
Messages = dict[str, FloatArray]

NAME = "ArduPilot DataFlash"

_FLIGHT = ("XKF1", "NKF1", "POS", "AHR2", "XKQ", "NKQ", "ATT", "GPS", "MSG", "GPA")
_SENSORS = ("IMU", "GPS", "GPA", "PARM")
_VEHICLES = {
    "ArduPlane": "fixed wing", "ArduCopter": "rotary wing", "ArduRover": "rover", "APM:Rover": "rover",
    "Rover": "rover", "Blimp": "blimp", "ArduSub": "submarine",
}  # fmt: skip
_UNITS = {"Lat": "°", "Lng": "°", "Alt": "m", "VN, VE, VD": "m/s", "Roll, Pitch, Yaw": "°"}
_ABOVE_ELLIPSOID = "Heights are above the ellipsoid: altitude plus the geoid's separation of the receiver"
_THREE_D = 3
_NEAR = 0.25


def recognises(head: bytes) -> bool:
    """Tell whether a file starts like a DataFlash log."""
    return head.startswith(MAGIC)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the flight as the autopilot's estimator has it.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or has no velocity and position that can be used.
    """
    path = one_file(paths, NAME)
    refuse_units(path, NAME, units)
    log = _log(path, _FLIGHT)
    gps = _messages(log, "GPS")
    velocity = first_usable(
        (*(_stream("velocity", log, name, "VN", "VE", "VD") for name in ("XKF1", "NKF1")), _gps_velocity(gps))
    )
    position = first_usable((*(_position(log, name) for name in ("POS", "AHR2")), _gps_position(gps)))
    geoid = _geoid(log)
    if position is not None and geoid is not None:
        position = replace(position, values=position.values + np.array((0.0, 0.0, geoid)))
    remarks = ["Time counts from when the autopilot was switched on."]
    remarks.append(SEA_LEVEL if geoid is None else f"{_ABOVE_ELLIPSOID} ({geoid:.1f} m).")
    if log.lost_bytes:
        remarks.append(f"{log.lost_bytes} bytes of the file make no sense and are left out.")
    try:
        return flight_of(
            path,
            NAME,
            velocity,
            position,
            _attitude(log),
            units=tuple(ColumnUnit(name, unit, OF_THE_FORMAT) for name, unit in _UNITS.items()),
            remarks=tuple(remarks),
            vehicle=_vehicle(log),
        )
    except MissionError as error:
        raise MissionError(f"{error}. It has {', '.join(log.names) or 'none of the messages used'}") from None


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log = _log(path, _SENSORS)
    imu = _stream("IMU", log, "IMU", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
    gps = _messages(log, "GPS")
    if imu is None or not imu.usable or gps is None:
        missing = "a GPS (GPS)" if gps is None else "an IMU (IMU)"
        raise MissionError(f"{path}: the log does not have {missing}; accepted are logs with both")
    names = [name.rstrip("\0") for name in log.texts("PARM", "Name")]
    values = (log.numbers("PARM") or {}).get("Value", np.empty(0))
    parameters = dict(zip(names, values.tolist(), strict=False))
    gnss = _gnss(gps, _messages(log, "GPA"), _geoid(log), parameters)
    made = repaired(str(path), imu.time, imu.values, gnss)
    check_log(made)
    return made


def _log(path: Path, wanted: Sequence[str]) -> DataFlashFile:
    data = whole(path, MAX_LOG_BYTES)
    if not data.startswith(MAGIC):
        raise MissionError(f"{path}: is no {NAME} log")
    return DataFlashFile.of(data, wanted)


def _messages(log: DataFlashFile, name: str) -> Messages | None:
    """Return the messages of a name that have a time, of the lowest instance, or core, there is."""
    messages = log.numbers(name)
    if messages is None or "TimeUS" not in messages:
        return None
    for key in ("I", "C"):
        if key in messages:
            rows = messages[key] == messages[key].min()
            return {name: values[rows] for name, values in messages.items()}
    return messages


def _values(messages: Messages | None, *names: str) -> FloatArray | None:
    if messages is None or not set(names) <= set(messages):
        return None
    return np.column_stack([messages[name] for name in names])


def _stream(what: str, log: DataFlashFile, name: str, *fields: str) -> Stream | None:
    messages = _messages(log, name)
    values = _values(messages, *fields)
    if messages is None or values is None:
        return None
    return Stream.of(what, messages["TimeUS"] * 1e-6, values)


def _place(messages: Messages | None) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]."""
    values = _values(messages, "Lat", "Lng", "Alt")
    return None if values is None else np.column_stack((np.radians(values[:, :2]), values[:, 2]))


def _believed(place: FloatArray) -> NDArray[np.bool_]:
    # Zero, zero is what is logged before the first fix.
    return np.asarray((np.abs(place[:, 0]) <= np.pi / 2) & (place[:, :2] != 0).any(axis=1))


def _position(log: DataFlashFile, name: str) -> Stream | None:
    messages = _messages(log, name)
    place = _place(messages)
    if messages is None or place is None:
        return None
    return Stream.of("position", messages["TimeUS"] * 1e-6, place, _believed(place))


def _geoid(log: DataFlashFile) -> float | None:
    """Return how far the geoid is above the ellipsoid, as the receiver says [m]; None if it does not."""
    messages = _messages(log, "GPA")
    told = np.empty(0) if messages is None else messages.get("Und", np.empty(0))
    told = told[np.abs(told) < 200]
    return float(np.median(told)) if told.size and told.any() else None


def _fixed(gps: Messages) -> NDArray[np.bool_]:
    status = gps.get("Status")
    return np.ones(len(gps["TimeUS"]), dtype=bool) if status is None else status >= _THREE_D


def _gps_position(gps: Messages | None) -> Stream | None:
    place = _place(gps)
    if gps is None or place is None:
        return None
    return Stream.of("GPS position", gps["TimeUS"] * 1e-6, place, _fixed(gps) & _believed(place))


def _over_ground(gps: Messages) -> FloatArray | None:
    """Return velocity north, east, down of speed, course and vertical speed."""
    values = _values(gps, "Spd", "GCrs", "VZ")
    if values is None:
        return None
    speed, course, down = values.T
    angle = np.radians(course)
    return np.column_stack((speed * np.cos(angle), speed * np.sin(angle), down))


def _gps_velocity(gps: Messages | None) -> Stream | None:
    velocity = None if gps is None else _over_ground(gps)
    if gps is None or velocity is None:
        return None
    return Stream.of("GPS velocity", gps["TimeUS"] * 1e-6, velocity, _fixed(gps))


def _attitude(log: DataFlashFile) -> Stream | None:
    """Return the attitude as quaternions: the filter's own, unless ATT is logged more often."""
    att = _stream("attitude", log, "ATT", "Roll", "Pitch", "Yaw")
    found = []
    if att is not None and att.usable:
        values = quaternion_from_euler(np.radians(att.values))
        found.append(Stream(att.what, att.time, values, att.read, att.first_lost))
    for name in ("XKQ", "NKQ"):
        stream = _stream("attitude", log, name, "Q1", "Q2", "Q3", "Q4")
        if stream is not None and stream.usable:
            fine = np.abs(np.linalg.norm(stream.values, axis=1) - 1) < 0.1
            found.append(Stream.of("attitude", stream.time, stream.values, fine))
    return max((one for one in found[::-1] if one.usable), key=lambda one: round(one.rate), default=None)


def _gnss(
    gps: Messages, accuracy: Messages | None, geoid: float | None, parameters: Mapping[str, float]
) -> GnssLog:
    count = len(gps["TimeUS"])
    unknown = np.full((count, 3), np.nan)
    time, place, velocity = gps["TimeUS"] * 1e-6, _place(gps), _over_ground(gps)
    place = unknown if place is None else place
    place = place + np.array((0.0, 0.0, geoid or 0.0))
    told = {name: _beside(time, accuracy, name) for name in ("HAcc", "VAcc", "SAcc")}
    level, vertical, speed = (
        np.where((told[name] > 1e-6) & (told[name] < 1e6), told[name], np.nan)
        for name in ("HAcc", "VAcc", "SAcc")
    )
    fine = _fixed(gps) & np.isfinite(place).all(axis=1) & _believed(place) & np.isfinite(time)
    late = max(parameters.get("GPS1_DELAY_MS", 0.0), parameters.get("GPS_DELAY_MS", 0.0))
    return GnssLog(
        time=time[fine],
        position=place[fine],
        velocity_n=(unknown if velocity is None else velocity)[fine],
        position_sigma=np.column_stack((level, level, vertical))[fine],
        velocity_sigma=np.column_stack((speed, speed, speed))[fine],
        lever_arm=_lever_arm(parameters),
        latency=1e-3 * late if 0 <= late <= 1000 else 0.0,
    )


def _beside(time: FloatArray, messages: Messages | None, name: str) -> FloatArray:
    """Return what the nearest message says of each time; NaN without one nearby."""
    if messages is None or name not in messages:
        return np.full_like(time, np.nan)
    order = np.argsort(messages["TimeUS"], kind="stable")
    at, values = messages["TimeUS"][order] * 1e-6, messages[name][order]
    after = np.clip(np.searchsorted(at, time), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(at[before] - time) < np.abs(at[after] - time), before, after)
    return np.where(np.abs(at[nearest] - time) <= _NEAR, values[nearest], np.nan)


def _lever_arm(parameters: Mapping[str, float]) -> FloatArray:
    """Return the way from the IMU to the antenna as the autopilot was told it [m]."""
    arm = [
        parameters.get(f"GPS1_POS_{axis}", parameters.get(f"GPS_POS1_{axis}", 0.0))
        - parameters.get(f"INS_POS1_{axis}", 0.0)
        for axis in "XYZ"
    ]
    return np.array(arm) if all(abs(one) <= 100 for one in arm) else np.zeros(3)


def _vehicle(log: DataFlashFile) -> str:
    for text in log.texts("MSG", "Message"):
        for name, vehicle in _VEHICLES.items():
            if text.startswith(name):
                return vehicle
    return ""
