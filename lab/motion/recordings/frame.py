"""Frame: the state of a vehicle at one moment of a flight that is still being flown."""

from __future__ import annotations

from typing import NamedTuple

from lab.base.arrays import FloatArray


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
