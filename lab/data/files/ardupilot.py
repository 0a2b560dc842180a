"""ArduPilot DataFlash log (.bin, or .log as text): the solution as a flight, IMU and GPS as a sensor log.

The velocity comes from the extended Kalman filter (XKF1, earlier NKF1 and EKF1), the position from POS,
the attitude from the filter's quaternions (XKQ, NKQ) or from ATT. Logs of 2012 to 2014, before the filter,
have the velocity of the GPS. The first core is used, and of several IMUs or receivers the first that has
about as many samples or fixes as any.

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

from lab.base.arrays import FloatArray
from lab.base.files.file_content import whole
from lab.base.files.mission_error import MissionError
from lab.data.checks.log_check import check_log
from lab.data.clock.faults import increasing
from lab.data.files import sdlog2
from lab.data.files.dataflash_file import MAGIC, DataFlashFile, Log
from lab.data.files.dataflash_text import DataFlashText, is_text
from lab.data.files.dataflash_time import TIME, Messages, MessageTimes
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import (
    FIX_3D,
    MAX_LOG_BYTES,
    Stream,
    believed_lever_arm,
    first_usable,
    flight_of,
    geoid_height,
    gps_delay,
    is_attitude,
    is_position,
)
from lab.data.files.track import slope
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repaired
from lab.data.rebuild.raw_flight import VERTICAL_VELOCITY, RawFlight
from lab.motion.frames.rotation import quaternion_from_euler

_MICROTESLA = 0.1
"""Microteslas in a milligauss."""
_NORTH = 360.0
"""Largest yaw of a receiver with two antennas [°]: it writes north as 360 and not as 0, which is no yaw."""
NAME = "ArduPilot DataFlash"

_FLIGHT = ("XKF1", "NKF1", "EKF1", "POS", "AHR2", "XKQ", "NKQ", "ATT", "GPS", "MSG", "GPA", "PARM")
_SENSORS = ("IMU", "GPS", "GPA", "PARM", "MAG", "MSG")
_VEHICLES = {
    "ArduPlane": "fixed wing", "APM:Plane": "fixed wing", "ArduCopter": "rotary wing",
    "APM:Copter": "rotary wing", "ArduRover": "rover", "APM:Rover": "rover",
    "Rover": "rover", "Blimp": "blimp", "ArduSub": "submarine",
}  # fmt: skip
_UNITS = {"Lat": "°", "Lng": "°", "Alt": "m", "VN, VE, VD": "m/s", "Roll, Pitch, Yaw": "°"}
_ABOVE_ELLIPSOID = "Heights are above the ellipsoid: altitude plus the geoid's separation of the receiver"
_NOVATEL = 15
"""Type of the receivers whose separation is logged with the receiver's own sign (AP_GPS_Type)."""
_FIXED_IN_2012 = 2
"""Status of a fix in logs from before a 3-D fix had a status of its own."""
_ABOUT_AS_MANY = 0.8
"""Part of the samples or fixes of the best IMU or receiver that an earlier one has, which is then used: the
autopilot prefers the first, whose own first fix may come later."""
_MAX_GPA_AGE = 0.25
"""Time between a fix and the message with its accuracy [s]: receivers of 5 Hz send both within 0.2 s."""
_HEAD = 2**16
"""Bytes at the start of a file in which its kind shows: a log as text describes its messages first."""
_COUNTED = {"IMU": "IMU", "GPS": "GPS", "GPA": "GPS"}
"""Messages whose instance is chosen by how many messages, of this name, it has; of others it is the first."""
_WITHOUT_CLIMB = "GPS velocity and climb"


