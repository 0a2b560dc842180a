"""Timed samples: those of a device, with times of the host's clock and in the axes of the vehicle.

A `ReadingTimes` gives headings and speeds theirs.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import SENT
from lab.base.arrays import FloatArray
from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.faults import increasing
from lab.data.clock.limits import LIMITS

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
Rows = NDArray[np.void]

NO_READINGS: Final = np.empty(0, TIMED_READING)
"""No readings."""
NO_READINGS.setflags(write=False)
_QUANTITIES: Final = tuple(aid.live for aid in SENT)
_ATTITUDE: Final = "attitude"
_OFF_UNIT: Final = 0.01
"""Largest deviation of the length of a quaternion from one: rounding to two digits stays below."""
_SIGMAS: Final = (np.radians(0.01), np.radians(60.0))
"""σ of a heading that are believed [rad]: the best receivers reach 0.03° over 10 m between their antennas;
above 60°, a heading shows little more than which way is not ahead."""


class ReadingTimes:
    """Times the readings of one stream; of each quantity, those not later than all before are dropped.

    A reading in the frame of a sample has the time of that sample. Otherwise, its time is that of the clock
    of the IMU, or of the receiver, or of its arrival less `ClockLimits.latency`.
    """

    def __init__(self) -> None:
        self._latest = dict.fromkeys((*_QUANTITIES, _ATTITUDE), -np.inf)

    def timed(
        self,
        rows: Rows,
        arrival: float,
        imu: Rows,
        clock: DeviceClock,
        fix_clock: DeviceClock,
        last: float,
    ) -> Rows:
        """Return readings with their times.

        Parameters
        ----------
        rows : (n,) array of `lab.data.protocols.samples.READING`
            Readings in the order of their frames.
        arrival
            When they were there [s].
        imu : (m,) array of `lab.data.clock.timed_samples.TIMED_IMU`
            Samples that came with them.
        clock, fix_clock
            Clocks of the IMU and of the receiver.
        last
            Time of the last sample by the clock of the IMU [s]; NaN if there is none.
        """
        made = np.empty(len(rows), TIMED_READING)
        for number, row in enumerate(rows):
            inside = np.flatnonzero(imu["end"] == row["end"])
            made["time"][number] = (
                imu["time"][inside[0]] if inside.size else _time(row, arrival, clock, fix_clock, last)
            )
        made["arrival"] = arrival
        for name in (*_QUANTITIES, _ATTITUDE, "end"):
            made[name] = rows[name]
        length = np.linalg.norm(made[_ATTITUDE], axis=1)
        made[_ATTITUDE][~(np.abs(length - 1) < _OFF_UNIT)] = np.nan  # zeros too, of who sends none
        sigma = rows["heading_sigma"]
        believed = (sigma > _SIGMAS[0]) & (sigma < _SIGMAS[1])
        made["heading_sigma"] = np.where(believed & np.isfinite(rows["heading"]), sigma, np.nan)
        for name in self._latest:
            time = np.where(_mask_known(made[name]), made["time"], np.nan)
            made[name][~increasing(time, self._latest[name])] = np.nan
            self._latest[name] = float(np.fmax.reduce(time, initial=self._latest[name]))
        return np.asarray(made[np.logical_or.reduce([_mask_known(made[name]) for name in self._latest])])


def _mask_known(values: FloatArray) -> NDArray[np.bool_]:
    """Return the mask (n,) of the rows with a value: a number, or all of an attitude."""
    known = np.isfinite(values)
    return known if known.ndim == 1 else np.asarray(known.all(axis=1))


def _time(row: np.void, arrival: float, clock: DeviceClock, fix_clock: DeviceClock, last: float) -> float:
    """Return the time of a reading that is in no frame of a sample [s]."""
    own, week = float(row["time"]), float(row["week_time"])
    if np.isfinite(own) and np.isfinite(clock.offset) and abs(own - last) < LIMITS.stale:
        return clock.offset + own
    by_receiver = fix_clock.predicted(week if np.isfinite(week) else float(row["utc"]))
    said = np.isfinite(week) or np.isfinite(row["utc"])
    if said and abs(by_receiver - arrival) < LIMITS.stale:  # NaN is not
        return by_receiver - LIMITS.latency
    return arrival - LIMITS.latency
