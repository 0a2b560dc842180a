"""Aircraft: the aircraft the pilot can fly: limits, speeds, and gains of the controls.

The models are JSBSim's own. Limits are what the pilot flew in calm air and in turbulence of severity 2, as
`tests/flying/test_aircraft.py` does again; they are not those of the real aircraft's handbook.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


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


# Where the limits come from, the docstring of the file says; tests/flying/test_aircraft.py flies them again.
_ALL = (
    Aircraft(
        name="c172p",
        title="Cessna 172P",
        limits={
            "airspeed_m_s": (33, 58),
            "rate_m_s": (0.2, 5),
            "height_m": (30, 3500),
            "bank_deg": (5, 40),
            "rotation_m_s": (24, 36),
        },
        airspeed=40.0,
        rate=3.3,
        slowest=32.0,
        stall_airspeed=22.0,
        rotation=28.3,
        climb_out=38.0,
    ),
    Aircraft(
        name="J3Cub",
        title="Piper J-3 Cub",
        limits={
            "airspeed_m_s": (24, 36),
            "rate_m_s": (0.2, 1.5),
            "height_m": (30, 1500),
            "bank_deg": (5, 30),
            "rotation_m_s": (18, 24),
        },
        airspeed=28.0,
        rate=1.0,
        slowest=21.0,
        stall_airspeed=15.0,
        gains=Gains(
            aileron=0.7,
            elevator=1.6,
            rudder=0.6,
            throttle_speed=0.12,
            throttle_trim=0.015,
            throttle_climb=0.12,
            heading=1.0,
        ),
        standing_height_ft=4.2,
        rotation=20.0,
        climb_out=26.0,
        climb_out_pitch=math.radians(9.0),
    ),
    Aircraft(
        name="t6texan2",
        title="Beechcraft T-6 Texan II",
        limits={
            "airspeed_m_s": (70, 140),
            "rate_m_s": (0.2, 12),
            "height_m": (30, 5000),
            "bank_deg": (5, 60),
            "rotation_m_s": (45, 60),
        },
        airspeed=90.0,
        rate=6.0,
        climb_acceleration=1.0,
        slowest=62.0,
        stall_airspeed=45.0,
        gains=Gains(
            aileron=0.3,
            elevator=1.2,
            rudder=0.6,
            throttle_speed=0.06,
            throttle_trim=0.006,
            throttle_climb=0.04,
            heading=1.8,
        ),
        standing_height_ft=6.2,
        rotation=48.0,
        climb_out=75.0,
        retracts=True,
    ),
    Aircraft(
        name="T37",
        title="Cessna T-37",
        limits={
            "airspeed_m_s": (75, 170),
            "rate_m_s": (0.2, 12),
            "height_m": (30, 6000),
            "bank_deg": (5, 45),
            "rotation_m_s": (45, 65),
        },
        airspeed=100.0,
        rate=6.0,
        climb_acceleration=1.0,
        slowest=70.0,
        stall_airspeed=50.0,
        gains=Gains(
            aileron=0.3,
            elevator=1.4,
            rudder=0.8,
            throttle_speed=0.05,
            throttle_trim=0.003,
            throttle_climb=0.04,
            heading=1.8,
        ),
        standing_height_ft=1.8,
        rotation=50.0,
        climb_out=80.0,
        retracts=True,
    ),
    Aircraft(
        name="737",
        title="Boeing 737",
        limits={
            "airspeed_m_s": (110, 240),
            "rate_m_s": (0.2, 12),
            "height_m": (30, 9000),
            "bank_deg": (5, 40),
            "rotation_m_s": (75, 90),
        },
        airspeed=140.0,
        rate=8.0,
        climb_acceleration=1.0,
        slowest=100.0,
        stall_airspeed=75.0,
        gains=Gains(
            aileron=0.7,
            elevator=2.0,
            rudder=0.8,
            throttle_speed=0.04,
            throttle_trim=0.003,
            throttle_climb=0.025,
            heading=2.0,
        ),
        standing_height_ft=4.0,
        rotation=80.0,
        climb_out=110.0,
        retracts=True,
    ),
)

AIRCRAFT: dict[str, Aircraft] = {aircraft.name: aircraft for aircraft in _ALL}
"""Every aircraft the pilot flies, by Its name in JSBSim."""
