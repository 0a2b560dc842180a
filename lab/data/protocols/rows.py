"""Rows: samples as a decoder finds them, held within limits, handed over as arrays."""

from __future__ import annotations

import struct

import numpy as np

from lab.base.aid_table import SENT
from lab.data.clock.limits import LIMITS
from lab.data.protocols.decoder import Statistics
from lab.data.protocols.limits import LimitCheck, Limits
from lab.data.protocols.samples import (
    FIX,
    IMU,
    NAN,
    NO_FIX,
    READING,
    UNKNOWN,
    UNMEASURED,
    Samples,
    Vector,
)

# Rows are packed one by one: this is ten times faster than to assign the fields of an array of one row.
_IMU_ROW = struct.Struct("<dq3d3d3dddqq")
_FIX_ROW = struct.Struct("<dddddd3ddddqqqq")
_READING_ROW = struct.Struct(f"<{8 + len(SENT)}dq")
"""Numbers of a row in the order of the fields; the types say what they are."""
assert _IMU_ROW.size == IMU.itemsize
assert _FIX_ROW.size == FIX.itemsize
assert _READING_ROW.size == READING.itemsize

LARGEST_HEIGHT = 1e6
"""Largest height of a fix that is believed [m]: the space station orbits at 4e5 m. Damaged floats hold any
number."""
LARGEST_SPEED = 1e4
"""Largest speed of a fix that is believed [m/s]: an orbit has 7800 m/s."""

_LARGEST_READING = {aid.live: max(-aid.column.low, aid.column.high) for aid in SENT} | {
    "heading": 2 * np.pi,
    "speed": 400.0,
}
"""Largest readings that are believed. The fastest car on wheels reached 341 m/s."""

_ROUNDING = 1e-3
"""Most by which a number of a unit quaternion may exceed 1: single precision and three digits stay below."""


class Rows:
    """Collects the samples of one stream.

    Parameters
    ----------
    statistics
        Counts what is refused.
    limits
        What is accepted.
    """

    def __init__(self, statistics: Statistics, limits: Limits) -> None:
        self._statistics = statistics
        self._check = LimitCheck(limits)
        self._imu = bytearray()
        self._fix = bytearray()
        self._reading = bytearray()

    def scale_rates(self, factor: float) -> None:
        """Compare the next angular rates with those before, whose unit was another one."""
        self._check.scale_rates(factor)

    def add_imu(
        self,
        end: int,
        time: float = NAN,
        count: int = -1,
        rate: Vector = UNKNOWN,
        force: Vector = UNKNOWN,
        magnetic: Vector = UNKNOWN,
        temperature: float = NAN,
        pressure: float = NAN,
        clipped: int = 0,
    ) -> None:
        """Take a sample of the IMU, or count it as refused; fields as of `IMU`."""
        if abs(time) > LIMITS.largest or not self._check.accepts(rate, force):
            self._statistics.refused += 1
            return
        self._imu += _IMU_ROW.pack(time, count, *rate, *force, *magnetic, temperature, pressure, end, clipped)

    def add_fix(
        self,
        end: int,
        time: float = NAN,
        week_time: float = NAN,
        utc: float = NAN,
        place: Vector = UNKNOWN,
        velocity_n: Vector = UNKNOWN,
        sigma: Vector = UNKNOWN,
        satellites: int = -1,
        fix_type: int = NO_FIX,
        sea_level: bool = False,
    ) -> None:
        """Take a fix, or count it as refused; fields as of `FIX`. Without a fix, its position is unknown.

        ``place`` is latitude, longitude and height, ``sigma`` that of the position in each horizontal axis,
        vertically, and of the speed.
        """
        latitude, longitude, height = place
        if fix_type <= NO_FIX and fix_type not in UNMEASURED:
            place = velocity_n = UNKNOWN
        elif (
            not (-np.pi / 2 <= latitude <= np.pi / 2 and abs(longitude) <= 2 * np.pi)
            or abs(height) > LARGEST_HEIGHT
            or any(abs(speed) > LARGEST_SPEED for speed in velocity_n)
        ):
            self._statistics.refused += 1
            return
        self._fix += _FIX_ROW.pack(
            time, week_time, utc, *place, *velocity_n, *sigma, satellites, fix_type, sea_level, end
        )

    def add_reading(
        self,
        end: int,
        time: float = NAN,
        week_time: float = NAN,
        utc: float = NAN,
        heading_sigma: float = NAN,
        **values: float,
    ) -> None:
        """Take a heading, a speed or another value, or count it as refused; fields as of `READING`."""
        if abs(time) > LIMITS.largest or any(abs(values[name]) > _LARGEST_READING[name] for name in values):
            self._statistics.refused += 1
            return
        row = [values.get(aid.live, NAN) for aid in SENT]
        self._reading += _READING_ROW.pack(time, week_time, utc, *row, heading_sigma, *[NAN] * 4, end)

    def add_attitude(self, end: int, time: float, attitude: Vector) -> None:
        """Take an attitude that the device itself estimates, or count it as refused; as of `READING`."""
        if abs(time) > LIMITS.largest or any(abs(value) > 1 + _ROUNDING for value in attitude):
            self._statistics.refused += 1
            return
        unknown = [NAN] * len(SENT)
        self._reading += _READING_ROW.pack(time, NAN, NAN, *unknown, NAN, *attitude, end)

    def taken(self) -> Samples:
        """Return what was collected, and begin anew."""
        found = Samples(
            np.frombuffer(self._imu, IMU),
            np.frombuffer(self._fix, FIX),
            np.frombuffer(self._reading, READING),
        )
        self._imu, self._fix, self._reading = bytearray(), bytearray(), bytearray()
        return found
