"""Vehicle: the kinds of vehicles, and how close their course is to their heading.

References
----------
MAVLink, *Common Message Set*, MAV_TYPE, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

MAV_TYPES: Mapping[float, str] = {
    1: "fixed wing", **dict.fromkeys((2, 3, 4, 13, 14, 15), "rotary wing"), 7: "airship", 8: "balloon",
    10: "rover", 11: "boat", 12: "submarine", **dict.fromkeys(range(19, 26), "vtol"),
}  # fmt: skip
"""Words for the vehicle by the number that MAVLink, and the autopilots that speak it, have for it
(MAV_TYPE)."""
UNKNOWN = ""
"""Name of an unknown vehicle."""


class Vehicle(NamedTuple):
    """A kind of vehicle.

    Attributes
    ----------
    name : str
        As written in ``log.toml`` and settings; empty where unknown.
    sideslip : float
        σ of heading minus course in motion [rad]; infinite if the course does not show the heading.
    """

    name: str
    sideslip: float

    @property
    def follows_nose(self) -> bool:
        """Whether it moves where its nose points, so that turns and changes of speed show axes and clock."""
        return bool(self.sideslip <= _MAX_SIDESLIP)


_MAX_SIDESLIP = np.radians(15.0)
"""σ of heading minus course up to which a vehicle goes where its nose points [rad]: between cars and
boats."""
_VEHICLES = (
    # Wind, sideslip, an IMU not quite straight in its vehicle: 10 m/s of crosswind at 55 m/s are 10°.
    Vehicle("aeroplane", np.radians(10.0)),
    Vehicle("car", np.radians(10.0)),
    # A current of 1 m/s across a boat of 2 m/s is 27°.
    Vehicle("boat", np.radians(30.0)),
    Vehicle("copter", np.inf),
    Vehicle("helicopter", np.inf),
    Vehicle("airship", np.inf),
    Vehicle("submarine", np.inf),
    Vehicle("pedestrian", np.inf),
)
"""The kinds of vehicles, and σ of heading minus course [rad], each for the reason above it."""
VEHICLES = tuple(one.name for one in _VEHICLES)
"""Names that are accepted."""

_WORDS = {
    "fixed wing": "aeroplane",
    "aircraft": "aeroplane",
    "rotary wing": "copter",
    "vtol": "copter",  # it hovers like one, in all directions
    "rover": "car",
    "blimp": "airship",
}


def vehicle_of(name: str) -> Vehicle:
    """Return a kind of vehicle by its name or an autopilot's word for it; an unknown one for other words."""
    name = _WORDS.get(name, name)
    for one in _VEHICLES:
        if one.name == name:
            return one
    return Vehicle(UNKNOWN, _VEHICLES[0].sideslip)
