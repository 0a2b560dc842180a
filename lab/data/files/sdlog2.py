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

from lab.base.arrays import Flags, FloatArray
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.data.files import streams
from lab.data.files.dataflash_file import MAGIC, DataFlashFile, parameters_of
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.streams import FIX_3D, TIME, Messages, Stream
from lab.data.files.ulog import on_map
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import SensorLog
from lab.data.log.vehicle import MAV_TYPES
from lab.data.rebuild.raw_flight import RawFlight

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
    velocity = streams.first_usable(
        (
            log.stream("velocity", "GPOS", "VelN", "VelE", "VelD"),
            log.stream("local velocity", "LPOS", "VX", "VY", "VZ"),
            log.stream("GPS velocity", "GPS", "VelN", "VelE", "VelD", valid=log.fixed),
        )
    )
    position = streams.first_usable(
        (
            log.position("position", "GPOS"),
            _local_position(log),
            log.position("GPS position", "GPS", valid=log.fixed),
        )
    )
    return streams.make_flight(
        path,
        NAME,
        velocity,
        position,
        _attitude(log),
        units=units_of_the_format(_UNITS),
        remarks=(streams.SWITCHED_ON, SEA_LEVEL, *streams.undecoded_remark(log.lost_bytes)),
        vehicle=log.vehicle,
        there_is=log.what_there_is,
    )


def read_log(path: Path) -> SensorLog:
    """Read the IMU and the GPS receiver the autopilot recorded.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, has no IMU or no GPS, or they cannot be navigated with.
    """
    log = _Messages(path, _SENSORS)
    gps = log.messages("GPS")
    missing = "a GPS (GPS)" if gps is None else "an IMU (IMU)"
    said = f"the log does not have {missing}; accepted are logs with both. {log.what_there_is()}"
    imu = streams.usable_imu(path, None if gps is None else log.imu, said)
    assert gps is not None
    velocity = streams.stack_fields(gps, "VelN", "VelE", "VelD")
    late = 1e-3 * log.parameters.get("EKF2_GPS_DELAY", log.parameters.get("PE_POS_DELAY_MS", 0.0))
    sigmas = gps.get("EPH"), gps.get("EPV"), None
    gnss = streams.make_gnss_log(
        gps[TIME],
        _read_place(gps),
        velocity,
        sigmas,
        log.fixed,
        np.zeros(3),
        streams.gps_delay(late),
        once=True,
    )
    if not gnss.time.size:
        raise MissionError(f"{path}: {log.no_fix()}; accepted are logs with fixes")
    return streams.checked_log(path, imu, gnss, AuxiliaryData(log.vehicle))


def read_imu(path: Path) -> Stream:
    """Read the IMU alone; `MissionError` if there is none."""
    return streams.usable_imu(path, _Messages(path, _SENSORS).imu, "the log does not have an IMU (IMU)")


class _Messages:
    """The messages of a file, with their times."""

    def __init__(self, path: Path, wanted: Sequence[str]) -> None:
        data = read_whole(path, streams.MAX_LOG_BYTES)
        if not recognises(data[:_DESCRIBED_WITHIN]):
            raise MissionError(f"{path}: is no {NAME} log")
        self._log = DataFlashFile.of(data, wanted)
        self.lost_bytes = self._log.lost_bytes
        self._stamps = (self._log.numbers("TIME") or {}).get("StartTime", np.empty(0)) * 1e-6
        self._stamped = self._log.places("TIME")
        self.parameters = parameters_of(self._log)

    @property
    def vehicle(self) -> str:
        return MAV_TYPES.get(self.parameters.get("MAV_TYPE", 0.0), "")

    def messages(self, name: str) -> Messages | None:
        """Return messages with the time that the clock message before each says."""
        found = self._log.numbers(name) if len(self._stamps) else None
        if found is None:
            return None
        before = np.searchsorted(self._stamped, self._log.places(name)) - 1
        return {**found, TIME: np.where(before >= 0, self._stamps[np.maximum(before, 0)], np.nan)}

    def stream(self, what: str, name: str, *fields: str, valid: Flags | None = None) -> Stream | None:
        return Stream.of_fields(what, self.messages(name), *fields, valid=valid)

    @property
    def imu(self) -> Stream | None:
        return self.stream("IMU", "IMU", "GyroX", "GyroY", "GyroZ", "AccX", "AccY", "AccZ")

    def position(self, what: str, name: str, valid: Flags | None = None) -> Stream | None:
        messages = self.messages(name)
        return Stream.of_place(what, messages, _read_place(messages), valid)

    @property
    def fixed(self) -> Flags | None:
        gps = self.messages("GPS")
        return None if gps is None or "Fix" not in gps else gps["Fix"] >= FIX_3D

    def what_there_is(self) -> str:
        said = f"It has {', '.join(self._log.names) or 'none of the messages used'}"
        if not len(self._stamps):
            return f"{said}, and no message TIME, so that no time is known"
        return f"{said}; {self.no_fix()}" if self.fixed is not None and not self.fixed.any() else said

    def no_fix(self) -> str:
        gps = self.messages("GPS") or {TIME: np.empty(0)}
        return streams.without_fix("messages of the GPS", len(gps[TIME]), "Fix", gps.get("Fix"))


def _read_place(messages: Messages | None) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m]."""
    return streams.read_place(messages, "Lat", "Lon", "Alt")


def _local_position(log: _Messages) -> Stream | None:
    stream = log.stream("local position", "LPOS", "RLat", "RLon", "RAlt", "X", "Y", "Z")
    if stream is None or not stream.usable:
        return None
    reference = stream.values[:, :3] * (np.radians(1.0), np.radians(1.0), 1.0)
    place = on_map(reference, stream.values[:, 3:])
    return Stream.of(
        stream.what, stream.time, place, streams.is_position(reference) & streams.is_position(place)
    )


def _attitude(log: _Messages) -> Stream | None:
    """Return the attitude as quaternions; until 2015 only the angles were logged."""
    quaternions = streams.make_attitude_stream(log.stream("attitude", "ATT", "qw", "qx", "qy", "qz"))
    return streams.first_usable(
        (quaternions, streams.attitude_of_angles(log.stream("attitude", "ATT", "Roll", "Pitch", "Yaw")))
    )
