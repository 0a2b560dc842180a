"""``ins-lab grade``: the hand-ins of a homework become a table."""

from __future__ import annotations

import codecs
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.files.atomic_file import write_file
from lab.base.parameters.counted import count_noun
from lab.cli.app import CommandError, argument, option, working
from lab.cli.options import Force, check_out

if TYPE_CHECKING:
    from lab.classroom.homework.grading import Handed, Row
    from lab.classroom.homework.homework_file import Keyed
    from lab.classroom.homework.roster import Roster

EXAMPLES = """\b
Examples:
  ins-lab grade handed_in --key receiver.key
  ins-lab grade handed_in --key receiver.key --out grades.csv
  ins-lab grade handed_in --key receiver.key --out grades.csv --feedback feedback \\
      --roster class.csv --moodle points.csv"""


def grade(
    folder: Annotated[Path, argument("FOLDER", "The folder with the hand-ins.")],
    key: Annotated[Path, option("--key", "FILE.key", "The key of the homework.")],
    out: Annotated[
        Path | None, option("--out", "FILE.csv", "Write the table to a file instead of standard output.")
    ] = None,
    feedback: Annotated[
        Path | None,
        option(
            "--feedback", "FOLDER", "Write a file for each student, without solutions, into a new folder."
        ),
    ] = None,
    roster: Annotated[
        Path | None, option("--roster", "FILE.csv", "The students, as Moodle or Canvas exports them.")
    ] = None,
    moodle: Annotated[
        Path | None, option("--moodle", "FILE.csv", "Write the points of the roster for Moodle.")
    ] = None,
    canvas: Annotated[
        Path | None, option("--canvas", "FILE.csv", "Write the points of the roster for Canvas.")
    ] = None,
    assignment: Annotated[
        str, option("--assignment", "TITLE", "What Moodle or Canvas calls the homework.", "its title")
    ] = "",
    force: Force = False,
    seconds: Annotated[
        int,
        typer.Option("--seconds", metavar="S", min=1, help="Longest run of one hand-in [s]."),
    ] = 300,
    memory: Annotated[
        int,
        typer.Option("--memory", metavar="GB", min=1, help="Most memory of the run of one hand-in [GB]."),
    ] = 4,
) -> None:
    """Grade the hand-ins of a homework: run their settings, and compare their answers, in a row each.

    An export of a run of the homework (netCDF, JSON, report, csv, path, figure) is run again, and compared
    bit for bit.
    """
    from lab.classroom.homework.bounded_runs import BoundedRuns, StartError  # noqa: PLC0415 - slow
    from lab.classroom.homework.exported_run import REPEATED  # noqa: PLC0415 - slow
    from lab.classroom.homework.feedback import check_new, write_feedback  # noqa: PLC0415 - slow
    from lab.classroom.homework.grading import GRADED, columns, csv_text  # noqa: PLC0415 - slow
    from lab.classroom.homework.grading import grade as rows_of  # noqa: PLC0415 - slow

    check_out(out, force, ".csv", "a table", "--out")
    books = [(path, name) for path, name in ((moodle, "--moodle"), (canvas, "--canvas")) if path]
    for path, name in books:
        check_out(path, force, ".csv", "a table", name)
    if books and roster is None:
        raise CommandError(f"{books[0][1]} needs the students: accepted is it with --roster FILE.csv")
    keyed, files = _read(key, folder, [path for path in (out, roster, moodle, canvas) if path])
    students = None if roster is None else _roster(roster)
    if students is not None:
        _make_gradebooks(
            moodle, canvas, students, [], keyed, assignment
        )  # refuses before the runs, which take long
    if feedback is not None:
        _check(feedback, folder, check_new)
    try:
        with working(folder.name) as progress, BoundedRuns(keyed, seconds, memory) as examining:
            rows = rows_of(files, keyed, progress, examining, examining.repeat)
    except StartError as error:
        raise CommandError(str(error)) from error
    _write(csv_text(columns(keyed.judge), rows), out)
    if students is not None:
        for path, text in _make_gradebooks(moodle, canvas, students, rows, keyed, assignment):
            _write(text, path, mark=b"")
    if feedback is not None:
        count = write_feedback(feedback, folder, files, rows, keyed)
        print(f"ins-lab: {feedback}: feedback on {count_noun(count, 'file')}", file=sys.stderr)
    done, again = (sum(row["status"] == one for row in rows) for one in (GRADED, REPEATED))
    words = f", {count_noun(again, 'export')} repeated to the last bit" if again else ""
    print(f"ins-lab: {count_noun(len(rows), 'file')}, {done} graded{words}", file=sys.stderr)


