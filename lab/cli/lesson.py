"""``ins-lab lesson``: list the lessons, and check the file of one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.cli.app import CommandError, argument, group, print_json, working
from lab.cli.options import AsJson
from lab.cli.terminal import table

if TYPE_CHECKING:
    from lab.classroom.lessons.catalogue import Entry
    from lab.classroom.lessons.lesson import Trial

EXAMPLES = """\b
Examples:
  ins-lab lesson list
  ins-lab lesson check my_lesson.toml
  ins-lab lesson check --run my_lesson.toml
  ins-lab serve --lessons my_lessons"""

lesson = group("lesson")


@lesson.command("list")
def list_lessons(
    folder: Annotated[Path | None, argument("FOLDER", "A folder with lessons of your own.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the lessons that ship, and those of a folder."""
    if folder is not None and not folder.is_dir():
        raise CommandError(f"{folder}: is not a folder; accepted is a folder with lessons as .toml files")
    from lab.classroom.lessons.catalogue import Catalogue  # noqa: PLC0415 - takes a second

    entries = Catalogue(folder).entries
    if as_json:
        print_json([_facts(entry) for entry in entries])
        return
    rows = [
        (entry.name, entry.origin, entry.lesson.title if entry.lesson else entry.problem) for entry in entries
    ]
    print(table(("name", "origin", "title, or what is wrong"), rows))


@lesson.command("check")
def check(
    file: Annotated[Path, argument("FILE", "The lesson, a .toml file.")],
    run: Annotated[
        bool,
        typer.Option("--run", help="Also run each check on its solution and on its wrong settings."),
    ] = False,
) -> None:
    """Check the file of a lesson; the first thing that is wrong is reported, with line, step and key."""
    from lab.classroom.lessons.fields import LessonError  # noqa: PLC0415 - takes a second
    from lab.classroom.lessons.lesson_file import read_lesson  # noqa: PLC0415 - takes a second

    try:
        found = read_lesson(file)
    except LessonError as error:
        raise CommandError(str(error)) from error
    asked = sum(step.asks for step in found.steps)
    print(f"{file}: {found.title}: steps: {len(found.steps)}, to solve: {asked}")
    if not run:
        return
    from lab.classroom.lessons.lesson import trials  # noqa: PLC0415 - takes a second

    with working(str(file)) as progress:
        tried = trials(found, progress)
    for trial in tried:
        print(_describe(trial))
    if not all(trial.is_right for trial in tried):
        raise typer.Exit(1)


def _describe(trial: Trial) -> str:
    verb = "accepts" if trial.accepted else "refuses"
    judgement = "right" if trial.is_right else "WRONG"
    values = ", ".join(f"{name} {value:.4g}" for name, value in trial.values.items())
    return f"step {trial.step}: the check {verb} {trial.what} ({judgement}){': ' if values else ''}{values}"


def _facts(entry: Entry) -> dict[str, object]:
    found = entry.lesson
    return {
        "name": entry.name,
        "origin": entry.origin,
        "title": found.title if found else None,
        "summary": found.summary if found else None,
        "steps": len(found.steps) if found else None,
        "problem": entry.problem or None,
    }
