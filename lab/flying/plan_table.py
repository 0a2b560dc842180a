"""Plan table: the tables of a flight plan as frozen dataclasses whose fields declare what they accept."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from typing import Any, TypeVar

from lab.base.files.mission_error import MissionError

Part = TypeVar("Part")
Limits = Mapping[str, tuple[float, float]]

LATITUDES = (-85.0, 85.0)
"""Latitudes of plans [°]: closer to a pole north turns on the path, which courses and headings do not
bear."""
TURNS = (-360.0, 360.0)
"""Longitudes, headings and directions of plans [°]."""
GROUNDS = (-500.0, 5000.0)
"""Heights of the ground above the ellipsoid [m]: the Dead Sea has -430 m, the highest airports 4400 m."""
HEIGHTS = (30.0, 12_000.0)
"""Heights above the ground that a pilot is asked to fly at [m]; most aircraft have narrower limits."""
AIRSPEEDS = (10.0, 300.0)
"""True airspeeds that a pilot is asked to fly [m/s]; every aircraft has narrower limits."""
SPEEDS = (-350.0, 350.0)
"""Components of the velocity of waypoints and commands [m/s]: about the speed of sound."""


@dataclass(frozen=True)
class Entry:
    """The meaning and the limits of a field: for reading TOML, for widgets and for messages.

    Attributes
    ----------
    label, unit, doc : str
        For people; the unit is empty where there is none.
    limits : tuple of 2 floats
        Smallest and largest number accepted.
    whole : bool
        Only whole numbers.
    choices : tuple of str
        The texts accepted; empty for a number.
    optional : bool
        The default is the aircraft's own number.
    """

    label: str
    unit: str = ""
    doc: str = ""
    limits: tuple[float, float] = (-math.inf, math.inf)
    whole: bool = False
    choices: tuple[str, ...] = ()
    optional: bool = False


def number(
    label: str,
    unit: str,
    limits: tuple[float, float],
    doc: str,
    *,
    default: Any = MISSING,
    whole: bool = False,
) -> Any:
    """Return a dataclass field that holds a number; a default of None means the aircraft's own."""
    entry = Entry(label, unit, doc, limits, whole, optional=default is None)
    return dataclasses.field(default=default, metadata={"entry": entry})


def choice(label: str, choices: tuple[str, ...], doc: str, *, default: str) -> Any:
    """Return a dataclass field that holds one of some texts."""
    return dataclasses.field(default=default, metadata={"entry": Entry(label, "", doc, choices=choices)})


def entries(kind: type) -> dict[str, Entry]:
    """Return the numbers and texts of a table, by the names of its fields.

    Parameters
    ----------
    kind
        A dataclass of this package, such as `lab.flying.manoeuvres.Turn`.
    """
    declared = dataclasses.fields(kind)
    return {field.name: field.metadata["entry"] for field in declared if "entry" in field.metadata}


def read_part(
    kind: type[Part],
    values: Any,
    where: str,
    parts: Mapping[str, Any] | None = None,
    limits: Limits | None = None,
) -> Part:
    """Return a dataclass from a mapping.

    Parameters
    ----------
    kind
        The dataclass.
    values
        What the mapping has, by the names of the fields.
    where
        Name of the mapping in messages.
    parts
        Fields that are read already.
    limits
        Narrower limits of some numbers, by name.

    Raises
    ------
    MissionError
        If a key is unknown or missing, or a value is not accepted.
    """
    if not isinstance(values, Mapping):
        raise MissionError(f"{where}: expected a table of values, got {values!r}")
    parts = parts or {}
    declared = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in declared:
            close = difflib.get_close_matches(str(key), declared, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise MissionError(f"{where}: there is no key {key!r}.{hint} Accepted: {', '.join(declared)}")
    for name, field in declared.items():
        if field.default is MISSING and name not in values and name not in parts:
            raise MissionError(f"{where}: {name} is missing. Accepted: {', '.join(declared)}")
    accepted = {key: accept(kind, key, value, where, limits) for key, value in values.items()}
    return kind(**accepted, **parts)


def read_parts(
    kind: type[Part], entries: Any, where: str, least: int, most: int, noun: str
) -> tuple[Part, ...]:
    """Return dataclasses from a list of mappings, of a number of entries; `noun` names them in messages.

    Raises
    ------
    MissionError
        If it is no such list; as `read_part`.
    """
    is_list = isinstance(entries, Sequence) and not isinstance(entries, str)
    if not is_list or not least <= len(entries) <= most:
        between = f"{least} to {most}" if least else f"up to {most}"
        raise MissionError(f"{where}: expected a list of {between} {noun}")
    return tuple(read_part(kind, entry, f"{where}, number {count}") for count, entry in enumerate(entries, 1))


def accept(kind: type, key: str, value: Any, where: str, limits: Limits | None = None) -> Any:
    """Return a value as a field of a table holds it.

    Raises
    ------
    MissionError
        If it is not accepted; as `read_part`.
    """
    entry = entries(kind)[key]
    if entry.choices:
        if value not in entry.choices:
            raise MissionError(f"{where}: {key} = {value!r}; accepted: {', '.join(entry.choices)}")
        return value
    low, high = entry.limits if limits is None else limits.get(key, entry.limits)
    noun = "a whole number" if entry.whole else "a number"
    is_number = not isinstance(value, bool) and isinstance(value, int if entry.whole else int | float)
    if not is_number or not low <= value <= high:
        raise MissionError(f"{where}: {key} = {value!r}; accepted is {noun} from {low:g} to {high:g}")
    return int(value) if entry.whole else float(value)


def plain_part(part: Any) -> dict[str, Any]:
    """Return the numbers and texts of a table as plain data, without defaults."""
    values = {name: getattr(part, name) for name in entries(type(part))}
    defaults = {field.name: field.default for field in dataclasses.fields(part)}
    return {name: value for name, value in values.items() if value != defaults[name]}
