"""Xsens encoder: samples and fixes as an MTi sends them in MTData2."""

from __future__ import annotations

import math
import struct
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols.nmea_encoder import headings
from lab.data.protocols.sending import merged, microseconds, whole
from lab.data.protocols.xsens import (
    ACCELERATION,
    EXTENDED,
    GNSS_PVT,
    MAGNETIC,
    NOMINAL_FIELD,
    PACKET_COUNTER,
    PRESSURE,
    PVT,
    PVT_SIZE,
    RATE_OF_TURN,
    SAMPLE_TIME_FINE,
    START,
    STATUS_WORD,
    TEMPERATURE,
    TICK,
)

Precision = Literal["single", "fp12.20", "fp16.32", "double"]
# The kind of number, as bits of an identifier.
_BITS: dict[Precision, int] = {"single": 0, "fp12.20": 1, "fp16.32": 2, "double": 3}


class XsensEncoder:
    """Writes samples and fixes; an `Encoder`.

    Parameters
    ----------
    precision
        Form of the numbers.
    """

    name = "xsens"

    def __init__(self, precision: Precision = "single") -> None:
        self._bits = _BITS[precision]
        self._count = 0

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples and fixes in the order of their time; NaN is left out."""
        return merged(imu, fix, self._sample, self._fix)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings as the sentences of a receiver beside the device; it sends no speeds."""
        return headings(reading)

    def _sample(self, row: np.void) -> bytes:
        items = self._head(row["time"])
        for kind, values in (
            (TEMPERATURE, [row["temperature"]]),
            (ACCELERATION, row["force"]),
            (RATE_OF_TURN, row["rate"]),
            (MAGNETIC, row["magnetic"] / NOMINAL_FIELD),
        ):
            if np.isfinite(values).all():
                items.append((kind | self._bits, b"".join(map(self._number, values))))
        if math.isfinite(row["pressure"]):
            items.append((PRESSURE, round(float(row["pressure"])).to_bytes(4, "big")))
        clipped = int(row["clipped"])
        bits = clipped >> 3 & 7 | (clipped & 7) << 3 | clipped & 7 << 6
        items.append((STATUS_WORD, (bits << 8 | bool(bits) << 19 | 3).to_bytes(4, "big")))
        return _message(items)

    def _fix(self, row: np.void) -> bytes:
        data = PVT.written(row).ljust(PVT_SIZE, b"\0")
        return _message([*self._head(row["time"]), (GNSS_PVT, data)])

    def _head(self, time: float) -> list[tuple[int, bytes]]:
        count, self._count = self._count, (self._count + 1) % 2**16
        ticks = round(microseconds(time) * 1e-6 / TICK) % 2**32
        return [(PACKET_COUNTER, count.to_bytes(2, "big")), (SAMPLE_TIME_FINE, ticks.to_bytes(4, "big"))]

    def _number(self, value: float) -> bytes:
        if self._bits == _BITS["single"]:
            return struct.pack(">f", value)
        if self._bits == _BITS["double"]:
            return struct.pack(">d", value)
        if self._bits == _BITS["fp12.20"]:
            return struct.pack(">i", whole(value * 2**20, 32))
        fixed = whole(value * 2**32, 48)
        return struct.pack(">Ih", fixed & 0xFFFFFFFF, fixed >> 32)


def _message(items: list[tuple[int, bytes]]) -> bytes:
    payload = b"".join(kind.to_bytes(2, "big") + bytes((len(data),)) + data for kind, data in items)
    is_long = len(payload) >= EXTENDED
    size = bytes((EXTENDED,)) + len(payload).to_bytes(2, "big") if is_long else bytes((len(payload),))
    message = START + size + payload
    return message + bytes(((START[0] - sum(message)) & 0xFF,))
