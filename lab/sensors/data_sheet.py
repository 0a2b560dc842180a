"""Data sheet: the numbers of a sensor in the words and units of its maker, and the card that they make.

A number is text, such as ``3.8 mdps/√Hz``, ``0.05 °/s rms in 100 Hz``, ``0.1 % FS`` or ``4 LSB at 16.4
LSB/dps``. Its unit decides what it is: a density per √Hz is one-sided unless it says otherwise, a random walk
per √h is N. A number far beyond every known sensor is refused, since a slip in the unit is likelier.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import TO_SI
from lab.sensors.cards import GRADES, Card, cards, gaps_filled, grades
from lab.sensors.datum import ALIKE, DENSITY, ONE_SIDED, TWO_SIDED, WORDS, Datum, find_setting
from lab.sensors.sheet_unit import ANGLE, PURE, SheetUnit, sheet_unit
from lab.sensors.suite import TRIADS, SensorSuite

LONGEST_TEXT = 200
"""Longest number, name, maker or source that is read [characters]."""
BEYOND = 10.0
"""Factor beyond the least and the largest number of all cards from which a number is refused: a wrong prefix
is a factor of 1,000, and °/h for °/s 3,600."""
MAY_BE_ZERO = ("misalignment", "g_sensitivity", "bias_temperature", "scale_temperature")
"""Terms that a sheet may state as zero; noise, biases, ranges and bandwidths are never zero."""


class SheetTerm(NamedTuple):
    """A term that is asked: the setting, the words of data sheets for it, and an example for each triad."""

    setting: str
    asks: str
    examples: tuple[str, str]


TERMS = (
    SheetTerm("range", "Range (full scale)", ("2000 dps", "16 g")),
    SheetTerm(
        DENSITY,
        "Noise density, random walk (ARW, VRW), or rms in a band",
        ("3.8 mdps/√Hz", "1.2 mg rms in 100 Hz"),
    ),
    SheetTerm("flicker", "In-run bias stability (bias instability)", ("8 deg/h", "36 ug")),
    SheetTerm("bias_sigma", "Bias repeatability, zero-rate or zero-g offset", ("0.5 dps", "20 mg")),
    SheetTerm(
        "scale_factor_sigma", "Scale factor (sensitivity) error or nonlinearity", ("0.5 %", "0.1 % FS")
    ),
    SheetTerm("misalignment", "Misalignment or cross-axis sensitivity", ("0.1 deg", "1 %")),
    SheetTerm("g_sensitivity", "Sensitivity to acceleration", ("0.1 dps/g", "")),
    SheetTerm("bias_temperature", "Change of the bias with temperature", ("0.01 dps/K", "0.1 mg/°C")),
    SheetTerm("scale_temperature", "Change of the scale factor with temperature", ("50 ppm/°C", "0.01 %/K")),
    SheetTerm("bandwidth", "Bandwidth (-3 dB)", ("100 Hz", "100 Hz")),
)
"""The terms in the order in which they are asked: the range first, since others may be parts of it."""

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_TEXT = re.compile(
    rf"\s*(?:±|\+/-|\+-|<=?|≤|~|≈)?\s*({_NUMBER}(?:\s*[,;]\s*{_NUMBER}|\s+{_NUMBER})*)\s*(.*)", re.DOTALL
)
_QUIET = re.compile(r"\b(?:typ(?:ical)?|max(?:imum)?)\b\.?|\(?\b1\s*(?:σ|sigma)\b\)?", re.IGNORECASE)
_AT = re.compile(
    rf"(?:\b(?:in|at|over|within|of)\b|@)\s*(?:an?\s+\w+\s+of\s+)?±?\s*({_NUMBER})\s*(.+)", re.IGNORECASE
)
_FULL_SCALE = re.compile(r"%\s*(?:of\s+)?(?:fsr?|f\.s\.|full[\s-]scale)\b\.?", re.IGNORECASE)
_SIDES = {
    ONE_SIDED: re.compile(r"\bone[\s-]sided\b", re.I),
    TWO_SIDED: re.compile(r"\btwo[\s-]sided\b", re.I),
}


def asked_terms(triad: str) -> tuple[SheetTerm, ...]:
    """Return the terms that are asked of a triad."""
    group = SensorSuite().groups()[triad]
    return tuple(term for term in TERMS if term.setting in group.param)


@dataclass(frozen=True)
class SheetNumber:
    """A number of a data sheet, read.

    Attributes
    ----------
    datum : Datum
        The number in a unit that cards have.
    reading : str
        How it was read, where that is not plain; empty otherwise.
    """

    datum: Datum
    reading: str = ""


class DataSheet:
    """The numbers of one sensor, taken one by one.

    Parameters
    ----------
    name, maker : str
        Name of the sensor and its manufacturer.
    grade : str
        One of `GRADES`; ``own`` assumes nothing, the others what is typical of them.
    source : str
        Document and revision.

    Raises
    ------
    SettingError
        If one is not accepted.
    """

    def __init__(self, name: str, maker: str, grade: str, source: str) -> None:
        self.name, self.maker, self.source = (
            checked_text(what, text) for what, text in (("name", name), ("maker", maker), ("source", source))
        )
        if not self.name or not self.source:
            what = "source: document and revision" if self.name else "name"
            raise SettingError(f"a card needs its {what}")
        if grade not in GRADES:
            raise SettingError(f"grade: {grade!r}; accepted is one of {', '.join(GRADES)}")
        self.grade = grade
        self._given: dict[str, dict[str, Datum]] = {}
        self._said: list[str] = []

    def take(self, triad: str, word: str, text: str) -> SheetNumber:
        """Take a number of a triad.

        Parameters
        ----------
        triad
            ``gyro`` or ``accelerometer``.
        word
            A setting of the triad, or a word of data sheets for it.
        text
            Number and unit, as the sheet writes them.

        Raises
        ------
        SettingError
            Naming triad and word: if the word, the number or the unit is not accepted, or the number is far
            beyond every known sensor.
        """
        setting = find_term(triad, word)
        where = f"{triad}, {word.strip()}"
        known = self._given.setdefault(triad, {})
        if setting in known:
            raise SettingError(f"{where}: is {setting}, which is given already; accepted is one of the two")
        found = sheet_number(triad, setting, text, self.source, known.get("range"), where)
        known[setting] = found.datum
        self._said.append(f"{triad} {setting.replace('_', ' ')} {' '.join(text.split())}")
        return found

    def take_all(self, given: Sequence[tuple[str, str]]) -> list[SheetNumber]:
        """Take numbers in any order; ranges first, since others may be parts of them.

        Parameters
        ----------
        given
            Triad, and word and number with ``=`` between them, such as ``ARW = 0.15 deg/√h``.

        Raises
        ------
        SettingError
            As `take`, or if there is no ``=``.
        """
        split = []
        for triad, text in given:
            word, sign, number = text.partition("=")
            if not sign:
                raise SettingError(
                    f"{triad} {text.strip()[:LONGEST_TEXT]}: accepted is WORD=NUMBER UNIT, such as noise "
                    "density=5 mdps/sqrt(Hz)"
                )
            split.append((triad, word, number))
        split.sort(key=lambda one: find_term(one[0], one[1]) != "range")
        return [self.take(*one) for one in split]

    def card(self) -> Card:
        """Return the card: the given numbers, what is typical of the grade for the others, and what was read.

        Raises
        ------
        SettingError
            If no number was given.
        """
        terms = {triad: dict(self._given[triad]) for triad in TRIADS if self._given.get(triad)}
        if not terms:
            raise SettingError("a card needs at least one number of the gyros or the accelerometers")
        note = f"As the sheet writes them: {'; '.join(self._said)}."
        return Card(self.name, self.maker, self.grade, note, terms, gaps_filled(terms, self.grade))


def checked_text(what: str, text: str) -> str:
    """Return a text of a card without spaces around it.

    Raises
    ------
    SettingError
        If it is too long, or has signs that cannot be printed.
    """
    text = text.strip()
    if len(text) > LONGEST_TEXT or not text.isprintable():
        raise SettingError(f"{what}: accepted are up to {LONGEST_TEXT} letters, digits and signs in one line")
    return text


def find_term(triad: str, word: str) -> str:
    """Return the setting that a word of data sheets means for a triad.

    Raises
    ------
    SettingError
        If there is none, naming the accepted words.
    """
    if triad not in TRIADS:
        raise SettingError(f"{triad!r}: accepted are {' and '.join(TRIADS)}")
    settings = [term.setting for term in asked_terms(triad)]
    plain = re.sub(r"[\s-]+", "_", word.strip().casefold())
    setting = find_setting(plain)
    if setting in settings:
        return setting
    words = [*settings, *(one for one, meant in WORDS.items() if meant in settings)]
    close = difflib.get_close_matches(plain, words, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    accepted = ", ".join(settings)
    raise SettingError(
        f"{triad}: there is no {word.strip()[:40]!r}.{hint} Accepted are {accepted}, and words of data "
        "sheets for them"
    )


def sheet_number(
    triad: str, setting: str, text: str, source: str, full_scale: Datum | None = None, where: str = ""
) -> SheetNumber:
    """Return a number of a data sheet.

    Parameters
    ----------
    triad, setting
        What it is a number of.
    text
        One number, or three for x, y and z, with a unit; after it ``rms in 100 Hz`` for noise in a band, ``at
        16.4 LSB/dps`` for steps of the output, ``at 2000 dps`` for parts of a full scale, or ``two-sided``.
    source
        Where it is from.
    full_scale
        Range of the triad, if known.
    where
        Name in messages.

    Raises
    ------
    SettingError
        If it is not accepted, saying what is.
    """
    where = where or f"{triad}, {setting}"
    try:
        return _read(triad, setting, text, source, full_scale)
    except (ValueError, OverflowError) as error:
        raise SettingError(f"{where}: {' '.join(text.split())[:LONGEST_TEXT]!r}: {error}") from error


def _read(triad: str, setting: str, text: str, source: str, full_scale: Datum | None) -> SheetNumber:
    parameter = SensorSuite().groups()[triad].param[setting]
    if len(text) > LONGEST_TEXT:
        raise ValueError(f"is longer than {LONGEST_TEXT} characters")
    example = next(term.examples[TRIADS.index(triad)] for term in TERMS if term.setting == setting)
    found = _TEXT.fullmatch(text)
    if found is None:
        raise ValueError(f"accepted is a number with its unit, such as {example}")
    values = [float(number) for number in re.findall(_NUMBER, found[1])]
    axes = getattr(parameter, "axes", ())
    if len(values) != 1 and len(values) != len(axes):
        many = f", or {len(axes)} ({', '.join(axes)})" if axes else ""
        raise ValueError(f"accepted is one number{many}, with a point before decimals, such as {example}")
    if not all(math.isfinite(value) and value >= 0 for value in values):
        raise ValueError("accepted are sizes from 0 on")
    unit, density, reading = _unit(setting, found[2], full_scale, parameter.unit, example)
    written = _written_unit(setting, unit, parameter.unit)
    sizes = [float(f"{value * unit.factor / TO_SI[written]:.12g}") for value in values]
    datum = Datum(sizes[0] if len(sizes) == 1 else tuple(sizes), written, source, density)
    _check_size(triad, setting, datum)
    return SheetNumber(datum, reading)


def _unit(
    setting: str, rest: str, full_scale: Datum | None, wanted: str, example: str
) -> tuple[SheetUnit, str, str]:
    """Return the unit of a number, its convention as a density, and how it was read."""
    rest = _QUIET.sub(" ", rest)
    side = next((name for name, pattern in _SIDES.items() if pattern.search(rest)), "")
    for pattern in _SIDES.values():
        rest = pattern.sub(" ", rest)
    is_rms = re.search(r"\brms\b", rest, re.IGNORECASE) is not None
    rest = re.sub(r"[\s(-]*\brms\b\)?", " ", rest, flags=re.IGNORECASE)
    tail = _AT.search(rest)
    at = (
        None if tail is None else (float(tail[1]), sheet_unit(re.sub(r"\b(?:band(?:width)?)\b", "", tail[2])))
    )
    rest = (rest if tail is None else rest[: tail.start()]).strip(" ,;")
    reading = ""
    if _FULL_SCALE.search(rest):
        unit, reading = _of_full_scale(setting, _FULL_SCALE.sub("%", rest), at, full_scale)
    elif not rest:
        raise ValueError(f"the unit is missing; accepted is one such as in {example}")
    else:
        unit = sheet_unit(rest)
    if is_rms:
        unit, reading = _in_band(setting, unit, at)
    elif unit.dimension[-1]:
        unit, reading = _in_steps(unit, at)
    elif at is not None and not reading:
        raise ValueError("what follows 'at' or 'in' belongs to rms, LSB or % FS; leave it out here")
    if setting == "misalignment" and unit.dimension == PURE:
        unit, reading = SheetUnit(unit.factor, ANGLE, False), "a part of another axis is that many radians"
    if unit.dimension != sheet_unit(wanted).dimension:
        kind = next((kind for kind in ALIKE if wanted in kind), (wanted,))
        raise ValueError(f"has the unit of something else; accepted are units like {' or '.join(kind)}")
    density = ""
    if setting == DENSITY:
        density = side or ONE_SIDED if unit.per_root_hertz else ""
        if side == ONE_SIDED and not unit.per_root_hertz:
            raise ValueError("a random walk is two-sided by definition")
    elif side:
        raise ValueError("one-sided and two-sided are of densities of noise")
    return unit, density, reading


def _of_full_scale(
    setting: str, rest: str, at: tuple[float, SheetUnit] | None, full_scale: Datum | None
) -> tuple[SheetUnit, str]:
    part = sheet_unit(rest)
    if setting == "scale_factor_sigma":
        return part, "a part of the full scale is that part of the scale factor"
    if at is not None:
        size, unit = at[0] * at[1].factor, at[1]
    elif full_scale is not None:
        unit = sheet_unit(full_scale.unit)
        size = float(np.max(full_scale.value)) * unit.factor
    else:
        raise ValueError(
            "% FS needs the range: give the range first, or write it after the unit: % FS at 2000 dps"
        )
    return SheetUnit(part.factor * size, unit.dimension, False), "a part of the range"


def _in_band(setting: str, unit: SheetUnit, at: tuple[float, SheetUnit] | None) -> tuple[SheetUnit, str]:
    """Return rms noise in a band as a density: over the root of the bandwidth, one-sided."""
    if setting != DENSITY:
        raise ValueError("rms is a size of noise; leave it out here")
    if unit.per_root_hertz:
        return unit, ""
    if at is None or at[1].dimension != sheet_unit("Hz").dimension or not at[0] > 0:
        raise ValueError("rms noise needs its bandwidth: write it after the unit, such as rms in 100 Hz")
    root = math.sqrt(at[0] * at[1].factor)
    angle, length, time, kelvin, step = unit.dimension
    dimension = (angle, length, time + 0.5, kelvin, step)
    return SheetUnit(unit.factor / root, dimension, True), "rms over the root of the bandwidth, one-sided"


def _in_steps(unit: SheetUnit, at: tuple[float, SheetUnit] | None) -> tuple[SheetUnit, str]:
    """Return a unit with steps of the output in it as one without."""
    steps = 0.0 if at is None else at[1].dimension[-1]
    if at is None or abs(steps) != 1 or not at[0] > 0:
        raise ValueError("LSB needs the sensitivity: write it after the unit, such as LSB at 16.4 LSB/dps")
    size = (at[0] * at[1].factor) ** -steps  # of a step: the sensitivity may be in LSB/dps or in dps/LSB
    times = unit.dimension[-1]
    rest = [a - times * steps * b for a, b in zip(unit.dimension, at[1].dimension, strict=True)]
    dimension = (rest[0], rest[1], rest[2], rest[3], 0.0)
    return SheetUnit(unit.factor * size**times, dimension, unit.per_root_hertz), "steps of the output"


def _written_unit(setting: str, unit: SheetUnit, wanted: str) -> str:
    """Return the unit in which a card writes a number: that of the sheet if cards have it."""
    kind: tuple[str, ...] = next((kind for kind in ALIKE if wanted in kind), (wanted,))
    if setting == DENSITY:
        kind = tuple(one for one in kind if one.endswith("/√Hz") is unit.per_root_hertz)
    same = (one for one in kind if math.isclose(TO_SI[one], unit.factor, rel_tol=1e-9))
    return next(same, wanted if wanted in kind else kind[0])


@functools.cache
def usual_range(triad: str, setting: str) -> tuple[float, float]:
    """Return the least and the largest number of all cards, in the unit of the setting, without zeros."""
    parameter = SensorSuite().groups()[triad].param[setting]
    tables: list[Mapping[str, Mapping[str, Datum]]] = [card.terms for card in cards().values()]
    data = [table.get(triad, {}).get(setting) for table in (*tables, *grades().values())]
    sizes = np.concatenate([np.ravel(one.in_unit(parameter.unit)) for one in data if one is not None])
    return float(sizes[sizes > 0].min()), float(sizes.max())


def _check_size(triad: str, setting: str, datum: Datum) -> None:
    parameter = SensorSuite().groups()[triad].param[setting]
    sizes = np.atleast_1d(datum.in_unit(parameter.unit))
    least, largest = usual_range(triad, setting)
    low, high = least / BEYOND, min(largest * BEYOND, parameter.bounds[1])
    if setting in MAY_BE_ZERO:
        sizes = sizes[sizes > 0]
    if np.any(sizes < low) or np.any(sizes > high):
        raise ValueError(
            f"is too {'small' if np.any(sizes < low) else 'large'} for a sensor: accepted are {low:.3g} to "
            f"{high:.3g} {parameter.unit}, {BEYOND:g} times beyond all cards. Is the unit right? A number "
            "that is right all the same goes into the file by hand"
        )
