"""PX4 ULog: the solution of a PX4 autopilot as a flight, its IMU and GPS as a sensor log.

Units and axes are those of PX4's topics: north, east, down; forward, right, down; time since boot in µs.
The first of several instances of a topic is used.

References
----------
PX4 Guide, *uORB Message Reference*, https://docs.px4.io/main/en/msg_docs/
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import LONGITUDES
from lab.base.files.file_content import whole
from lab.base.files.mission_error import MissionError
from lab.data.checks.log_check import check_log
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import (
    FIX_3D,
    MAX_GPS_DELAY,
    MAX_LOG_BYTES,
    Stream,
    believed_lever_arm,
    first_usable,
    flight_of,
    is_attitude,
    is_position,
)
from lab.data.files.ulog_file import MAGIC, ULogFile
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repaired
from lab.data.log.vehicle import MAV_TYPES
from lab.data.rebuild.raw_flight import RawFlight

Messages = NDArray[np.void]

NAME = "PX4 ULog"

_FLIGHT = (
    "vehicle_local_position", "vehicle_global_position", "vehicle_attitude", "vehicle_gps_position",
    "sensor_gps", "vehicle_status",
)  # fmt: skip
_SENSORS = (
    "sensor_combined", "vehicle_imu", "vehicle_gps_position", "sensor_gps", "vehicle_magnetometer",
    "vehicle_status",
)  # fmt: skip
_VEHICLES = {1: "rotary wing", 2: "fixed wing", 3: "rover", 4: "blimp"}
"""Names of ``vehicle_type`` (uORB, VehicleStatus)."""
_NO_TIME = 2**31 - 1
"""Relative time of an accelerometer that has no sample (uORB, SensorCombined)."""
_MICROTESLA = 100.0
"""Microteslas in a gauss."""
_UNITS = {"latitude": "°", "longitude": "°", "altitude": "m", "velocity": "m/s"}
_MAP_RADIUS = 6_371_000.0
"""Radius of the sphere on which PX4 draws its map [m] (PX4, geo.h)."""
_HEADING_SIGMAS = (1e-4, np.pi)
"""σ of a heading that are believed [rad]."""


def recognises(head: bytes) -> bool:
    """Return whether a file starts like a ULog."""
    return head.startswith(MAGIC)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or has no velocity and position that can be used.
    """
    path = one_file(paths, NAME, fixed=units)
    log = _log(path, _FLIGHT)
    local, place = log.topic("vehicle_local_position"), log.topic("vehicle_global_position")
    gps, attitude = _gps(log), log.topic("vehicle_attitude")
    velocity = first_usable((_local_velocity(local), _gps_velocity(gps)))
    position = first_usable((_global(place), _local_position(local), _gps_position(gps)))
    quaternion = (
        None
        if attitude is None
        else _stream("attitude", attitude, "q", size=4, counters=("quat_reset_counter",))
    )
    if quaternion is not None:
        fine = is_attitude(quaternion.values)
        quaternion = Stream.of("attitude", quaternion.time, quaternion.values, fine, quaternion.counter)
    remarks = list(_remarks(log))
    above_ellipsoid = place is not None and "alt_ellipsoid" in (place.dtype.names or ())
    if position is not None and not (above_ellipsoid and position.what == "global position"):
        remarks.append(SEA_LEVEL)
    try:
        return flight_of(
            path,
            NAME,
            velocity,
            position,
            first_usable((quaternion,)),
            units=units_of_the_format(_UNITS),
            remarks=tuple(remarks),
            vehicle=_vehicle(log),
        )
    except MissionError as error:
        raise MissionError(f"{error}. It has {', '.join(log.names) or 'none of the topics used'}") from None


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log = _log(path, _SENSORS)
    gps, imu = _gps(log), _imu(log)
    if imu is None or gps is None:
        missing = "an IMU (sensor_combined, vehicle_imu)" if imu is None else "a GPS (vehicle_gps_position)"
        raise MissionError(f"{path}: the log does not have {missing}; accepted are logs with both")
    gnss = _gnss(log, gps)
    auxiliary = AuxiliaryData(_vehicle(log), _magnetometer(log), _headings(gps))
    try:
        made = repaired(str(path), imu.time, imu.values, gnss, auxiliary=auxiliary)
    except MissionError as error:
        raise MissionError(f"{error}{_no_fix(gps, gnss)}") from None
    check_log(made)
    return replace(made, repairs=(*made.repairs, *_losses(log)))


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    imu = _imu(_log(path, _SENSORS))
    if imu is None:
        raise MissionError(f"{path}: the log does not have an IMU (sensor_combined, vehicle_imu)")
    return imu


