"""Grading: a folder of hand-ins becomes a table; the grader computes every number himself.

Each file has a row, in the order of the names. A file that is not accepted has the reason in its row, and
does not stop the others. The flight, its IMU rate and its sensors are those of the key, so that no hand-in
decides how long it takes; `lab.classroom.homework.bounded_runs` stops a run that takes long nevertheless. The
same folder and key give the same bytes.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import os
import stat
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from lab.base.progress import Progress
from lab.classroom.homework.bounded_runs import FIGURES, Examining, examine
from lab.classroom.homework.exported_run import ENDINGS, Repeated, repeat
from lab.classroom.homework.hand_in import DEEPEST, HandIn, HandInError, open_hand_in, read_hand_in
from lab.classroom.homework.homework import Judge
from lab.classroom.homework.homework_file import Keyed
from lab.classroom.homework.variant import variant_tag
from lab.classroom.lessons.quantities import QUANTITIES

MOST_FILES = 2000
"""Most files in a folder; more than any class hands in."""
GRADED, NOT_RUN, REFUSED = "graded", "not run", "refused"
"""Status of a row: with its settings run; with answers only; with a reason only."""
_FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")
"""Signs with which a spreadsheet begins a formula; the wide ones where people write Chinese or Japanese."""

Row = dict[str, str]


class GradingError(ValueError):
    """A folder that cannot be graded; the message says what is accepted."""


class Handed(NamedTuple):
    """A file of the folder.

    Attributes
    ----------
    path : Path
        The file.
    name : str
        Its name within the folder, with ``/`` between folders.
    """

    path: Path
    name: str


def list_files(folder: Path, leave_out: Iterable[Path] = ()) -> list[Handed]:
    """Return the files of a folder and of the folders in it, in the order of their names.

    Files whose names begin with a point are left out: those of the system. Links are in the list, so that
    they get a row, and are not followed.

    Parameters
    ----------
    folder
        The folder.
    leave_out
        Files that are no hand-ins, such as the key.

    Raises
    ------
    GradingError
        If there are more than `MOST_FILES`.
    """
    apart = {os.path.realpath(path) for path in leave_out}
    found = []
    for path in _walk(folder, 0):
        if os.path.realpath(path) not in apart or path.is_symlink():
            name = PurePath(os.path.relpath(path, folder)).as_posix()
            found.append(Handed(path, os.fsencode(name).decode("utf-8", "backslashreplace")))
        if len(found) > MOST_FILES:
            raise GradingError(
                f"{folder}: has more than {MOST_FILES} files; accepted is a folder of hand-ins"
            )
    return sorted(found, key=lambda one: one.name)


def _walk(folder: Path, depth: int) -> Iterator[Path]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                continue
            if not entry.is_dir(follow_symlinks=False):
                yield Path(entry.path)
            elif depth < DEEPEST:
                try:
                    yield from _walk(Path(entry.path), depth + 1)
                except OSError:
                    yield Path(entry.path)  # gets a row: it is a folder that cannot be listed
            else:
                yield Path(entry.path)  # gets a row, so that nobody's hand-in is missing without a word


def grade(
    files: list[Handed],
    keyed: Keyed,
    progress: Progress | None = None,
    examining: Examining = examine,
    repeating: Callable[[Path], Repeated] | None = None,
) -> list[Row]:
    """Return a row for each file, by the name of its column.

    A file that was exported of a run of the homework is run again, and compared bit for bit.

    Parameters
    ----------
    files
        The files.
    keyed
        The homework with its key.
    progress
        Called with a phrase and the fraction done, from 0 to 1.
    examining
        What runs the settings of a student; `lab.classroom.homework.bounded_runs.BoundedRuns` bounds time and
        memory.
    repeating
        What runs exports again; bounded likewise.
    """
    repeating = repeating or (lambda path: repeat(keyed, path, FIGURES))
    opened = [_open(file, keyed) for file in files]
    names = Counter(_fold_name(found.name) for found, _ in opened if isinstance(found, HandIn))
    first: dict[str, str] = {}
    rows = []
    for number, (file, (found, mark)) in enumerate(zip(files, opened, strict=True)):
        if progress is not None:
            progress(_one_line(file.name), number / len(files))
        row = dict.fromkeys(columns(keyed.judge), "")
        row |= {"file": text_cell(file.name), "homework": keyed.homework.name}
        if isinstance(found, Path):
            rows.append(row | _export_cells(repeating(found)))
            continue
        if isinstance(found, str):
            rows.append(row | {"status": REFUSED, "remark": text_cell(found)})
            continue
        original = first.setdefault(mark, file.name)
        remarks = [f"the same file as {original}"] if original != file.name else []
        if names[_fold_name(found.name)] > 1 and not remarks:
            remarks.append("this name is in several files")
        rows.append(row | _grade_hand_in(found, keyed.judge_for(found.name), remarks, examining))
    return rows


def _open(file: Handed, keyed: Keyed) -> tuple[HandIn | Path | str, str]:
    """Return the hand-in in a file, the file if it is an export, or why there is none; and its digest."""
    if file.name.lower().endswith(ENDINGS) and file.path.is_file() and not file.path.is_symlink():
        return file.path, ""
    try:
        content = read_hand_in(file.path)
        handed = open_hand_in(content, keyed.homework, keyed.key)
        _check_variant(handed, keyed)
        return handed, hashlib.sha256(content).hexdigest()
    except HandInError as error:
        return str(error), ""


def _export_cells(found: Repeated) -> Row:
    """Return the cells of an export."""
    row = {figure_column(name): _figure(value) for name, value in found.figures.items()}
    settings = {path: value for path, value in found.changes.items() if path != "seed"}
    return row | {
        "status": found.status,
        "remark": text_cell(found.remark),
        "settings": text_cell(_assignments(settings)),
    }


def _check_variant(handed: HandIn, keyed: Keyed) -> None:
    """Raise `HandInError` if a hand-in is not of the variant of the student whose name it has."""
    right = variant_tag(keyed.key, handed.name) if keyed.varies else ""
    if handed.variant == right:
        return
    if not keyed.varies:
        raise HandInError("is of a variant for one student, and this homework is the same for all")
    shown = handed.name if handed.name.isprintable() else "this name"
    raise HandInError(
        f"is of the variant of another student than {shown}; accepted is the hand-in of a student's own file"
        if handed.variant
        else f"is of no variant; accepted is the hand-in of the file for {shown}"
    )


def columns(judge: Judge) -> list[str]:
    """Return the columns of the table."""
    homework = judge.homework
    faults = ["faults_named", "faults_right", "faults_wrong", "faults_missed", "faults_points"]
    return [
        *("file", "name", "status", "remark", "homework", "points", "of"),
        *(figure_column(name) for name in FIGURES),
        *(faults if homework.names_faults else []),
        *(
            f"{what}_{number}"
            for number in range(1, len(homework.questions) + 1)
            for what in ("answer", "answer_points")
        ),
        *(f"goal_{number}_points" for number in range(1, len(homework.goals) + 1)),
        "settings",
    ]


def csv_text(names: list[str], rows: list[Row]) -> str:
    """Return a table as csv, with lines that end with LF."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def text_cell(text: str) -> str:
    """Return a text for a cell: on one line, and never a formula of a spreadsheet."""
    plain = _one_line(text)
    return f"'{plain}" if plain.lstrip().startswith(_FORMULA) else plain


