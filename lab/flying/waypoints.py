"""WaypointPlan: a path from point to point as a smooth motion of a car, an aircraft or a boat.

Legs are geodesics. A corner is flown by: the turn begins before the waypoint and ends after it, its rate
builds up smoothly, stays constant (a circle) and decays in the same way, at the speed of the slower of its
two legs. A leg accelerates at its begin and slows down at its end, and its height follows one smooth S.
The vehicle stops at a waypoint with a wait. Attitude is that of a coordinated turn.

Speeds are those over the ellipsoid at height 0; 1 km higher it is 0.016 % more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.flying.coordinated_turn import Vehicle, attitude
from lab.flying.geodesy import geodesic, integral
from lab.flying.manoeuvres import MAX_DURATION
from lab.flying.path_profile import Leg, Turn, profile
from lab.flying.plan_table import LATITUDES, TURNS, choice, number, plain_part, read_part, read_parts
from lab.motion.frames.displacement import longer_above, metres_per_radian
from lab.motion.frames.rotation import wrap
from lab.motion.recordings.recording import Recording

SAMPLE = 0.05
"""Longest time between two samples of the recording [s]."""
MAX_WAYPOINTS = 10_000
"""Most waypoints in one plan."""
SHARPEST = math.radians(150.0)
"""Largest change of course at a waypoint that is not stopped at [rad]. The turn begins before the waypoint by
the radius times the tangent of half of it: 3.7 radii here, 11 at 170°."""

STEEPEST = 0.5
"""Largest slope of a climb or descent, m per m. The steepest street (Baldwin Street, Dunedin) has 0.35, the
climbs of the shipped flights 0.11: more is mostly a wrong unit of the height."""

_MIN_DISTANCE = 1e-3
"""Distance of waypoints below which they are at one place [m]."""
_MIN_SPEED = 0.1
"""Slowest speed at which a leg is travelled [m/s]. A plain choice: it goes 1.4 km within `MAX_DURATION`."""
_MAX_ROUNDS = 80
"""Most rounds of Picard's iteration: the longest paths at the highest latitudes need most."""
_FARTHEST = 1.5
"""Largest latitude in a round [rad]: 86°, where the tangent stays finite until the rounds settle."""
_CONVERGED = 1e-13
"""Change of latitude and course in a round below which they are found [rad]: 1 µm."""
_DEFAULTS = {  # acceleration, lateral acceleration [m/s²], turn rate [rad/s], time to build up a turn [s]
    "aircraft": (1.5, STANDARD_GRAVITY * math.tan(math.radians(25)), math.radians(20), 4.0),
    "car": (2.0, 2.5, math.radians(30), 1.5),
    "boat": (0.5, 0.7, math.radians(6), 4.0),
}


@dataclass(frozen=True)
class Waypoint:
    """A point of the path and how it is passed."""

    latitude_deg: float = number("Latitude", "°", LATITUDES, "Geodetic latitude on WGS-84.")
    longitude_deg: float = number("Longitude", "°", TURNS, "Longitude on WGS-84, east positive.")
    height_m: float = number("Height", "m", (-500, 20_000), "Height above the ellipsoid.")
    speed_m_s: float = number(
        "Speed", "m/s", (0, 350), "Horizontal speed from here on; at the last waypoint, the speed there."
    )
    wait_s: float = number("Wait", "s", (0, MAX_DURATION), "Time to stand still here.", default=0.0)


