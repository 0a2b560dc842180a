"""Timed samples: those of a device, with times of the host's clock and in the axes of the vehicle."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from lab.base.aid_table import SENT

TIMED_IMU: Final = np.dtype(
    [
        ("time", np.float64),
        ("arrival", np.float64),
        ("rate", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("magnetic", np.float64, (3,)),
        ("temperature", np.float64),
        ("pressure", np.float64),
        ("clipped", np.int64),
        ("gap", np.bool_),
        ("end", np.int64),
    ]
)
"""A sample of an IMU.

``time`` of the host's monotonic clock at which the sample ends, increasing [s]; ``arrival`` of its last byte
by the same clock [s]; angular ``rate`` (3,) [rad/s], specific ``force`` (3,) [m/s²] and ``magnetic`` field
(3,) [T] forward, right, down; ``temperature`` [°C]; ``pressure`` [Pa]; ``clipped`` as of
`lab.data.protocols.samples.IMU`, for the axes of the device; ``gap``, whether samples are missing before it;
``end``, the bytes of the stream up to the end of its frame.
"""
OF_A_FIX: Final[list[tuple[Any, ...]]] = [
    ("latitude", np.float64),
    ("longitude", np.float64),
    ("height", np.float64),
    ("velocity_n", np.float64, (3,)),
    ("horizontal_sigma", np.float64),
    ("vertical_sigma", np.float64),
    ("speed_sigma", np.float64),
    ("satellites", np.int64),
    ("fix_type", np.int64),
    ("sea_level", np.int64),
    ("end", np.int64),
]
"""Fields that a fix of a device has, too; see `lab.data.protocols.samples.FIX`."""
TIMED_FIX: Final = np.dtype(
    [
        ("time", np.float64),
        ("arrival", np.float64),
        ("utc", np.float64),
        *OF_A_FIX,
    ]
)
"""A fix of a receiver: ``time`` of validity and ``arrival`` of the host's monotonic clock [s].

The other fields are those of `lab.data.protocols.samples.FIX`.
"""
TIMED_READING: Final = np.dtype(
    [
        ("time", np.float64),
        ("arrival", np.float64),
        *((aid.live, np.float64) for aid in SENT),
        ("heading_sigma", np.float64),
        ("attitude", np.float64, (4,)),
        ("end", np.int64),
    ]
)
"""A heading, a speed or another reading: ``time`` of validity and ``arrival`` by the host's clock [s].

``heading_sigma`` is NaN also where the device gives one that is not believed. ``attitude`` is `q_nb` as the
device itself estimates it, in the axes of the vehicle; NaN where it sends none.
The other fields are those of `lab.data.protocols.samples.READING`.
"""
