"""UBX encoder: samples and fixes as a u-blox receiver with an IMU sends them."""

from __future__ import annotations

import math
import struct
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import WEEK
from lab.data.protocols.framing import fletcher16
from lab.data.protocols.sending import known, merged, vector
from lab.data.protocols.ubx import (
    COUNT_FROM,
    ESF_MEAS,
    ESF_RAW,
    FORCE_UNIT,
    GYRO_UNIT,
    HEADING_UNIT,
    LINE_FORWARD,
    MEAS_TICK,
    NAV_PVT,
    NAV_RELPOSNED,
    PVT,
    RAW_TICK,
    RELPOSNED,
    SPEED,
    SPEED_UNIT,
    SYNC,
    TEMPERATURE,
    TEMPERATURE_UNIT,
    X_FORCE,
    X_GYRO,
    Y_FORCE,
    Y_GYRO,
    Z_FORCE,
    Z_GYRO,
)

_LARGEST = 2**23 - 1  # the data of ESF-RAW have 24 bits with sign
_WEEK = round(1e3 * WEEK)
"""[ms]."""
_AXES = 3  # a message without a whole triad is no sample
_PVT_SIZE = 92
"""Bytes of NAV-PVT from protocol 15 on."""


class UbloxEncoder:
    """Writes samples and fixes; an `Encoder`.

    Parameters
    ----------
    imu
        Message of a sample: ESF-RAW with both triads, or two of ESF-MEAS.
    """

    name = "ublox"

    def __init__(self, imu: Literal["raw", "meas"] = "raw") -> None:
        self._sample = _raw if imu == "raw" else _measured

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples, which are rounded to the device's units, and of fixes."""
        return merged(imu, fix, self._sample, _pvt)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return the messages of headings and speeds."""
        return b"".join(map(_reading, reading))


def _message(kind: bytes, payload: bytes) -> bytes:
    body = kind + len(payload).to_bytes(2, "little") + payload
    return SYNC + body + fletcher16(body)


def _counts(row: np.void) -> dict[int, int]:
    """Return the data of a sample by type, as 24 bits."""
    values: dict[int, float] = {}
    if np.isfinite(row["rate"]).all():
        values |= dict(zip((X_GYRO, Y_GYRO, Z_GYRO), vector(row, "rate", GYRO_UNIT), strict=True))
    if np.isfinite(row["force"]).all():
        values |= dict(zip((X_FORCE, Y_FORCE, Z_FORCE), vector(row, "force", FORCE_UNIT), strict=True))
    if math.isfinite(row["temperature"]):
        values[TEMPERATURE] = float(row["temperature"]) / TEMPERATURE_UNIT
    return {kind: round(min(max(one, -_LARGEST), _LARGEST)) & 0xFFFFFF for kind, one in values.items()}


def _ticks(time: float, tick: float, modulus: int) -> int:
    return round(float(time) / tick) % modulus if math.isfinite(time) else 0


def _raw(row: np.void) -> bytes:
    tag = _ticks(row["time"], RAW_TICK, 2**24)
    pairs = b"".join(struct.pack("<II", kind << 24 | one, tag) for kind, one in _counts(row).items())
    return _message(ESF_RAW, bytes(4) + pairs)


def _measured(row: np.void) -> bytes:
    counts = _counts(row)
    tag = _ticks(row["time"], MEAS_TICK, 2**32)
    messages = []
    for kinds in ((X_FORCE, Y_FORCE, Z_FORCE), (X_GYRO, Y_GYRO, Z_GYRO, TEMPERATURE)):
        words = [struct.pack("<I", kind << 24 | counts[kind]) for kind in kinds if kind in counts]
        if len(words) >= _AXES:
            messages.append(
                _message(ESF_MEAS, struct.pack("<IHH", tag, len(words) << COUNT_FROM, 0) + b"".join(words))
            )
    return b"".join(messages)


def _reading(row: np.void) -> bytes:
    messages = b""
    if math.isfinite(row["heading"]):
        week_time = round(1e3 * float(row["week_time"])) % _WEEK if math.isfinite(row["week_time"]) else 0
        angle = round(float(row["heading"]) % (2 * math.pi) / HEADING_UNIT)
        spread = round(known(row, "heading_sigma")[0] / HEADING_UNIT)
        messages += _message(NAV_RELPOSNED, RELPOSNED.pack(1, week_time, angle, spread, LINE_FORWARD))
    if math.isfinite(row["speed"]):
        word = SPEED << 24 | round(float(row["speed"]) / SPEED_UNIT) & 0xFFFFFF
        tag = _ticks(row["time"], MEAS_TICK, 2**32)
        messages += _message(ESF_MEAS, struct.pack("<IHHI", tag, 1 << COUNT_FROM, 0, word))
    return messages


def _pvt(row: np.void) -> bytes:
    return _message(NAV_PVT, PVT.written(row).ljust(_PVT_SIZE, b"\0"))
