"""Hand-out: which file and which link each student gets of a homework with variants."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import NamedTuple

from lab.classroom.homework.grading import text_cell
from lab.classroom.homework.hand_in import LONGEST_NAME
from lab.classroom.homework.homework_file import Keyed
from lab.classroom.homework.variant import fold_name
from lab.classroom.lessons.fields import LessonError

LINKS = "links.csv"
"""Name of the table of links."""
_LONGEST_FILE = 60
"""Longest name of a file without its ending [characters]: with four bytes each, below 255 bytes."""


class HandedOut(NamedTuple):
    """The homework of one student.

    Attributes
    ----------
    name : str
        The student's name.
    file : str
        Name of the file.
    query : str
        What follows the address of the teacher's server in the student's link.
    """

    name: str
    file: str
    query: str


def handed_out(keyed: Keyed, students: Sequence[str]) -> list[HandedOut]:
    """Return what each student gets, in the order of the names given.

    Raises
    ------
    LessonError
        If a name is not accepted, or is there twice.
    """
    found, files, names = list[HandedOut](), set[str](), set[str]()
    for written in students:
        name = " ".join(written.split())
        if not name or len(name) > LONGEST_NAME or not name.isprintable():
            raise LessonError(
                f"{name[:40]!r}: accepted are names of 1 to {LONGEST_NAME} printable characters"
            )
        if fold_name(name) in names:
            raise LessonError(f"{name}: is there twice; accepted are different names")
        names.add(fold_name(name))
        file = _choose_free_name(_plain_name(name), files)
        files.add(file.casefold())
        found.append(HandedOut(name, file, f"?homework={keyed.judge_for(name).homework.link}"))
    return found


def links_text(made: Sequence[HandedOut]) -> str:
    """Return the table of links as csv."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(("Name", "File", "Link: the address of your server, followed by"))
    writer.writerows((text_cell(one.name), text_cell(one.file), one.query) for one in made)
    return buffer.getvalue()


def _plain_name(name: str) -> str:
    """Return a name for a file: letters and digits of any script, and underlines between words."""
    words = "".join(sign if sign.isalnum() or sign in "-" else " " for sign in name).split()
    return "_".join(words).strip("-")[:_LONGEST_FILE] or "student"


def _choose_free_name(name: str, taken: set[str]) -> str:
    file, number = f"{name}.homework", 1
    while file.casefold() in taken:
        number += 1
        file = f"{name}_{number}.homework"
    return file
