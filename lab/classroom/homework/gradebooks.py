"""Gradebooks: the points of a homework as the csv files that Moodle and Canvas import.

References
----------
As of `lab.classroom.homework.roster`.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from lab.classroom.homework.grading import GRADED, NOT_RUN, Row, text_cell, unguard_cell
from lab.classroom.homework.roster import CANVAS, MOODLE, Roster, RosterError
from lab.classroom.homework.variant import fold_name

_OF_MOODLE = (
    "Identifier",
    "Full name",
    "First name",
    "Last name",
    "Surname",
    "Username",
    "ID number",
    "Email address",
)
"""Headings by which Moodle finds a student, and those by which a teacher does."""
_OF_CANVAS = (
    "Student",
    "LastName",
    "FirstName",
    "ID",
    "SIS User ID",
    "SIS Login ID",
    "Integration ID",
    "Root Account",
    "Section",
)
"""Headings by which Canvas finds a student."""
GRADE = "Grade"
"""Heading of Moodle's offline grading worksheet that is filled."""
_MODIFIED = "Last modified (grade)"


class Points(NamedTuple):
    """The points of a course.

    Attributes
    ----------
    by_name : mapping of str to str
        Points, as written, by the folded name.
    remarks : list of str
        Whose points are left out, and why.
    """

    by_name: Mapping[str, str]
    remarks: list[str]


def collect_points(rows: Iterable[Row], roster: Roster) -> Points:
    """Return the points of each student of a roster who handed in once.

    Parameters
    ----------
    rows
        The rows of the grades, as of `lab.classroom.homework.grading.grade`.
    roster
        The students.
    """
    handed: dict[str, list[Row]] = {}
    for row in rows:
        if row["status"] in (GRADED, NOT_RUN):
            handed.setdefault(fold_name(unguard_cell(row["name"])), []).append(row)
    known, found, remarks = roster.by_name(), {}, list[str]()
    twice = {fold_name(name) for name in roster.same_names()}
    for name, theirs in handed.items():
        shown = unguard_cell(theirs[0]["name"])
        if name in twice:
            remarks.append(f"{shown}: the roster has this name more than once; enter the points by hand")
        elif name not in known:
            remarks.append(f"{shown}: is not in the roster; compare the spelling")
        elif len(theirs) > 1:
            files = ", ".join(unguard_cell(row["file"]) for row in theirs)
            remarks.append(
                f"{shown}: handed in {len(theirs)} files, {files}; leave one of them in the folder"
            )
        else:
            found[name] = theirs[0]["points"]
    return Points(found, remarks)


def moodle_text(roster: Roster, points: Points, title: str) -> str:
    """Return the csv for *Grades, Import*, or the worksheet of *Offline grading worksheet* filled in.

    Parameters
    ----------
    roster
        The roster that Moodle exported.
    points
        The points.
    title
        Heading of the points in a file for *Grades, Import*.

    Raises
    ------
    RosterError
        If Moodle cannot find the students by the roster.
    """
    if roster.kind != MOODLE:
        raise RosterError(
            f"is a roster of {roster.kind}; accepted for Moodle is one that it exported, with Email "
            "address, ID number or Identifier"
        )
    is_worksheet = {"Identifier", GRADE, _MODIFIED} <= set(roster.headings)
    if is_worksheet:
        return _csv(roster.headings, roster, points, GRADE, ())
    return _csv((*_find_headings(roster, _OF_MOODLE), text_cell(title)), roster, points, text_cell(title), ())


def canvas_text(roster: Roster, points: Points, title: str, best: float) -> str:
    """Return the csv for *Gradebook, Import*.

    Parameters
    ----------
    roster
        The gradebook that Canvas exported.
    points
        The points.
    title
        The assignment, as its heading in the gradebook, ``Title (1234)``; another title makes a new one.
    best
        The points possible.

    Raises
    ------
    RosterError
        If Canvas cannot find the students by the roster.
    """
    if roster.kind != CANVAS:
        raise RosterError(
            f"is a roster of {roster.kind}; accepted for Canvas is the gradebook that it exported, with "
            "Student, ID and Section"
        )
    heading = text_cell(find_assignment(roster, title))
    headings = (*_find_headings(roster, _OF_CANVAS), heading)
    possible = ["    Points Possible", *("",) * (len(headings) - 2), f"{best:.6g}"]
    return _csv(headings, roster, points, heading, (possible,))


def find_assignment(roster: Roster, title: str) -> str:
    """Return the heading of an assignment in a gradebook of Canvas: the title, with its number if known."""
    alike = [one for one in roster.headings if one == title or one.rpartition(" (")[0] == title]
    return alike[0] if len(alike) == 1 else title


def _find_headings(roster: Roster, wanted: Sequence[str]) -> list[str]:
    return [heading for heading in roster.headings if heading in wanted]


def _csv(
    headings: Sequence[str], roster: Roster, points: Points, where: str, first: Iterable[Sequence[str]]
) -> str:
    """Return a csv with a row for each student; those without points have the cell that they had."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(first)
    for student in roster.students:
        own = points.by_name.get(fold_name(student.name))
        writer.writerow(
            own if heading == where and own is not None else _cell(student.cells.get(heading, ""))
            for heading in headings
        )
    return buffer.getvalue()


def _cell(text: str) -> str:
    """Return a cell of the roster: numbers and the dash of Moodle as they are, which are no formulas."""
    if text.strip() == "-":
        return text
    try:
        float(text)
    except ValueError:
        return text_cell(text)
    return text