def recognises(head: bytes) -> bool:
    """Return whether a file starts like a DataFlash log, in bytes or as text."""
    return (head.startswith(MAGIC) and not sdlog2.recognises(head)) or is_text(head)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or has no velocity and position that can be used.
    """
    path = one_file(paths, NAME, fixed=units)
    log, times = _log(path, _FLIGHT)
    gps = _messages(times, "GPS")
    filtered = [_stream("velocity", times, name, "VN", "VE", "VD") for name in ("XKF1", "NKF1", "EKF1")]
    velocity = first_usable((*filtered, _gps_velocity(gps)))
    position = first_usable((*(_position(times, name) for name in ("POS", "AHR2")), _gps_position(gps)))
    parameters = _parameters(log)
    geoid = _geoid(times, parameters)
    if position is not None and geoid is not None:
        position = replace(position, values=position.values + np.array((0.0, 0.0, geoid)))
    climb = velocity is not None and velocity.what == _WITHOUT_CLIMB
    attitude = _attitude(times)
    remarks = [_clock_remark(times), *_instance_remarks(times)]
    remarks.append(SEA_LEVEL if geoid is None else f"{_ABOVE_ELLIPSOID} ({geoid:.1f} m).")
    if climb:
        remarks.append("The vertical velocity is not recorded: it is the slope of the GPS's heights.")
    remarks += _lost_remarks(log)
    try:
        flight = flight_of(
            path,
            NAME,
            velocity,
            position,
            attitude,
            units=units_of_the_format(_UNITS),
            remarks=tuple(remarks),
            vehicle=_vehicle(log, parameters),
        )
    except MissionError as error:
        raise MissionError(f"{error}. {_what_there_is(log, times, gps)}") from None
    return replace(flight, made=(VERTICAL_VELOCITY,)) if climb else flight


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log, times = _log(path, _SENSORS)
    imu = _stream("IMU", times, "IMU", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
    gps = _messages(times, "GPS")
    if imu is None or not imu.usable or gps is None:
        missing = "a GPS (GPS)" if gps is None else "an IMU (IMU)"
        raise MissionError(
            f"{path}: the log does not have {missing} with a time; accepted are logs with both. "
            f"{_what_there_is(log, times, gps)}"
        )
    parameters = _parameters(log)
    instances = int(_counts(times, "IMU")[0]), int(_counts(times, "GPS")[0])
    gnss = _gnss(gps, _messages(times, "GPA"), _geoid(times, parameters), parameters, instances)
    if not gnss.time.size:
        raise MissionError(f"{path}: {_no_fix(gps)}; accepted are logs with fixes")
    compass, headings = magnetometer_of(_messages(times, "MAG")), headings_of(gps, _fixed(gps))
    auxiliary = AuxiliaryData(_vehicle(log, parameters), compass, headings)
    made = repaired(str(path), imu.time, imu.values, gnss, auxiliary=auxiliary)
    check_log(made)
    remarks = [*_instance_remarks(times), *_lost_remarks(log)]
    remarks += [_clock_remark(times)] if times.unstamped else []
    return replace(made, repairs=(*made.repairs, *remarks))


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    _, times = _log(path, _SENSORS)
    imu = _stream("IMU", times, "IMU", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
    if imu is None or not imu.usable:
        raise MissionError(f"{path}: the log does not have an IMU (IMU) with a time")
    return imu


def _parameters(log: Log) -> dict[str, float]:
    names = [name.rstrip("\0") for name in log.texts("PARM", "Name")]
    values = (log.numbers("PARM") or {}).get("Value", np.empty(0))
    return dict(zip(names, values.tolist(), strict=False))


def _lost_remarks(log: Log) -> list[str]:
    lost = log.lost_bytes
    return [f"{lost} bytes of the file could not be decoded and are left out."] if lost else []


def _log(path: Path, wanted: Sequence[str]) -> tuple[Log, MessageTimes]:
    data = whole(path, MAX_LOG_BYTES)
    if not recognises(data[:_HEAD]):
        raise MissionError(f"{path}: is no {NAME} log")
    log: Log = DataFlashFile.of(data, wanted) if data.startswith(MAGIC) else DataFlashText(data, wanted)
    return log, MessageTimes(log, wanted)


def _clock_remark(times: MessageTimes) -> str:
    remark = "Time counts from when the autopilot was switched on."
    if times.of_week:
        remark = "Time is that of the GPS week: the log has no other."
    if times.unstamped:
        remark += (
            f" The messages {' and '.join(times.unstamped)} have no time: they are timed by their order "
            "among the others."
        )
    return remark


def _what_there_is(log: Log, times: MessageTimes, gps: Messages | None) -> str:
    """Return which messages a log has, and what is wrong with those of the GPS."""
    said = f"It has {', '.join(log.names) or 'none of the messages used'}"
    untimed = [name for name in log.names if name not in ("MSG", "PARM") and times.of(name) is None]
    if untimed:
        said += f"; of these {', '.join(untimed)} cannot be used: no time (TimeUS, TimeMS), or damaged"
    if gps is not None and not (_fixed(gps) & np.isfinite(gps[TIME])).any():
        said += f"; {_no_fix(gps)}"
    return said


def _no_fix(gps: Messages) -> str:
    highest = int(np.nan_to_num(gps["Status"]).max(initial=0.0)) if "Status" in gps else 0
    return f"none of the {len(gps[TIME])} GPS messages has a fix with a position (Status {highest} at most)"


def _messages(times: MessageTimes, name: str) -> Messages | None:
    """Return the messages of a name that have a time, of one instance, or of the lowest core there is."""
    messages = times.of(name)
    if messages is None:
        return None
    if "I" in messages:
        counted = _COUNTED.get(name)
        used = messages["I"].min() if counted is None else _counts(times, counted)[0]
        return _of_instance(messages, "I", used)
    return _of_instance(messages, "C", messages["C"].min()) if "C" in messages else messages


def _of_instance(messages: Messages, key: str, number: float) -> Messages | None:
    rows = messages[key] == number
    return {name: values[rows] for name, values in messages.items()} if rows.any() else None


def _counts(times: MessageTimes, name: str) -> tuple[float, dict[float, int]]:
    """Return the instance that is used of an IMU or receiver, and how many samples or fixes each has."""
    messages = times.of(name)
    if messages is None or "I" not in messages:
        return 0.0, {}
    fine = _fixed(messages) if name == "GPS" else np.ones(len(messages[TIME]), dtype=bool)
    fine = fine & np.isfinite(messages[TIME])
    counts = {float(one): int(fine[messages["I"] == one].sum()) for one in np.unique(messages["I"])}
    most = max(counts.values(), default=0)
    return next((one for one, count in counts.items() if count >= _ABOUT_AS_MANY * most), 0.0), counts


def _instance_remarks(times: MessageTimes) -> list[str]:
    """Return remarks on an IMU or a receiver that is used although it is not the first."""
    remarks = []
    for name, what, seen in (("IMU", "IMU", "samples"), ("GPS", "receiver", "fixes")):
        used, counts = _counts(times, name)
        if counts and used != min(counts):
            others = ", ".join(f"{one:.0f} has {count}" for one, count in counts.items() if one != used)
            remarks.append(
                f"The {what} of instance {used:.0f} is used, which has {counts[used]} {seen}: {others}."
            )
    return remarks


def _values(messages: Messages | None, *names: str) -> FloatArray | None:
    if messages is None or not set(names) <= set(messages):
        return None
    return np.column_stack([messages[name] for name in names])


def _stream(what: str, times: MessageTimes, name: str, *fields: str) -> Stream | None:
    messages = _messages(times, name)
    values = _values(messages, *fields)
    if messages is None or values is None:
        return None
    return Stream.of(what, messages[TIME], values)


def _place(messages: Messages | None) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]."""
    values = _values(messages, "Lat", "Lng", "Alt")
    return None if values is None else np.column_stack((np.radians(values[:, :2]), values[:, 2]))


