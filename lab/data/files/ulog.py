"""PX4 ULog: the solution of a PX4 autopilot as a flight, its IMU and GPS as a sensor log.

Units and axes are those of PX4's topics: north, east, down; forward, right, down; time since boot in µs.
The first of several instances of a topic is used.

References
----------
PX4 Guide, *uORB Message Reference*, https://docs.px4.io/main/en/msg_docs/
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from operator import methodcaller
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.data.files import streams
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import FIX_3D, TIME, Messages, Stream
from lab.data.files.ulog_file import MAGIC, ULogFile
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.log.vehicle import MAV_TYPES
from lab.data.rebuild.raw_flight import RawFlight

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
_IMUS = "sensor_combined, vehicle_imu"
_NO_TIME = 2**31 - 1
"""Relative time of an accelerometer that has no sample (uORB, SensorCombined)."""
_MICROTESLA = 100.0
"""Microteslas in a gauss."""
_UNITS = {"latitude": "°", "longitude": "°", "altitude": "m", "velocity": "m/s"}
_MAP_RADIUS = 6_371_000.0
"""Radius of the sphere on which PX4 draws its map [m] (PX4, geo.h)."""
_HEADING_SIGMAS = (1e-4, np.pi)
"""σ of a heading that are believed [rad]."""


recognises = methodcaller("startswith", MAGIC)
"""Return whether a file starts like a ULog."""


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or has no velocity and position that can be used.
    """
    path = one_file(paths, NAME, fixed=units)
    log = open_ulog(path, _FLIGHT)
    local, place = _topic(log, "vehicle_local_position"), _topic(log, "vehicle_global_position")
    gps = _gps(log)
    velocity = streams.first_usable((_local_velocity(local), _gps_velocity(gps)))
    values = _read_place(place, "lat", "lon", ("alt_ellipsoid", "alt"))
    resets = _counter(place, "lat_lon_reset_counter", "alt_reset_counter")
    own = Stream.of_place("global position", place, values, counter=resets)
    position = streams.first_usable((own, _local_position(local), _gps_position(gps)))
    attitude = _topic(log, "vehicle_attitude", 4, "q")
    counter = _counter(attitude, "quat_reset_counter")
    quaternions = Stream.of_fields("attitude", attitude, "q", counter=counter)
    remarks = [streams.SWITCHED_ON, *_losses(log)]
    above_ellipsoid = place is not None and "alt_ellipsoid" in place
    if position is not None and not (above_ellipsoid and position.what == "global position"):
        remarks.append(SEA_LEVEL)
    return streams.make_flight(
        path,
        NAME,
        velocity,
        position,
        streams.first_usable((streams.make_attitude_stream(quaternions),)),
        units=units_of_the_format(_UNITS),
        remarks=remarks,
        vehicle=_vehicle(log),
        there_is=lambda: f"It has {', '.join(log.names) or 'none of the topics used'}",
    )


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log = open_ulog(path, _SENSORS)
    gps, imu = _gps(log), _imu(log)
    if imu is None or gps is None:
        missing = f"an IMU ({_IMUS})" if imu is None else "a GPS (vehicle_gps_position)"
        raise MissionError(f"{path}: the log does not have {missing}; accepted are logs with both")
    gnss = _gnss(log, gps)
    try:
        made = streams.checked_log(
            path, imu, gnss, AuxiliaryData(_vehicle(log), _magnetometer(log), _headings(gps))
        )
    except MissionError as error:
        if gnss.time.size:
            raise
        said = streams.without_fix("GPS messages", len(gps[TIME]), "fix_type", gps.get("fix_type"))
        raise MissionError(f"{error}. {said[0].upper()}{said[1:]}") from None
    return replace(made, repairs=(*made.repairs, *_losses(log)))


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    return streams.usable_imu(
        path, _imu(open_ulog(path, _SENSORS)), f"the log does not have an IMU ({_IMUS})"
    )


def open_ulog(path: Path, wanted: Sequence[str]) -> ULogFile:
    """Return the content of a ULog, with the topics that are wanted; `MissionError` if it cannot be read."""
    data = read_whole(path, streams.MAX_LOG_BYTES)
    if not data.startswith(MAGIC):
        raise MissionError(f"{path}: is no {NAME}")
    try:
        return ULogFile.of(data, wanted)
    except ValueError as error:
        raise MissionError(f"{path}: cannot be read: {error}") from error


