"""Shipped notebooks: the lessons that come with the lab, and their copies for Jupyter."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from lab.base.files.atomic_file import write_file

KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
"""The kernel of every notebook, as Jupyter names it."""


class MissingJupytextError(ImportError):
    """Jupytext, which makes notebooks of their texts, is not installed; the message says what to do."""


class Shipped(NamedTuple):
    """A notebook that ships with the lab.

    Attributes
    ----------
    name : str
        Its name, such as ``"02_strapdown"``.
    title : str
        Its heading.
    path : Path
        Its text, in the percent format of jupytext.
    """

    name: str
    title: str
    path: Path


def folder() -> Path:
    """Return the folder of the texts: that of an installed lab, or that of a clone."""
    installed = Path(__file__).with_name("notebooks")
    return installed if installed.is_dir() else Path(__file__).parents[3] / "notebooks"


def notebooks() -> tuple[Shipped, ...]:
    """Return the notebooks in their order."""
    return tuple(Shipped(path.stem, _title(path), path) for path in sorted(folder().glob("[0-9]*_*.py")))


def copy_notebooks(target: Path, *, overwrite: bool = False) -> tuple[list[Path], list[Path]]:
    """Write all notebooks into a folder as ``.ipynb`` files without outputs.

    Parameters
    ----------
    target
        The folder; it is created if it does not exist.
    overwrite
        Whether existing files are replaced.

    Returns
    -------
    written, kept : lists of Path
        The files that were written, and those that existed and were kept.

    Raises
    ------
    MissingJupytextError
        If jupytext is not installed.
    OSError
        If the folder cannot be made, or a file not be written.
    """
    try:
        import jupytext  # noqa: PLC0415 - belongs to an extra, and only copying needs it
    except ImportError as error:
        raise MissingJupytextError(
            "jupytext is not installed, which makes the notebooks; install it with "
            "pip install 'ins-lab[notebook]'"
        ) from error
    target.mkdir(parents=True, exist_ok=True)
    written, kept = [], []
    for shipped in notebooks():
        path = target / f"{shipped.name}.ipynb"
        if path.exists() and not overwrite:
            kept.append(path)
            continue
        notebook = jupytext.read(shipped.path, fmt="py:percent")
        notebook.metadata = {"kernelspec": dict(KERNEL)}
        for number, cell in enumerate(notebook.cells):
            cell.id = f"{shipped.name}-{number}"  # jupytext draws them, and two copies would differ
        write_file(path, jupytext.writes(notebook, fmt="ipynb"))
        written.append(path)
    return written, kept


def _title(path: Path) -> str:
    heading = re.search(r"^# # (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return heading[1] if heading else path.stem
