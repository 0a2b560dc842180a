"""Samples: rows of an IMU and of a receiver as devices send them, in SI units.

Axes are those of the device. What a device does not send is NaN, or -1 for whole numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import SENT
from lab.data.clock.timed_samples import OF_A_FIX

IMU: Final = np.dtype(
    [
        ("time", np.float64),
        ("count", np.int64),
        ("rate", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("magnetic", np.float64, (3,)),
        ("temperature", np.float64),
        ("pressure", np.float64),
        ("end", np.int64),
        ("clipped", np.int64),
    ]
)
"""A sample of an IMU.

``time`` of the device's clock [s]; ``count`` of the device's samples; angular ``rate`` (3,) [rad/s];
specific ``force`` (3,) [m/s²]; ``magnetic`` field (3,) [T]; ``temperature`` [°C]; ``pressure`` [Pa];
``end``, the number of bytes of the stream up to the end of its frame; ``clipped``, a sum of `CLIPPED_RATE`,
`CLIPPED_FORCE` and `CLIPPED_MAGNETIC`, shifted left by the number of the axis, for the axes that the device
reports as out of range.
"""
CLIPPED_RATE: Final = 1
"""Bit of x in ``clipped``; y and z are the next two."""
CLIPPED_FORCE: Final = 1 << 3
"""Bit of x in ``clipped``; y and z are the next two."""
CLIPPED_MAGNETIC: Final = 1 << 6
"""Bit of x in ``clipped``; y and z are the next two."""

FIX: Final = np.dtype(
    [
        ("time", np.float64),
        ("week_time", np.float64),
        ("utc", np.float64),
        *OF_A_FIX,
    ]
)
"""A fix of a receiver.

``time`` of the clock that also stamps the IMU of the same stream [s]; ``week_time`` of GPS [s]; ``utc``
since 1970, or since a midnight where the device gives no date [s]; ``latitude``, ``longitude`` [rad];
``height`` above the ellipsoid [m], or above the sea where ``sea_level`` is 1 because the receiver does not
give the height of the geoid; ``velocity_n`` (3,) north, east, down [m/s]; σ of position in each horizontal
axis and vertically [m], and of speed [m/s]; ``satellites`` used; ``fix_type``, `NO_FIX` or one of those below
it, by MAVLink's numbers where it has them; ``end`` as of `IMU`.
"""
READING: Final = np.dtype(
    [
        ("time", np.float64),
        ("week_time", np.float64),
        ("utc", np.float64),
        *((aid.live, np.float64) for aid in SENT),
        ("heading_sigma", np.float64),
        ("attitude", np.float64, (4,)),
        ("end", np.int64),
    ]
)
"""A reading of two antennas, of a compass, of an odometer, or of a further sensor of the aid table.

``time``, ``week_time``, ``utc`` and ``end`` as of `FIX`; true ``heading`` of the forward axis [rad];
``speed`` forward [m/s]; what further sensors read; σ of the heading [rad]; ``attitude`` (4,), which the
device itself estimates: a quaternion, scalar first, whose rotation takes its axes to north, east and down.
"""
NO_FIX: Final = 1
"""Kind of a fix that is none, GPS_FIX_TYPE_NO_FIX of MAVLink: position and velocity are NaN."""
FIX_2D: Final = 2  # GPS_FIX_TYPE_2D_FIX
FIX_3D: Final = 3  # GPS_FIX_TYPE_3D_FIX
FIX_DIFFERENTIAL: Final = 4  # GPS_FIX_TYPE_DGPS
FIX_RTK_FLOAT: Final = 5  # GPS_FIX_TYPE_RTK_FLOAT
FIX_RTK: Final = 6  # GPS_FIX_TYPE_RTK_FIXED
SIMULATED: Final = 16  # the receiver runs in its simulator mode
COMBINED: Final = 17  # measured, and smoothed by the receiver's dead reckoning
UNSENT: Final = -1  # the device does not send the kind
ESTIMATED: Final = -2  # `UNMEASURED` says what these three are
ENTERED: Final = -3  # in manual mode
WARNED: Final = -4  # by the receiver itself
UNMEASURED: Final = {
    ESTIMATED: "the receiver estimated the position (dead reckoning)",
    ENTERED: "the position was typed in (manual mode)",
    WARNED: "the receiver warns of the position (status V of NMEA, gnssFixOK = 0 of UBX)",
}
"""Positions that satellites did not give, in words. No consumer takes them unless it asks for them."""
NAMED: Final = {
    SIMULATED: "simulated: the receiver runs in its simulator mode",
    COMBINED: "of satellites combined with the receiver's dead reckoning",
}
"""Kinds of fixes that are used and reported, in words that follow "are"."""

NAN: Final = float("nan")
UNKNOWN: Final = (NAN, NAN, NAN)
"""A vector that the device does not send."""
NO_READINGS: Final = np.empty(0, READING)
"""No readings."""
NO_READINGS.setflags(write=False)

Vector = Sequence[float]


class Samples(NamedTuple):
    """What a decoder found: rows in the order of their frames.

    Attributes
    ----------
    imu : (n,) array of `IMU`
        Samples of the IMU.
    fix : (m,) array of `FIX`
        Fixes of the receiver.
    reading : (k,) array of `READING`
        Headings and speeds.
    """

    imu: NDArray[np.void]
    fix: NDArray[np.void]
    reading: NDArray[np.void] = NO_READINGS


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Return the rows of all parts."""
    # With the type given, NumPy need not find that of each two parts, which takes longer than to join them.
    return Samples(
        np.concatenate([np.empty(0, IMU), *(part.imu for part in parts)], dtype=IMU),
        np.concatenate([np.empty(0, FIX), *(part.fix for part in parts)], dtype=FIX),
        np.concatenate([NO_READINGS, *(part.reading for part in parts)], dtype=NO_READINGS.dtype),
    )
