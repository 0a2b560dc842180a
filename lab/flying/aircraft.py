"""Aircraft: the aircraft the pilot can fly, in ``aircraft.toml``: limits, speeds, and gains of the controls.

The models are JSBSim's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lab.base.parameters.toml_file import read_toml


@dataclass(frozen=True)
class Gains:
    """Gains from instruments to controls; the defaults are those of the Cessna 172.

    Attributes
    ----------
    aileron, elevator, rudder : float
        Factors on all deflections: large for weak controls.
    throttle_speed : float
        Throttle per airspeed too low [1/(m/s)].
    throttle_trim : float
        Throttle per second of airspeed too low [1/(m/s)/s].
    throttle_climb : float
        Throttle per rate of climb [1/(m/s)].
    heading : float
        Bank per angle left to turn [rad/rad].
    """

    aileron: float = 1.0
    elevator: float = 1.0
    rudder: float = 1.0
    throttle_speed: float = 0.1
    throttle_trim: float = 0.005
    throttle_climb: float = 0.1
    heading: float = 1.2


@dataclass(frozen=True)
class Aircraft:
    """An aircraft of JSBSim's as the pilot knows it. Speeds are true airspeeds [m/s].

    Attributes
    ----------
    name : str
        Its name in JSBSim.
    title : str
        Its name for people.
    limits : mapping
        Limits of the numbers of a flight plan, by their names, where they are narrower than a manoeuvre's.
    airspeed, rate : float
        Default airspeed and rate of climb [m/s].
    climb_acceleration : float
        Acceleration with which a rate of climb is taken up and off [m/s²].
    slowest : float
        Airspeed below which the pilot lowers the nose.
    stall_alpha, stall_airspeed : float
        Limits beyond which it has stalled [rad], [m/s].
    gains : Gains
        The pilot's gains.
    standing_height_ft : float
        Height of the centre of gravity above the runway at which JSBSim puts it down [ft].
    rotation : float or None
        Airspeed at which it is rotated on take-off; None for one the pilot cannot take off with.
    climb_out : float
        Airspeed of the climb after the take-off.
    climb_out_pitch : float
        Pitch to which it is rotated [rad].
    retracts : bool
        The undercarriage can be raised.
    """

    name: str
    title: str
    limits: Mapping[str, tuple[float, float]]
    airspeed: float
    rate: float
    slowest: float
    stall_airspeed: float
    climb_acceleration: float = 0.5
    stall_alpha: float = math.radians(18.0)
    gains: Gains = field(default_factory=Gains)
    standing_height_ft: float = 4.36
    rotation: float | None = None
    climb_out: float = 0.0
    climb_out_pitch: float = math.radians(8.0)
    retracts: bool = False


def _read_aircraft(name: str, row: Mapping[str, Any]) -> Aircraft:
    """Return an aircraft of the table; a key that ends in ``_deg`` is an angle in degrees."""
    angles = {key: math.radians(row[key]) for key in row if key.endswith("_deg")}
    given = {key: value for key, value in row.items() if key not in angles}
    given |= {key.removesuffix("_deg"): angle for key, angle in angles.items()}
    given["limits"] = {key: tuple(bounds) for key, bounds in row["limits"].items()}
    return Aircraft(name, **given | {"gains": Gains(**row.get("gains", {}))})


AIRCRAFT = {
    name: _read_aircraft(name, row)
    for name, row in read_toml(Path(__file__).with_name("aircraft.toml")).items()
}
"""Every aircraft the pilot flies, by its name in JSBSim."""