def _roster(path: Path) -> Roster:
    from lab.classroom.homework.roster import RosterError, read_roster  # noqa: PLC0415 - slow

    try:
        return read_roster(path)
    except RosterError as error:
        raise CommandError(f"--roster {error}") from error


def _make_gradebooks(
    moodle: Path | None, canvas: Path | None, students: Roster, rows: list[Row], keyed: Keyed, title: str
) -> list[tuple[Path, str]]:
    """Return the files for learning platforms with their texts; report whose points are left out."""
    from lab.classroom.homework.gradebooks import canvas_text, collect_points, moodle_text  # noqa: PLC0415 - slow
    from lab.classroom.homework.roster import RosterError  # noqa: PLC0415 - slow

    points = collect_points(rows, students)
    title, found = title or keyed.homework.title, list[tuple[Path, str]]()
    try:
        if moodle is not None:
            found.append((moodle, moodle_text(students, points, title)))
        if canvas is not None:
            found.append((canvas, canvas_text(students, points, title, keyed.homework.best)))
    except RosterError as error:
        raise CommandError(f"--roster {error}") from error
    for remark in points.remarks:
        print(f"ins-lab: {remark}", file=sys.stderr)
    return found


def _check(feedback: Path, folder: Path, check_new: Callable[[Path], None]) -> None:
    """Refuse a folder for the feedback that is in use, or within the hand-ins."""
    from lab.classroom.homework.grading import GradingError  # noqa: PLC0415 - slow

    if feedback.resolve().is_relative_to(folder.resolve()):
        raise CommandError(f"--feedback {feedback}: is within the hand-ins; accepted is a folder elsewhere")
    try:
        check_new(feedback)
    except GradingError as error:
        raise CommandError(f"--feedback {error}") from error


def _read(key: Path, folder: Path, apart: list[Path]) -> tuple[Keyed, list[Handed]]:
    """Return the homework with its key, and the files in the folder that may be hand-ins.

    Raises
    ------
    CommandError
        If the key or the folder is not accepted, or the folder has no files.
    """
    from lab.classroom.homework.grading import GradingError, check_folder, list_files  # noqa: PLC0415 - slow
    from lab.classroom.homework.homework_file import read_key  # noqa: PLC0415 - slow
    from lab.classroom.homework.sealing import SealError  # noqa: PLC0415 - slow
    from lab.classroom.lessons.fields import LessonError  # noqa: PLC0415 - slow

    try:
        keyed = read_key(key)
        check_folder(folder)
        files = list_files(folder, (key, *apart))
    except (LessonError, SealError, GradingError) as error:
        raise CommandError(str(error)) from error
    if not files:
        raise CommandError(f"{folder}: is empty; accepted is a folder with hand-ins")
    return keyed, files


def _write(text: str, out: Path | None, mark: bytes = codecs.BOM_UTF8) -> None:
    """Write the table to a file or to standard output, there too if the file cannot be written.

    The mark begins a file: without that of UTF-8, Excel expects another encoding.
    """
    if out is None:
        sys.stdout.buffer.write(text.encode()) if hasattr(sys.stdout, "buffer") else print(text, end="")
        return
    try:
        write_file(out, mark + text.encode())
    except OSError as error:  # the runs took long: the table must not be lost
        print(text, end="")
        raise CommandError(
            f"{out}: {error.strerror or error}; the table is on standard output instead"
        ) from error