class TopicRows(Mapping[str, FloatArray]):
    """The messages of a topic: some of their fields as numbers, and their time of validity since boot [s]."""

    def __init__(self, rows: NDArray[np.void], fields: Sequence[str]) -> None:
        self._rows, self._fields = rows, fields

    def __getitem__(self, name: str) -> FloatArray:
        if name == TIME:
            stamps = self.get("timestamp_sample")
            if stamps is None or not (stamps > 0).all():
                stamps = self.get("timestamp", np.full(len(self._rows), np.nan))
            return 1e-6 * stamps
        if name not in self._fields:
            raise KeyError(name)
        with np.errstate(invalid="ignore"):  # damaged numbers are no numbers without a warning
            return np.asarray(self._rows[name], dtype=np.float64)

    def __iter__(self) -> Iterator[str]:
        return iter((*self._fields, TIME))

    def __len__(self) -> int:
        return len(self._fields) + 1


def _topic(log: ULogFile, name: str, size: int = 0, *vectors: str) -> Messages | None:
    """Return the messages of a topic, with its fields that are single numbers, and vectors of a size."""
    rows = log.topic(name)
    if rows is None:
        return None
    names = rows.dtype.names or ()
    shown = [one for one in names if rows[one].shape[1:] == ((size,) if one in vectors else ())]
    return TopicRows(rows, shown)


def _counter(messages: Messages | None, *names: str) -> FloatArray | None:
    """Return the sum of the counters of resets, which all only grow; None if there is none."""
    found = [] if messages is None else [messages[name] for name in names if name in messages]
    return sum(found[1:], start=found[0]) if found else None


def _mask_valid(messages: Messages, *flags: str) -> Flags:
    """Return which messages (n,) have no flag that is zero."""
    fine = np.ones(len(messages[TIME]), dtype=bool)
    for flag in flags:
        fine &= messages.get(flag, fine) != 0
    return fine


def _local_velocity(local: Messages | None) -> Stream | None:
    if local is None:
        return None
    valid = _mask_valid(local, "v_xy_valid", "v_z_valid")
    counter = _counter(local, "vxy_reset_counter", "vz_reset_counter")
    return Stream.of_fields("local velocity", local, "vx", "vy", "vz", valid=valid, counter=counter)


def _read_place(
    messages: Messages | None, latitude: str, longitude: str, heights: Sequence[str], angle: float = 1.0,
    length: float = 1.0,
) -> FloatArray | None:  # fmt: skip
    """Return latitude, longitude [rad] and height [m] (n, 3) of fields in a unit [°], [m]."""
    height = next((one for one in heights if messages is not None and one in messages), "")
    place = streams.stack_fields(messages, latitude, longitude, height)
    degree = np.radians(1.0)
    return None if place is None else place * (angle, angle, length) * (degree, degree, 1.0)


def _local_position(local: Messages | None) -> Stream | None:
    """Return where local coordinates are."""
    values = streams.stack_fields(local, "ref_lat", "ref_lon", "ref_alt", "x", "y", "z")
    if local is None or values is None:
        return None
    position = on_map(values[:, :3] * (np.radians(1.0), np.radians(1.0), 1.0), values[:, 3:])
    counter = _counter(local, "xy_reset_counter", "z_reset_counter")
    return Stream.of_place("local position", local, position, _mask_valid(local, "xy_global"), counter)


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


def _gps(log: ULogFile) -> Messages | None:
    topic = _topic(log, "vehicle_gps_position")
    return topic if topic is not None else _topic(log, "sensor_gps")


def _mask_fixed(gps: Messages) -> Flags:
    return np.asarray(gps.get("fix_type", np.full(len(gps[TIME]), FIX_3D)) >= FIX_3D)


