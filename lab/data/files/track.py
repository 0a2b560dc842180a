"""Track: the points of a satellite receiver as a flight, with its speed and course where recorded.

Recorded speed and course give the horizontal velocity: a receiver measures them by Doppler, far more
accurately than differences of its rounded positions. If the file has no vertical velocity, it is the slope of
a smooth curve through the heights, as smooth as their noise and quantisation require.

A file may have a second copy of a track, with pressure altitudes as its heights. Converters of IGC files
write both, the pressure altitudes first, since GPX and KML have one height.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import HEIGHTS, LATITUDES, LONGITUDES, MAX_SPEED, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.clock.faults import increasing
from lab.data.rebuild.quantisation import value_step
from lab.data.rebuild.raw_flight import (
    VERTICAL_VELOCITY,
    ColumnUnit,
    Dropped,
    RawFlight,
    Unmeasured,
    list_dropped,
)
from lab.data.rebuild.row_repair import NO_FIX
from lab.data.rebuild.sample_times import prediction_error
from lab.data.rebuild.smoothing import (
    LIVELINESS,
    WIDEST_STEPS,
    best_smoothing,
    smoothing_of_steps,
    smoothing_spline,
)

_OF_PRESSURE = re.compile(r"(?i)pres(?:s|alt)|baro")
"""In the name of a track whose heights are pressure altitudes: PRESALTTRK of GPSBabel, or barometric."""
_MAX_NAME = 40
"""Most characters of a name that are reported: the file is hostile."""
_ZERO = 1e-6
"""Latitude and longitude that are zero but for rounding [°]: a decimetre. Zero is written without a fix."""
_MIN_COURSE_SPEED = 2.0
"""Speed up to which receivers leave the course out, since it is noise [m/s]."""
_STANDSTILL = 0.5
"""Speed below which a vehicle that gives no course stands [m/s]."""
_AMPLIFIED = 1.94**0.5
"""Noise of a sample appears so many times as large in what four neighbours say of it (`prediction_error`)."""
_SIGMA_OF_MEDIAN = 1.4826
"""σ of normal noise over the median of its size."""
_MEASURED = "The velocity is the receiver's."
_SLOPE = (
    "The horizontal velocity is the receiver's speed and course; the vertical one is the slope of a smooth "
    "curve through the heights."
)
_MIN_KNOWN = 0.9
"""Part of the points at which a quantity has to be known to be used: the other points are left out."""


@dataclass(frozen=True, eq=False)
class Track:
    """Points as a file has them, in the order of the file; NaN where unknown.

    Attributes
    ----------
    path : Path
        The file.
    format : str
        Name of the reader.
    time : (n,) array
        Time [s].
    latitude, longitude : (n,) arrays
        Position on WGS-84 [°].
    height : (n,) array
        Height [m].
    speed, course : (n,) arrays
        Speed over ground [m/s], its direction from true north to the east [°].
    lines : (n,) array
        Line of each point, as an editor shows it.
    down : (n,) array or None
        Vertical velocity, positive down, if the file has it [m/s].
    columns : tuple of ColumnUnit
        What the file calls its quantities: latitude, longitude, height, speed, course; in this order.
    euler : (n, 3) array or None
        Roll, pitch, yaw, if the file has them [rad].
    rows_read, dropped, remarks, doubts, vehicle
        As of `RawFlight`, of what came before.
    unmeasured : Mapping
        Masks (n,) of points whose positions are no measurement, by the reason.
    """

    path: Path
    format: str
    time: FloatArray
    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray
    speed: FloatArray
    course: FloatArray
    lines: NDArray[np.int64]
    columns: tuple[ColumnUnit, ...]
    rows_read: int
    dropped: tuple[Dropped, ...] = ()
    remarks: tuple[str, ...] = ()
    vehicle: str = ""
    down: FloatArray | None = None
    doubts: tuple[str, ...] = ()
    unmeasured: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    euler: FloatArray | None = None
    _lost: list[Dropped] = field(default_factory=list, init=False)

    def flight(self) -> RawFlight:
        """Return the flight of the points that can be used.

        Raises
        ------
        MissionError
            If there are too few, saying what is wrong with the others.
        """
        kept = np.ones(len(self.time), dtype=bool)
        self._keep(kept, np.isfinite(self.time), "without a time")
        on_earth = (np.abs(self.latitude) <= LATITUDES[1]) & (np.abs(self.longitude) <= LONGITUDES[1])
        self._keep(kept, on_earth, "without a position on the Earth")
        somewhere = (np.abs(self.latitude) > _ZERO) | (np.abs(self.longitude) > _ZERO)
        self._keep(kept, somewhere, NO_FIX)
        remarks, is_measured = list(self.remarks), False
        down = np.full_like(self.time, np.nan) if self.down is None else self.down
        has_height = self._has_quantity(kept, self.height)
        if has_height:
            believed = (self.height >= HEIGHTS[0]) & (self.height <= HEIGHTS[1])
            self._keep(kept, believed, f"without a height from {HEIGHTS[0]:g} to {HEIGHTS[1]:g} m")
        elif np.isfinite(self.height[kept]).any():
            part = np.isfinite(self.height[kept]).mean()
            remarks.append(
                f"The heights are not used: they are known at {part:.0%} of the points, and less than "
                f"{_MIN_KNOWN:.0%} is too few."
            )
        course = np.where(self.speed < _STANDSTILL, np.nan_to_num(self.course), self.course)
        course = _hold_course(course, self.speed < _MIN_COURSE_SPEED)
        has_velocity = has_height and self._has_quantity(
            kept, np.where(self.speed <= MAX_SPEED, course, np.nan)
        )
        if has_velocity:
            believed = (self.speed >= 0) & (self.speed <= MAX_SPEED) & np.isfinite(course)
            self._keep(kept, believed, "without a speed and a course")
            falls = np.abs(down) <= MAX_SPEED
            is_measured = self._has_quantity(kept, np.where(falls, down, np.nan))
            if is_measured:
                self._keep(kept, falls, "without a vertical velocity")
            remarks.append(_MEASURED if is_measured else _SLOPE)
        elif np.isfinite(self.speed).any():
            why = "they are known at too few points" if has_height else "they are together with heights only"
            remarks.append(f"Speed and course are not used: {why}.")
        whole = None if self.euler is None else np.asarray(np.isfinite(self.euler).all(axis=1))
        has_attitude = whole is not None and bool(kept.any() and whole[kept].mean() >= _MIN_KNOWN)
        if whole is not None and has_attitude:
            self._keep(kept, whole, "without an attitude")
        elif whole is not None and whole.any():
            remarks.append("The attitude is not used: it is known at too few points.")
        if kept.sum() < MIN_SAMPLES:
            raise MissionError(self._too_few(int(kept.sum())))
        velocity = None
        if has_velocity:
            angle, speed = np.radians(course[kept]), self.speed[kept]
            vertical = down[kept] if is_measured else -slope(self.time[kept], self.height[kept])
            velocity = np.stack((speed * np.cos(angle), speed * np.sin(angle), vertical), axis=-1)
        used = (True, True, has_height, has_velocity, has_velocity)
        return RawFlight(
            format=self.format,
            time=self.time[kept],
            latitude=np.radians(self.latitude[kept]),
            longitude=np.radians(self.longitude[kept]),
            height=self.height[kept] if has_height else None,
            velocity_n=velocity,
            euler=self.euler[kept] if self.euler is not None and has_attitude else None,
            rows_read=self.rows_read,
            dropped=(*self.dropped, *self._lost),
            units=tuple(unit for unit, there in zip(self.columns, used, strict=True) if there),
            remarks=tuple(remarks),
            vehicle=self.vehicle,
            made=(VERTICAL_VELOCITY,) if has_velocity and not is_measured else (),
            doubts=self.doubts,
            unmeasured=tuple(
                Unmeasured(reason, rows[kept], int(self.lines[np.argmax(kept & rows)]))
                for reason, rows in self.unmeasured.items()
                if (kept & rows).any()
            ),
        )

    def _keep(self, kept: NDArray[np.bool_], fine: NDArray[np.bool_], reason: str) -> None:
        self._lost.extend(Dropped.of(reason, kept & ~fine, self.lines))
        kept &= fine

    @staticmethod
    def _has_quantity(kept: NDArray[np.bool_], values: FloatArray) -> bool:
        """Return whether a quantity is known at nearly all points."""
        return bool(kept.any() and np.isfinite(values[kept]).mean() >= _MIN_KNOWN)

    def _too_few(self, count: int) -> str:
        why = list_dropped((*self.dropped, *self._lost))
        return (
            f"{self.path}: {count} of {self.rows_read} points can be used{f' ({why})' if why else ''}; "
            f"accepted is a track of at least {MIN_SAMPLES} points with time and position"
        )


def _hold_course(course: FloatArray, slow: NDArray[np.bool_]) -> FloatArray:
    """Return the course; where a slow receiver leaves it out, the last one known, or the first to come."""
    known = np.flatnonzero(np.isfinite(course))
    if not known.size:
        return course
    last = np.maximum(np.searchsorted(known, np.arange(len(course)), side="right") - 1, 0)
    return np.where(slow & ~np.isfinite(course), course[known[last]], course)


def slope(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivative of the smoothing spline through noisy samples, at their times.

    It is as smooth as cross-validation finds best, and at least so smooth that noise and steps of the samples
    make no liveliness that nothing on a vehicle has: λ is their variance over `LIVELINESS`.

    Parameters
    ----------
    time : (n,) array
        Times as stamped [s]; those that do not increase are interpolated.
    values : (n,) array
        Samples, such as heights [m].
    """
    # Time stamps are not repaired yet; the curve needs those that increase.
    forward = increasing(time)
    t, y = time[forward] - time[0], values[forward, None]
    if len(t) < MIN_SAMPLES:
        return np.zeros_like(time)
    noise = 0.0
    if len(t) > MIN_SAMPLES:
        noise = _SIGMA_OF_MEDIAN * float(np.median(np.abs(prediction_error(t, y)))) / _AMPLIFIED
    widest = WIDEST_STEPS**4 * float(np.median(np.diff(t))) ** 3
    try:
        needed = max(
            best_smoothing(t, y), smoothing_of_steps(t, y, value_step(y[:, 0])), noise**2 / LIVELINESS
        )
        spline = smoothing_spline(t, y, min(needed, widest)).derivative()
    except MissionError:  # stamps too uneven for the equations, which time repair cuts later
        spline = smoothing_spline(t, y, 0.0).derivative()
    return np.asarray(spline(np.clip(time - time[0], 0.0, t[-1]))[:, 0])


class _Extent(NamedTuple):
    points: int
    start: float


def pressure_copies(
    names: Mapping[int, str], track: NDArray[np.int64], time: NDArray[np.float64]
) -> dict[int, str]:
    """Return the tracks with pressure altitudes of which the file has a copy with other heights.

    Parameters
    ----------
    names
        Names of tracks, by number.
    track, time : (n,) arrays
        Of each point: the number of its track, and its time [s].

    Returns
    -------
    dict
        A sentence on each, by number of the track.
    """
    numbers, first, counts = np.unique(track, return_index=True, return_counts=True)
    extents = {
        int(number): _Extent(int(count), float(time[at]))
        for number, at, count in zip(numbers, first, counts, strict=True)
    }
    of_pressure = {number for number in extents if _OF_PRESSURE.search(names.get(number, ""))}
    others = {extent for number, extent in extents.items() if number not in of_pressure}
    return {
        number: f"The track {names[number][:_MAX_NAME]} is not used: its heights are pressure altitudes, and "
        "the file has the same track with others."
        for number in sorted(of_pressure)
        if extents[number] in others
    }
