"""PX4 sdlog2 (.px4log), the log of PX4 until 2016: the solution as a flight, IMU and GPS as a sensor log.

The file is framed like a DataFlash log of ArduPilot, but differs: messages have no time of their own, a
message ``TIME`` gives that of those after it [µs since boot]; angles are in radians; velocity and position
come from ``GPOS``, or from ``LPOS`` and the GPS where it is missing.

References
----------
PX4 Firmware 1.3, *src/modules/sdlog2/sdlog2_messages.h*.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.file_content import whole
from lab.base.files.mission_error import MissionError
from lab.data.checks.log_check import check_log
from lab.data.clock.faults import increasing
from lab.data.files.dataflash_file import MAGIC, DataFlashFile
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import (
    FIX_3D,
    MAX_LOG_BYTES,
    Stream,
    first_usable,
    flight_of,
    gps_delay,
    is_attitude,
    is_position,
)
from lab.data.files.ulog import on_map
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repaired
from lab.data.log.vehicle import MAV_TYPES
from lab.data.rebuild.raw_flight import RawFlight
from lab.motion.frames.rotation import quaternion_from_euler

NAME = "PX4 sdlog2"

_FLIGHT = ("TIME", "GPOS", "LPOS", "GPS", "ATT", "PARM")
_SENSORS = ("TIME", "IMU", "GPS", "PARM")
_CLOCK = b"StartTime"
_DESCRIBED_WITHIN = 2**14
"""Bytes at the start of a log in which all its messages are described: 89 bytes for each of some hundred."""
_UNITS = {
    "Lat": "°", "Lon": "°", "Alt": "m", "VelN, VelE, VelD": "m/s", "Roll, Pitch, Yaw": "rad",
}  # fmt: skip


def recognises(head: bytes) -> bool:
    """Return whether a file starts like sdlog2: framed like DataFlash, with the clock messages of its own."""
    return head.startswith(MAGIC) and _CLOCK in head[:_DESCRIBED_WITHIN]


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the solution of the autopilot's estimator as a flight.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or has no velocity and position that can be used.
    """
    path = one_file(paths, NAME, fixed=units)
    log = _Messages(path, _FLIGHT)
    velocity = first_usable(
        (
            log.stream("velocity", "GPOS", "VelN", "VelE", "VelD"),
            log.stream("local velocity", "LPOS", "VX", "VY", "VZ"),
            log.stream("GPS velocity", "GPS", "VelN", "VelE", "VelD", valid=log.fixed),
        )
    )
    position = first_usable(
        (
            log.position("position", "GPOS"),
            _local_position(log),
            log.position("GPS position", "GPS", valid=log.fixed),
        )
    )
    remarks = ["Time counts from when the autopilot was switched on.", SEA_LEVEL]
    if log.lost_bytes:
        remarks.append(f"{log.lost_bytes} bytes of the file could not be decoded and are left out.")
    try:
        return flight_of(
            path,
            NAME,
            velocity,
            position,
            _attitude(log),
            units=units_of_the_format(_UNITS),
            remarks=tuple(remarks),
            vehicle=log.vehicle,
        )
    except MissionError as error:
        raise MissionError(f"{error}. {log.what_there_is()}") from None


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log = _Messages(path, _SENSORS)
    imu = log.stream("IMU", "IMU", "GyroX", "GyroY", "GyroZ", "AccX", "AccY", "AccZ")
    gps = log.messages("GPS")
    if imu is None or not imu.usable or gps is None:
        missing = "a GPS (GPS)" if gps is None else "an IMU (IMU)"
        raise MissionError(
            f"{path}: the log does not have {missing}; accepted are logs with both. {log.what_there_is()}"
        )
    gnss = _gnss(log, gps)
    if not gnss.time.size:
        raise MissionError(f"{path}: {log.no_fix()}; accepted are logs with fixes")
    made = repaired(str(path), imu.time, imu.values, gnss, auxiliary=AuxiliaryData(log.vehicle))
    check_log(made)
    return made


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    imu = _Messages(path, _SENSORS).stream("IMU", "IMU", "GyroX", "GyroY", "GyroZ", "AccX", "AccY", "AccZ")
    if imu is None or not imu.usable:
        raise MissionError(f"{path}: the log does not have an IMU (IMU)")
    return imu


