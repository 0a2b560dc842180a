"""Simulator csv: the flight of a simulator whose columns a profile names: motion, rates, accelerations, air.

Position is geodetic, geocentric or Earth-fixed; velocity is over the Earth in n or in b; the acceleration is
given, or made of the derivatives of the velocity in b: u' + q w - r v and so on (Stevens and Lewis 1.5-4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import SEA_LEVEL, one_file
from lab.data.files.profile import Profile
from lab.data.files.unit_names import UNITS
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.data.sheets.flight_columns import (
    LIMITS,
    Columns,
    raw_flight,
    read_columns,
    refuse_no_motion,
)
from lab.motion.frames import ecef
from lab.motion.frames.rotation import C_nb_from_euler

_TOGETHER = (("geocentric_latitude", "longitude"), ("roll", "pitch", "yaw"), ("alpha", "beta"))
"""Angles that are in one unit where their headings do not name it."""
_MAX_RADIANS = 6.3
"""Largest angle that may be in radians where the heading names no unit: a full turn, rounded up."""
_MAX_SPEED = 400.0
"""Median speed up to which a time counts in milliseconds [m/s]: some aircraft fly faster, but not half of a
flight."""
_MIN_MILLISECONDS = 5.0
"""Median step of the time from which it may be in milliseconds: nobody logs a sample in five seconds, and no
logger 200 a second."""
_MIN_MOVED = 1e-6
"""Change of latitude or longitude from which the aircraft moves [rad]: 6 m."""
_MIN_TICKING = 0.9
"""Part of the computer's time stamps with which the simulator's clock has to step, to be used."""
_RATE_OF_CLOCKS = (0.5, 2.0)
"""Rates of the simulator's clock, relative to the computer's, at which it is used: faster or slower, it
counts in another unit or the simulation was accelerated."""


def read(profile: Profile, paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the csv of a simulator.

    Parameters
    ----------
    profile
        What its columns are.
    paths
        The file.
    units
        Units that overrule those of the profile, by column.

    Raises
    ------
    MissionError
        For whatever is wrong with the file; if it has no motion, naming what to record.
    """
    path = one_file(paths, profile.name)
    columns = read_columns(path, profile, units)
    remarks = _in_other_unit(columns)
    place = columns.vector("ecef_x", "ecef_y", "ecef_z")
    if place is not None:
        for key, value in zip(("latitude", "longitude", "height"), ecef.geodetic(place).T, strict=True):
            columns.values[key] = value
            columns.units.pop(key, None)
    elif columns.get("geodetic_height") is not None:
        columns.values["height"] = columns.values["geodetic_height"]
        columns.units["height"] = columns.units.pop("geodetic_height")
    remarks += _geocentric(columns)
    remarks += [SEA_LEVEL] if profile.sea_level and "height" in columns.values else []
    euler = columns.vector("roll", "pitch", "yaw")
    velocity_n, told = _velocity(columns, euler)
    time, clock = _time(profile, columns)
    rate = columns.vector("rate_x", "rate_y", "rate_z")
    flight = raw_flight(
        profile.name,
        columns,
        time=time,
        velocity_n=velocity_n,
        euler=euler,
        body_rate=None if told and rate is not None and not rate.any() else rate,
        acceleration_b=_acceleration(columns),
        remarks=[*remarks, *told, *clock],
    )
    refuse_no_motion(path, flight, profile.advice)
    return flight if place is None else _near_the_earth(path, flight, columns)


def _in_other_unit(columns: Columns) -> list[str]:
    """Read angles that are too large for radians as degrees, and times with steps of seconds as ms."""
    remarks = []

    def change(keys: Sequence[str], kind: str) -> None:
        for key in keys:
            unit = columns.others[key]
            columns.values[key] *= UNITS[kind][unit] / UNITS[kind][columns.units[key].unit]
            columns.units[key] = replace(columns.units[key], unit=unit, source="guessed")

    for keys in _TOGETHER:
        found = [key for key in keys if key in columns.others]
        if any(np.abs(columns.values[key]).max() > _MAX_RADIANS for key in found):
            names = [columns.units[key].column for key in found]
            change(found, "angle")
            remarks.append(f"{', '.join(names)} are taken as degrees: they are too large for radians.")
    if "time" in columns.others and _is_milliseconds(columns):
        change(["time"], "time")
        remarks.append("The time is taken as milliseconds, by the speed that results.")
    return remarks


