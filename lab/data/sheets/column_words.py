"""Column words: the words of column headings, in ``words.toml``: what they name, and in other languages.

Apps such as phyphox export in the language of the phone: ``Beschleunigung x (m/s^2)``, ``Temps (s)``. Phones
and loggers call a magnetometer ``Magnetic field x``, ``magnetometerX``, ``mag_x_uT``, ``Bx``; SensorLog on an
iPhone calls the field of its compass ``locationHeadingX``.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache
from pathlib import Path

from lab.base.parameters.toml_file import read_toml

_TABLES = read_toml(Path(__file__).with_name("words.toml"))
SENSORS = {name: frozenset(text.split()) for name, text in _TABLES["sensors"].items()}
"""Words of sensors and of times, by what they say."""
WORSE = {word: int(rank) for rank, text in _TABLES["worse"].items() for word in text.split()}
"""How much worse a column is for words in its heading: what is estimated, relative or of another origin."""
_ENTRY = re.compile(r"(\w+)(?:\[(.*)\])?(?: \+(\d+))?")
"""A quantity, its unit, and by how much it is worse than others."""


def _names(table: str) -> dict[str, tuple[str, str, int]]:
    """Return quantity, unit and rank of each whole heading of a table."""
    found: dict[str, tuple[str, str, int]] = {}
    for entry, text in _TABLES[table].items():
        parts = _ENTRY.fullmatch(entry)
        assert parts is not None
        found |= dict.fromkeys(text.split(), (parts[1], parts[2] or "", int(parts[3] or 0)))
    return found


NAMES, STAMPS = _names("names"), _names("stamps")
"""Quantity, unit and rank of headings that are a name of their own, and of those of time stamps."""
PATTERNS = tuple(
    (quantity, re.compile("".join(text.format(**_TABLES["parts"]).split())))
    for quantity, text in _TABLES["patterns"].items()
)
"""What a column is by its words, put together; the first pattern that fits is taken."""
_IDEOGRAMS = re.compile(r"[\u4e00-\u9fff]")
"""How a word of Chinese begins, which letters may stand beside without a blank."""
_MEANING = {word: meaning for meaning, text in _TABLES["languages"].items() for word in text.split()}
_MEANING |= _TABLES["phrases"]
_WORDS = sorted(_MEANING, key=len, reverse=True)
_KNOWN = re.compile(
    rf"(?<![a-z])(?:{'|'.join(_WORDS)})(?=[xyz]?(?![a-z]))|{'|'.join(filter(_IDEOGRAMS.match, _WORDS))}",
    re.IGNORECASE,
)
_OF_ACCURACY = re.compile(r"(?i)accuracy (horizontal|vertical)")
FIELD_WORDS = SENSORS["field"]
"""Words of a measured field; a vector is one only beside another of them."""


def _words_pattern(*tables: frozenset[str]) -> str:
    """Return a pattern of all words in tables."""
    return "|".join(sorted(frozenset().union(*tables)))


_SENSED = SENSORS["gyro"] | SENSORS["accelerometer"]
_SENSED_WORDS = _words_pattern(_SENSED, SENSORS["short_rate"], SENSORS["short_force"])
GLUED = re.compile(rf"(?i)^(?:.*[\s_.:/-])?(?:{_SENSED_WORDS})[xyz]$")
"""A word of a sensor with its axis behind it, such as ``AccX`` or ``imu_gx``."""
LEADING = re.compile(rf"(?i)^([xyz])[\s_.-]*(?:rate|{_words_pattern(_SENSED, FIELD_WORDS)})(?![a-z])")
"""A word of a sensor behind its axis, such as ``x_acc``."""
MIDDLE = re.compile(
    rf"(?i)(?:^|[\s_.:/-])(?:{_words_pattern(_SENSED, FIELD_WORDS - {'vector'})})[\s_.-]+([xyz][\s_.-]+)"
    r"(?!rms|peak|avg|median|sum)(?=[a-z])"
)
"""A word of a sensor with its axis and a place behind it, such as ``acc_x_dashboard``."""
GLUED_FIELD = re.compile(r"(?i)^(?:(?:.*[\s_.:/-])?mag|[bm])([xyz])$")
"""A short name with its axis, such as ``mx`` or ``imu_magx``."""


def names_field(words: frozenset[str], joined: str) -> bool:
    """Return whether the words of a heading, its axis cut off, name a measured magnetic field.

    Parameters
    ----------
    words
        The words.
    joined
        The same, put together.
    """
    named = words & (FIELD_WORDS - {"vector"}) or joined in SENSORS["short_field"]
    return bool(named) and not words & SENSORS["computed_field"]


@lru_cache(maxsize=4096)
def in_english(text: str) -> str:
    """Return a heading with the words of other languages in English; others are not changed.

    Parameters
    ----------
    text
        The heading, or the name of a file.
    """
    plain = "".join(map(_without_accent, unicodedata.normalize("NFC", text)))
    translated = _KNOWN.sub(_meaning, plain)
    return _OF_ACCURACY.sub(r"\1 accuracy", translated) if translated != plain else text


def _meaning(found: re.Match[str]) -> str:
    word = _MEANING[found[0].lower()]
    return f" {word} " if _IDEOGRAMS.match(found[0]) else word


def _without_accent(character: str) -> str:
    """Return a letter without its accent; signs such as ° and ² stay."""
    base = unicodedata.normalize("NFD", character)[0]
    return base if base.isascii() and base.isalpha() else character
