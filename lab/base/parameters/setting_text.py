"""Setting text: a value written after ``--set`` or in an address, read according to its declaration.

Such a text is never parsed as part of a file: its declaration determines the possible types. The setting
itself checks the value afterwards.
"""

from __future__ import annotations

import json
import re
from typing import Any

import param

MAX_CHARACTERS = 20_000
"""Longest text of a value accepted; a full covariance of 21 states has 11,000 characters."""
MAX_PATH = 200
"""Longest accepted dotted path [characters]; the longest existing one has about 40."""
MAX_DIGITS = 400
"""Longest accepted number [characters]; the largest float has 309 digits."""

_MAX_DEPTH = 3
"""Deepest nesting of lists; settings have two."""
# Matches a word longer than any number.
_LONG_WORD = re.compile(rf"[^\s,\[\]]{{{MAX_DIGITS + 1}}}")
_NUMBER = re.compile(r"[+-]?(\d+(_\d+)*\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
_WHOLE = re.compile(r"[+-]?\d+(_\d+)*", re.ASCII)
_SWITCH = {"true": True, "True": True, "false": False, "False": False}


def value_of(declaration: param.Parameter, text: str) -> Any:
    """Return the value that a text gives a setting.

    Parameters
    ----------
    declaration
        The parameter of the setting.
    text
        Numbers and lists of numbers as in TOML and JSON; words with or without quotes.

    Returns
    -------
    object
        The value of the text; the text itself if such a setting cannot have it.

    Raises
    ------
    ValueError
        If the text, or a number in it, is too long, or lists are nested too deeply.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"has {len(text)} characters; accepted are up to {MAX_CHARACTERS}")
    word = _without_quotes(text)
    if isinstance(declaration, param.String):
        return word
    if isinstance(declaration, param.Boolean):
        return _SWITCH.get(text, text)
    if isinstance(declaration, param.Selector):
        return next((one for one in declaration.objects if str(one) == word), word)
    if _LONG_WORD.search(text):
        raise ValueError(f"has a number of more than {MAX_DIGITS} characters")
    return _numbers(text) if text.startswith("[") else _number(word)


def _without_quotes(text: str) -> str:
    quoted = len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'"
    return text[1:-1] if quoted else text


def _number(text: str) -> int | float | str:
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text


def _numbers(text: str) -> Any:
    """Return a list of numbers, or of lists of them; the text itself if it is not such a list."""
    depth = deepest = 0
    for sign in text:
        depth += (sign == "[") - (sign == "]")
        deepest = max(deepest, depth)
    if deepest > _MAX_DEPTH:
        raise ValueError(f"has lists inside one another {deepest} times; accepted are up to {_MAX_DEPTH}")
    try:
        return json.loads(text)
    except ValueError:
        return text
