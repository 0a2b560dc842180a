"""JSBSim csv: the file of an output directive of type CSV, with groups and properties.

Latitude comes from the geodetic column or from Earth-fixed Cartesian position, in feet, which also gives
the height above the ellipsoid. ``Latitude (deg)`` alone is geocentric; it is used unchanged where a file
has no other, as in the first years, when JSBSim's Earth was a sphere. Those files have headings of their
own (``Vn``, ``Tht``) and angles in radians, unless the heading says degrees. JSBSim's sea level is the
ellipsoid. Rates are over the Earth, and so is the acceleration put together from the derivatives of the
body velocities: ``UdotBody + Q WBody - R VBody`` and so on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import (
    LIMITS,
    NAMED,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
    recognised,
    refuse_no_motion,
)
from lab.data.files.table import plain
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight
from lab.motion.frames import ecef

NAME = "JSBSim csv"

Variant = tuple[str, str, str]


def _field(key: str, quantity: str, *variants: Variant) -> tuple[Field, ...]:
    """Return the fields of a quantity, for each variant a heading, a property and their unit."""
    fields = []
    for heading, path, unit in variants:
        spellings = (heading, f"/fdm/jsbsim/{path}", path) if path else (heading,)
        names = tuple(plain(name) for name in spellings if name)
        fields.append(Field(key, names, quantity, unit, NAMED))
    return tuple(fields)


TIME = Field(
    "time", ("time", plain("/fdm/jsbsim/simulation/sim-time-sec"), "simulation/sim-time-sec"), "time", "s"
)

FIELDS = (
    TIME,
    *_field("latitude", "angle", ("Latitude Geodetic (deg)", "position/lat-geod-deg", "°"),
            ("", "position/lat-geod-rad", "rad")),
    *_field("geocentric latitude", "angle", ("Latitude (deg)", "position/lat-gc-deg", "°"),
            ("", "position/lat-gc-rad", "rad"), ("Latitude", "", "rad")),
    *_field("longitude", "angle", ("Longitude (deg)", "position/long-gc-deg", "°"),
            ("", "position/long-gc-rad", "rad"), ("Longitude", "", "rad")),
    *_field("geodetic height", "length", ("", "position/geod-alt-ft", "ft"),
            ("", "position/geod-alt-km", "km")),
    *_field("height", "length", ("Altitude ASL (ft)", "position/h-sl-ft", "ft"),
            ("", "position/h-sl-meters", "m"), ("Altitude (ft)", "", "ft"), ("Altitude", "", "ft")),
    *_field("x", "length", ("X_{ECEF} (ft)", "position/ecef-x-ft", "ft")),
    *_field("y", "length", ("Y_{ECEF} (ft)", "position/ecef-y-ft", "ft")),
    *_field("z", "length", ("Z_{ECEF} (ft)", "position/ecef-z-ft", "ft")),
    *_field("north", "speed", ("V_{North} (ft/s)", "velocities/v-north-fps", "ft/s"), ("Vn", "", "ft/s"),
            ("Vn (ft/s)", "", "ft/s")),
    *_field("east", "speed", ("V_{East} (ft/s)", "velocities/v-east-fps", "ft/s"), ("Ve", "", "ft/s"),
            ("Ve (ft/s)", "", "ft/s")),
    *_field("down", "speed", ("V_{Down} (ft/s)", "velocities/v-down-fps", "ft/s"), ("Vd", "", "ft/s"),
            ("Vd (ft/s)", "", "ft/s")),
    *_field("roll", "angle", ("Phi (deg)", "attitude/phi-deg", "°"), ("", "attitude/phi-rad", "rad"),
            ("", "attitude/roll-rad", "rad"), ("Phi", "", "rad")),
    *_field("pitch", "angle", ("Theta (deg)", "attitude/theta-deg", "°"), ("", "attitude/theta-rad", "rad"),
            ("", "attitude/pitch-rad", "rad"), ("Tht (deg)", "", "°"), ("Tht", "", "rad"),
            ("Theta", "", "rad")),
    *_field("heading", "angle", ("Psi (deg)", "attitude/psi-deg", "°"), ("", "attitude/psi-rad", "rad"),
            ("", "attitude/heading-true-rad", "rad"), ("Psi", "", "rad")),
    *_field("p", "angular rate", ("P (deg/s)", "", "°/s"), ("", "velocities/p-rad_sec", "rad/s"),
            ("P", "", "rad/s"), ("P (rad/s)", "", "rad/s")),
    *_field("q", "angular rate", ("Q (deg/s)", "", "°/s"), ("", "velocities/q-rad_sec", "rad/s"),
            ("Q", "", "rad/s"), ("Q (rad/s)", "", "rad/s")),
    *_field("r", "angular rate", ("R (deg/s)", "", "°/s"), ("", "velocities/r-rad_sec", "rad/s"),
            ("R", "", "rad/s"), ("R (rad/s)", "", "rad/s")),
    *_field("u", "speed", ("UBody", "velocities/u-fps", "ft/s")),
    *_field("v", "speed", ("VBody", "velocities/v-fps", "ft/s")),
    *_field("w", "speed", ("WBody", "velocities/w-fps", "ft/s")),
    *_field("udot", "acceleration", ("UdotBody", "accelerations/udot-ft_sec2", "ft/s²")),
    *_field("vdot", "acceleration", ("VdotBody", "accelerations/vdot-ft_sec2", "ft/s²")),
    *_field("wdot", "acceleration", ("WdotBody", "accelerations/wdot-ft_sec2", "ft/s²")),
    *_field("airspeed", "speed", ("V_{Total} (ft/s)", "velocities/vt-fps", "ft/s"), ("Vtotal", "", "ft/s"),
            ("Vtotal (ft/s)", "", "ft/s")),
    *_field("alpha", "angle", ("Alpha (deg)", "aero/alpha-deg", "°"), ("", "aero/alpha-rad", "rad"),
            ("Alpha", "", "rad")),
    *_field("beta", "angle", ("Beta (deg)", "aero/beta-deg", "°"), ("", "aero/beta-rad", "rad"),
            ("Beta", "", "rad")),
)  # fmt: skip
"""Columns that are read, by the headings of JSBSim's groups and the paths of its properties."""