def _log(path: Path, wanted: Sequence[str]) -> ULogFile:
    data = whole(path, MAX_LOG_BYTES)
    if not data.startswith(MAGIC):
        raise MissionError(f"{path}: is no {NAME}")
    try:
        return ULogFile.of(data, wanted)
    except ValueError as error:
        raise MissionError(f"{path}: cannot be read: {error}") from error


def _column(messages: Messages, *names: str, factor: float = 1.0) -> FloatArray | None:
    """Return the first of several fields that is there, as numbers (n,) times a factor."""
    for name in names:
        if name in (messages.dtype.names or ()) and messages[name].ndim == 1:
            return _double(messages[name]) * factor
    return None


def _columns(messages: Messages, *names: str) -> FloatArray | None:
    """Return fields side by side (n, k); None if one is not there."""
    found = [_column(messages, name) for name in names]
    there = [column for column in found if column is not None]
    return np.column_stack(there) if len(there) == len(found) else None


def _vector(messages: Messages, name: str, size: int) -> FloatArray | None:
    if name in (messages.dtype.names or ()) and messages[name].shape[1:] == (size,):
        return _double(messages[name])
    return None


def _double(values: NDArray[np.generic]) -> FloatArray:
    """Return numbers in double precision; damaged ones are no number without a warning."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64)


def _seconds(messages: Messages) -> FloatArray:
    """Return the time of validity, since boot [s]."""
    stamps = _column(messages, "timestamp_sample")
    published = _column(messages, "timestamp")
    if published is None:
        return np.full(len(messages), np.nan)
    if stamps is not None and (stamps > 0).all():
        return stamps * 1e-6
    return published * 1e-6


def _stream(
    what: str,
    messages: Messages,
    *names: str,
    size: int = 0,
    valid: Sequence[str] = (),
    counters: Sequence[str] = (),
) -> Stream | None:
    """Return fields, or one field that is an array of a size, where flags say that they are valid."""
    values = _vector(messages, names[0], size) if size else _columns(messages, *names)
    if values is None:
        return None
    fine = np.ones(len(messages), dtype=bool)
    for flag in valid:
        column = _column(messages, flag)
        if column is not None:
            fine &= column != 0
    return Stream.of(what, _seconds(messages), values, fine, _counter(messages, *counters))


def _counter(messages: Messages, *names: str) -> FloatArray | None:
    """Return the sum of the counters of resets, which all only grow; None if there is none."""
    found = [column for name in names if (column := _column(messages, name)) is not None]
    return sum(found[1:], start=found[0]) if found else None


def _local_velocity(local: Messages | None) -> Stream | None:
    if local is None:
        return None
    return _stream(
        "local velocity", local, "vx", "vy", "vz", valid=("v_xy_valid", "v_z_valid"),
        counters=("vxy_reset_counter", "vz_reset_counter"),
    )  # fmt: skip


def _global(place: Messages | None) -> Stream | None:
    if place is None:
        return None
    height = _column(place, "alt_ellipsoid", "alt")
    angles = _columns(place, "lat", "lon")
    if height is None or angles is None:
        return None
    values = np.column_stack((np.radians(angles), height))
    counter = _counter(place, "lat_lon_reset_counter", "alt_reset_counter")
    return Stream.of("global position", _seconds(place), values, _on_earth(values), counter)


def _local_position(local: Messages | None) -> Stream | None:
    """Return where local coordinates are."""
    if local is None:
        return None
    values = _columns(local, "ref_lat", "ref_lon", "ref_alt", "x", "y", "z")
    if values is None:
        return None
    position = on_map(values[:, :3] * (np.radians(1.0), np.radians(1.0), 1.0), values[:, 3:])
    flag = _column(local, "xy_global")
    return Stream.of(
        "local position",
        _seconds(local),
        position,
        None if flag is None else (flag != 0) & _on_earth(position),
        _counter(local, "xy_reset_counter", "z_reset_counter"),
    )


def on_map(reference: FloatArray, offset: FloatArray) -> FloatArray:
    """Return where local coordinates are: PX4 draws them on an azimuthal equidistant map of a sphere.

    Parameters
    ----------
    reference : (n, 3) array
        Latitude, longitude [rad] and height [m] of the origin.
    offset : (n, 3) array
        North, east, down of it [m].

    Returns
    -------
    (n, 3) array
        Latitude, longitude [rad], height [m].
    """
    latitude, longitude = reference[:, :2].T
    x, y = offset[:, :2].T / _MAP_RADIUS
    angle = np.hypot(x, y)
    s, c = np.sinc(angle / np.pi), np.cos(angle)  # s is the sine over the angle
    north = np.arcsin(np.clip(c * np.sin(latitude) + x * s * np.cos(latitude), -1, 1))
    east = longitude + np.arctan2(y * s, np.cos(latitude) * c - x * np.sin(latitude) * s)
    return np.column_stack((north, east, reference[:, 2] - offset[:, 2]))


def _on_earth(position: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(is_position(position) & (np.abs(position[:, 1]) <= np.radians(LONGITUDES[1])))


def _gps(log: ULogFile) -> Messages | None:
    topic = log.topic("vehicle_gps_position")
    return topic if topic is not None else log.topic("sensor_gps")


def _fixed(gps: Messages) -> NDArray[np.bool_]:
    kind = _column(gps, "fix_type")
    return np.ones(len(gps), dtype=bool) if kind is None else kind >= FIX_3D


def _no_fix(gps: Messages, gnss: GnssLog) -> str:
    """Return what is added to a refusal where the receiver never had a fix."""
    if gnss.time.size:
        return ""
    kind = _column(gps, "fix_type")
    best = 0 if kind is None else int(np.nan_to_num(kind).max(initial=0))
    return f". None of the {len(gps)} GPS messages has a fix with a position (fix_type {best} at most)"


def _gps_place(gps: Messages) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]; fields were whole numbers until 1.14."""
    latitude = _column(gps, "latitude_deg")
    if latitude is not None:
        longitude = _column(gps, "longitude_deg")
        height = _column(gps, "altitude_ellipsoid_m", "altitude_msl_m")
    else:
        latitude, longitude = _column(gps, "lat", factor=1e-7), _column(gps, "lon", factor=1e-7)
        height = _column(gps, "alt_ellipsoid", "alt", factor=1e-3)
    if latitude is None or longitude is None or height is None:
        return None
    return np.column_stack((np.radians(latitude), np.radians(longitude), height))


