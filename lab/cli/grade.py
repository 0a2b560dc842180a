"""``ins-lab grade``: the hand-ins of a homework become a table."""

from __future__ import annotations

import codecs
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.parameters.counted import counted
from lab.cli.app import CommandError, working
from lab.cli.options import Force, check_out

if TYPE_CHECKING:
    from lab.classroom.homework.grading import Handed
    from lab.classroom.homework.homework_file import Keyed

EXAMPLES = """\b
Examples:
  ins-lab grade handed_in --key receiver.key
  ins-lab grade handed_in --key receiver.key --out grades.csv"""


def grade(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="The folder with the hand-ins.", show_default=False)
    ],
    key: Annotated[
        Path, typer.Option("--key", metavar="FILE.key", help="The key of the homework.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE.csv",
            help="Write the table to a file instead of standard output.",
            show_default=False,
        ),
    ] = None,
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
    from lab.classroom.homework.grading import GRADED, columns, csv_text  # noqa: PLC0415 - slow
    from lab.classroom.homework.grading import grade as rows_of  # noqa: PLC0415 - slow

    check_out(out, force, ".csv", "a table", "--out")
    keyed, files = _read(key, folder, out)
    try:
        with working(folder.name) as progress, BoundedRuns(keyed, seconds, memory) as examining:
            rows = rows_of(files, keyed, progress, examining, examining.repeat)
    except StartError as error:
        raise CommandError(str(error)) from error
    _write(csv_text(columns(keyed.judge), rows), out)
    done, again = (sum(row["status"] == one for row in rows) for one in (GRADED, REPEATED))
    words = f", {counted(again, 'export')} repeated to the last bit" if again else ""
    print(f"ins-lab: {counted(len(rows), 'file')}, {done} graded{words}", file=sys.stderr)


def _read(key: Path, folder: Path, out: Path | None) -> tuple[Keyed, list[Handed]]:
    """Return the homework with its key, and the files in the folder that may be hand-ins.

    Raises
    ------
    CommandError
        If the key or the folder is not accepted, or the folder has no files.
    """
    from lab.classroom.homework.grading import GradingError, check_folder, files_of  # noqa: PLC0415 - slow
    from lab.classroom.homework.homework_file import read_key  # noqa: PLC0415 - slow
    from lab.classroom.homework.sealing import SealError  # noqa: PLC0415 - slow
    from lab.classroom.lessons.fields import LessonError  # noqa: PLC0415 - slow

    try:
        keyed = read_key(key)
        check_folder(folder)
        files = files_of(folder, (key, *([out] if out is not None else [])))
    except (LessonError, SealError, GradingError) as error:
        raise CommandError(str(error)) from error
    if not files:
        raise CommandError(f"{folder}: is empty; accepted is a folder with hand-ins")
    return keyed, files


def _write(text: str, out: Path | None) -> None:
    """Write the table to a file or to standard output, there too if the file cannot be written."""
    from lab.base.files.atomic_file import atomic_file  # noqa: PLC0415 - slow

    if out is None:
        sys.stdout.buffer.write(text.encode()) if hasattr(sys.stdout, "buffer") else print(text, end="")
        return
    try:
        with atomic_file(out) as file:
            file.write(codecs.BOM_UTF8 + text.encode())  # without the mark, Excel expects no UTF-8
    except OSError as error:  # the runs took long: the table must not be lost
        print(text, end="")
        raise CommandError(
            f"{out}: {error.strerror or error}; the table is on standard output instead"
        ) from error
