"""VectorNav encoder: samples and fixes as a VN-200 sends them, in binary messages or ASCII lines."""

from __future__ import annotations

import struct
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import GAUSS
from lab.data.protocols.framing import crc16_xmodem, xor8
from lab.data.protocols.nmea_encoder import headings
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT
from lab.data.protocols.sending import known, merged, nanoseconds, sent_fix, vector
from lab.data.protocols.vectornav import KILOPASCAL, SYNC

# Kinds of fixes of the device.
_FIX_TYPES = {FIX_2D: 2, FIX_3D: 3, FIX_DIFFERENTIAL: 4, FIX_RTK_FLOAT: 7, FIX_RTK: 8}
_SAMPLE = struct.Struct("<BBHQ6f3fff")
"""Common group: TimeStartup (bit 0), Imu (9), MagPres (10)."""
_FIX = struct.Struct("<BBHHQQBB3d3f3ff")
"""Common group: TimeStartup; GPS group: Tow (1), NumSats (3), Fix (4), PosLla (5), VelNed (7), PosU (9),
VelU (10)."""


class VectorNavEncoder:
    """Writes samples and fixes; an `Encoder`. The device's single precision rounds them.

    Parameters
    ----------
    form
        ``"binary"`` for messages with the device's time, uncompensated sensors and GPS; ``"VNIMU"`` or
        ``"VNYMR"`` for ASCII lines, which have neither time nor attitude here, with the GPS in ``$VNGPS``.
    """

    name = "vectornav"

    def __init__(self, form: Literal["binary", "VNIMU", "VNYMR"] = "binary") -> None:
        self._form = form

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples and fixes in the order of their time; NaN is sent as zero."""
        if self._form == "binary":
            return merged(imu, fix, _binary_sample, _binary_fix)
        return merged(imu, fix, self._line, _gps_line)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings as the sentences of a receiver beside the device; it sends no speeds."""
        return headings(reading)

    def _line(self, row: np.void) -> bytes:
        magnetic, force, rate = vector(row, "magnetic", GAUSS), vector(row, "force"), vector(row, "rate")
        cells = [f"{value:+08.4f}" for value in magnetic]
        cells += [f"{value:+07.3f}" for value in force] + [f"{value:+010.6f}" for value in rate]
        if self._form == "VNYMR":
            return _checked(",".join(["VNYMR", "+000.000", "+000.000", "+000.000", *cells]))
        temperature, pressure = known(row, "temperature", "pressure")
        return _checked(
            ",".join(["VNIMU", *cells, f"{temperature:+05.1f}", f"{pressure / KILOPASCAL:+08.3f}"])
        )


def _summed(message: bytes) -> bytes:
    return message + crc16_xmodem(message[1:]).to_bytes(2, "big")


def _binary_sample(row: np.void) -> bytes:
    temperature, pressure = known(row, "temperature", "pressure")
    sensed = (*vector(row, "force"), *vector(row, "rate"), *vector(row, "magnetic", GAUSS))
    fields = 1 << 0 | 1 << 9 | 1 << 10
    time = nanoseconds(row["time"])
    return _summed(_SAMPLE.pack(SYNC, 1, fields, time, *sensed, temperature, pressure / KILOPASCAL))


def _binary_fix(row: np.void) -> bytes:
    fix = sent_fix(row)
    place = (fix.latitude, fix.longitude, fix.height)
    sigma = (fix.horizontal_sigma, fix.horizontal_sigma, fix.vertical_sigma, fix.speed_sigma)
    fields = 1 << 1 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 7 | 1 << 9 | 1 << 10
    head = (SYNC, 1 | 1 << 3, 1, fields, nanoseconds(row["time"]), nanoseconds(row["week_time"]))
    kind = _FIX_TYPES.get(fix.kind, 0)
    return _summed(_FIX.pack(*head, fix.satellites, kind, *place, *fix.velocity_n, *sigma))


def _gps_line(row: np.void) -> bytes:
    fix = sent_fix(row)
    cells = [f"{fix.week_time:013.6f}", "0000", f"{_FIX_TYPES.get(fix.kind, 0)}", f"{fix.satellites:02d}"]
    cells += [f"{angle:+013.8f}" for angle in (fix.latitude, fix.longitude)]
    cells += [f"{value:+010.3f}" for value in (fix.height, *fix.velocity_n)]
    sigma = (fix.horizontal_sigma, fix.horizontal_sigma, fix.vertical_sigma, fix.speed_sigma)
    cells += [f"{value:+07.3f}" for value in sigma]
    return _checked(",".join(["VNGPS", *cells, "0.000000"]))


def _checked(body: str) -> bytes:
    return f"${body}*{xor8(body.encode()):02X}\r\n".encode()
