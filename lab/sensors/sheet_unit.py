"""Sheet unit: a unit as data sheets write it, as a factor to SI and a dimension.

``ug/sqrt(Hz)``, ``µg/√Hz`` and ``ug/rtHz`` are one unit; ``mdps``, ``deg/hr`` and ``°/h`` are rates. What a
unit measures follows from its parts, so that any spelling of a unit of the right kind is accepted.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from lab.base.parameters.units import DEGREE, FOOT, STANDARD_GRAVITY

LONGEST = 60
"""Longest unit that is read [characters]; the longest of the tests has 23."""

Dimension = tuple[float, float, float, float, float]
"""Exponents of angle, length, time, temperature and steps of the output (LSB)."""

PURE: Dimension = (0.0, 0.0, 0.0, 0.0, 0.0)
"""Dimension of a pure number."""
ANGLE: Dimension = (1.0, 0.0, 0.0, 0.0, 0.0)
"""Dimension of an angle."""
_LENGTH: Dimension = (0.0, 1.0, 0.0, 0.0, 0.0)
"""Dimension of a length."""
_TIME: Dimension = (0.0, 0.0, 1.0, 0.0, 0.0)
"""Dimension of a time."""
_KELVIN: Dimension = (0.0, 0.0, 0.0, 1.0, 0.0)
"""Dimension of a temperature."""
_STEP: Dimension = (0.0, 0.0, 0.0, 0.0, 1.0)
"""Dimension of steps of the output."""
_FORCE: Dimension = (0.0, 1.0, -2.0, 0.0, 0.0)
"""Dimension of a specific force."""
_ATOMS: dict[str, tuple[float, Dimension]] = {
    "deg": (DEGREE, ANGLE),
    "rad": (1.0, ANGLE),
    "arcmin": (DEGREE / 60, ANGLE),
    "arcsec": (DEGREE / 3600, ANGLE),
    "g": (STANDARD_GRAVITY, _FORCE),
    "gal": (0.01, _FORCE),
    "m": (1.0, _LENGTH),
    "ft": (FOOT, _LENGTH),
    "s": (1.0, _TIME),
    "min": (60.0, _TIME),
    "h": (3600.0, _TIME),
    "hz": (1.0, (0.0, 0.0, -1.0, 0.0, 0.0)),
    "k": (1.0, _KELVIN),
    "lsb": (1.0, _STEP),
    "%": (0.01, PURE),
    "ppm": (1e-6, PURE),
}
"""The units of which others are made: factor to SI and dimension."""
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3}
"""Factors of the prefixes of the SI that data sheets have."""
_SPELLINGS = (
    (r"°\s*c\b|\bdeg(?:rees?)?\.?\s*c\b|℃|\bkelvin\b|\bc\b", "k"),
    (r"\bdegrees?\b|°|º|\bdeg\b\.?", "deg"),
    (r"\b(n|u|m)?dps\b", r"(\1deg/s)"),
    (r"\b(hours?|hrs?)\b", "h"),
    (r"\b(seconds?|secs?)\b", "s"),
    (r"\b(lsbs?|digits?|counts?)\b", "lsb"),
    (r"\bper\b", "/"),
    (r"\bpercent\b", "%"),
    (r"√\s*|\b(?:sqrt|rt)[\s-]*(?=\()|\b(?:sqrt|rt)[\s-]*(?=(?:hz|h|s|hr|hour|sec)\b)", "~"),
)
_TOKEN = re.compile(r"\s*(\^\s*\(?\s*(?:-?\d+(?:\.\d+)?(?:\s*/\s*\d+)?)\s*\)?|[a-z%]+|[~/*()·]|[²½])")


@dataclass(frozen=True)
class SheetUnit:
    """A unit of a data sheet.

    Attributes
    ----------
    factor : float
        Factor to SI, radians for angles.
    dimension : tuple of float
        Exponents of angle, length, time, temperature and steps of the output.
    per_root_hertz : bool
        Whether it is a density per root of a frequency, and no random walk per root of a time.
    """

    factor: float
    dimension: Dimension
    per_root_hertz: bool


def sheet_unit(text: str) -> SheetUnit:
    """Return the unit that a text is.

    Parameters
    ----------
    text
        A unit, such as ``mdps/sqrt(Hz)``.

    Raises
    ------
    ValueError
        If it is no unit that is known, naming the part.
    """
    if len(text) > LONGEST:
        raise ValueError(f"is longer than {LONGEST} characters")
    plain = unicodedata.normalize("NFC", text).replace("µ", "u").replace("μ", "u").replace("−", "-")
    plain = plain.strip().lower().replace("″", "arcsec").replace("′", "arcmin")
    for pattern, written in _SPELLINGS:
        plain = re.sub(pattern, written, plain)
    plain = re.sub(r"(?<![a-z])(hz|h|s)\s*(?:\^\s*\(?\s*(?:0?\.5|1/2)\s*\)?|½)", r"~\1", plain)
    plain = re.sub(r"(?<![a-z])s2(?![a-z0-9])", "s²", plain)
    parts = _tokens(plain)
    found, rest = _product(parts)
    if rest:
        raise ValueError(f"{rest[0]!r} stands where a unit ends")
    return SheetUnit(*found, per_root_hertz=re.search(r"~ ?\(? ?hz", plain) is not None)


def _tokens(plain: str) -> list[str]:
    found, at = [], 0
    while at < len(plain):
        token = _TOKEN.match(plain, at)
        if token is None:
            if not plain[at:].strip():
                break
            raise ValueError(f"{plain[at:].strip()[:20]!r} is no unit")
        found.append(token[1])
        at = token.end()
    if not found:
        raise ValueError("there is no unit")
    return found


def _product(parts: list[str]) -> tuple[tuple[float, Dimension], list[str]]:
    """Return factor and dimension of a product, and what follows it."""
    (factor, dimension), parts = _power(parts)
    while parts and parts[0] != ")":
        sign = -1.0 if parts[0] == "/" else 1.0
        if parts[0] in "/*·":
            parts = parts[1:]
        (one, other), parts = _power(parts)
        factor, dimension = factor * one**sign, _sum(dimension, other, sign)
    return (factor, dimension), parts


def _power(parts: list[str]) -> tuple[tuple[float, Dimension], list[str]]:
    """Return factor and dimension of an atom or a bracket with its exponent, and what follows it."""
    if not parts:
        raise ValueError("it ends with a sign")
    head, *parts = parts
    exponent = 1.0
    if head == "~":
        found, parts = _power(parts)
        return _raise_to_power(found, 0.5), parts
    if head == "(":
        found, parts = _product(parts)
        if not parts:
            raise ValueError("a bracket is open")
        parts = parts[1:]
    else:
        found = _atom(head)
    if parts and parts[0] in "²½":
        exponent, parts = {"²": 2.0, "½": 0.5}[parts[0]], parts[1:]
    elif parts and parts[0].startswith("^"):
        above, _, below = parts[0].strip("^() ").partition("/")
        if below and not float(below):
            raise ValueError("an exponent is divided by zero")
        exponent, parts = float(above) / float(below or 1), parts[1:]
        if abs(exponent) > 2:
            raise ValueError(f"the exponent {exponent:g} is none of a unit of sensors")
    return _raise_to_power(found, exponent), parts


def _atom(name: str) -> tuple[float, Dimension]:
    if name in _ATOMS:
        return _ATOMS[name]
    prefix, rest = name[:1], name[1:]
    if prefix in _PREFIXES and rest in _ATOMS and rest not in ("%", "ppm", "k", "lsb"):
        factor, dimension = _ATOMS[rest]
        return _PREFIXES[prefix] * factor, dimension
    raise ValueError(f"{name[:20]!r} is no unit")


def _raise_to_power(found: tuple[float, Dimension], exponent: float) -> tuple[float, Dimension]:
    factor, dimension = found
    return factor**exponent, _sum(PURE, dimension, exponent)


def _sum(one: Dimension, other: Dimension, times: float) -> Dimension:
    angle, length, time, kelvin, step = (a + times * b for a, b in zip(one, other, strict=True))
    return angle, length, time, kelvin, step
