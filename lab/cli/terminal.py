"""Terminal: tables, progress and units for screens of any width and encoding."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import shutil
import sys
import textwrap
import threading
import time
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, ClassVar, Self, TextIO, cast

PATIENCE = 0.5
"""Time after which unfinished work shows its progress [s]."""

STRIDE = 0.1
"""Part of the work after which a step that counts is shown again where there is no terminal."""

ERASE = "\r\x1b[K"
"""What a terminal obeys by erasing the line."""

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

_NUMBER = re.compile(r"\d[\d.,e+]*")
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters except tabs and ends of lines, and marks that change the direction of writing."""


def spell_what_cannot_be_encoded() -> None:
    """Make standard output and error write ``deg`` for ``°`` and so on if their encoding lacks the sign."""
    codecs.register_error("ins-lab-spelled", _spell)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="ins-lab-spelled")


def escape_controls(text: str) -> str:
    """Return a text with escapes in place of signs that a terminal obeys, or that change the direction.

    A stranger's mission or the name of a file may contain them, to clear the screen or to look like another
    text.
    """
    return _OBEYED.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class VisibleText:
    """A stream that writes every text as `escape_controls`; in all else, it is the stream below it.

    Parameters
    ----------
    stream
        The stream below it.
    """

    starting: ClassVar[TextIO | None] = None
    """The terminal that shows `say_starting`."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text, in place of `say_starting`."""
        _erase_starting()
        return self.stream.write(escape_controls(text))

    def __getattr__(self, name: str) -> Any:
        """Return anything else of the stream below it."""
        return getattr(self.stream, name)


@contextlib.contextmanager
def visible_output() -> Iterator[None]:
    """Write to standard output and error as `escape_controls` while this is open."""
    out, error = (cast(TextIO, VisibleText(stream)) for stream in (sys.stdout, sys.stderr))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            yield
        finally:
            _erase_starting()


def say_starting() -> None:
    """Say on a terminal that a command starts, until it writes something: many need a second before that."""
    stream = sys.stderr.stream if isinstance(sys.stderr, VisibleText) else sys.stderr
    if stream is not None and stream.isatty():
        stream.write("starting ...")
        stream.flush()
        VisibleText.starting = stream


def _erase_starting() -> None:
    terminal, VisibleText.starting = VisibleText.starting, None
    if terminal is not None:
        terminal.write(ERASE)
        terminal.flush()


def drop_output() -> None:
    """Drop what still waits to be written to standard output: Python would try again when it ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_in_ascii(sign) for sign in error.object[error.start : error.end]), error.end


def _in_ascii(sign: str) -> str:
    letter = unicodedata.normalize("NFKD", sign)[0]  # é becomes e and an accent
    return _SPELLED.get(sign) or (letter if letter.isascii() else "?")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Collection[int] = ()) -> str:
    """Return an aligned table.

    If the terminal is too narrow, the last column is wrapped; in a pipe it is not.

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


def paragraphs(*parts: str) -> str:
    """Return texts with an empty line between them, without those that are empty."""
    return "\n\n".join(filter(None, parts))


def format_list(sentences: Iterable[str]) -> str:
    """Return sentences as a list, each on a line."""
    return "\n".join(f"- {sentence}" for sentence in sentences)


class ProgressLine:
    """Reports on standard error the progress of work that takes longer than `PATIENCE`.

    In a terminal, one line shows the current step and the seconds, and disappears when the work is done.
    Elsewhere, each step is one line; one that differs in its numbers alone is shown every `STRIDE`.

    Parameters
    ----------
    task
        Name of the whole task.
    stream
        Where to write; standard error by default.
    """

    def __init__(self, task: str, stream: TextIO | None = None) -> None:
        self._task = task
        self._step = ""
        self._fraction = self._written = 0.0
        given = stream or sys.stderr
        self._stream = given.stream if isinstance(given, VisibleText) else given
        self._alive = self._stream.isatty()
        self._shown = False
        self._begin = time.monotonic()
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._watch = threading.Thread(target=self._report, daemon=True)

    def __enter__(self) -> Self:
        self._watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._watch.join()
        if self._alive and self._shown:
            self._stream.write(ERASE)
            self._stream.flush()

    def __call__(self, step: str, fraction: float) -> None:
        """Report the current step and the fraction of the whole that is done."""
        with self._lock:
            counts = fraction >= self._written + STRIDE and step != self._step
            new = counts or _NUMBER.sub("", step) != _NUMBER.sub("", self._step)
            self._step, self._fraction = step, fraction
            if self._shown and fraction < 1 and (new or self._alive):
                self._write()

    def _report(self) -> None:
        pause = PATIENCE
        while not self._done.wait(pause):
            with self._lock:
                self._shown = True
                self._write()
            if not self._alive:
                break
            pause = 1.0

    def _write(self) -> None:
        line = escape_controls(f"{self._task}: {self._step} ..." if self._step else f"{self._task} ...")
        self._written = self._fraction
        seconds = time.monotonic() - self._begin
        self._stream.write(
            f"{ERASE}{line} {self._fraction:.0%}, {seconds:.0f} s" if self._alive else f"{line}\n"
        )
        self._stream.flush()
