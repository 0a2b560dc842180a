"""NMEA encoder: fixes as a receiver sends them, in RMC, GGA and GST."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import KNOT
from lab.data.protocols.framing import xor8
from lab.data.protocols.samples import FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT, NO_FIX
from lab.data.protocols.sending import merged, sent_fix

_QUALITIES = {FIX_DIFFERENTIAL: 2, FIX_RTK: 4, FIX_RTK_FLOAT: 5}  # quality of GGA; 1 is any other fix
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)  # zero of the time of a fix


class NmeaEncoder:
    """Writes fixes; an `Encoder`. The protocol has no samples, and no vertical velocity."""

    name = "nmea"

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the sentences of fixes: positions to 1e-7 minutes, the height above the ellipsoid in GGA."""
        return merged(imu[:0], fix, lambda _: b"", _sentences)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return the sentences of headings; the protocol has no speeds of an odometer."""
        return headings(reading)


def headings(reading: NDArray[np.void]) -> bytes:
    """Return headings as sentences HDT, as receivers with two antennas and compasses send them.

    Parameters
    ----------
    reading : (k,) array of `lab.data.protocols.samples.READING`
        Readings; those without a heading are left out.
    """
    shown = reading["heading"][np.isfinite(reading["heading"])]
    return b"".join(_checked(f"GNHDT,{math.degrees(one) % 360:.4f},T") for one in shown.tolist())


def _sentences(row: np.void) -> bytes:
    fix = sent_fix(row)
    seconds = fix.utc if math.isfinite(fix.utc) else fix.week_time
    now = _EPOCH + timedelta(milliseconds=round(1e3 * seconds))
    clock = f"{now:%H%M%S}.{now.microsecond // 1000:03d}"
    if fix.kind <= NO_FIX:
        return _checked(f"GNRMC,{clock},V,,,,,,,{now:%d%m%y},,,N") + _checked(
            f"GNGGA,{clock},,,,,0,00,,,M,,M,,"
        )
    place = f"{_angle(fix.latitude, 2, 'NS')},{_angle(fix.longitude, 3, 'EW')}"
    geoid = "" if row["sea_level"] else "0.0"
    quality = _QUALITIES.get(fix.kind, 1)
    text = _checked(f"GNRMC,{clock},A,{place},{fix.speed / KNOT:.5f},{fix.course:.5f},{now:%d%m%y},,,A")
    text += _checked(
        f"GNGGA,{clock},{place},{quality},{fix.satellites:02d},1.0,{fix.height:.4f},M,{geoid},M,,"
    )
    if math.isfinite(row["horizontal_sigma"]):
        level = f"{fix.horizontal_sigma:.4f}"
        text += _checked(f"GNGST,{clock},,,,,{level},{level},{fix.vertical_sigma:.4f}")
    return text


def _angle(degrees: float, width: int, sides: str) -> str:
    """Return degrees and minutes with 7 decimals, and the letter of the side."""
    minutes = round(abs(degrees) * 60e7)
    return f"{minutes // 600_000_000:0{width}d}{minutes % 600_000_000 / 1e7:010.7f},{sides[int(degrees < 0)]}"


def _checked(body: str) -> bytes:
    return f"${body}*{xor8(body.encode()):02X}\r\n".encode()
