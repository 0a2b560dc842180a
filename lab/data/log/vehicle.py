"""Vehicle: the kinds of vehicles, the words that files have for them, and how they move.

References
----------
MAVLink, *Common Message Set*, MAV_TYPE, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

MAV_TYPES: Mapping[float, str] = {
    1: "fixed wing", **dict.fromkeys((2, 3, 4, 13, 14, 15), "rotary wing"), 7: "airship", 8: "balloon",
    9: "rocket", 10: "rover", 11: "boat", 12: "submarine", **dict.fromkeys(range(19, 26), "vtol"),
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
    flight : str
        The vehicle, as of `lab.flying.coordinated_turn.attitude`, whose limits and attitude its flights have.
    words : tuple of str
        Further names for it in files, in lower case: of autopilots, simulators and watches.
    """

    name: str
    sideslip: float
    flight: str
    words: tuple[str, ...] = ()

    @property
    def follows_nose(self) -> bool:
        """Whether it moves where its nose points, so that turns and changes of speed show axes and clock."""
        return bool(self.sideslip <= _MAX_SIDESLIP)

    @property
    def stays_level(self) -> bool:
        """Whether its down axis points down on average, so that gravity shows axes."""
        return self.flight != "rocket"


_MAX_SIDESLIP = np.radians(15.0)
"""σ of heading minus course up to which a vehicle goes where its nose points [rad]: between cars and
boats."""
_VEHICLES = (
    # Wind, sideslip, an IMU not quite straight in its vehicle: 10 m/s of crosswind at 55 m/s are 10°.
    Vehicle("aeroplane", np.radians(10.0), "aircraft", ("fixed wing", "aircraft", "airplane", "glider")),
    Vehicle("car", np.radians(10.0), "car", ("rover", "truck", "vehicle", "driving", "motorcycling", "bus")),
    # A current of 1 m/s across a boat of 2 m/s is 27°.
    Vehicle("boat", np.radians(30.0), "boat", ("ship", "vessel", "boating", "sailing", "rowing", "kayaking")),
    Vehicle(  # vtol: it hovers like one, in all directions
        "copter",
        np.inf,
        "copter",
        ("rotary wing", "vtol", "multirotor", "quadcopter", "quadrotor", "hexacopter"),
    ),
    Vehicle("helicopter", np.inf, "copter"),
    Vehicle("airship", np.inf, "copter", ("blimp", "balloon")),  # they drift in all directions
    Vehicle("submarine", np.inf, "boat"),
    Vehicle("pedestrian", np.inf, "pedestrian", ("walking", "running", "hiking")),
    Vehicle("rocket", np.inf, "rocket"),
)
"""The kinds of vehicles, and σ of heading minus course [rad], each for the reason above it."""
_BY_WORD = {word: one for one in _VEHICLES for word in (one.name, *one.words)}
VEHICLES = tuple(one.name for one in _VEHICLES)
"""Names that are accepted."""


def vehicle_of(name: str) -> Vehicle:
    """Return a kind of vehicle by its name or a word for it; an unknown one for other words."""
    return _BY_WORD.get(name) or Vehicle(UNKNOWN, _VEHICLES[0].sideslip, _VEHICLES[0].flight)


def vehicle_in(text: str) -> Vehicle:
    """Return the kind of vehicle that a text of a file names in whole words; an unknown one without any.

    The name of a type of aircraft, such as Caravan, names none.
    """
    said = f" {' '.join(re.findall('[a-z]+', text.casefold()))} "
    for word, one in _BY_WORD.items():
        if f" {word} " in said:
            return one
    return vehicle_of(UNKNOWN)
