"""MicroStrain encoder: samples and fixes as a 3DM-GQ7 or the like sends them in MIP packets."""

from __future__ import annotations

import math
import struct

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import GAUSS, STANDARD_GRAVITY
from lab.data.protocols.framing import fletcher16
from lab.data.protocols.mip import (
    FIX_INFO,
    FORCE,
    GNSS,
    GNSS_TIME,
    MAGNETIC,
    MILLIBAR,
    PLACE,
    PRESSURE,
    RATE,
    REFERENCE_TIME,
    SENSOR,
    SYNC,
    VELOCITY,
)
from lab.data.protocols.nmea_encoder import headings
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT, NO_FIX
from lab.data.protocols.sending import merged, nanoseconds, sent_fix, vector

# Kinds of fixes of FIX_INFO.
_FIX_TYPES = {FIX_3D: 0, FIX_2D: 1, FIX_RTK_FLOAT: 5, FIX_RTK: 6, FIX_DIFFERENTIAL: 7}
_NONE = 3  # no fix
_ALL = 0x1F  # flags of a place of which all is valid


class MipEncoder:
    """Writes samples and fixes; an `Encoder`. The device's single precision rounds them."""

    name = "mip"

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the bytes of samples and fixes in the order of their time; NaN is left out."""
        return merged(imu, fix, _sample, _fix)

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings as the sentences of a receiver beside the device; it sends no speeds."""
        return headings(reading)


def _sample(row: np.void) -> bytes:
    fields = [(REFERENCE_TIME, struct.pack(">Q", nanoseconds(row["time"])))]
    for kind, name, unit in (
        (FORCE, "force", STANDARD_GRAVITY), (RATE, "rate", 1.0), (MAGNETIC, "magnetic", GAUSS),
    ):  # fmt: skip
        if np.isfinite(row[name]).all():
            fields.append((kind, struct.pack(">3f", *vector(row, name, unit))))
    if math.isfinite(row["pressure"]):
        fields.append((PRESSURE, struct.pack(">f", row["pressure"] / MILLIBAR)))
    return _packet(SENSOR, fields)


def _fix(row: np.void) -> bytes:
    fix = sent_fix(row)
    valid = _ALL if fix.kind > NO_FIX else 0
    place = (fix.latitude, fix.longitude, fix.height, fix.height, fix.horizontal_sigma, fix.vertical_sigma)
    speeds = (math.hypot(*fix.velocity_n), fix.speed, fix.course, fix.speed_sigma, 0.0)
    return _packet(
        GNSS[0],
        [
            (REFERENCE_TIME, struct.pack(">Q", nanoseconds(row["time"]))),
            (GNSS_TIME, struct.pack(">dHH", fix.week_time, 0, 1)),
            (FIX_INFO, struct.pack(">BBHH", _FIX_TYPES.get(fix.kind, _NONE), fix.satellites, 0, 7)),
            (PLACE, struct.pack(">4d2fH", *place, valid)),
            (VELOCITY, struct.pack(">8fH", *fix.velocity_n, *speeds, valid)),
        ],
    )


def _packet(descriptors: int, fields: list[tuple[int, bytes]]) -> bytes:
    payload = b"".join(bytes((len(data) + 2, kind)) + data for kind, data in fields)
    packet = SYNC + bytes((descriptors, len(payload))) + payload
    return packet + fletcher16(packet)