@dataclass(frozen=True)
class WaypointPlan:
    """A path from point to point."""

    waypoints: tuple[Waypoint, ...]
    vehicle: str = choice(
        "Vehicle", tuple(_DEFAULTS), "An aircraft banks, a car does not, a boat stays level.", default="car"
    )
    acceleration_m_s2: float | None = number(
        "Acceleration",
        "m/s²",
        (0.01, 30),
        "Largest along the path; the vehicle's own by default.",
        default=None,
    )
    lateral_acceleration_m_s2: float | None = number(
        "Lateral acceleration", "m/s²", (0.01, 30), "Largest in a turn; 4.6 is 25° of bank.", default=None
    )
    turn_rate_deg_s: float | None = number("Turn rate", "°/s", (0.1, 180), "Largest in a turn.", default=None)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "flight") -> WaypointPlan:
        """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

        Parameters
        ----------
        values
            ``waypoints``, a list of tables as `Waypoint`; the vehicle and its limits.
        where
            Name of the mapping in messages.

        Raises
        ------
        MissionError
            If a key is unknown or missing, or a value is not accepted.
        """
        values = dict(values)
        parts: dict[str, Any] = {}
        if "waypoints" in values:
            entries, here = values.pop("waypoints"), f"{where}.waypoints"
            parts["waypoints"] = read_parts(Waypoint, entries, here, 2, MAX_WAYPOINTS, "waypoints")
        return read_part(cls, values, where, parts)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data without defaults; `from_dict` restores the plan."""
        return {**plain_part(self), "waypoints": [plain_part(waypoint) for waypoint in self.waypoints]}


def travel(plan: WaypointPlan) -> Recording:
    """Return the motion along the waypoints.

    Raises
    ------
    MissionError
        If waypoints coincide or lie too near each other for their turns and changes of speed, turn back
        too sharply or climb too steeply, or the path takes too long.
    """
    points = plan.waypoints
    distance, course = _geodesics(points)
    turns = [Turn(lasts_still=points[0].wait_s), *_corners(plan, course), Turn(lasts_still=points[-1].wait_s)]
    legs = [_leg(plan, number, length, turns) for number, length in enumerate(distance.tolist())]
    total = sum(leg.lasts for leg in legs) + sum(turn.lasts for turn in turns)
    if not MIN_SAMPLES * SAMPLE <= total <= MAX_DURATION:
        raise MissionError(
            f"the path takes {total:.6g} s; accepted are {MIN_SAMPLES * SAMPLE:g} to {MAX_DURATION:g} s: "
            "change speeds or waypoints"
        )
    time = np.linspace(0.0, total, math.ceil(total / SAMPLE) + 1)
    position, velocity = _over_the_ellipsoid(points[0], time, course[0, 0], *profile(turns, legs, time))
    euler = attitude(time, velocity, cast(Vehicle, plan.vehicle))
    return Recording(time, *position, velocity, euler)


def _geodesics(points: Sequence[Waypoint]) -> tuple[FloatArray, FloatArray]:
    """Return length [m] and course at both ends [rad] of every leg: (n,), (n, 2)."""
    latitude = np.radians([point.latitude_deg for point in points])
    longitude = np.radians([point.longitude_deg for point in points])
    distance, out, arriving = geodesic(latitude[:-1], longitude[:-1], latitude[1:], longitude[1:])
    short = np.flatnonzero(~(distance > _MIN_DISTANCE))
    if short.size:
        first = int(short[0]) + 1
        raise MissionError(
            f"waypoints {first} and {first + 1} are at one place, or opposite each other on the Earth; "
            "accepted are waypoints with one shortest path between them"
        )
    return distance, np.stack((out, arriving), axis=-1)


def _limits(plan: WaypointPlan) -> tuple[float, float, float, float]:
    """Return acceleration, lateral acceleration, turn rate and the time to build up a turn."""
    along, lateral, rate, ramp = _DEFAULTS[plan.vehicle]
    along = along if plan.acceleration_m_s2 is None else plan.acceleration_m_s2
    if plan.lateral_acceleration_m_s2 is not None:
        ramp *= max(1.0, plan.lateral_acceleration_m_s2 / lateral)
        lateral = plan.lateral_acceleration_m_s2
    rate = rate if plan.turn_rate_deg_s is None else math.radians(plan.turn_rate_deg_s)
    return along, lateral, rate, ramp


def _corners(plan: WaypointPlan, course: FloatArray) -> list[Turn]:
    """Return the turns at the waypoints between the first and the last."""
    _, lateral, most, ramp = _limits(plan)
    turns = []
    for number_, change in enumerate(wrap(course[1:, 0] - course[:-1, 1]).tolist(), 1):
        here, speed = plan.waypoints[number_], _corner_speed(plan, number_)
        if here.wait_s:
            turns.append(Turn(change, lasts_still=here.wait_s))
        elif abs(change) > SHARPEST:
            raise MissionError(
                f"waypoint {number_ + 1} turns back by {math.degrees(abs(change)):.0f}°; accepted are up to "
                f"{math.degrees(SHARPEST):.0f}°, or a wait_s there"
            )
        else:
            turns.append(Turn.at_speed(change, speed, min(most, lateral / speed), ramp))
    return turns


def _corner_speed(plan: WaypointPlan, number_: int) -> float:
    """Return the speed at a waypoint, counted from 0."""
    points = plan.waypoints
    if points[number_].wait_s:
        return 0.0
    before = points[max(number_ - 1, 0)].speed_m_s
    return min(before, points[number_].speed_m_s)


def _leg(plan: WaypointPlan, number_: int, distance: float, turns: Sequence[Turn]) -> Leg:
    here, there = plan.waypoints[number_ : number_ + 2]
    between = f"waypoints {number_ + 1} and {number_ + 2}"
    if here.speed_m_s < _MIN_SPEED:
        raise MissionError(
            f"waypoint {number_ + 1}: speed_m_s = {here.speed_m_s:g} leads nowhere; at least {_MIN_SPEED:g}"
        )
    straight = distance - turns[number_].reach - turns[number_ + 1].reach
    speeds = (_corner_speed(plan, number_), _corner_speed(plan, number_ + 1))
    acceleration = _limits(plan)[0]
    leg = Leg.between(straight, speeds, here.speed_m_s, acceleration, (here.height_m, there.height_m))
    if leg is None:
        raise MissionError(
            f"{between} are {distance:.0f} m apart, too near for the turns ({distance - straight:.0f} m) "
            "and the change of speed between them: move them apart, or ask for less speed or wider limits"
        )
    if leg.steepest > STEEPEST:
        raise MissionError(
            f"the path between {between} climbs or descends by {leg.steepest:.2g} m per m; accepted is up to "
            f"{STEEPEST:g}"
        )
    return leg


def _over_the_ellipsoid(
    first: Waypoint,
    time: FloatArray,
    course: float,
    speed: FloatArray,
    turned: FloatArray,
    height: FloatArray,
    climb: FloatArray,
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], FloatArray]:
    """Return latitude, longitude and height, and velocity (n, 3), by Picard's iteration.

    Along a geodesic the course changes by the change of longitude times sin(latitude) (Clairaut's relation,
    differentiated).
    """
    start = math.radians(first.latitude_deg)
    latitude, bearing = np.full_like(time, start), course + turned
    for _ in range(_MAX_ROUNDS):
        per_latitude, per_longitude = metres_per_radian(latitude, 0.0)
        turning = integral(time, speed * np.sin(bearing) / per_longitude * np.sin(latitude))
        there = start + integral(time, speed * np.cos(bearing) / per_latitude)
        changes = np.abs(there - latitude).max(), np.abs(course + turned + turning - bearing).max()
        latitude, bearing = np.clip(there, -_FARTHEST, _FARTHEST), course + turned + turning
        if max(changes) < _CONVERGED:
            break
    _, per_longitude = metres_per_radian(latitude, 0.0)
    north, east = speed * np.cos(bearing), speed * np.sin(bearing)
    longitude = wrap(math.radians(first.longitude_deg) + integral(time, east / per_longitude))
    more_north, more_east = longer_above(latitude, height)
    velocity = np.stack((north * more_north, east * more_east, -climb), axis=-1)
    return (latitude, longitude, height), velocity