def _is_milliseconds(columns: Columns) -> bool:
    """Return whether time is in whole numbers, and steps of seconds would be too long."""
    time = columns.values["time"]
    step = float(np.median(np.abs(np.diff(time))))
    if step < _MIN_MILLISECONDS or (time % 1).any() or not {"latitude", "longitude"} <= set(columns.values):
        return False
    place = np.column_stack((columns.values["latitude"], columns.values["longitude"], 0 * time))
    distance = float(np.median(np.linalg.norm(np.diff(ecef.position(place), axis=0), axis=1)))
    return distance <= _MAX_SPEED * step * UNITS["time"]["ms"]


def _geocentric(columns: Columns) -> list[str]:
    """Use a geocentric latitude where there is no other."""
    latitude = columns.values.pop("geocentric_latitude", None)
    unit = columns.units.pop("geocentric_latitude", None)
    if latitude is None or unit is None or "latitude" in columns.values:
        return []
    columns.values["latitude"], columns.units["latitude"] = latitude, unit
    return [
        "The latitude is geocentric but used as geodetic: the flight is displaced by up to 21 km along the "
        "meridian, and otherwise unchanged."
    ]


def _velocity(columns: Columns, euler: FloatArray | None) -> tuple[FloatArray | None, list[str]]:
    """Return the velocity in n, given so or in b, and a report."""
    found = columns.vector("north", "east", "down")
    if found is None:
        found = columns.vector("north", "east", "-up")
    velocity_b = columns.vector("velocity_x", "velocity_y", "velocity_z")
    if found is not None or velocity_b is None or euler is None:
        return found, []
    place = columns.vector("latitude", "longitude")
    moves = place is not None and bool((np.ptp(place, axis=0) > _MIN_MOVED).any())
    # Tools that write a format for others to replay fill what they do not have with zeros.
    if not velocity_b.any() and moves:
        return None, ["The velocities are all zero although the aircraft moves: they are not used."]
    return np.einsum("nij,nj->ni", C_nb_from_euler(euler), velocity_b), []


def _time(profile: Profile, columns: Columns) -> tuple[FloatArray, list[str]]:
    """Return the time of the rows: of the simulator's own clock if it runs, and else of the computer's."""
    own, computer = columns.get("own_time"), columns.values["time"]
    if own is not None:
        elapsed, on_computer = own[-1] - own[0], computer[-1] - computer[0]
        steps = len(np.unique(own)) > _MIN_TICKING * len(np.unique(computer))
        runs = _RATE_OF_CLOCKS[0] * on_computer < elapsed < _RATE_OF_CLOCKS[1] * on_computer
        columns.units.pop("time" if steps and runs else "own_time")
        if steps and runs:
            return own - own[0], []  # what it counts from has no use here
    return computer, [profile.without_own_time] if profile.without_own_time else []


def _acceleration(columns: Columns) -> FloatArray | None:
    """Return the change of velocity over the Earth, in b."""
    given = columns.vector("acceleration_x", "acceleration_y", "acceleration_z")
    derivative = columns.vector("velocity_rate_x", "velocity_rate_y", "velocity_rate_z")
    rate = columns.vector("rate_x", "rate_y", "rate_z")
    velocity = columns.vector("velocity_x", "velocity_y", "velocity_z")
    if given is not None or derivative is None or rate is None or velocity is None:
        return given
    return derivative + np.cross(rate, velocity)


def _near_the_earth(path: Path, flight: RawFlight, columns: Columns) -> RawFlight:
    """Leave out the rows whose Cartesian position is where no flight is, such as at the Earth's centre."""
    low, high = LIMITS["length"]
    height = columns.values["height"]
    kept = (height >= low) & (height <= high)
    if kept.all():
        return flight
    reason = f"Earth-fixed position at heights beyond {low:g} to {high:g} m, which is what a flight can have"
    lost = Dropped(reason, int((~kept).sum()), int(columns.lines[np.argmin(kept)]))
    if kept.sum() < MIN_SAMPLES:
        raise MissionError(
            f"{path}: {kept.sum()} of {columns.rows_read} rows of samples can be used ({lost.count} from row "
            f"{lost.first_row} on: {reason}); accepted are at least {MIN_SAMPLES}. If the unit of a column "
            "is another one, give it"
        )
    return flight.rows(kept, (lost,))
