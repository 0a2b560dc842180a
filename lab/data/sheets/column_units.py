"""Column units: the units in the headings of columns, in the spellings of loggers."""

from __future__ import annotations

import re

from lab.base.files.mission_error import MissionError
from lab.data.files.unit_names import unit_name

UNIT = re.compile(
    r"(?i)[\s_.-](rad[_/ ]?s(?:ec)?|radps|rps|rad_per_s(?:ec)?|dps|deg[_/ ]?s(?:ec)?|degps|deg_per_s(?:ec)?|"
    r"mdps|mrad_s|m[_/ ]?s\^?2|m_s_2|mps2|mpss|m_per_s2|m/s/s|mg|milli_?g|gauss|mgauss|microt|[uµμ]t|hpa|"
    r"kpa|mbar|g|m[_/]s|mps|km[_/]?h|kph|kmh|kmph|"
    r"knots|knot|kts|kt|kn|mph|ft_s|fps|deg|degrees|rad|m|meters|metres|ft|feet|mm|cm|s|sec|secs|seconds|ms|"
    r"msec|millis|us|usec|micros|ns|nsec|nanos|1e7|e7)$"
)
"""A unit at the end of a heading, without brackets."""
_SPELLINGS = {
    "rads": "rad/s", "rad_s": "rad/s", "rad s": "rad/s", "radsec": "rad/s", "rad_sec": "rad/s",
    "rad_per_s": "rad/s", "rad_per_sec": "rad/s", "rps": "rad/s", "rads^-1": "rad/s", "rad*s^-1": "rad/s",
    "r/s": "rad/s", "dps": "°/s", "deg_s": "°/s", "degs": "°/s", "degsec": "°/s", "deg_sec": "°/s",
    "deg_per_s": "°/s", "deg_per_sec": "°/s", "deg/sec": "°/s", "deg*s^-1": "°/s", "d/s": "°/s", "º/s": "°/s",
    "degrees/s": "°/s", "degrees/sec": "°/s", "degree/s": "°/s", "mdps": "m°/s", "mrad_s": "mrad/s",
    "m_s2": "m/s²", "m_s^2": "m/s²", "ms2": "m/s²", "ms^2": "m/s²", "m_s_2": "m/s²", "mpss": "m/s²",
    "m_per_s2": "m/s²", "m/s/s": "m/s²", "ms^-2": "m/s²", "m*s^-2": "m/s²", "m/sec^2": "m/s²",
    "m/sec2": "m/s²", "m/(s^2)": "m/s²", "m/s**2": "m/s²", "meters/s^2": "m/s²",
    "gs": "g", "gravity": "g", "millig": "mg", "milli_g": "mg", "m_s": "m/s", "meters/second": "m/s",
    "meter/s": "m/s", "meters/s": "m/s", "m/sec": "m/s", "km_h": "km/h", "kmph": "km/h", "km/hr": "km/h",
    "ft_s": "ft/s", "ft/sec": "ft/s", "secs": "s", "msec": "ms", "millis": "ms", "usec": "µs",
    "micros": "µs", "μs": "µs", "nsec": "ns", "nanos": "ns", "nanoseconds": "ns", "1e7": "1e-7°",
    "e7": "1e-7°", "dege7": "1e-7°", "arcmin": "′", "º": "°", "wgs84": "°",
    "ut": "µT", "µt": "µT", "μt": "µT", "microt": "µT", "microtesla": "µT", "tesla": "T", "nanotesla": "nT",
    "millitesla": "mT", "gauss": "G", "mgauss": "mG", "milligauss": "mG", "hpa": "hPa", "kpa": "kPa",
    "pa": "Pa", "hectopascal": "hPa", "millibar": "mbar", "inhg": "inHg",
}  # fmt: skip


def unit_of(kind: str, spelling: str) -> str:
    """Return a unit as `UNITS` has it; empty for what is no unit of the kind."""
    spelling = spelling.strip("[]() ")
    text = "".join(spelling.split()).lower()
    try:
        return unit_name(kind, _SPELLINGS.get(spelling.lower(), _SPELLINGS.get(text, spelling)))
    except (MissionError, KeyError):
        return ""
