"""Feedback: what each student is told about a hand-in, in a text file beside the others of the same name.

It says what was right and how many points that gave, and not what would have been right. A file has the path
of its hand-in: Moodle finds the students by it (*Upload multiple feedback files in a zip*).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from lab.base.files.atomic_file import write_file
from lab.classroom.homework.bounded_runs import FIGURES
from lab.classroom.homework.grading import (
    GRADED,
    NOT_RUN,
    REFUSED,
    GradingError,
    Handed,
    Row,
    figure_column,
    unguard_cell,
)
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.homework_file import Keyed

SUFFIX = ".feedback.txt"
"""Ending of the name of a feedback file, behind the whole name of the hand-in."""


def check_new(folder: Path) -> None:
    """Raise `GradingError` unless a folder is empty or does not exist."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise GradingError(f"{folder}: is not empty; accepted is a new folder for the feedback")


def write_feedback(
    folder: Path, hand_ins: Path, files: Sequence[Handed], rows: Sequence[Row], keyed: Keyed
) -> int:
    """Write the feedback on each hand-in into a new folder; return how many files that are.

    Parameters
    ----------
    folder
        The new folder.
    hand_ins
        The folder with the hand-ins.
    files, rows
        The files, and what `lab.classroom.homework.grading.grade` returned for them.
    keyed
        The homework with its key.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    for file, row in zip(files, rows, strict=True):
        path = folder / os.path.relpath(file.path, hand_ins)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path.with_name(path.name + SUFFIX), feedback_text(row, keyed.homework))
    return len(rows)


def feedback_text(row: Row, homework: Homework) -> str:
    """Return the feedback for a row of the grades; without solutions.

    Parameters
    ----------
    row
        The row.
    homework
        The homework.
    """
    lines = [homework.title, f"File: {unguard_cell(row['file'])}"]
    if row["status"] == REFUSED:
        return "\n".join([*lines, "", f"This file was not graded: it {unguard_cell(row['remark'])}.", ""])
    if row["status"] not in (GRADED, NOT_RUN):
        return "\n".join([*lines, "", f"This export was run again: {unguard_cell(row['remark'])}.", ""])
    lines += [f"Name: {unguard_cell(row['name'])}", f"Points: {row['points']} of {row['of']}", ""]
    if homework.names_faults:
        named = unguard_cell(row["faults_named"]) or "none"
        lines += [
            f"Hidden faults: {row['faults_points']} of {homework.fault_points:g} points",
            f"  You named: {named}",
            f"  Right: {row['faults_right']}, wrong: {row['faults_wrong']}, missed: {row['faults_missed']}",
        ]
    for number, question in enumerate(homework.questions, 1):
        answer, won = unguard_cell(row[f"answer_{number}"]), float(row[f"answer_points_{number}"])
        found = "right" if won else "not right" if answer else "no answer"
        if not question.points:
            found = "no points are given for it"
        lines += [
            f"Question {number}: {won:g} of {question.points:g} points",
            f"  You answered: {answer or '-'} ({found})",
        ]
    for number, goal in enumerate(homework.goals, 1):
        won = float(row[f"goal_{number}_points"])
        words = f" {goal.text}" if goal.text else ""
        reached = "" if not goal.points else " (reached)" if won else " (not reached)"
        lines += [
            f"Goal {number}: {won:g} of {goal.points:g} points",
            f" {words or ' A condition on the result.'}{reached}",
        ]
    lines += ["", f"Your settings: {unguard_cell(row['settings']) or 'as in the homework'}"]
    figures = [(figure_column(name), row[figure_column(name)]) for name in FIGURES]
    if row["status"] == NOT_RUN:
        lines += [f"They were not run: {unguard_cell(row['remark'])}."]
    else:
        lines += ["Their run gave:", *(f"  {name}: {value or 'unknown'}" for name, value in figures)]
        if row["remark"]:
            lines += [f"Remark: {unguard_cell(row['remark'])}."]
    return "\n".join([*lines, ""])
