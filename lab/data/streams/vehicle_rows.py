"""Vehicle rows: samples and fixes as they were timed, in the axes of the vehicle and in the order of time."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.counted import count_noun
from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.faults import increasing
from lab.data.clock.limits import LIMITS
from lab.data.clock.timed_samples import TIMED_FIX, TIMED_IMU
from lab.data.log.calibration import Calibration
from lab.data.protocols.samples import NAMED, NO_FIX, UNMEASURED
from lab.data.streams.axis_map import AxisMap

Rows = NDArray[np.void]

_MICROTESLA = 1e6
"""Microteslas in a tesla: calibrations are in µT, streams in T."""
NO_IMU, NO_FIXES = np.empty(0, TIMED_IMU), np.empty(0, TIMED_FIX)
"""No samples, no fixes."""


class VehicleRows:
    """Makes rows of `TIMED_IMU`.

    Attributes
    ----------
    axes : AxisMap
        The axis map; may be replaced at any time.
    calibration : Calibration or None
        The constant errors of the device, which are removed; may be replaced at any time.
    triads_apart : bool
        Whether the device sends rates and forces one by one: a rate then gets the last force.
    """

    def __init__(self, axes: AxisMap) -> None:
        self.axes = axes
        self.calibration: Calibration | None = None
        self.triads_apart = False
        self._force: FloatArray | None = None  # the last, of a device that sends the triads one by one
        self._gap = True
        self._latest = -np.inf

    def restart(self) -> None:
        """Begin anew after a gap."""
        self._force, self._gap = None, True

    def with_both_triads(self, rows: Rows) -> Rows:
        """Return the rows with rates; those that lack the force get the last one that came by itself."""
        alone = np.isnan(rows["rate"][:, 0])
        if alone.any() and not np.isnan(rows["force"][alone][:, 0]).any():
            self.triads_apart = True
        if not self.triads_apart:
            return rows
        made = np.array(rows)
        last = np.maximum.accumulate(np.where(alone, np.arange(len(made)), -1))
        before = np.full(3, np.nan) if self._force is None else self._force
        forces = np.where((last >= 0)[:, None], made["force"][last], before)
        if alone.any():
            self._force = made["force"][last[-1]].copy()
        lacking = np.isnan(made["force"][:, 0])
        made["force"][lacking] = forces[lacking]
        return np.asarray(made[~alone & ~np.isnan(made["force"][:, 0])])

    def put(self, rows: Rows, times: FloatArray, arrival: float, gap: NDArray[np.bool_]) -> Rows:
        """Return timed rows; those that are not later than all before are dropped."""
        if self._gap:
            gap[0], self._gap = True, False
        kept = increasing(times, self._latest)
        if not kept.all():  # the mapping began anew, or the host cannot tell them apart
            begins = not kept[0]
            rows, times, gap = rows[kept], times[kept], gap[kept]
            if not len(rows):
                self._gap = True
                return NO_IMU
            gap[0] |= begins
        self._latest = float(times[-1])
        made = np.empty(len(rows), TIMED_IMU)
        made["time"], made["arrival"], made["gap"] = times, arrival, gap
        known = self.calibration
        seen = rows if known is None else _calibrate_rows(rows, known, self.axes)
        made["rate"] = self.axes.mapped(seen["rate"])
        made["force"] = self.axes.mapped(seen["force"], force=True)
        made["magnetic"] = self.axes.mapped(seen["magnetic"])
        if known is not None:
            for name in ("rate", "force", "magnetic"):
                made[name] = made[name] @ known.turn.T
        for name in ("temperature", "pressure", "clipped", "end"):
            made[name] = rows[name]
        return made


def _calibrate_rows(rows: Rows, known: Calibration, axes: AxisMap) -> Rows:
    """Return a copy of rows without the errors of a calibration, in the axes of the device."""
    rows = rows.copy()
    if known.gyro is not None:
        rows["rate"] = known.gyro.removed(rows["rate"])
    if known.accelerometer is not None:
        sign = -1.0 if axes.inverted_force else 1.0
        rows["force"] = sign * known.accelerometer.removed(sign * rows["force"])
    if known.magnetometer is not None:
        measured: Flags = np.asarray(
            rows["magnetic"].any(axis=1)
        )  # zero in all axes says that there is no reading
        removed = known.magnetometer.removed(rows["magnetic"] * _MICROTESLA) / _MICROTESLA
        rows["magnetic"] = np.where(measured[:, None], removed, rows["magnetic"])
    return rows


class FixRows:
    """Makes rows of `TIMED_FIX`.

    Attributes
    ----------
    clock : DeviceClock
        Clock of the receiver, if it has its own.
    """

    def __init__(self) -> None:
        self.clock = DeviceClock()
        self._kinds: Counter[int] = Counter()  # of positions
        self._latest = -np.inf

    @property
    def positions(self) -> tuple[str, ...]:
        """What the receiver says of positions that are no usual fixes, in sentences."""
        total = self._kinds.total()
        left_out = {kind: f"not used: {reason}" for kind, reason in UNMEASURED.items()}
        return tuple(
            f"{self._kinds[kind]} of {count_noun(total, 'position')} are {words}."
            for kind, words in (NAMED | left_out).items()
            if self._kinds[kind]
        )

    def timed(self, rows: Rows, arrival: float, imu: DeviceClock, last: float) -> Rows:
        """Return fixes at their times of validity; those without position are left out.

        Parameters
        ----------
        rows : (m,) array of `lab.data.protocols.samples.FIX`
            The fixes.
        arrival
            When they arrived [s].
        imu, last
            The clock of the IMU, and its last time by the device [s].
        """
        rows = rows[np.isfinite(rows["latitude"])]
        self._kinds.update(rows["fix_type"].tolist())
        rows = rows[rows["fix_type"] > NO_FIX]
        if not len(rows):
            return NO_FIXES
        own = rows["time"]
        shared = np.isfinite(own).all() and np.isfinite(imu.offset)
        if shared and abs(own[-1] - last) < LIMITS.stale:
            times = imu.offset + own
        else:
            clock = np.where(np.isfinite(rows["week_time"]), rows["week_time"], rows["utc"])
            if np.isfinite(clock).all() and (np.diff(clock) > 0).all():
                times = self.clock.mapped(np.asarray(clock), arrival)[0] - LIMITS.latency
            else:
                times = np.full(len(rows), arrival) - LIMITS.latency
        kept = increasing(times, self._latest)
        rows, times = rows[kept], times[kept]
        if not len(rows):
            return NO_FIXES
        self._latest = float(times[-1])
        made = np.empty(len(rows), TIMED_FIX)
        made["time"], made["arrival"] = times, arrival
        for name in TIMED_FIX.names or ():
            if name not in ("time", "arrival"):
                made[name] = rows[name]
        return made
