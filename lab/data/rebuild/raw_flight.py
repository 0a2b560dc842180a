"""RawFlight: a flight as recorded, in SI units and the lab's axes, before any repair."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError

JUDGED_SAMPLES = 20_000
"""Samples by which a longer recording is judged: enough for every statistic taken, quick whatever its
length."""
_MIN_OWN_SAMPLES = 8
"""Fewest samples that a quantity recorded at a lower rate has of its own: a spline and its roughness need
some beyond the four of `lab.base.files.bounds.MIN_SAMPLES`."""


@dataclass(frozen=True)
class Dropped:
    """Rows of a file that were left out.

    Attributes
    ----------
    reason : str
        Why, in words that follow a number of rows: "cells missing", "a second recording".
    count : int
        How many rows.
    first_row : int
        The first of them: the line number an editor shows, or the number of the message in a binary log.
    """

    reason: str
    count: int
    first_row: int

    @classmethod
    def of(
        cls, reason: str, lost: Flags, rows: Sequence[int] | NDArray[Any] | None = None
    ) -> tuple[Self, ...]:
        """Return the report on rows (n,) that are lost; nothing if none is.

        Parameters
        ----------
        reason
            Why.
        lost : (n,) array
            Which rows are left out.
        rows : (n,) array, optional
            Their numbers; from 1 by default.
        """
        if not lost.any():
            return ()
        first = int(np.argmax(lost))
        return (cls(reason, int(lost.sum()), first + 1 if rows is None else int(rows[first])),)


def list_dropped(dropped: Iterable[Dropped]) -> str:
    """Return what was left out, in words."""
    return "; ".join(f"{one.count} from row {one.first_row} on: {one.reason}" for one in dropped)


@dataclass(frozen=True)
class ColumnUnit:
    """The unit a column of a file was read in.

    Attributes
    ----------
    column : str
        Name of the column as in the file.
    unit : str
        Its unit, as `lab.data.files.unit_names` spells it.
    source : str
        How it is known: "named in the file", "of the format", "guessed", "given by you".
    """

    column: str
    unit: str
    source: str


@dataclass(frozen=True)
class Reset:
    """An instant at which the estimator of an autopilot jumped to another solution.

    Attributes
    ----------
    time : float
        The source's clock at the first sample after it [s].
    change : str
        What jumped and how far: "the heading by 47°".
    """

    time: float
    change: str


@dataclass(frozen=True, eq=False)
class Unmeasured:
    """Samples whose positions are no measurement, as their source says itself.

    Attributes
    ----------
    reason : str
        Why, as of `Dropped`.
    rows : (n,) array
        The mask of them.
    first_row : int
        As of `Dropped`.
    """

    reason: str
    rows: NDArray[np.bool_]
    first_row: int


VERTICAL_VELOCITY = "vertical velocity"
"""What `RawFlight.made` says where the vertical velocity is the slope of the heights."""


@dataclass(frozen=True, eq=False, repr=False)
class RawFlight:
    """A flight as read, with the time stamps of its source. Arrays are read-only and finite.

    Time stamps may repeat, run backwards or lie on a coarse grid: `lab.data.rebuild` repairs them.

    Attributes
    ----------
    format : str
        Name of the format, as its reader has it.
    time : (n,) array
        The source's own clock [s].
    latitude, longitude : (n,) arrays or None
        Geodetic position on WGS-84 [rad].
    height : (n,) array or None
        Height above the ellipsoid, or above the sea where the file has no other [m].
    velocity_n : (n, 3) array or None
        Velocity over the Earth, north, east, down [m/s].
    euler : (n, 3) array or None
        Roll, pitch, yaw (true heading) [rad].
    body_rate : (n, 3) array or None
        Recorded angular rate of the body over the Earth, forward, right, down [rad/s]: to check with.
    acceleration_b : (n, 3) array or None
        Recorded acceleration over the Earth (no gravity in it), forward, right, down [m/s²]: to check with.
    airspeed, alpha, beta : (n,) arrays or None
        True airspeed [m/s], angle of attack, sideslip [rad].
    rows_read : int
        Rows of samples in the file.
    dropped : tuple of Dropped
        Which of them were left out, and why.
    units : tuple of ColumnUnit
        The unit of every column that was used.
    remarks : tuple of str
        Further remarks, as whole sentences.
    vehicle : str
        The vehicle, if the file states it.
    rates : tuple of (str, float)
        What the file has less often than its samples, such as "velocity", and how often [Hz]: it is
        interpolated.
    made : tuple of str
        What the reader made of other quantities: "vertical velocity", the slope of the heights.
    resets : tuple of Reset
        Where the solution jumps though nothing moved like that.
    unmeasured : tuple of Unmeasured
        Samples that `measured` leaves out.
    doubts : tuple of str
        Why the source itself does not stand for the flight, as whole sentences.
    """

    format: str
    time: FloatArray
    latitude: FloatArray | None = None
    longitude: FloatArray | None = None
    height: FloatArray | None = None
    velocity_n: FloatArray | None = None
    euler: FloatArray | None = None
    body_rate: FloatArray | None = None
    acceleration_b: FloatArray | None = None
    airspeed: FloatArray | None = None
    alpha: FloatArray | None = None
    beta: FloatArray | None = None
    rows_read: int = 0
    dropped: tuple[Dropped, ...] = ()
    units: tuple[ColumnUnit, ...] = ()
    remarks: tuple[str, ...] = ()
    vehicle: str = ""
    rates: tuple[tuple[str, float], ...] = ()
    made: tuple[str, ...] = ()
    resets: tuple[Reset, ...] = ()
    unmeasured: tuple[Unmeasured, ...] = ()
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.quantities:
            value = getattr(self, name)
            # Another flight's arrays need no copy, because they are read-only.
            own = value.dtype == np.float64 and value.flags.c_contiguous and value.base is None
            if value.flags.writeable or not own:
                value = np.array(value, dtype=np.float64, order="C")
            if len(value) != len(self.time) or not np.isfinite(value).all():
                raise ValueError(f"{name}: {len(value)} values, not all finite or not {len(self.time)}")
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @property
    def position(self) -> FloatArray | None:
        """Latitude, longitude [rad] and height [m] (n, 3), zero without heights; None without positions."""
        if self.latitude is None or self.longitude is None:
            return None
        height = np.zeros_like(self.latitude) if self.height is None else self.height
        return np.stack((self.latitude, self.longitude, height), axis=-1)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the arrays the file has."""
        return tuple(
            name for name in self.__dataclass_fields__ if isinstance(getattr(self, name), np.ndarray)
        )

    def every(self, name: str) -> int:
        """Return every how many samples the file has a quantity, 1 unless `rates` names it."""
        if len(self.time) < _MIN_OWN_SAMPLES or name not in dict(self.rates):
            return 1
        own = float(np.median(np.diff(self.time))) * dict(self.rates)[name]
        return int(max(1, min(round(1 / own) if own > 0 else 1, len(self.time) // _MIN_OWN_SAMPLES)))

    def __repr__(self) -> str:
        return f"<RawFlight {self.format}: {len(self.time)} samples of {', '.join(self.quantities)}>"

    def rows(
        self, kept: NDArray[np.bool_] | NDArray[np.intp], dropped: tuple[Dropped, ...] = ()
    ) -> RawFlight:
        """Return the flight with some of its rows only.

        Parameters
        ----------
        kept
            Which rows, as a mask or as indices in order.
        dropped
            The reasons for leaving out the others, added to the earlier ones.
        """
        arrays: dict[str, Any] = {name: getattr(self, name)[kept] for name in self.quantities}
        for array in arrays.values():
            array.setflags(write=False)
        unmeasured = tuple(replace(one, rows=one.rows[kept]) for one in self.unmeasured)
        return replace(self, **arrays, dropped=(*self.dropped, *dropped), unmeasured=unmeasured)

    def measured(self) -> RawFlight:
        """Return the flight without the samples whose positions are no measurement.

        Raises
        ------
        MissionError
            If there are too few others.
        """
        if not self.unmeasured:
            return self
        lost = np.any([one.rows for one in self.unmeasured], axis=0)
        dropped = tuple(Dropped(one.reason, int(one.rows.sum()), one.first_row) for one in self.unmeasured)
        if (~lost).sum() < MIN_SAMPLES:
            raise MissionError(
                f"{(~lost).sum()} of {len(lost)} positions are measured ({list_dropped(dropped)}); "
                "accepted are at "
                f"least {MIN_SAMPLES}. --set positions=all, or Positions on the page, keeps the others"
            )
        return replace(self.rows(~lost, dropped), unmeasured=())

    def with_all_positions(self) -> RawFlight:
        """Return the flight with all samples, and a doubt for those whose positions are no measurement."""
        kept = (
            f"{int(one.rows.sum())} of {len(one.rows)} positions are kept that are {one.reason}."
            for one in self.unmeasured
        )
        return replace(self, unmeasured=(), doubts=(*self.doubts, *kept))