def _position(times: MessageTimes, name: str) -> Stream | None:
    messages = _messages(times, name)
    place = _place(messages)
    if messages is None or place is None:
        return None
    return Stream.of("position", messages[TIME], place, is_position(place))


def _geoid(times: MessageTimes, parameters: Mapping[str, float]) -> float | None:
    """Return the height of the geoid over the ellipsoid from the receiver [m]; None if it gives none.

    ArduPilot logs altitude less height over the ellipsoid, the negative of what receivers call separation.
    """
    messages = _messages(times, "GPA")
    geoid = None if messages is None else geoid_height(messages.get("Und", np.empty(0)))
    if geoid is None:
        return None
    number = int(_counts(times, "GPS")[0]) + 1
    names = f"GPS{number}_TYPE", "GPS_TYPE" if number == 1 else f"GPS_TYPE{number}"
    return geoid if _NOVATEL in (parameters.get(name) for name in names) else -geoid


def _fixed(gps: Messages) -> NDArray[np.bool_]:
    status = gps.get("Status")
    if status is None:
        return np.ones(len(gps[TIME]), dtype=bool)
    old = "TimeUS" not in gps and not (status >= FIX_3D).any()
    return np.asarray(status >= (_FIXED_IN_2012 if old else FIX_3D))


def _gps_position(gps: Messages | None) -> Stream | None:
    place = _place(gps)
    if gps is None or place is None:
        return None
    return Stream.of("GPS position", gps[TIME], place, _fixed(gps) & is_position(place))


