"""Unit names: the spellings of units in files and by people, and their factors to SI."""

from __future__ import annotations

import difflib
import math
import re
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
}.items()}  # fmt: skip
"""Factor to SI of each unit, by quantity; angles in radians, magnetic fields in µT."""

_SPELLINGS = {spelling: unit for unit, spellings in {
    "s": "с seconds second sec secs",
    "ms": "milliseconds msec millis 0.001s",
    "µs": "microseconds us usec micros μs",
    "min": "minutes",
    "h": "hours",
    "days": "day",
    "°": "deg degrees degree º wgs84",
    "rad": "radians radian",
    "m": "м metres meters metre meter",
    "ft": "feet foot ftmsl ftagl ftwgs",
    "cm": "0.01m",
    "mm": "0.001m",
    "m/s": "м/с mps metrespersecond meterspersecond m_s meters/second meter/s meters/s m/sec "
        "meters_per_second metres_per_second",
    "kt": "knots knot kts ktas kn",
    "ft/s": "fps feetpersecond ft_s ft/sec",
    "km/h": "км/ч kmh kph km_h kmph km/hr",
    "ft/min": "fpm",
    "°/s": "°/с град/с "
        "deg/s degps degreespersecond dps deg_s degs degsec deg_sec deg_per_s deg_per_sec deg/sec "
        "degpersec deg*s^-1 d/s º/s degrees/s degrees/sec degree/s",
    "rad/s": "рад/с "
        "radps rad/sec radianspersecond rad_sec rads rad_s radsec rad_per_s rad_per_sec rps rads^-1 "
        "radpersec rad*s^-1 r/s",
    "m/s²": "м/с² м/с2 м/с^2 "
        "m/s2 m/s^2 mps2 m_s2 m_s^2 ms2 ms^2 m_s_2 mpss m_per_s2 m/s/s ms^-2 m*s^-2 m/sec^2 m/sec2 "
        "m/(s^2) m/s**2 meters/s^2",
    "g": "gforce gs gravity",
    "ft/s²": "ft/s2 ft/s^2 ft/sec^2",
    "cm/s²": "cm/s2 cm/s^2 gal",
    "mm/s²": "mm/s2 mm/s^2",
    "µg": "ug μg",
    "°/h": "deg/h deg/hr °/hr deg/hour",
    "m°/s": "mdps mdeg mdeg/s",
    "mrad/s": "mrad_s",
    "mg": "millig milli_g",
    "ns": "nsec nanos nanoseconds",
    "1e-7°": "1e7 e7 dege7",
    "semicircles": "semicircle",
    "′": "arcmin",
    "µT": "ut µt μt microt microtesla",
    "T": "tesla",
    "nT": "nanotesla",
    "mT": "millitesla",
    "G": "gauss",
    "mG": "mgauss milligauss",
    "hPa": "hpa hectopascal",
    "kPa": "kpa",
    "Pa": "pa",
    "mbar": "millibar",
    "inHg": "inhg",
}.items() for spelling in spellings.split()}  # fmt: skip
"""Units by what files and people write, without blanks and in lower case."""


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


def unit_of(kind: str, spelling: str) -> str:
    """Return a unit as `UNITS` has it; empty for what is no unit of the kind."""
    text, counts = "".join(spelling.strip("[]() ").split()), ""
    if found := _COUNTS.fullmatch(text):
        text, counts = found[1], f"/{found[2]}"
    for written in (text, text.lower()):
        unit = _SPELLINGS.get(written, written)
        if unit in UNITS.get(kind, ()):
            return f"{unit}{counts}"
    return ""
