"""Place: the line of a lesson's file that a message is about."""

from __future__ import annotations

import re

_MESSAGE = re.compile(r"(?:step (?P<step>\d+): )?(?P<key>\w+)(?:, \w+)*(?:: (?P<path>[\w.]+))?")
_HEAD = re.compile(r"\s*\[\[\s*step\s*\]\]")
_TEXTS = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)


def line_of(text: str, message: str) -> int:
    """Return the line, from 1, that a message of `lab.classroom.lessons.lesson_file` is about.

    Parameters
    ----------
    text
        The file, which is TOML.
    message
        The message: the step if there is one, the key, and the path of a setting if it is about one. A
        missing key has the line at which its step begins.
    """
    found = _MESSAGE.match(message)
    lines = _TEXTS.sub(lambda quoted: re.sub(r"[^\n]", " ", quoted[0]), text).split("\n")
    heads = [number for number, line in enumerate(lines) if _HEAD.match(line)]
    first, last = 0, heads[0] if heads else len(lines)
    if found is None:
        return 1
    if found["step"] is not None:
        number = int(found["step"])
        if number > len(heads):  # the steps are written in another way, such as in one line
            return 1
        first, last = heads[number - 1], heads[number] if number < len(heads) else len(lines)
    key = _line_with(lines, found["key"], first, last)
    if key is None:
        return first + 1
    parts = [] if found["path"] is None else found["path"].split(".")
    inside = _line_with(lines, parts[-1], key, last) if parts else None
    return 1 + (key if inside is None else inside)


def _line_with(lines: list[str], name: str, first: int, last: int) -> int | None:
    """Return the first line of a stretch that sets a key, or begins its table; None without one."""
    sets = re.compile(rf"(?:^|[\s.{{,\[]){re.escape(name)}\s*(?:[=.\]]|$)")
    return next((number for number in range(first, last) if sets.search(lines[number])), None)
