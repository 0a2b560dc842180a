"""Roster: the students of a course, from the csv that a learning platform exports.

Recognised are the gradebook of Canvas, the participants, the grades and the offline grading worksheet of
Moodle, and any csv with a column of names. The cells of a student are kept as they are, because a platform
finds its students by them.

References
----------
Canvas, `lib/gradebook_exporter.rb`: headings Student (or LastName, FirstName), ID, SIS User ID, SIS Login ID,
Section; a row "Points Possible". Moodle, *Grade import* and `mod/assign/feedback/offline`: First name, Last
name, ID number, Email address; Identifier, Full name, Grade, Last modified (grade).
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from lab.classroom.homework.hand_in import LONGEST_NAME
from lab.classroom.homework.variant import fold_name

CANVAS, MOODLE, NAMES = "Canvas", "Moodle", "names"
"""Where a roster comes from; the last one for a list of names that neither of them wrote."""
LARGEST = 2_000_000
"""Largest roster that is read [bytes]: a gradebook of 1000 students and 50 assignments has 0.5 MB."""
MOST_STUDENTS = 2000
"""Most students; as many as files that are graded."""
_DELIMITERS = ",;\t"
_TEST_STUDENT = ("student, test", "test student")
"""What Canvas calls the student that a teacher plays."""
_POINTS_POSSIBLE = "points possible"
_FULL = ("full name", "name", "student", "student name")
_FIRST, _LAST = ("first name", "firstname", "given name"), ("last name", "lastname", "surname", "family name")
ACCEPTED = (
    "accepted is the gradebook that Canvas exports, the participants or grades that Moodle exports, or a csv "
    "with a column Name, Full name or Student, or with First name and Last name"
)


class RosterError(ValueError):
    """A roster that is not accepted; the message says why, and what is accepted."""


class Student(NamedTuple):
    """A student of a roster.

    Attributes
    ----------
    name : str
        The name, the given name first.
    cells : mapping of str to str
        The cells of the roster by their heading.
    """

    name: str
    cells: Mapping[str, str]


class Roster(NamedTuple):
    """The students of a course.

    Attributes
    ----------
    kind : str
        `CANVAS`, `MOODLE` or `NAMES`.
    headings : tuple of str
        The headings, as they are written.
    students : tuple of Student
        The students, in the order of the file.
    """

    kind: str
    headings: tuple[str, ...]
    students: tuple[Student, ...]

    def by_name(self) -> dict[str, Student]:
        """Return the students by their names as `lab.classroom.homework.variant.fold_name` compares them.

        Names that two students have are left out.
        """
        count = Counter(fold_name(student.name) for student in self.students)
        return {fold_name(one.name): one for one in self.students if count[fold_name(one.name)] == 1}

    def same_names(self) -> list[str]:
        """Return the names that more than one student has."""
        count = Counter(fold_name(student.name) for student in self.students)
        return sorted({one.name for one in self.students if count[fold_name(one.name)] > 1})


def read_roster(path: Path) -> Roster:
    """Return the students of a csv.

    Raises
    ------
    RosterError
        If the file cannot be read, or has no students.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise RosterError(f"{path.name}: has {size} bytes; accepted are up to {LARGEST // 10**6} MB")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise RosterError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise RosterError(f"{path.name}: is not text in UTF-8; {ACCEPTED}") from error
    try:
        return roster_of(text)
    except RosterError as error:
        raise RosterError(f"{path.name}: {error}") from error


def roster_of(text: str) -> Roster:
    """Return the students of the text of a csv; the delimiter is a comma, a semicolon or a tab.

    Raises
    ------
    RosterError
        If there are none.
    """
    first = text.partition("\n")[0]
    delimiter = max(_DELIMITERS, key=first.count)
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True))
    except csv.Error as error:
        raise RosterError(f"is no csv: {error}; {ACCEPTED}") from error
    headings = tuple(cell.strip() for cell in rows[0]) if rows else ()
    known = {heading.casefold(): place for place, heading in enumerate(headings)}
    kind = _kind(known)
    students = []
    for number, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) > len(headings):
            raise RosterError(f"line {number} has {len(row)} cells, and there are {len(headings)} headings")
        cells = dict(zip(headings, (*row, *("",) * (len(headings) - len(row))), strict=True))
        written = _format_name(row, known)
        if not written or (kind == CANVAS and _is_no_student(written)):
            continue
        name = " ".join(written.split())
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise RosterError(
                f"line {number}: accepted are names of up to {LONGEST_NAME} printable characters"
            )
        students.append(Student(name, cells))
    if not students:
        raise RosterError("has no students below its headings")
    if len(students) > MOST_STUDENTS:
        raise RosterError(f"has {len(students)} students; accepted are up to {MOST_STUDENTS}")
    return Roster(kind, headings, tuple(students))


def _kind(known: Mapping[str, int]) -> str:
    """Return where the headings come from; raise `RosterError` if none has names."""
    has_name = any(name in known for name in _FULL)
    has_both = any(name in known for name in _FIRST) and any(name in known for name in _LAST)
    if not has_name and not has_both:
        shown = ", ".join(list(known)[:8])
        raise RosterError(f"has no column with names among {shown or 'no headings'}; {ACCEPTED}")
    if {"id", "section"} <= set(known) and ("student" in known or {"lastname", "firstname"} <= set(known)):
        return CANVAS
    if {"email address", "id number", "identifier", "username"} & set(known):
        return MOODLE
    return NAMES


def _format_name(row: list[str], known: Mapping[str, int]) -> str:
    """Return the name in a row, the given name first; empty if there is none."""

    def cell(names: tuple[str, ...]) -> str:
        place = next((known[name] for name in names if name in known), None)
        return "" if place is None or place >= len(row) else row[place].strip()

    first, last = cell(_FIRST), cell(_LAST)
    if first or last:
        return f"{first} {last}".strip()
    full = cell(_FULL)
    family, comma, given = full.partition(",")
    return f"{given.strip()} {family.strip()}" if comma and given.strip() and "," not in given else full


def _is_no_student(written: str) -> bool:
    return fold_name(written) in (_POINTS_POSSIBLE, *_TEST_STUDENT)
