"""Fields: the headings of a text format's quantities, and its columns in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import HEIGHTS, LATITUDES, MAX_SPEED, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.files.table import (
    Header,
    Required,
    Table,
    find_header,
    head_lines,
    plain,
    read_table,
)
from lab.data.files.unit_names import UNITS, refuse_unknown, unit_name
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight

OF_THE_FORMAT = "of the format"
NAMED = "named in the file"
GIVEN = "given by you"

_MAX_TIME = 1e12
"""Largest time stamp [s]: counts from the year 0 are 6e10 s."""
_MAX_OFFSET = 1e7
"""Largest coordinate in a Cartesian frame, local or fixed to the Earth [m]: its radius is 6.4e6 m."""
_MAX_ANGLE = 1e4
"""Largest angle [rad]: headings that count turns, of 1600 and more."""
_MAX_RATE = 200.0
"""Largest angular rate [rad/s]: 11 000 °/s, five times what gyros of vehicles measure."""
_MAX_ACCELERATION = 1e4
"""Largest acceleration [m/s²]: a thousand g, more than accelerometers of vehicles measure."""

LIMITS = {
    "time": (-_MAX_TIME, _MAX_TIME),
    "latitude": (float(np.radians(LATITUDES[0])), float(np.radians(LATITUDES[1]))),
    "depth": (-HEIGHTS[1], -HEIGHTS[0]),
    **dict.fromkeys(("X", "Z", "x", "y", "z"), (-_MAX_OFFSET, _MAX_OFFSET)),
    "angle": (-_MAX_ANGLE, _MAX_ANGLE),
    "length": HEIGHTS,
    "speed": (-MAX_SPEED, MAX_SPEED),
    "angular rate": (-_MAX_RATE, _MAX_RATE),
    "acceleration": (-_MAX_ACCELERATION, _MAX_ACCELERATION),
}
"""Range accepted for each quantity, or for single keys [SI]."""

SEA_LEVEL = (
    "The file gives heights above sea level, which are used as heights above the ellipsoid: the flight is "
    "too low or too high by the height of the geoid there (at most 107 m)."
)
"""The remark for files that have no other height."""


@dataclass(frozen=True)
class Field:
    """A quantity of a format.

    Attributes
    ----------
    key : str
        Name of the quantity within the lab.
    names : tuple of str
        The headings it may have, as `plain` gives them; the first that is there is taken.
    quantity : str
        A key of `UNITS`.
    unit : str
        Its unit, unless another is given.
    source : str
        How the unit is known.
    """

    key: str
    names: tuple[str, ...]
    quantity: str
    unit: str
    source: str = OF_THE_FORMAT


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of one file in SI units, by key.

    Attributes
    ----------
    values : dict
        Column by key of its field.
    rows_read, dropped, remarks
        As `RawFlight` has them.
    units : dict
        The unit each was read in, by key.
    lines : (n,) array
        The line of each row.
    """

    values: dict[str, FloatArray]
    rows_read: int
    dropped: tuple[Dropped, ...]
    units: dict[str, ColumnUnit]
    remarks: tuple[str, ...]
    lines: NDArray[np.int32]

    def get(self, key: str) -> FloatArray | None:
        """Return a column, or None if the file does not have it."""
        return self.values.get(key)

    def vector(self, *keys: str) -> FloatArray | None:
        """Return columns side by side; a minus sign before a key negates it. None if one is missing."""
        if not all(key.lstrip("-") in self.values for key in keys):
            return None
        return np.column_stack(
            [-self.values[key[1:]] if key.startswith("-") else self.values[key] for key in keys]
        )


def recognised(head: bytes, required: Required) -> bool:
    """Return whether the first bytes of a file hold a header with the required headings."""
    return find_header(head_lines(head), required) is not None


def read_columns(
    path: Path,
    fields: Sequence[Field],
    units: Mapping[str, str],
    required: Required,
    order: Header | None = None,
) -> Columns:
    """Read the columns of a file that a format knows.

    Parameters
    ----------
    path
        The file.
    fields
        The fields of the format.
    units
        Units that overrule those of the fields, by column as in the file.
    required
        For each need the headings of which one must be there.
    order
        The columns of a file that has no header.

    Raises
    ------
    MissionError
        For whatever is wrong with the file or the units.
    """
    table = read_table(path, {name for field in fields for name in field.names}, required, order)
    found: dict[Field, str] = {}
    for field in fields:
        name = next((name for name in field.names if name in table.columns), None)
        if name and all(field.key != other.key for other in found):
            found[field] = name
    used = {field: table.headings[name] for field, name in found.items()}
    by_name = {plain(column): unit for column, unit in units.items()}
    refuse_unknown(path, {_as_in_file(column, used): unit for column, unit in units.items()}, used.values())
    values, read_in = {}, {}
    for field, name in found.items():
        given = by_name.get(name)
        unit = field.unit if given is None else _unit(path, used[field], field.quantity, given)
        read_in[field.key] = ColumnUnit(used[field], unit, field.source if given is None else GIVEN)
        values[field.key] = table.columns.pop(name)
        values[field.key] *= UNITS[field.quantity][unit]
    return _believable(path, table, list(found), values, read_in)


