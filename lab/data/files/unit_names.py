"""Unit names: the spellings of units in files and by people, and their factors to SI."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping

from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import (
    DAY,
    DEGREE,
    FOOT,
    KILOMETRE_PER_HOUR,
    KNOT,
    MILE_PER_HOUR,
    STANDARD_GRAVITY,
)

UNITS: dict[str, dict[str, float]] = {
    "time": {
        "s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9, "1e-4 s": 1e-4, "min": 60.0, "h": 3600.0, "days": DAY,
    },
    "angle": {"°": DEGREE, "rad": 1.0, "1e-7°": 1e-7 * DEGREE, "1e-6°": 1e-6 * DEGREE, "′": DEGREE / 60},
    "length": {"m": 1.0, "ft": FOOT, "km": 1000.0, "cm": 0.01, "mm": 1e-3},
    "speed": {
        "m/s": 1.0, "kt": KNOT, "ft/s": FOOT, "km/h": KILOMETRE_PER_HOUR, "mph": MILE_PER_HOUR,
        "ft/min": FOOT / 60, "cm/s": 0.01, "mm/s": 1e-3,
    },
    "angular rate": {
        "°/s": DEGREE, "rad/s": 1.0, "mrad/s": 1e-3, "m°/s": 1e-3 * DEGREE, "°/h": DEGREE / 3600,
        "rpm": 2 * math.pi / 60,
    },
    "acceleration": {
        "m/s²": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "ft/s²": FOOT, "cm/s²": 0.01,
        "mm/s²": 1e-3, "µg": 1e-6 * STANDARD_GRAVITY,
    },
    "magnetic field": {"µT": 1.0, "nT": 1e-3, "mT": 1e3, "T": 1e6, "G": 100.0, "mG": 0.1},
    "pressure": {"hPa": 100.0, "kPa": 1000.0, "Pa": 1.0, "mbar": 100.0, "bar": 1e5, "inHg": 3386.389},
}  # fmt: skip
"""Factor to SI of each unit, by quantity; angles in radians, magnetic fields in µT."""

_SPELLINGS = {
    "seconds": "s", "second": "s", "sec": "s", "milliseconds": "ms", "microseconds": "µs", "us": "µs",
    "minutes": "min", "hours": "h", "day": "days",
    "deg": "°", "degrees": "°", "degree": "°", "radians": "rad", "radian": "rad",
    "metres": "m", "meters": "m", "metre": "m", "meter": "m", "feet": "ft", "foot": "ft",
    "ftmsl": "ft", "ftagl": "ft",
    "mps": "m/s", "knots": "kt", "knot": "kt", "kts": "kt", "ktas": "kt", "fps": "ft/s", "kmh": "km/h",
    "kn": "kt", "kph": "km/h", "fpm": "ft/min",
    "deg/s": "°/s", "degps": "°/s", "degreespersecond": "°/s", "radps": "rad/s", "rad/sec": "rad/s",
    "radianspersecond": "rad/s", "rad_sec": "rad/s",
    "m/s2": "m/s²", "m/s^2": "m/s²", "mps2": "m/s²", "gforce": "g", "ft/s2": "ft/s²", "ft/s^2": "ft/s²",
    "ft/sec^2": "ft/s²",
    "cm/s2": "cm/s²", "cm/s^2": "cm/s²", "gal": "cm/s²", "mm/s2": "mm/s²", "mm/s^2": "mm/s²",
    "ug": "µg", "μg": "µg", "deg/h": "°/h", "deg/hr": "°/h", "°/hr": "°/h", "deg/hour": "°/h",
    "metrespersecond": "m/s", "meterspersecond": "m/s", "feetpersecond": "ft/s",
}  # fmt: skip


def unit_name(quantity: str, spelling: str) -> str:
    """Return a unit as `UNITS` has it.

    Parameters
    ----------
    quantity
        Of what, as a key of `UNITS`.
    spelling
        As a person or a file writes it.

    Raises
    ------
    MissionError
        If this is no unit of the quantity, listing those that are.
    """
    text = "".join(spelling.split())
    for candidate in (text, text.lower()):
        name = _SPELLINGS.get(candidate, candidate)
        if name in UNITS[quantity]:
            return name
    raise MissionError(
        f"{spelling!r} is not a known unit of {quantity}; accepted are {', '.join(UNITS[quantity])}"
    )


def refuse_unknown(path: object, units: Mapping[str, str], columns: Collection[str]) -> None:
    """Raise if units are given for columns that are not there.

    Parameters
    ----------
    path
        The file, for the message.
    units
        Units by column, as given.
    columns
        The columns that are read.

    Raises
    ------
    MissionError
        Naming the first such column, and those that are there.
    """
    for column in units:
        if column not in columns:
            near = difflib.get_close_matches(column, list(columns), n=1)
            raise MissionError(
                f"{path}: a unit is given for the column {column}, which is not read from this file"
                f"{f' (do you mean {near[0]}?)' if near else ''}; accepted are {', '.join(columns)}"
            )
