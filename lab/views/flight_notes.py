"""Notes on stretches of a flight, as links and the command line write them: ``60-75:Look here``.

A note is text, whoever wrote it: it is never read as markup.
"""

from __future__ import annotations

import re
import unicodedata

LONGEST = 200
"""Longest text of a note [characters]."""
ACCEPTED = (
    f"accepted is a time or a stretch of time in seconds with a text of up to {LONGEST} characters, such as "
    "60-75:Look here."
)
"""What a note must be, in words."""

_SECONDS = r"\d{1,9}(?:\.\d{1,9})?"
_WRITTEN = re.compile(rf"({_SECONDS})(?:-({_SECONDS}))?:(.*)", re.ASCII | re.DOTALL)


def plain_text(typed: str) -> str:
    """Return a text in one line, without control characters and marks of the direction of writing."""
    kept = (" " if unicodedata.category(one).startswith("C") else one for one in typed[: 4 * LONGEST])
    return " ".join("".join(kept).split())


def read_note(written: str) -> tuple[float, float, str] | None:
    """Return start and end [s] and the text of a note; None if it is not acceptable.

    >>> read_note("60-75:Look here")
    (60.0, 75.0, 'Look here')
    >>> read_note("60: Look here")
    (60.0, 60.0, 'Look here')
    """
    parts = _WRITTEN.fullmatch(written)
    if parts is None:
        return None
    start, end, text = float(parts[1]), float(parts[2] or parts[1]), plain_text(parts[3])
    return (start, end, text) if start <= end and 0 < len(text) <= LONGEST else None