def _as_in_file(column: str, used: Mapping[Field, str]) -> str:
    return next((heading for heading in used.values() if plain(heading) == plain(column)), column)


def _unit(path: Path, column: str, quantity: str, given: str) -> str:
    try:
        return unit_name(quantity, given)
    except MissionError as error:
        raise MissionError(f"{path}, column {column}: {error}") from None


def _believable(
    path: Path,
    table: Table,
    fields: Sequence[Field],
    values: dict[str, FloatArray],
    units: dict[str, ColumnUnit],
) -> Columns:
    """Leave out the rows with numbers no flight has."""
    kept = np.ones(len(table.lines), dtype=bool)
    dropped: tuple[Dropped, ...] = ()
    for field in fields:
        value = values[field.key]
        low, high = LIMITS.get(field.key) or LIMITS[field.quantity]
        fine = (value >= low) & (value <= high)
        lost = kept & ~fine
        if lost.any():
            heading = units[field.key]
            factor = UNITS[field.quantity][heading.unit]
            reason = (
                f"{heading.column} beyond {low / factor:.6g} to {high / factor:.6g} {heading.unit}, which is "
                "what a flight can have"
            )
            dropped += (Dropped(reason, int(lost.sum()), int(table.lines[np.argmax(lost)])),)
            kept &= fine
    if dropped:
        values = {key: value[kept] for key, value in values.items()}
    if kept.sum() < MIN_SAMPLES:
        what = "; ".join(f"{drop.count} from row {drop.first_row} on: {drop.reason}" for drop in dropped)
        raise MissionError(
            f"{path}: {kept.sum()} of {table.rows_read} rows of samples can be used ({what}); accepted are "
            f"at least {MIN_SAMPLES}. If the unit of a column is another one, give it"
        )
    return Columns(
        values, table.rows_read, (*table.dropped, *dropped), units, table.remarks, table.lines[kept]
    )


def raw_flight(
    name: str,
    columns: Columns,
    *,
    time: FloatArray | None = None,
    velocity_n: FloatArray | None = None,
    euler: FloatArray | None = None,
    body_rate: FloatArray | None = None,
    acceleration_b: FloatArray | None = None,
    remarks: Sequence[str] = (),
) -> RawFlight:
    """Return the flight of an aircraft out of its columns.

    Parameters
    ----------
    name
        Of the format.
    columns
        Whose time, position and air data are taken as they are.
    time, velocity_n, euler, body_rate, acceleration_b
        What the format has in another form, as `RawFlight` has it.
    remarks
        Remarks of the reader, put before those of the table.
    """
    return RawFlight(
        format=name,
        time=columns.values["time"] if time is None else time,
        latitude=columns.get("latitude"),
        longitude=columns.get("longitude"),
        height=columns.get("height"),
        velocity_n=velocity_n,
        euler=euler,
        body_rate=body_rate,
        acceleration_b=acceleration_b,
        airspeed=columns.get("airspeed"),
        alpha=columns.get("alpha"),
        beta=columns.get("beta"),
        rows_read=columns.rows_read,
        dropped=columns.dropped,
        units=tuple(columns.units.values()),
        remarks=(*remarks, *columns.remarks),
        vehicle="aircraft",
    )


def refuse_no_motion(path: Path, flight: RawFlight, advice: str) -> None:
    """Raise if a flight has no motion: no velocity, no position, and no airspeed with attitude.

    Parameters
    ----------
    path
        The file, for the message.
    flight
        As read.
    advice
        What the user should record instead, as whole sentences.

    Raises
    ------
    MissionError
        If there is neither velocity nor position nor airspeed with attitude.
    """
    by_air = flight.airspeed is not None and flight.euler is not None
    by_position = flight.latitude is not None and flight.longitude is not None
    if flight.velocity_n is None and not by_position and not by_air:
        raise MissionError(
            f"{path}: there is neither velocity nor position nor airspeed with attitude in it. {advice}"
        )


def one_file(paths: Sequence[Path], reader: str, fixed: Mapping[str, str] | None = None) -> Path:
    """Return the one file of a format that has one for a flight.

    Parameters
    ----------
    paths
        The files of a flight.
    reader
        Name of the format.
    fixed
        Units that are given, by column, where the format fixes its units.

    Raises
    ------
    MissionError
        If there are more, or a unit is given that the format fixes.
    """
    if len(paths) != 1:
        raise MissionError(
            f"{paths[1]}: a flight of {reader} is one file, and {len(paths)} are given; give one at a time"
        )
    if fixed:
        raise MissionError(
            f"{paths[0]}: {reader} fixes its units, so that of {next(iter(fixed))} cannot be given another"
        )
    return paths[0]


def units_of_the_format(units: Mapping[str, str]) -> tuple[ColumnUnit, ...]:
    """Return the columns of a format that fixes its units, each with its unit."""
    return tuple(ColumnUnit(name, unit, OF_THE_FORMAT) for name, unit in units.items())
