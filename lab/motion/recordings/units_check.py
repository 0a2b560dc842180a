"""Units check: whether a flight's own numbers contradict the units they claim, such as radians for degrees.

The change of the position must equal the integral of the recorded velocity, and the yaw of an aeroplane
must be near its course. A wrong unit violates one of the two by a known factor.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import FOOT, KILOMETRE_PER_HOUR, KNOT, MILE_PER_HOUR
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.ecef import axes, near_pole, position

_LEGS = 200
"""Legs in which the path by position is compared with the path by velocity: the noise of positions averages
out in each, and turns still show. The tests pass from 100 to 400."""
_SHORTEST_PATH = 100.0
"""Shortest path from which its ratio is judged [m]: far beyond the noise of a receiver's positions. The tests
pass from 50 to 200 m."""
_MIN_COURSE_SPEED = 5.0
"""Speed from which the course is compared with the yaw [m/s]: below it, wind and taxiing part them. The tests
pass from 2.5 to 10 m/s."""
_MIN_LIKENESS = 0.9
"""Correlation of the two paths from which their ratio means anything: a wrong unit leaves it at 1."""
_RATIO_OF_SAME_UNITS = (0.8, 1.25)
"""Ratios of the two paths that no wrong unit explains: the nearest of `_VELOCITY_UNITS` is 0.51."""
_RATIO_TOLERANCE = 0.04
"""Relative distance from a unit's factor at which it is named: 10 % part feet per second from km/h."""
_MAX_YAW_OFF_COURSE = np.radians(20.0)
"""Rms angle between yaw and course up to which the yaw is not suspected [rad]: 10 m/s of crosswind at 30
m/s."""
_CLEARLY_BETTER = 1 / 3
"""Part of that angle which has to be left when the numbers are read as radians, to call them radians."""

_VELOCITY_UNITS = {
    KNOT: "knots",
    FOOT: "feet per second",
    KILOMETRE_PER_HOUR: "km/h",
    MILE_PER_HOUR: "miles per hour",
}
"""Units in which a velocity may be recorded by mistake, by their factor to m/s."""


def check_units(where: str, table: FloatArray) -> None:
    """Raise if the numbers of a flight look like other units than their columns say.

    Parameters
    ----------
    where
        Name of the file, for the message.
    table : (n, 10 or more) array
        Time [s], latitude, longitude [°], height [m], velocity north, east, down [m/s], roll, pitch, yaw [°];
        values within their limits and time increasing.

    Raises
    ------
    MissionError
        If positions or attitude look like radians, velocity like another unit, or time like milliseconds.
    """
    _check_position(where, table)
    _check_attitude(where, table)


def _check_position(where: str, table: FloatArray) -> None:
    time, velocity = table[:, 0], table[:, 4:6]
    latitude, longitude = table[:, 1], table[:, 2]
    ratio = _path_ratio(time, np.radians(latitude), np.radians(longitude), velocity)
    if ratio is not None and _RATIO_OF_SAME_UNITS[0] < ratio < _RATIO_OF_SAME_UNITS[1]:
        return
    # Only numbers that would all be proper angles in radians raise a suspicion.
    if np.abs(latitude).max() <= np.pi / 2 and np.abs(longitude).max() <= 2 * np.pi:
        as_radians = _path_ratio(time, latitude, longitude, velocity)
        if as_radians is not None and _is_near(as_radians, 1.0):
            raise MissionError(
                f"{where}, every row, columns latitude_deg and longitude_deg: the numbers look like radians "
                "(their change fits the recorded velocity only then); accepted are degrees"
            )
    if ratio is None:
        return
    for factor, unit in _VELOCITY_UNITS.items():
        if _is_near(ratio, factor):
            raise MissionError(
                f"{where}, every row, columns velocity_north_m_s and velocity_east_m_s: the numbers look "
                f"like {unit} (the position changes {ratio:.3g} times as fast); accepted are m/s"
            )
    if _is_near(ratio, 1e-3):
        raise MissionError(
            f"{where}, every row, column time_s: the numbers look like milliseconds (the position changes "
            "1000 times more slowly than the velocity says); accepted are seconds"
        )


def _path_ratio(
    time: FloatArray, latitude: FloatArray, longitude: FloatArray, velocity: FloatArray
) -> float | None:
    """Return the path by position over the path by velocity, by least squares over legs of the flight.

    None if the aircraft hardly moves, or the two paths are not correlated.
    """
    if near_pole(latitude).any():
        return _path_ratio_near_pole(time, latitude, longitude, velocity)
    legs = np.unique(np.linspace(0, len(time) - 1, min(len(time), _LEGS + 1)).astype(int))
    steps = np.diff(time)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    travelled = running_sums(steps)[legs]
    by_velocity = np.diff(travelled, axis=0)
    middle = (latitude[legs][1:] + latitude[legs][:-1]) / 2
    per_latitude, per_longitude = metres_per_radian(middle, 0.0)
    turn = np.diff(longitude[legs])
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    by_position = np.column_stack([np.diff(latitude[legs]) * per_latitude, turn * per_longitude])
    return _likeness(by_velocity, by_position)


def _path_ratio_near_pole(
    time: FloatArray, latitude: FloatArray, longitude: FloatArray, velocity: FloatArray
) -> float | None:
    """Return the same in Earth-fixed axes: close to a pole north turns along the path."""
    place = np.stack((latitude, longitude, np.zeros_like(latitude)), axis=-1)
    level = np.column_stack((velocity, np.zeros_like(latitude)))
    velocity_e = np.einsum("nij,nj->ni", axes(latitude, longitude), level)
    steps = np.diff(time)[:, None] * (velocity_e[1:] + velocity_e[:-1]) / 2
    legs = np.unique(np.linspace(0, len(time) - 1, min(len(time), _LEGS + 1)).astype(int))
    travelled = running_sums(steps)[legs]
    return _likeness(np.diff(travelled, axis=0), np.diff(position(place)[legs], axis=0))


def _likeness(by_velocity: FloatArray, by_position: FloatArray) -> float | None:
    """Return the ratio of two paths in legs, if they are correlated."""
    power = float(np.sum(by_velocity**2))
    likeness = float(np.sum(by_velocity * by_position))
    if np.sum(np.linalg.norm(by_velocity, axis=1)) < _SHORTEST_PATH:
        return None
    if likeness < _MIN_LIKENESS * np.sqrt(power * float(np.sum(by_position**2))):
        return None
    return likeness / power


def _check_attitude(where: str, table: FloatArray) -> None:
    roll_pitch, yaw = table[:, 7:9], table[:, 9]
    if np.abs(roll_pitch).max() > np.pi or np.abs(yaw).max() > 2 * np.pi:
        return
    moving = np.hypot(table[:, 4], table[:, 5]) > _MIN_COURSE_SPEED
    if moving.sum() < 2:
        return
    course = np.arctan2(table[moving, 5], table[moving, 4])
    off_as_degrees = _rms_angle(np.radians(yaw[moving]) - course)
    off_as_radians = _rms_angle(yaw[moving] - course)
    if off_as_degrees > _MAX_YAW_OFF_COURSE and off_as_radians < _CLEARLY_BETTER * off_as_degrees:
        raise MissionError(
            f"{where}, every row, columns roll_deg, pitch_deg and yaw_deg: the numbers look like radians (no "
            "angle exceeds 2π, and yaw follows the course only when read as radians); accepted are degrees"
        )


def _rms_angle(angle: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.arctan2(np.sin(angle), np.cos(angle)) ** 2)))


def _is_near(ratio: float, factor: float) -> bool:
    return abs(ratio / factor - 1) < _RATIO_TOLERANCE