def _gps_position(gps: Messages | None) -> Stream | None:
    place = None if gps is None else _gps_place(gps)
    if gps is None or place is None:
        return None
    return Stream.of("GPS position", _seconds(gps), place, _fixed(gps) & _on_earth(place))


def _gps_velocity(gps: Messages | None) -> Stream | None:
    if gps is None:
        return None
    return _stream("GPS velocity", gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s", valid=("vel_ned_valid",))


def _imu(log: ULogFile) -> Stream | None:
    """Return angular rate and specific force, from the topic that has them more often."""
    found = []
    combined, integrated = log.topic("sensor_combined"), log.topic("vehicle_imu")
    if combined is not None:
        gyro, force = _vector(combined, "gyro_rad", 3), _vector(combined, "accelerometer_m_s2", 3)
        late = _column(combined, "accelerometer_timestamp_relative")
        if gyro is not None and force is not None:
            valid = None if late is None else late != _NO_TIME
            found.append(Stream.of("IMU", _seconds(combined), np.concatenate((gyro, force), axis=1), valid))
    if integrated is not None:
        turn, gain = _vector(integrated, "delta_angle", 3), _vector(integrated, "delta_velocity", 3)
        spans = _columns(integrated, "delta_angle_dt", "delta_velocity_dt")
        if turn is not None and gain is not None and spans is not None:
            span = np.where(spans > 0, spans * 1e-6, np.nan)
            rates = np.concatenate((turn / span[:, :1], gain / span[:, 1:]), axis=1)
            found.append(Stream.of("IMU", _seconds(integrated), rates))
    return max((one for one in found if one.usable), key=lambda one: len(one.time), default=None)


def _gnss(log: ULogFile, gps: Messages) -> GnssLog:
    time, place = _seconds(gps), _gps_place(gps)
    velocity = _columns(gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    unknown = np.full((len(gps), 3), np.nan)
    valid = _column(gps, "vel_ned_valid")
    if velocity is not None and valid is not None:
        velocity = np.where(valid[:, None] != 0, velocity, np.nan)
    sigma = [_sigma(_column(gps, name)) for name in ("eph", "epv", "s_variance_m_s")]
    level, vertical, speed = (np.full(len(gps), np.nan) if one is None else one for one in sigma)
    place = unknown if place is None else place
    fine = _fixed(gps) & np.isfinite(place).all(axis=1) & _on_earth(place) & np.isfinite(time)
    late = _column(gps, "timestamp_sample") if "timestamp_sample" in (gps.dtype.names or ()) else None
    stamped = late is not None and bool((late > 0).all())
    delay = 1e-3 * log.parameters.get("EKF2_GPS_DELAY", 0.0)
    return GnssLog(
        time=time[fine],
        position=place[fine],
        velocity_n=(unknown if velocity is None else velocity)[fine],
        position_sigma=np.column_stack((level, level, vertical))[fine],
        velocity_sigma=np.column_stack((speed, speed, speed))[fine],
        lever_arm=_lever_arm(log.parameters),
        # The driver's own time of the sample has the delay in it.
        latency=0.0 if stamped else float(np.clip(delay, 0, MAX_GPS_DELAY)),
    )


def _magnetometer(log: ULogFile) -> Magnetometer | None:
    """Return the field, calibrated and turned into b by the autopilot, which logs it in gauss."""
    topic = log.topic("vehicle_magnetometer")
    field = None if topic is None else _vector(topic, "magnetometer_ga", 3)
    if topic is None or field is None:
        return None
    stream = Stream.of("magnetometer", _seconds(topic), field * _MICROTESLA)
    return Magnetometer(stream.time, stream.values) if stream.usable else None


def _headings(gps: Messages) -> Headings | None:
    """Return the headings of a receiver with two antennas, their offset taken off by the driver."""
    heading, sigma = _column(gps, "heading"), _column(gps, "heading_accuracy")
    if heading is None:
        return None
    time, fixed = _seconds(gps), _fixed(gps)
    fine = np.isfinite(heading) & np.isfinite(time) & fixed & (np.abs(heading) <= 2 * np.pi)
    unknown = np.full(len(gps), np.nan)
    sigma = (
        unknown
        if sigma is None
        else np.where((sigma > _HEADING_SIGMAS[0]) & (sigma < _HEADING_SIGMAS[1]), sigma, np.nan)
    )
    # A receiver with one antenna may leave the field at zero.
    return Headings(time[fine], heading[fine], sigma[fine]) if heading[fine].any() else None


def _sigma(values: FloatArray | None) -> FloatArray | None:
    """Return a σ of the receiver, NaN where it is none."""
    return None if values is None else believed_sigma(values)


def _lever_arm(parameters: Mapping[str, float]) -> FloatArray:
    """Return the lever arm from the IMU to the antenna that the autopilot's parameters give [m]."""
    arm = [
        parameters.get(f"EKF2_GPS_POS_{axis}", 0.0) - parameters.get(f"EKF2_IMU_POS_{axis}", 0.0)
        for axis in "XYZ"
    ]
    return believed_lever_arm(arm)


def _vehicle(log: ULogFile) -> str:
    """Return the vehicle; one that flies in both ways, or may, hovers too, whichever comes last."""
    by_parameter = MAV_TYPES.get(log.parameters.get("MAV_TYPE", 0.0), "")
    status = log.topic("vehicle_status")
    if status is None or not len(status):
        return by_parameter
    both, kinds = _column(status, "is_vtol"), _column(status, "vehicle_type")
    if by_parameter == "vtol" or (both is not None and both.any()):
        return "vtol"
    return by_parameter if kinds is None else _VEHICLES.get(int(kinds[-1]), by_parameter)


def _remarks(log: ULogFile) -> tuple[str, ...]:
    return ("Time counts from when the autopilot was switched on.", *_losses(log))


def _losses(log: ULogFile) -> tuple[str, ...]:
    remarks = []
    if log.dropouts:
        remarks.append(
            f"The logger could not keep up {log.dropouts} times, for {log.dropped_seconds:.3g} s in all."
        )
    if log.lost_bytes:
        remarks.append(f"{log.lost_bytes} bytes of the file could not be decoded and are left out.")
    return tuple(remarks)
