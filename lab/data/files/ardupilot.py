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
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.data.files import sdlog2, streams
from lab.data.files.dataflash_file import MAGIC, DataFlashFile, Log, parameters_of
from lab.data.files.dataflash_text import DataFlashText, is_text
from lab.data.files.dataflash_time import MessageTimes
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import FIX_3D, TIME, Messages, Stream
from lab.data.files.track import slope
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.rebuild.raw_flight import VERTICAL_VELOCITY, RawFlight

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
    log, times = open_log(path, _FLIGHT)
    gps = _messages(times, "GPS")
    filtered = [
        Stream.of_fields("velocity", _messages(times, name), "VN", "VE", "VD")
        for name in ("XKF1", "NKF1", "EKF1")
    ]
    velocity = streams.first_usable((*filtered, _gps_velocity(gps)))
    own = [_messages(times, name) for name in ("POS", "AHR2")]
    position = streams.first_usable(
        (*(Stream.of_place("position", one, _read_place(one)) for one in own), _gps_position(gps))
    )
    parameters = parameters_of(log)
    geoid = _geoid(times, parameters)
    if position is not None and geoid is not None:
        position = replace(position, values=position.values + np.array((0.0, 0.0, geoid)))
    climb = velocity is not None and velocity.what == _WITHOUT_CLIMB
    remarks = [_clock_remark(times), *_instance_remarks(times)]
    remarks.append(SEA_LEVEL if geoid is None else f"{_ABOVE_ELLIPSOID} ({geoid:.1f} m).")
    if climb:
        remarks.append("The vertical velocity is not recorded: it is the slope of the GPS's heights.")
    flight = streams.make_flight(
        path,
        NAME,
        velocity,
        position,
        _attitude(times),
        units=units_of_the_format(_UNITS),
        remarks=(*remarks, *streams.undecoded_remark(log.lost_bytes)),
        vehicle=_vehicle(log, parameters),
        there_is=lambda: _describe_messages(log, times, gps),
    )
    return replace(flight, made=(VERTICAL_VELOCITY,)) if climb else flight


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log, times = open_log(path, _SENSORS)
    gps = _messages(times, "GPS")
    missing = "a GPS (GPS)" if gps is None else "an IMU (IMU)"
    said = f"the log does not have {missing} with a time; accepted are logs with both."
    imu = streams.usable_imu(
        path, None if gps is None else _imu(times), f"{said} {_describe_messages(log, times, gps)}"
    )
    assert gps is not None
    parameters = parameters_of(log)
    instances = int(_counts(times, "IMU")[0]), int(_counts(times, "GPS")[0])
    gnss = _gnss(gps, _messages(times, "GPA"), _geoid(times, parameters), parameters, instances)
    if not gnss.time.size:
        raise MissionError(f"{path}: {_no_fix(gps)}; accepted are logs with fixes")
    compass, headings = magnetometer_of(_messages(times, "MAG")), headings_of(gps, _mask_fixed(gps))
    made = streams.checked_log(path, imu, gnss, AuxiliaryData(_vehicle(log, parameters), compass, headings))
    remarks = [*_instance_remarks(times), *streams.undecoded_remark(log.lost_bytes)]
    remarks += [_clock_remark(times)] if times.unstamped else []
    return replace(made, repairs=(*made.repairs, *remarks))


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    return streams.usable_imu(
        path, _imu(open_log(path, _SENSORS)[1]), "the log does not have an IMU (IMU) with a time"
    )


def _imu(times: MessageTimes) -> Stream | None:
    return Stream.of_fields("IMU", _messages(times, "IMU"), "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")


def open_log(path: Path, wanted: Sequence[str]) -> tuple[Log, MessageTimes]:
    """Return a log with the messages that are wanted, and their times; or raise `MissionError`."""
    data = read_whole(path, streams.MAX_LOG_BYTES)
    if not recognises(data[:_HEAD]):
        raise MissionError(f"{path}: is no {NAME} log")
    log: Log = DataFlashFile.of(data, wanted) if data.startswith(MAGIC) else DataFlashText(data, wanted)
    return log, MessageTimes(log, wanted)


def _clock_remark(times: MessageTimes) -> str:
    remark = "Time is that of the GPS week: the log has no other." if times.of_week else streams.SWITCHED_ON
    if times.unstamped:
        remark += (
            f" The messages {' and '.join(times.unstamped)} have no time: they are timed by their order "
            "among the others."
        )
    return remark


def _describe_messages(log: Log, times: MessageTimes, gps: Messages | None) -> str:
    """Return which messages a log has, and what is wrong with those of the GPS."""
    said = f"It has {', '.join(log.names) or 'none of the messages used'}"
    untimed = [name for name in log.names if name not in ("MSG", "PARM") and times.of(name) is None]
    if untimed:
        said += f"; of these {', '.join(untimed)} cannot be used: no time (TimeUS, TimeMS), or damaged"
    if gps is not None and not (_mask_fixed(gps) & np.isfinite(gps[TIME])).any():
        said += f"; {_no_fix(gps)}"
    return said


