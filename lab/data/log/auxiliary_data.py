"""Auxiliary data: vehicle, magnetometer, headings and other solutions in a log of IMU and GPS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from lab.base.aid_table import SERIES
from lab.base.arrays import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Timed:
    """Values with times.

    Attributes
    ----------
    time : (k,) array
        Times, increasing [s].
    """

    time: FloatArray

    def later(self, seconds: float) -> Self:
        """Return the same with later times."""
        return replace(self, time=self.time + seconds)


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Timed):
    """The solution of a better system, used as reference.

    Attributes
    ----------
    position : (k, 3) array
        Latitude, longitude [rad], height [m]; NaN where unknown.
    velocity_n : (k, 3) array
        Velocity north, east, down [m/s]; NaN where unknown.
    euler : (k, 3) array
        Roll, pitch, yaw [rad]; NaN where unknown.
    """

    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Reference):
    """The solution of another estimator, such as the autopilot's, from the same sensors: it is no truth.

    Attributes
    ----------
    name : str
        Name, such as "PX4 EKF2".
    """

    name: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Magnetometer(Timed):
    """The measured magnetic field, hard iron removed as far as it is known.

    Attributes
    ----------
    field : (k, 3) array
        Field in b: forward, right, down [µT].
    declination : float
        Magnetic declination, positive east [rad]; NaN where the log does not state it.
    """

    field: FloatArray
    declination: float = np.nan


@dataclass(frozen=True, eq=False, repr=False)
class Headings(Timed):
    """Measured headings, such as those of a receiver with two antennas.

    Attributes
    ----------
    heading : (k,) array
        True heading [rad].
    sigma : (k,) array
        σ [rad]; NaN where unknown.
    """

    heading: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Series(Timed):
    """What a sensor with one number measured: such as a barometer's heights [m].

    Attributes
    ----------
    value : (k,) array
        Readings.
    """

    value: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class AuxiliaryData:
    """Data of a log in addition to IMU and GPS.

    Attributes
    ----------
    vehicle : str
        Name of the vehicle, one of `lab.data.log.vehicle.VEHICLES`, or an autopilot's word for it; empty
        where nobody named it.
    forward_assumed : bool
        Whether it is only assumed which axis of the IMU points forward. The course is then no safe heading.
    magnetometer : Magnetometer or None
        The magnetometer.
    headings : Headings or None
        Headings as measured.
    barometer, odometer, airspeed : Series or None
        Heights by pressure [m], speeds forward, and true airspeeds [m/s].
    further : dict of Series
        Readings of the further sensors of the aid table, by name, in SI units.
    comparisons : tuple of Comparison
        Other solutions.
    """

    vehicle: str = ""
    magnetometer: Magnetometer | None = None
    headings: Headings | None = None
    barometer: Series | None = None
    odometer: Series | None = None
    airspeed: Series | None = None
    comparisons: tuple[Comparison, ...] = ()
    forward_assumed: bool = False
    further: Mapping[str, Series] = field(default_factory=dict)

    @classmethod
    def of_series(cls, series: Mapping[str, Series], **others: Any) -> Self:
        """Return auxiliary data with readings by the names of the aid table, and the other attributes."""
        own = {one.name for one in fields(cls)}
        named: dict[str, Any] = {name: one for name, one in series.items() if name in own}
        further = {name: one for name, one in series.items() if name not in own}
        return cls(**named, **others, further=further)

    @property
    def series(self) -> dict[str, Series]:
        """What sensors with one number measured, by the names of the aid table."""
        found = {aid.name: getattr(self, aid.name, self.further.get(aid.name)) for aid in SERIES}
        return {name: one for name, one in found.items() if one is not None}

    def later(self, seconds: float) -> AuxiliaryData:
        """Return the same with later times."""
        return self.of_series(
            {name: one.later(seconds) for name, one in self.series.items()},
            vehicle=self.vehicle,
            magnetometer=self.magnetometer and self.magnetometer.later(seconds),
            headings=self.headings and self.headings.later(seconds),
            comparisons=tuple(one.later(seconds) for one in self.comparisons),
            forward_assumed=self.forward_assumed,
        )

    def named(self, vehicle: str) -> AuxiliaryData:
        """Return the same with another vehicle."""
        return replace(self, vehicle=vehicle)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is held."""
        return all(getattr(self, one.name) in (None, "", (), {}) for one in fields(self))