class _Messages:
    """The messages of a file, with their times."""

    def __init__(self, path: Path, wanted: Sequence[str]) -> None:
        data = whole(path, MAX_LOG_BYTES)
        if not recognises(data[:_DESCRIBED_WITHIN]):
            raise MissionError(f"{path}: is no {NAME} log")
        self._log = DataFlashFile.of(data, wanted)
        self.lost_bytes = self._log.lost_bytes
        self._stamps = (self._log.numbers("TIME") or {}).get("StartTime", np.empty(0)) * 1e-6
        self._stamped = self._log.places("TIME")
        names = [name.rstrip("\0") for name in self._log.texts("PARM", "Name")]
        values = (self._log.numbers("PARM") or {}).get("Value", np.empty(0))
        self.parameters = dict(zip(names, np.nan_to_num(values).tolist(), strict=False))

    @property
    def vehicle(self) -> str:
        return MAV_TYPES.get(self.parameters.get("MAV_TYPE", 0.0), "")

    def messages(self, name: str) -> dict[str, FloatArray] | None:
        return self._log.numbers(name) if len(self._stamps) else None

    def time(self, name: str) -> FloatArray:
        """Return when the messages of a name were written: what the clock message before each says [s]."""
        before = np.searchsorted(self._stamped, self._log.places(name)) - 1
        return np.where(before >= 0, self._stamps[np.maximum(before, 0)], np.nan)

    def stream(
        self, what: str, name: str, *fields: str, valid: NDArray[np.bool_] | None = None
    ) -> Stream | None:
        messages = self.messages(name)
        if messages is None or not set(fields) <= set(messages):
            return None
        return Stream.of(what, self.time(name), np.column_stack([messages[field] for field in fields]), valid)

    def position(self, what: str, name: str, valid: NDArray[np.bool_] | None = None) -> Stream | None:
        messages = self.messages(name)
        place = None if messages is None else _place(messages)
        if place is None:
            return None
        fine = is_position(place) if valid is None else is_position(place) & valid
        return Stream.of(what, self.time(name), place, fine)

    @property
    def fixed(self) -> NDArray[np.bool_] | None:
        gps = self.messages("GPS")
        return None if gps is None or "Fix" not in gps else gps["Fix"] >= FIX_3D

    def what_there_is(self) -> str:
        said = f"It has {', '.join(self._log.names) or 'none of the messages used'}"
        if not len(self._stamps):
            return f"{said}, and no message TIME, so that no time is known"
        return f"{said}; {self.no_fix()}" if self.fixed is not None and not self.fixed.any() else said

    def no_fix(self) -> str:
        gps = self.messages("GPS") or {"Fix": np.zeros(0)}
        highest = int(np.nan_to_num(gps.get("Fix", np.zeros(0))).max(initial=0.0))
        return f"no message of the GPS has a fix with a position (Fix {highest} at most)"


def _place(messages: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]."""
    if not {"Lat", "Lon", "Alt"} <= set(messages):
        return None
    return np.column_stack((np.radians(messages["Lat"]), np.radians(messages["Lon"]), messages["Alt"]))


def _local_position(log: _Messages) -> Stream | None:
    stream = log.stream("local position", "LPOS", "RLat", "RLon", "RAlt", "X", "Y", "Z")
    if stream is None or not stream.usable:
        return None
    reference = stream.values[:, :3] * (np.radians(1.0), np.radians(1.0), 1.0)
    place = on_map(reference, stream.values[:, 3:])
    return Stream.of(stream.what, stream.time, place, is_position(reference) & is_position(place))


def _attitude(log: _Messages) -> Stream | None:
    """Return the attitude as quaternions; until 2015 only the angles were logged."""
    stream = log.stream("attitude", "ATT", "qw", "qx", "qy", "qz")
    if stream is not None:
        stream = Stream.of("attitude", stream.time, stream.values, is_attitude(stream.values))
    angles = log.stream("attitude", "ATT", "Roll", "Pitch", "Yaw")
    if (stream is None or not stream.usable) and angles is not None and angles.usable:
        stream = Stream.of("attitude", angles.time, quaternion_from_euler(angles.values))
    return first_usable((stream,))


def _gnss(log: _Messages, gps: Mapping[str, FloatArray]) -> GnssLog:
    time, place = log.time("GPS"), _place(gps)
    unknown = np.full((len(time), 3), np.nan)
    place = unknown if place is None else place
    velocity = unknown
    if {"VelN", "VelE", "VelD"} <= set(gps):
        velocity = np.column_stack([gps[name] for name in ("VelN", "VelE", "VelD")])
    level, vertical = (believed_sigma(gps.get(name, unknown[:, 0])) for name in ("EPH", "EPV"))
    fine = np.isfinite(time) & np.isfinite(place).all(axis=1) & is_position(place)
    if log.fixed is not None:
        fine &= log.fixed
    fine[fine] = increasing(time[fine])
    late = 1e-3 * log.parameters.get("EKF2_GPS_DELAY", log.parameters.get("PE_POS_DELAY_MS", 0.0))
    return GnssLog(
        time=time[fine],
        position=place[fine],
        velocity_n=velocity[fine],
        position_sigma=np.column_stack((level, level, vertical))[fine],
        velocity_sigma=unknown[fine],
        lever_arm=np.zeros(3),
        latency=gps_delay(late),
    )
