"""Simulator csv: the flight of a simulator whose columns a profile names: motion, rates, accelerations, air.

Position is geodetic, geocentric or Earth-fixed; velocity is over the Earth in n or in b; the acceleration is
given, or made of the derivatives of the velocity in b: u' + q w - r v and so on (Stevens and Lewis 1.5-4).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import (
    GIVEN,
    LIMITS,
    OF_THE_FORMAT,
    SEA_LEVEL,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
    recognised,
    refuse_no_motion,
)
from lab.data.files.profile import Profile
from lab.data.files.table import Required, plain
from lab.data.files.unit_names import UNITS, unit_name
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames import ecef
from lab.motion.frames.rotation import C_nb_from_euler

KINDS = {
    **dict.fromkeys(("time", "own_time"), "time"),
    **dict.fromkeys(
        ("latitude", "geocentric_latitude", "longitude", "roll", "pitch", "yaw", "alpha", "beta"), "angle"
    ),
    **dict.fromkeys(("height", "geodetic_height", "ecef_x", "ecef_y", "ecef_z"), "length"),
    **dict.fromkeys(("north", "east", "down", "up", "airspeed"), "speed"),
    **{f"{name}_{axis}": kind for axis in "xyz" for name, kind in (
        ("velocity", "speed"), ("rate", "angular rate"), ("acceleration", "acceleration"),
        ("velocity_rate", "acceleration"),
    )},
}  # fmt: skip
"""Quantities of simulators and the kinds of their units: x, y, z are forward, right, down. Velocities, their
derivatives, rates and accelerations are over the Earth."""
_KEYS = {"ecef_x": "x", "ecef_y": "y", "ecef_z": "z"}
"""Quantities that `lab.data.files.fields.LIMITS` names otherwise."""
_COLUMN = re.compile(r"(-?)\s*([a-z_]+)\s*\[([^\]]*)\]")
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


@lru_cache(maxsize=64)
def _fields(path: Path, profile: tuple[tuple[str, str], ...], around: tuple[str, str], source: str) -> tuple[
    tuple[Field, ...], dict[str, int], dict[str, str]
]:  # fmt: skip
    """Return the fields of a profile, the sign of each heading, and its other unit if it may have two."""
    fields, signs, others = [], {}, {}
    for heading, text in profile:
        found = _COLUMN.fullmatch(text)
        if found is None or found[2] not in KINDS:
            raise MissionError(
                f"{path}: {heading!r} = {text!r}; accepted is a quantity with its unit, such as -roll[°], of "
                f"{', '.join(KINDS)}"
            )
        kind = KINDS[found[2]]
        unit, _, other = found[3].partition(" or ")
        try:
            unit, other = unit_name(kind, unit), unit_name(kind, other) if other else ""
        except MissionError as error:
            raise MissionError(f"{path}: {heading!r} = {text!r}: {error}") from None
        names = _spellings(heading, *around)
        fields.append(Field(_KEYS.get(found[2], found[2]), names, kind, unit, source or OF_THE_FORMAT))
        for name in names:
            signs[name] = -1 if found[1] else 1
            if other:
                others[name] = other
    return tuple(fields), signs, others


def _spellings(heading: str, prefix: str = "", suffix: str = "") -> tuple[str, ...]:
    """Return what a heading may be, as `lab.data.files.table.plain` gives it."""
    is_path = "/" in heading
    befores = dict.fromkeys((prefix, "") if is_path else ("",))
    afters = dict.fromkeys(("", suffix) if is_path else ("",))
    return tuple(plain(f"{before}{heading}{after}") for before in befores for after in afters)


def check(profile: Profile) -> None:
    """Raise a `MissionError` if a column of a simulator's profile is no quantity with a unit."""
    _of(profile)


def _of(profile: Profile) -> tuple[tuple[Field, ...], dict[str, int], dict[str, str]]:
    around = (profile.prefix, profile.suffix)
    return _fields(profile.path, tuple(profile.columns.items()), around, profile.source)


def _required(profile: Profile) -> Required:
    """Return the headings that a file has to have, and one that no other program writes."""
    around = (profile.prefix, profile.suffix)
    needs = [tuple(name for one in need for name in _spellings(one, *around)) for need in profile.needs]
    if profile.shared:
        common = {plain(one) for one in profile.shared}
        fields = _of(profile)[0]
        own = [name for one in fields for name in one.names if name not in common and one.key != "time"]
        needs.append(tuple(own))
    return needs


def recognises(profile: Profile, head: bytes) -> bool:
    """Return whether a file has the headings of a profile."""
    return recognised(head, _required(profile))


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
    fields, signs, others = _of(profile)
    columns = read_columns(path, fields, units, _required(profile))
    remarks = [*profile.remarks, *_in_other_unit(columns, others)]
    for key, unit in columns.units.items():
        columns.values[key] *= signs[plain(unit.column)]
    place = columns.vector("x", "y", "z")
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


def _in_other_unit(columns: Columns, others: Mapping[str, str]) -> list[str]:
    """Read angles that are too large for radians as degrees, and times with steps of seconds as ms."""
    remarks = []

    def open_ones(keys: Sequence[str]) -> list[str]:
        known = [key for key in keys if key in columns.units and columns.units[key].source != GIVEN]
        return [key for key in known if plain(columns.units[key].column) in others]

    def change(keys: Sequence[str], kind: str) -> None:
        for key in keys:
            unit = others[plain(columns.units[key].column)]
            columns.values[key] *= UNITS[kind][unit] / UNITS[kind][columns.units[key].unit]
            columns.units[key] = replace(columns.units[key], unit=unit, source="guessed")

    for keys in _TOGETHER:
        found = open_ones(keys)
        if any(np.abs(columns.values[key]).max() > _MAX_RADIANS for key in found):
            names = [columns.units[key].column for key in found]
            change(found, "angle")
            remarks.append(f"{', '.join(names)} are taken as degrees: they are too large for radians.")
    if open_ones(["time"]) and _is_milliseconds(columns):
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