def _no_fix(gps: Messages) -> str:
    return streams.without_fix("GPS messages", len(gps[TIME]), "Status", gps.get("Status"))


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
    fine = _mask_fixed(messages) if name == "GPS" else np.ones(len(messages[TIME]), dtype=bool)
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


def _read_place(messages: Messages | None) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]."""
    return streams.read_place(messages, "Lat", "Lng", "Alt")


def _geoid(times: MessageTimes, parameters: Mapping[str, float]) -> float | None:
    """Return the height of the geoid over the ellipsoid from the receiver [m]; None if it gives none.

    ArduPilot logs altitude less height over the ellipsoid, the negative of what receivers call separation.
    """
    messages = _messages(times, "GPA")
    geoid = None if messages is None else streams.geoid_height(messages.get("Und", np.empty(0)))
    if geoid is None:
        return None
    number = int(_counts(times, "GPS")[0]) + 1
    names = f"GPS{number}_TYPE", "GPS_TYPE" if number == 1 else f"GPS_TYPE{number}"
    return geoid if _NOVATEL in (parameters.get(name) for name in names) else -geoid


def _mask_fixed(gps: Messages) -> NDArray[np.bool_]:
    status = gps.get("Status")
    if status is None:
        return np.ones(len(gps[TIME]), dtype=bool)
    old = "TimeUS" not in gps and not (status >= FIX_3D).any()
    return np.asarray(status >= (_FIXED_IN_2012 if old else FIX_3D))


def _gps_position(gps: Messages | None) -> Stream | None:
    return Stream.of_place("GPS position", gps, _read_place(gps), None if gps is None else _mask_fixed(gps))


def _over_ground(gps: Messages) -> FloatArray | None:
    """Return velocity north, east, down of speed, course and vertical speed; NaN down if that is missing."""
    values = streams.stack_fields(gps, "Spd", "GCrs")
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
        return Stream.of("GPS velocity", gps[TIME], velocity, _mask_fixed(gps))
    position = _gps_position(gps)
    if position is None or not position.usable:
        return None
    climb = slope(position.time, position.values[:, 2])
    velocity[:, 2] = -np.interp(gps[TIME], position.time, climb)
    return Stream.of(_WITHOUT_CLIMB, gps[TIME], velocity, _mask_fixed(gps))


def _attitude(times: MessageTimes) -> Stream | None:
    """Return the attitude as quaternions: the filter's own, unless ATT is logged more often."""
    found = [
        streams.make_attitude_stream(
            Stream.of_fields("attitude", _messages(times, name), "Q1", "Q2", "Q3", "Q4")
        )
        for name in ("NKQ", "XKQ")
    ]
    att = Stream.of_fields("attitude", _messages(times, "ATT"), "Roll", "Pitch", "Yaw")
    return streams.most_frequent((*found, streams.attitude_of_angles(att, np.radians(1.0))))


def _gnss(
    gps: Messages,
    accuracy: Messages | None,
    geoid: float | None,
    parameters: Mapping[str, float],
    instances: tuple[int, int],
) -> GnssLog:
    time, place = gps[TIME], _read_place(gps)
    if place is not None:
        place[:, 2] += geoid or 0.0
    number = instances[1] + 1
    names = f"GPS{number}_DELAY_MS", "GPS_DELAY_MS" if number == 1 else f"GPS_DELAY_MS{number}"
    late = max(parameters.get(name, 0.0) for name in names)
    late = late or parameters.get("EKF_POS_DELAY", 0.0)  # of the first filter, until 2016
    sigmas = [_nearest_values(time, accuracy, name) for name in ("HAcc", "VAcc", "SAcc")]
    of_imu = f"INS_POS{instances[0] + 1}_"
    arm = streams.read_lever_arm(parameters, ((f"GPS{number}_POS_", of_imu), (f"GPS_POS{number}_", of_imu)))
    delay, once = streams.gps_delay(1e-3 * late), "TimeUS" not in gps
    return streams.make_gnss_log(
        time, place, _over_ground(gps), sigmas, _mask_fixed(gps), arm, delay, once=once
    )


def _nearest_values(time: FloatArray, messages: Messages | None, name: str) -> FloatArray:
    """Return the value of the nearest message at each time; NaN without one nearby."""
    if messages is None or name not in messages:
        return np.full_like(time, np.nan)
    order = np.argsort(messages[TIME], kind="stable")
    at, values = messages[TIME][order], messages[name][order]
    after = np.clip(np.searchsorted(at, time), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(at[before] - time) < np.abs(at[after] - time), before, after)
    return np.where(np.abs(at[nearest] - time) <= _MAX_GPA_AGE, values[nearest], np.nan)


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
    field = streams.stack_fields(messages, "MagX", "MagY", "MagZ")
    if messages is None or field is None:
        return None
    healthy = messages.get("Health", np.ones(len(field))) != 0
    stream = Stream.of(
        "magnetometer", messages[TIME], field * _MICROTESLA, healthy & (field != 0).any(axis=1)
    )
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
