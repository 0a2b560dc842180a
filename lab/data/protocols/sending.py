"""Sending: numbers of rows in the forms that devices send, and samples and fixes in the order of a device."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_SATELLITES = 254
"""Largest number of satellites that is sent: MAVLink has 255 for an unknown one."""


class SentFix(NamedTuple):
    """A fix to be sent: 0 for what is not known, but for the time of day.

    Attributes
    ----------
    latitude, longitude : float
        [°].
    height, horizontal_sigma, vertical_sigma : float
        [m].
    velocity_n : list of three floats
        North, east, down [m/s].
    speed, speed_sigma : float
        Horizontal speed, and σ of the speed [m/s].
    course : float
        0 to 360 [°].
    week_time, utc : float
        As of `lab.data.protocols.samples.FIX` [s].
    satellites, kind : int
        Satellites, and a ``fix_type`` of `lab.data.protocols.samples.FIX`.
    """

    latitude: float
    longitude: float
    height: float
    velocity_n: list[float]
    speed: float
    course: float
    horizontal_sigma: float
    vertical_sigma: float
    speed_sigma: float
    week_time: float
    utc: float
    satellites: int
    kind: int


def sent_fix(row: np.void) -> SentFix:
    """Return a row of `lab.data.protocols.samples.FIX` as it is sent."""
    latitude, longitude, height = known_fields(row, "latitude", "longitude", "height")
    level, vertical, speed = known_fields(row, "horizontal_sigma", "vertical_sigma", "speed_sigma")
    north, east, down = vector(row, "velocity_n")
    return SentFix(
        latitude=math.degrees(latitude),
        longitude=math.degrees(longitude),
        height=height,
        velocity_n=[north, east, down],
        speed=math.hypot(north, east),
        course=math.degrees(math.atan2(east, north)) % 360,
        horizontal_sigma=level,
        vertical_sigma=vertical,
        speed_sigma=speed,
        week_time=known_fields(row, "week_time")[0],
        utc=float(row["utc"]),
        satellites=min(max(int(row["satellites"]), 0), MOST_SATELLITES),
        kind=int(row["fix_type"]),
    )


def known_fields(row: np.void, *names: str) -> list[float]:
    """Return fields of a row; 0 for what is not known."""
    return [float(row[name]) if math.isfinite(row[name]) else 0.0 for name in names]


def vector(row: np.void, name: str, unit: float = 1.0) -> list[float]:
    """Return a field (3,) of a row in a unit; 0 for what is not known."""
    return [float(value) / unit if math.isfinite(value) else 0.0 for value in row[name]]


def microseconds(seconds: float) -> int:
    """Return a time as a whole number [µs]; 0 if it is not known or negative."""
    return round(1e6 * max(float(seconds), 0.0)) if math.isfinite(seconds) else 0


def nanoseconds(seconds: float) -> int:
    """Return a time as a whole number [ns]; 0 if it is not known or negative."""
    return round(1e9 * max(float(seconds), 0.0)) if math.isfinite(seconds) else 0


def round_to_bits(value: float, bits: int = 16) -> int:
    """Return a value as a whole number of some bits with a sign, at the end of its range if it is beyond."""
    largest = 1 << bits - 1
    return round(min(max(value, -largest), largest - 1))


class FrameEncoder:
    """An `Encoder` that sends a frame for each sample and each fix, or none where the protocol has none."""

    def _samples(self, imu: NDArray[np.void]) -> bytes:
        return b"".join(map(self._sample, imu))

    def _sample(self, row: np.void) -> bytes:
        return b""

    def _fix(self, row: np.void) -> bytes:
        return b""

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the frames of samples and fixes, each fix after the last sample that is not later.

        Parameters
        ----------
        imu : (n,) array of `lab.data.protocols.samples.IMU`
            Samples, in order.
        fix : (m,) array of `lab.data.protocols.samples.FIX`
            Fixes, in order. Those without a time follow all samples.
        """
        after = (
            np.searchsorted(imu["time"], fix["time"], side="right") if len(imu) else np.zeros(len(fix), int)
        )
        frames, begin = [], 0
        for row, end in zip(fix, after.tolist(), strict=True):
            frames += [self._samples(imu[begin:end]), self._fix(row)]
            begin = max(begin, end)
        return b"".join((*frames, self._samples(imu[begin:])))