ANYBODYS = frozenset(
    plain(name)
    for name in (
        "Latitude (deg)", "Longitude (deg)", "Latitude", "Longitude", "Altitude", "Altitude (ft)", "Alpha",
        "Beta", "Alpha (deg)", "Beta (deg)", "P", "Q", "R", "Vn", "Ve", "Vd",
    )
)  # fmt: skip
"""Headings that other programs write too: a file with no others is none of JSBSim's."""

REQUIRED = (
    TIME.names,
    tuple(name for field in FIELDS if field is not TIME for name in field.names if name not in ANYBODYS),
)
_MAX_RADIANS = 6.3
"""Largest angle that may be in radians where the heading names no unit: a full turn, rounded up."""


def recognises(head: bytes) -> bool:
    """Return whether a file has JSBSim's headings of time and of at least one other quantity."""
    return recognised(head, REQUIRED)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a csv of JSBSim.

    Raises
    ------
    MissionError
        For whatever is wrong with the file; if it has no motion, naming
        what to record.
    """
    path = one_file(paths, NAME)
    columns = read_columns(path, FIELDS, units, REQUIRED)
    place = columns.vector("x", "y", "z")
    if place is not None:
        for key, value in zip(("latitude", "longitude", "height"), ecef.geodetic(place).T, strict=True):
            columns.values[key] = value
            columns.units.pop(key, None)
    elif columns.get("geodetic height") is not None:
        columns.values["height"] = columns.values["geodetic height"]
        columns.units["height"] = columns.units.pop("geodetic height")
    remarks = [*_unlabelled_degrees(columns), *_geocentric(columns)]
    flight = raw_flight(
        NAME,
        columns,
        velocity_n=columns.vector("north", "east", "down"),
        euler=columns.vector("roll", "pitch", "heading"),
        body_rate=columns.vector("p", "q", "r"),
        acceleration_b=_acceleration(columns),
        remarks=remarks,
    )
    refuse_no_motion(
        path,
        flight,
        "Accepted is a csv with the groups <position>ON</position> and <velocities>ON</velocities>, or with "
        "the properties position/lat-geod-deg, position/long-gc-deg, position/geod-alt-ft and "
        "velocities/v-north-fps, v-east-fps, v-down-fps.",
    )
    return flight if place is None else _near_the_earth(path, flight, columns)


def _unlabelled_degrees(columns: Columns) -> list[str]:
    """Read angles that are too large for radians as degrees where the heading names no unit."""
    remarks = []
    for keys in (("geocentric latitude", "longitude"), ("roll", "pitch", "heading"), ("alpha", "beta")):
        open_ones = [key for key in keys if key in columns.units and _says_no_unit(columns.units[key])]
        if any(np.abs(columns.values[key]).max() > _MAX_RADIANS for key in open_ones):
            names = [columns.units[key].column for key in open_ones]
            for key in open_ones:
                columns.values[key] = np.radians(columns.values[key])
                columns.units[key] = replace(columns.units[key], unit="°", source="guessed")
            remarks.append(f"{', '.join(names)} are taken as degrees: they are too large for radians.")
    return remarks


def _says_no_unit(unit: ColumnUnit) -> bool:
    return unit.source == NAMED and "(" not in unit.column and "/" not in unit.column


def _geocentric(columns: Columns) -> list[str]:
    """Use a geocentric latitude where there is no other."""
    latitude = columns.values.pop("geocentric latitude", None)
    unit = columns.units.pop("geocentric latitude", None)
    if latitude is None or unit is None or "latitude" in columns.values:
        return []
    columns.values["latitude"], columns.units["latitude"] = latitude, unit
    return [
        "The latitude is geocentric but used as geodetic: the flight is displaced by up to 21 km along the "
        "meridian, and otherwise unchanged."
    ]


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


def _acceleration(columns: Columns) -> FloatArray | None:
    """Return the change of velocity over the Earth, in b."""
    derivative, rate = columns.vector("udot", "vdot", "wdot"), columns.vector("p", "q", "r")
    velocity = columns.vector("u", "v", "w")
    if derivative is None or rate is None or velocity is None:
        return None
    return derivative + np.cross(rate, velocity)
