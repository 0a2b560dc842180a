"""Mission name: the names of user missions that every file system accepts."""

from __future__ import annotations

import re
import unicodedata

from lab.base.files.mission_error import MissionError

MAX_LETTERS = 48
"""Longest name [characters]: with its ending and in UTF-8 it fits every file system."""
PUNCTUATION = " -_.+()"
"""Accepted characters of a name besides letters and digits."""

_ENDINGS = (".toml", ".csv", ".gz")
_RESERVED = frozenset(
    {
        "con",
        "prn",
        "aux",
        "nul",
        "log",
        *(f"{port}{number}" for port in ("com", "lpt") for number in range(10)),
    }
)
"""Devices of Windows, and ``log.toml``, which describes a log whatever stands in it."""


def accepted_name(name: str) -> str:
    """Return a name in the form in which it is stored (Unicode NFC).

    Raises
    ------
    MissionError
        If it is empty or too long, has a character other than letters, digits and `PUNCTUATION`, begins or
        ends with one that shells and file systems treat specially, is reserved, or ends like a file.
    """
    name = unicodedata.normalize("NFC", name)
    wrong = _find_problem(name)
    if wrong:
        raise MissionError(
            f"name {name!r}: {wrong}; accepted are 1 to {MAX_LETTERS} letters, digits, spaces, - _ . + ( ),"
            " such as alpine_tour"
        )
    return name


def without_archive(text: str) -> str:
    """Return the name of a file without the ending of an archive: it holds the files of a log."""
    return re.sub(r"(?i)\.zip$", "", text)


def suggested_name(text: str) -> str:
    """Return an accepted name as close as possible to a text, such as the name of a file."""
    text = unicodedata.normalize("NFC", text)
    while text.lower().endswith(_ENDINGS):
        text = text[: text.rindex(".")]
    kept = re.sub(r"_+", "_", "".join(letter if _is_plain(letter) else "_" for letter in text))
    name = kept[:MAX_LETTERS].strip(f"{PUNCTUATION}")
    if not _find_problem(name):
        return name
    name = f"mission_{name}"[:MAX_LETTERS].strip(PUNCTUATION)
    return name if not _find_problem(name) else "mission"


def _find_problem(name: str) -> str:
    """Return the problem of a name; empty if it is accepted."""
    strange = next((letter for letter in name if not _is_plain(letter)), None)
    if not name:
        wrong = "is empty"
    elif len(name) > MAX_LETTERS:
        wrong = f"has {len(name)} characters"
    elif strange is not None:
        wrong = f"{strange!r} is not possible in the name of a file everywhere"
    elif name[0] in " -." or name[-1] in " .":
        wrong = "begins with a space, hyphen or point, or ends with a space or point"
    elif name.partition(".")[0].strip().lower() in _RESERVED:
        wrong = "is reserved"
    elif name.lower().endswith(_ENDINGS):
        wrong = "ends like the name of a file"
    else:
        wrong = ""
    return wrong


def _is_plain(letter: str) -> bool:
    return letter in PUNCTUATION or unicodedata.category(letter)[0] in "LNM"