def unguard_cell(cell: str) -> str:
    """Return the text of a cell that `text_cell` made."""
    return cell[1:] if cell.startswith("'") and cell[1:].lstrip().startswith(_FORMULA) else cell


def _one_line(text: str) -> str:
    return "".join(sign if sign.isprintable() else "�" for sign in text)


def _grade_hand_in(handed: HandIn, judge: Judge, remarks: list[str], examining: Examining) -> Row:
    """Return the cells of a hand-in that could be opened."""
    homework = judge.homework
    row = {"name": text_cell(handed.name), "settings": text_cell(_assignments(handed.changes))}
    points = 0.0
    if homework.names_faults:
        real = {fault.title for fault in homework.scenario.hidden.found}
        named = set(handed.faults)
        of_faults = judge.points_of_faults(handed.faults)
        points += of_faults
        row |= {
            "faults_named": "; ".join(sorted(named)),
            "faults_right": str(len(named & real)),
            "faults_wrong": str(len(named - real)),
            "faults_missed": str(len(real - named)),
            "faults_points": f"{of_faults:.6g}",
        }
    for number, (answer, question, solution) in enumerate(
        zip(handed.answers, homework.questions, judge.solutions, strict=True), 1
    ):
        won = question.points * solution.accepts(answer)
        points += won
        row |= {f"answer_{number}": text_cell(answer), f"answer_points_{number}": f"{won:.6g}"}
    examined = examining(judge, handed.changes)
    remarks += [examined.problem] if examined.problem else []
    row |= {figure_column(name): _figure(value) for name, value in examined.figures.items()}
    for number, (goal, is_reached) in enumerate(zip(homework.goals, examined.passed, strict=True), 1):
        points += goal.points * is_reached
        row[f"goal_{number}_points"] = f"{goal.points * is_reached:.6g}"
    row |= {"points": f"{points:.6g}", "of": f"{homework.best:.6g}"}
    status = NOT_RUN if examined.problem else GRADED
    return row | {"status": status, "remark": text_cell("; ".join(remarks))}


def figure_column(name: str) -> str:
    """Return the heading of a quantity of `FIGURES`, with its unit."""
    unit = QUANTITIES[name].unit
    return f"{name} [{unit}]" if unit else name


def _figure(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _assignments(changes: Mapping[str, Any]) -> str:
    return "; ".join(f"{path}={_value(value)}" for path, value in sorted(changes.items()))


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "none"}[value]
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _fold_name(name: str) -> str:
    return name.casefold()


def check_folder(folder: Path) -> None:
    """Raise `GradingError` if a path is not a folder that can be listed."""
    try:
        if not stat.S_ISDIR(folder.stat().st_mode):
            raise GradingError(f"{folder}: is not a folder; accepted is one with hand-ins")
        with os.scandir(folder):
            pass
    except OSError as error:
        raise GradingError(f"{folder}: cannot be read: {error.strerror or error}") from error
