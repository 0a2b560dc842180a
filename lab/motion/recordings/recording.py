"""Recording: the data of a flight recording from any file or simulator, and of one moment of a flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A flight as recorded: samples in time of position, velocity and attitude. Arrays are read-only.

    Attributes
    ----------
    time : (n,) array
        Recorder's own time, strictly increasing [s].
    latitude, longitude : (n,) arrays
        Geodetic position on WGS-84 [rad].
    height : (n,) array
        Height above the ellipsoid [m].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    euler : (n, 3) array
        Roll, pitch, yaw (true heading) [rad].
    airspeed, alpha, beta : (n,) arrays or None
        True airspeed [m/s], angle of attack [rad], sideslip [rad], where recorded.
    """

    time: FloatArray
    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray
    velocity_n: FloatArray
    euler: FloatArray
    airspeed: FloatArray | None = None
    alpha: FloatArray | None = None
    beta: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if value is not None:
                # A copy: the caller's own array stays writable.
                value = np.array(value, dtype=np.float64, order="C")
                value.setflags(write=False)
                object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"<Recording: {len(self.time)} samples in {self.duration:.3f} s>"

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def position(self) -> FloatArray:
        """Latitude, longitude [rad] and height [m], (n, 3)."""
        return np.stack((self.latitude, self.longitude, self.height), axis=-1)


class Frame(NamedTuple):
    """The state of a vehicle at a moment.

    Attributes
    ----------
    time : float
        Time of the flight [s].
    position : (3,) array
        Latitude, longitude [rad], height [m].
    velocity_n : (3,) array
        North, east, down [m/s].
    euler : (3,) array
        Roll, pitch, yaw [rad].
    """

    time: float
    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray
