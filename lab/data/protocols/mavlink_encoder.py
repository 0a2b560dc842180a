"""MAVLink encoder: samples in HIGHRES_IMU and fixes in GPS_RAW_INT, by pymavlink."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import GAUSS
from lab.data.protocols.mavlink import MISSING
from lab.data.protocols.samples import NO_FIX
from lab.data.protocols.sending import known, merged, microseconds, sent_fix, vector

_ALL_FIELDS = 0x1FFF  # fields_updated of HIGHRES_IMU: all thirteen
_UNKNOWN = 65_535  # value of an unknown 16-bit field of GPS_RAW_INT


class MavlinkEncoder:
    """Writes samples and fixes of system 1; an `Encoder`. Single precision rounds samples.

    Raises
    ------
    ImportError
        If pymavlink is not installed.
    """

    name = "mavlink"

    def __init__(self) -> None:
        try:
            from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise ImportError(MISSING) from error
        self._link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self._wheel: tuple[int, float, float] | None = None  # last time [µs], speed [m/s], distance [m]

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples and fixes in the order of their time; NaN is sent as zero."""
        return merged(imu, fix, self._sample, self._fix)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings in GPS2_RAW and speeds in WHEEL_DISTANCE, the distance of one wheel."""
        return b"".join(map(self._reading, reading))

    def _reading(self, row: np.void) -> bytes:
        packed, now = b"", microseconds(row["time"])
        if np.isfinite(row["heading"]):
            yaw = round(1e2 * math.degrees(row["heading"])) % 36_000 or 36_000
            unknown = (NO_FIX, 0, 0, 0, _UNKNOWN, _UNKNOWN, _UNKNOWN, _UNKNOWN, 255, 0, 0)
            spread = round(1e5 * math.degrees(known(row, "heading_sigma")[0]))
            packed += self._packed(self._link.gps2_raw_encode(now, *unknown, yaw, hdg_acc=spread))
        if np.isfinite(row["speed"]):
            speed = float(row["speed"])
            before, slow, distance = self._wheel or (now, speed, 0.0)
            distance += (speed + slow) / 2 * (now - before) * 1e-6
            self._wheel = now, speed, distance
            packed += self._packed(self._link.wheel_distance_encode(now, 1, [distance, *[0.0] * 15]))
        return packed

    def _sample(self, row: np.void) -> bytes:
        temperature, pressure = known(row, "temperature", "pressure")
        message = self._link.highres_imu_encode(
            microseconds(row["time"]), *vector(row, "force"), *vector(row, "rate"),
            *vector(row, "magnetic", GAUSS), pressure / 100, 0.0, 0.0, temperature, _ALL_FIELDS,
        )  # fmt: skip
        return self._packed(message)

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        moving = np.isfinite(row["velocity_n"][:2]).all()
        height = round(1e3 * fix.height)
        message = self._link.gps_raw_int_encode(
            microseconds(row["time"]), max(fix.kind, NO_FIX), round(1e7 * fix.latitude),
            round(1e7 * fix.longitude), height, _UNKNOWN, _UNKNOWN,
            min(round(1e2 * fix.speed), _UNKNOWN - 1) if moving else _UNKNOWN,
            round(1e2 * fix.course) if moving else _UNKNOWN,
            fix.satellites if row["satellites"] >= 0 else 255, 0 if row["sea_level"] else height,
            round(1e3 * fix.horizontal_sigma), round(1e3 * fix.vertical_sigma), round(1e3 * fix.speed_sigma),
        )  # fmt: skip
        return self._packed(message)

    def _packed(self, message: object) -> bytes:
        packed = message.pack(self._link)  # type: ignore[attr-defined]
        self._link.seq = (self._link.seq + 1) % 256
        return bytes(packed)
