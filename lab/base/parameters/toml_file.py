"""TOML file: the one reader and the one writer of TOML; excessive content is refused before it is parsed.

In `tomllib`, time and memory grow with the square of the number of parts of a dotted key, deeply nested
values raise a `RecursionError`, and integers may be so long that Python refuses to print them. Files come
from untrusted sources, so these are counted first, in one pass over the text.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

MAX_BYTES = 2**20
"""Largest TOML text accepted [bytes]; the largest that ships, the cards of sensors, has 30 kB."""
MAX_DEPTH = 16
"""Deepest nesting of arrays and tables in brackets accepted; a covariance matrix has 2."""
MAX_PARTS = 8
"""Most parts of a dotted key accepted; the settings have 3, cards 4."""
MAX_WORD = 1000
"""Longest accepted number or bare key [characters]; the largest float has 309 digits."""
MAX_SIGNS = 150_000
"""Most accepted dots, commas, equals signs and brackets outside of strings.

A motion definition of 1 MB has 135,000. The worst text of so many takes 130 MB and about a second.
"""

_TOKEN = re.compile(
    r'''"""(?:[^\\]|\\.)*?(?:"{3,5}|\Z)|\'\'\'.*?(?:'{3,5}|\Z)'''  # texts of several lines
    r"""|"(?:[^"\\\n]|\\.)*(?:["\n]|\Z)|'[^'\n]*(?:['\n]|\Z)"""  # texts of one line
    r"""|\#[^\n]*|[^\s"'\#\[\]{}=,.]+|[\n\[\]{}=,.]""",  # comments, words, signs
    re.DOTALL,
)

_SIGNS = frozenset(".,=[]{}")
_DEEPER = {"[": 1, "{": 1, "]": -1, "}": -1}  # change of the nesting level by a sign


class TomlError(ValueError):
    """A text or a file that cannot be read as TOML; the message says what is accepted."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises
    ------
    TomlError
        If it is not TOML, or is larger or more deeply nested than accepted.
    """
    if len(text) > MAX_BYTES:
        raise TomlError(f"too large; accepted are TOML files up to {MAX_BYTES // 2**20} MB")
    _check_bounds(text)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise TomlError(f"is not TOML: {error}") from error


def toml_text(values: Mapping[str, Any], *, inline: bool = False) -> str:
    """Return values as TOML text, the inverse of `parse_toml`.

    Parameters
    ----------
    values
        Texts, numbers, truth values, and lists and tables of them.
    inline
        Whether each value stands on one line, tables too.
    """
    import tomlkit  # noqa: PLC0415 - takes 0.1 s, and only writing needs it

    def table(value: Mapping[str, Any]) -> Any:
        found = tomlkit.inline_table()
        found.update({key: write_value(item) for key, item in value.items()})
        return found

    def write_value(value: Any) -> Any:
        if isinstance(value, str):
            # A carriage return within a multi-line string would be read as the end of a line.
            return tomlkit.string(value, multiline="\n" in value and "\r" not in value and not inline)
        if isinstance(value, Mapping) and inline:
            return table(value)
        if isinstance(value, Mapping):
            return {key: write_value(item) for key, item in value.items()}
        return [write_value(item) for item in value] if isinstance(value, list | tuple) else value

    return tomlkit.dumps({key: write_value(item) for key, item in values.items()})


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file in UTF-8, with or without byte order mark.

    Raises
    ------
    TomlError
        If it cannot be read, is not an ordinary file, or is not accepted by `parse_toml`.
    """
    return parse_toml(read_text(path))


def read_text(path: Path) -> str:
    """Return the text of a TOML file, line ends as LF.

    Raises
    ------
    TomlError
        If it cannot be read, is not an ordinary file, is too large, or is not text in UTF-8.
    """
    try:
        content = _content(path)
    except OSError as error:
        raise TomlError(f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # such as a name with a zero in it
        raise TomlError(f"cannot be read: {error}") from error
    if len(content) > MAX_BYTES:
        raise TomlError(f"too large; accepted are TOML files up to {MAX_BYTES // 2**20} MB")
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise TomlError("is not TOML: the text is not UTF-8") from error


def _content(path: Path) -> bytes:
    """Return the content of an ordinary file, at most one byte more than accepted."""
    # Opening or reading a pipe or a device could block forever.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError("is not an ordinary file")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read(MAX_BYTES + 1)
    finally:
        os.close(descriptor)


def _check_bounds(text: str) -> None:
    """Refuse text that `tomllib` cannot handle.

    Up to the first error in the text, these are the same tokens that `tomllib` reads; there, it stops.
    """
    depth = dots = signs = 0
    for found in _TOKEN.finditer(text):
        word = found[0]
        if word in _SIGNS:
            signs += 1
            dots = dots + 1 if word == "." else 0
            depth = max(depth + _DEEPER.get(word, 0), 0)
            if dots >= MAX_PARTS:
                raise _too_much(text, found, f"a key of more than {MAX_PARTS} parts with dots between them")
            if depth > MAX_DEPTH:
                raise _too_much(text, found, f"brackets inside one another more than {MAX_DEPTH} times")
            if signs > MAX_SIGNS:
                raise _too_much(text, found, f"more than {MAX_SIGNS} values")
        elif word == "\n":
            dots = 0
        elif len(word) > MAX_WORD and word[0] not in "\"'#":
            raise _too_much(text, found, f"a number or a key of more than {MAX_WORD} characters")


def _too_much(text: str, found: re.Match[str], what: str) -> TomlError:
    line = text.count("\n", 0, found.start()) + 1
    return TomlError(f"line {line}: {what}; accepted are settings as the lab writes them, which have fewer")