def _over_ground(gps: Messages) -> FloatArray | None:
    """Return velocity north, east, down of speed, course and vertical speed; NaN down if that is missing."""
    values = _values(gps, "Spd", "GCrs")
    if values is None:
        return None
    speed, angle = values[:, 0], np.radians(values[:, 1])
    down = gps.get("VZ", np.full(len(speed), np.nan))
    return np.column_stack((speed * np.cos(angle), speed * np.sin(angle), down))


def _gps_velocity(gps: Messages | None) -> Stream | None:
    velocity = None if gps is None else _over_ground(gps)
    if gps is None or velocity is None:
        return None
    if "VZ" in gps:
        return Stream.of("GPS velocity", gps[TIME], velocity, _fixed(gps))
    position = _gps_position(gps)
    if position is None or not position.usable:
        return None
    climb = slope(position.time, position.values[:, 2])
    velocity[:, 2] = -np.interp(gps[TIME], position.time, climb)
    return Stream.of(_WITHOUT_CLIMB, gps[TIME], velocity, _fixed(gps))


def _attitude(times: MessageTimes) -> Stream | None:
    """Return the attitude as quaternions: the filter's own, unless ATT is logged more often."""
    att = _stream("attitude", times, "ATT", "Roll", "Pitch", "Yaw")
    found = []
    if att is not None and att.usable:
        values = quaternion_from_euler(np.radians(att.values))
        found.append(Stream(att.what, att.time, values, att.read, att.first_lost))
    for name in ("XKQ", "NKQ"):
        stream = _stream("attitude", times, name, "Q1", "Q2", "Q3", "Q4")
        if stream is not None and stream.usable:
            found.append(Stream.of("attitude", stream.time, stream.values, is_attitude(stream.values)))
    return max((one for one in found[::-1] if one.usable), key=lambda one: round(one.rate), default=None)


