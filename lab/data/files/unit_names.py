"""Unit names: the spellings of units in files and by people, and their factors to SI."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Mapping
from functools import lru_cache
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import read_toml
from lab.base.parameters.units import (
    DAY,
    DEGREE,
    FOOT,
    KILOMETRE_PER_HOUR,
    KNOT,
    MILE_PER_HOUR,
    STANDARD_GRAVITY,
)

_COUNTS = re.compile(r"(.+)/(0*[1-9]\d{0,8}(?:\.\d{1,9})?)")
"""A unit over how many counts it is."""


class Factors(dict[str, float]):
    """Factors to SI by unit; a unit over a number, such as ``g/16384`` of raw counts, is one too."""

    def __missing__(self, unit: str) -> float:
        if unit not in self:
            raise KeyError(unit)
        base, _, count = unit.rpartition("/")
        return self[base] / float(count)

    def __contains__(self, unit: object) -> bool:
        found = _COUNTS.fullmatch(unit) if isinstance(unit, str) else None
        return super().__contains__(unit) or (found is not None and super().__contains__(found[1]))


UNITS: dict[str, Factors] = {name: Factors(units) for name, units in {
    "time": {
        "s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9, "1e-4 s": 1e-4, "min": 60.0, "h": 3600.0, "days": DAY,
    },
    "angle": {
        "°": DEGREE, "rad": 1.0, "1e-7°": 1e-7 * DEGREE, "1e-6°": 1e-6 * DEGREE, "′": DEGREE / 60,
        "semicircles": math.pi / 2**31,
    },
    "length": {"m": 1.0, "ft": FOOT, "km": 1000.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3},
    "speed": {
        "m/s": 1.0, "kt": KNOT, "ft/s": FOOT, "km/h": KILOMETRE_PER_HOUR, "mph": MILE_PER_HOUR,
        "ft/min": FOOT / 60, "cm/s": 0.01, "mm/s": 1e-3,
    },
    "angular rate": {
        "°/s": DEGREE, "rad/s": 1.0, "mrad/s": 1e-3, "m°/s": 1e-3 * DEGREE, "°/h": DEGREE / 3600,
        "°/min": DEGREE / 60,
        "rpm": 2 * math.pi / 60,
    },
    "acceleration": {
        "m/s²": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "ft/s²": FOOT, "cm/s²": 0.01,
        "mm/s²": 1e-3, "µg": 1e-6 * STANDARD_GRAVITY,
    },
    "magnetic field": {"µT": 1.0, "nT": 1e-3, "mT": 1e3, "T": 1e6, "G": 100.0, "mG": 0.1},
    "pressure": {"hPa": 100.0, "kPa": 1000.0, "Pa": 1.0, "mbar": 100.0, "bar": 1e5, "inHg": 3386.389},
}.items()}  # fmt: skip
"""Factor to SI of each unit, by quantity; angles in radians, magnetic fields in µT."""
KIND_OF_SI = {unit: kind for kind, units in UNITS.items() for unit, factor in units.items() if factor == 1}
"""The quantity of each unit whose factor is one, such as length of m."""

_SPELLINGS, _OVER, _PER = (
    {spelling: unit for unit, spellings in table.items() for spelling in spellings.split()}
    for table in read_toml(Path(__file__).with_suffix(".toml")).values()
)
"""Units by what files and people write, without blanks and in lower case, and what stands above and below the
bar of a unit over a time."""
_TIMES = "|".join(sorted(_PER, key=len, reverse=True))
_LENGTHS = "|".join(sorted(_OVER, key=len, reverse=True))
RATIO = (
    rf"(?:{_LENGTHS})_?(?:/|per|p|)_?(?:{_TIMES})"
    rf"(?:_?(?:/|per|p|)_?(?:{_TIMES}))?(?:_?\^?-?[12²])?"
)
"""A length or an angle over a time, or its square: ``m/s/s``, ``cm_s2``, ``degrees per second``."""
_RATIO = re.compile(rf"({_LENGTHS})(?:/|per|p|)({_TIMES})((?:/|per|p|)(?:{_TIMES}))?(-?\d)?")
"""The same in lower case, without blanks and the marks of `_MARKS`."""
_MARKS = str.maketrans("²⁻¹", "2-1", " _^*·⋅.()")
_NAMED = {"mi/h": "mph", "nmi/h": "kt", "rev/min": "rpm"}
_MULTIPLE = re.compile(r"(\d{1,9}(?:\.\d{1,9})?(?:e-?\d{1,2})?)[*x×]?((?!e?\d).+)")
_IN_POWERS = re.compile(r"([^\d*x×]+?)_?[*x×]?_?1?e-?(\d{1,2})")
"""A unit after a number, ``1e-3g``; and before a power of ten in which it is counted, ``deg*1e7``."""


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


@lru_cache(maxsize=4096)
def unit_of(kind: str, spelling: str) -> str:
    """Return a unit as `UNITS` has it; empty for what is no unit of the kind."""
    text, counts = "".join(spelling.strip("[](){}<> ").split()), ""
    if found := _COUNTS.fullmatch(text):
        text, counts = found[1], f"/{found[2]}"
    for written in (text, text.lower(), text.lower().replace(".", ""), f"{kind}:{text.lower()}"):
        unit = _SPELLINGS.get(written, written)
        if unit in UNITS.get(kind, ()):
            return f"{unit}{counts}"
    if unit := _over_time(kind, text.lower()):
        return f"{unit}{counts}"
    return "" if counts else _read_scaled_unit(kind, text.lower())


def _over_time(kind: str, text: str) -> str:
    """Return the unit of a length or an angle over a time; empty for another text."""
    plain = text.replace("squared", "2").translate(_MARKS)
    if plain in _OVER or not (found := _RATIO.fullmatch(plain)):  # metres are no m/s
        return ""
    is_square = found[3] is not None or (found[4] or "").endswith("2")
    unit = f"{_OVER[found[1]]}/{_PER[found[2]]}{'²' if is_square else ''}"
    unit = _NAMED.get(unit, unit)
    return unit if unit in UNITS.get(kind, ()) else ""


def _read_scaled_unit(kind: str, text: str) -> str:
    """Return the unit of a text with a number before a unit, or a power of ten behind it; else nothing."""
    text = text.replace("10^", "1e")
    if found := _MULTIPLE.fullmatch(text):
        base, size = unit_of(kind, found[2]), float(found[1])
    elif found := _IN_POWERS.fullmatch(text):
        base, size = unit_of(kind, found[1]), 10.0 ** -int(found[2])
    else:
        return ""
    if not base or not size:
        return ""
    factor = UNITS[kind][base] * size
    known = (unit for unit, one in UNITS[kind].items() if math.isclose(one, factor, rel_tol=1e-9))
    count = next(iter(UNITS[kind].values())) / factor
    counted = f"{next(iter(UNITS[kind]))}/{count:.9f}".rstrip("0").rstrip(".")
    return next(known, counted if counted in UNITS[kind] else "")