def _gps_place(gps: Messages | None) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]; fields were whole numbers until 1.14."""
    if gps is not None and "latitude_deg" in gps:
        return _read_place(gps, "latitude_deg", "longitude_deg", ("altitude_ellipsoid_m", "altitude_msl_m"))
    return _read_place(gps, "lat", "lon", ("alt_ellipsoid", "alt"), 1e-7, 1e-3)


def _gps_position(gps: Messages | None) -> Stream | None:
    return Stream.of_place("GPS position", gps, _gps_place(gps), None if gps is None else _mask_fixed(gps))


def _gps_velocity(gps: Messages | None) -> Stream | None:
    if gps is None:
        return None
    valid = _mask_valid(gps, "vel_ned_valid")
    return Stream.of_fields("GPS velocity", gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s", valid=valid)


def _imu(log: ULogFile) -> Stream | None:
    """Return angular rate and specific force, from the topic that has them more often."""
    found = []
    combined = _topic(log, "sensor_combined", 3, "gyro_rad", "accelerometer_m_s2")
    if combined is not None:
        late = combined.get("accelerometer_timestamp_relative")
        valid = None if late is None else late != _NO_TIME
        found.append(Stream.of_fields("IMU", combined, "gyro_rad", "accelerometer_m_s2", valid=valid))
    integrated = _topic(log, "vehicle_imu", 3, "delta_angle", "delta_velocity")
    gains = streams.stack_fields(integrated, "delta_angle", "delta_velocity")
    spans = streams.stack_fields(integrated, "delta_angle_dt", "delta_velocity_dt")
    if integrated is not None and gains is not None and spans is not None:
        span = np.where(spans > 0, spans * 1e-6, np.nan)
        found.append(Stream.of("IMU", integrated[TIME], gains / np.repeat(span, 3, axis=1)))
    usable = (one for one in found if one is not None and one.usable)
    return max(usable, key=lambda one: len(one.time), default=None)


def _gnss(log: ULogFile, gps: Messages) -> GnssLog:
    velocity = streams.stack_fields(gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    if velocity is not None:
        velocity = np.where(_mask_valid(gps, "vel_ned_valid")[:, None], velocity, np.nan)
    sigmas = [gps.get(name) for name in ("eph", "epv", "s_variance_m_s")]
    stamped = bool((gps.get("timestamp_sample", np.zeros(1)) > 0).all())
    delay = 1e-3 * log.parameters.get("EKF2_GPS_DELAY", 0.0)
    # The driver's own time of the sample has the delay in it.
    latency = 0.0 if stamped else float(np.clip(delay, 0, streams.MAX_GPS_DELAY))
    arm = streams.read_lever_arm(log.parameters, (("EKF2_GPS_POS_", "EKF2_IMU_POS_"),))
    return streams.make_gnss_log(gps[TIME], _gps_place(gps), velocity, sigmas, _mask_fixed(gps), arm, latency)


def _magnetometer(log: ULogFile) -> Magnetometer | None:
    """Return the field, calibrated and turned into b by the autopilot, which logs it in gauss."""
    topic = _topic(log, "vehicle_magnetometer", 3, "magnetometer_ga")
    stream = Stream.of_fields("magnetometer", topic, "magnetometer_ga")
    if stream is None or not stream.usable:
        return None
    return Magnetometer(stream.time, stream.values * _MICROTESLA)


def _headings(gps: Messages) -> Headings | None:
    """Return the headings of a receiver with two antennas, their offset taken off by the driver."""
    if "heading" not in gps:
        return None
    time, heading = gps[TIME], gps["heading"]
    sigma = gps.get("heading_accuracy", np.full(len(time), np.nan))
    sigma = np.where((sigma > _HEADING_SIGMAS[0]) & (sigma < _HEADING_SIGMAS[1]), sigma, np.nan)
    fine = np.isfinite(heading) & np.isfinite(time) & _mask_fixed(gps) & (np.abs(heading) <= 2 * np.pi)
    # A receiver with one antenna may leave the field at zero.
    return Headings(time[fine], heading[fine], sigma[fine]) if heading[fine].any() else None


def _vehicle(log: ULogFile) -> str:
    """Return the vehicle; one that flies in both ways, or may, hovers too, whichever comes last."""
    by_parameter = MAV_TYPES.get(log.parameters.get("MAV_TYPE", 0.0), "")
    status = _topic(log, "vehicle_status")
    if status is None:
        return by_parameter
    if by_parameter == "vtol" or status.get("is_vtol", np.zeros(1)).any():
        return "vtol"
    kinds = status.get("vehicle_type")
    return by_parameter if kinds is None else _VEHICLES.get(kinds[-1], by_parameter)


def _losses(log: ULogFile) -> tuple[str, ...]:
    remarks = []
    if log.dropouts:
        times = "once" if log.dropouts == 1 else f"{log.dropouts} times"
        remarks.append(f"The logger could not keep up {times}, for {log.dropped_seconds:.3g} s in all.")
    return (*remarks, *streams.undecoded_remark(log.lost_bytes))
