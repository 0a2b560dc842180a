"""Terminal: tables, progress and units for people who read them on a screen of any width and encoding."""

from __future__ import annotations

import codecs
import shutil
import sys
import textwrap
import threading
import unicodedata
from collections.abc import Collection, Sequence
from typing import Self, TextIO

PATIENCE = 0.5
"""Time after which work still under way says so [s]."""

_SPELLED = {
    "°": "deg",
    "µ": "u",
    "√": "sqrt",
    "σ": "sigma",
    "²": "^2",
    "³": "^3",
    "±": "+-",
    "×": "x",
    "₀": "0",
}


def spell_what_cannot_be_encoded() -> None:
    """Let standard output and error write ``deg`` for ``°`` and so on where their encoding lacks the sign."""
    codecs.register_error("ins-lab-spelled", _spell)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="ins-lab-spelled")


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_in_ascii(sign) for sign in error.object[error.start : error.end]), error.end


def _in_ascii(sign: str) -> str:
    letter = unicodedata.normalize("NFKD", sign)[0]  # é is e and an accent
    return _SPELLED.get(sign) or (letter if letter.isascii() else "?")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Collection[int] = ()) -> str:
    """Return an aligned table.

    Where the terminal is too narrow, the last column goes on in further lines; in a pipe it does not.

    Parameters
    ----------
    header
        Titles of the columns.
    rows
        One row of cells each.
    right
        Columns aligned to the right.
    """
    lines = [header, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    start = sum(widths[:-1]) + 2 * (len(header) - 1)
    room = max(shutil.get_terminal_size(fallback=(10_000, 24)).columns - start, 20)
    out = []
    for line in lines:
        cells = [
            cell.rjust(width) if column in right else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]
        last, *more = textwrap.wrap(cells[-1], room, break_on_hyphens=False) or [""]
        out.append("  ".join([*cells[:-1], last]).rstrip())
        out.extend(" " * start + rest for rest in more)
    return "\n".join(out)


class Progress:
    """A line on standard error while something takes longer than `PATIENCE`.

    In a terminal the line follows the news and goes when the work is done; elsewhere it is written once.

    Parameters
    ----------
    what
        What is being done.
    stream
        Where to write; standard error by default.
    """

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self._what = what
        self._news = ""
        self._stream = stream or sys.stderr
        self._alive = self._stream.isatty()
        self._shown = threading.Event()
        self._timer = threading.Timer(PATIENCE, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Self:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        self._timer.join()
        if self._alive and self._shown.is_set():
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def __call__(self, news: float | str) -> None:
        """Take news of the work: the fraction done, or what is done now."""
        self._news = f" {news}" if isinstance(news, str) else f" {news:.0%}"
        if self._alive and self._shown.is_set():
            self._show()

    def _show(self) -> None:
        line = f"{self._what}{self._news} ..."
        self._stream.write(f"\r\x1b[K{line}" if self._alive else f"{line}\n")
        self._stream.flush()
        self._shown.set()
