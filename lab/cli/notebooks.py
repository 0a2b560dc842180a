"""``ins-lab notebooks``: the lessons for Jupyter, listed and copied into a folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from lab.base.parameters.counted import count_noun
from lab.cli.app import CommandError, argument, group, print_json
from lab.cli.options import AsJson, Force
from lab.cli.terminal import table

EXAMPLES = """\b
Examples:
  ins-lab notebooks list
  ins-lab notebooks copy my_notebooks
  jupyter lab my_notebooks"""

notebooks = group("notebooks")


@notebooks.command("list")
def list_notebooks(as_json: AsJson = False) -> None:
    """List the notebooks that ship with the lab."""
    from lab.classroom.exercises.shipped_notebooks import notebooks as shipped  # noqa: PLC0415 - reads them

    found = shipped()
    if as_json:
        print_json([{"name": one.name, "title": one.title} for one in found])
    else:
        print(table(("name", "title"), [(one.name, one.title) for one in found]))


@notebooks.command("copy")
def copy(
    folder: Annotated[Path, argument("FOLDER", "Folder to write them into.")],
    force: Force = False,
) -> None:
    """Write all notebooks into a folder as .ipynb files; files that exist are kept without --force."""
    from lab.classroom.exercises.shipped_notebooks import MissingJupytextError, copy_notebooks  # noqa: PLC0415 - rarely needed

    try:
        written, kept = copy_notebooks(folder, overwrite=force)
    except MissingJupytextError as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(f"{folder}: cannot be written: {error.strerror or error}") from error
    for path in written:
        print(path)
    if kept:
        names = ", ".join(path.name for path in kept)
        print(
            f"ins-lab: {count_noun(len(kept), 'notebook')} kept, since they exist already: {names}; "
            "replace them with --force",
            file=sys.stderr,
        )