def _gnss(
    gps: Messages,
    accuracy: Messages | None,
    geoid: float | None,
    parameters: Mapping[str, float],
    instances: tuple[int, int],
) -> GnssLog:
    count = len(gps[TIME])
    unknown = np.full((count, 3), np.nan)
    time, place, velocity = gps[TIME], _place(gps), _over_ground(gps)
    place = unknown if place is None else place
    place = place + np.array((0.0, 0.0, geoid or 0.0))
    level, vertical, speed = (
        believed_sigma(_nearest(time, accuracy, name)) for name in ("HAcc", "VAcc", "SAcc")
    )
    fine = _fixed(gps) & np.isfinite(place).all(axis=1) & is_position(place) & np.isfinite(time)
    if "TimeUS" not in gps:
        # A fix that was logged twice has the time of the week of the first.
        fine[fine] = increasing(time[fine])
    number = instances[1] + 1
    names = f"GPS{number}_DELAY_MS", "GPS_DELAY_MS" if number == 1 else f"GPS_DELAY_MS{number}"
    late = max(parameters.get(name, 0.0) for name in names)
    late = late or parameters.get("EKF_POS_DELAY", 0.0)  # of the first filter, until 2016
    return GnssLog(
        time=time[fine],
        position=place[fine],
        velocity_n=(unknown if velocity is None else velocity)[fine],
        position_sigma=np.column_stack((level, level, vertical))[fine],
        velocity_sigma=np.column_stack((speed, speed, speed))[fine],
        lever_arm=_lever_arm(parameters, *instances),
        latency=gps_delay(1e-3 * late),
    )


def _nearest(time: FloatArray, messages: Messages | None, name: str) -> FloatArray:
    """Return the value of the nearest message at each time; NaN without one nearby."""
    if messages is None or name not in messages:
        return np.full_like(time, np.nan)
    order = np.argsort(messages[TIME], kind="stable")
    at, values = messages[TIME][order], messages[name][order]
    after = np.clip(np.searchsorted(at, time), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(at[before] - time) < np.abs(at[after] - time), before, after)
    return np.where(np.abs(at[nearest] - time) <= _MAX_GPA_AGE, values[nearest], np.nan)


def _lever_arm(parameters: Mapping[str, float], imu: int, gps: int) -> FloatArray:
    """Return the lever arm from an IMU to the antenna of a receiver that the parameters give [m]."""
    arm = [
        parameters.get(f"GPS{gps + 1}_POS_{axis}", parameters.get(f"GPS_POS{gps + 1}_{axis}", 0.0))
        - parameters.get(f"INS_POS{imu + 1}_{axis}", 0.0)
        for axis in "XYZ"
    ]
    return believed_lever_arm(arm)


def _vehicle(log: Log, parameters: Mapping[str, float]) -> str:
    if parameters.get("Q_ENABLE", 0.0) > 0:
        return "vtol"
    for text in log.texts("MSG", "Message"):
        for name, vehicle in _VEHICLES.items():
            if text.startswith(name):
                return vehicle
    return ""


def magnetometer_of(messages: Messages | None) -> Magnetometer | None:
    """Return the field in b, which the autopilot logs in milligauss with its offsets applied.

    Parameters
    ----------
    messages
        The messages MAG of one compass, with their times.
    """
    names = ("MagX", "MagY", "MagZ")
    if messages is None or not set(names) <= set(messages):
        return None
    field = np.column_stack([messages[name] for name in names]) * _MICROTESLA
    healthy = messages.get("Health", np.ones(len(field))) != 0
    stream = Stream.of("magnetometer", messages[TIME], field, healthy & (field != 0).any(axis=1))
    return Magnetometer(stream.time, stream.values) if stream.usable else None


def headings_of(gps: Messages, fixed: NDArray[np.bool_]) -> Headings | None:
    """Return the headings of a receiver with two antennas; one without them logs a yaw of zero.

    Parameters
    ----------
    gps
        The messages GPS of one receiver, with their times.
    fixed
        Which of them have a fix.
    """
    yaw = gps.get("Yaw")
    if yaw is None:
        return None
    fine = fixed & np.isfinite(yaw) & np.isfinite(gps[TIME]) & (yaw > 0) & (yaw <= _NORTH)
    stream = Stream.of("heading", gps[TIME], yaw, fine)
    if not stream.usable:
        return None
    return Headings(stream.time, np.radians(stream.values[:, 0]), np.full(len(stream.time), np.nan))
