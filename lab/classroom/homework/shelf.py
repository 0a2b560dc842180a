"""Shelf: the homework of a teacher's own server, read from the keys in a folder, again when they change.

A server with the keys runs the homework itself, so that nothing hidden leaves it.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from lab.classroom.homework.homework import Homework
from lab.classroom.homework.homework_file import read_key
from lab.classroom.homework.sealing import SealError
from lab.classroom.lessons.catalogue import Stamp, files_in
from lab.classroom.lessons.fields import LessonError

MOST_FILES = 100
"""Most keys of a folder that are read; more are left out, in the order of their names."""


class Shelved(NamedTuple):
    """A homework of the shelf.

    Attributes
    ----------
    file : str
        Name of the key, without its ending.
    homework : Homework or None
        The homework; None if the key is not accepted.
    problem : str
        Why it is not accepted; empty if it is.
    """

    file: str
    homework: Homework | None
    problem: str = ""


class Shelf:
    """The homework of one server.

    Parameters
    ----------
    folder
        The folder with the keys; None without one.

    Attributes
    ----------
    entries : list of Shelved
        The homework, in the order of the files.
    version : int
        A number that grows with every change of the entries.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._read: dict[Path, tuple[Stamp, Shelved]] = {}
        self.entries: list[Shelved] = []
        self.version = 0
        self.refresh()

    def refresh(self) -> None:
        """Read the keys that have changed."""
        if self._folder is None:
            return
        before, found = (
            self.entries,
            {path: self._entry(path) for path in files_in(self._folder, ".key", MOST_FILES)},
        )
        self._read = {path: self._read[path] for path in found if path in self._read}
        self.entries = list(found.values())
        self.version += [id(entry) for entry in before] != [id(entry) for entry in self.entries]

    def find(self, name: str) -> Homework | None:
        """Return the homework of a name; None if there is none."""
        for entry in self.entries:
            if entry.homework is not None and entry.homework.name == name:
                return entry.homework
        return None

    def _entry(self, path: Path) -> Shelved:
        try:
            status = path.stat()
        except OSError as error:
            self._read.pop(path, None)
            return Shelved(path.stem, None, f"{path.name}: cannot be read: {error.strerror or error}")
        stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
        if path not in self._read or self._read[path][0] != stamp:
            self._read[path] = stamp, _read(path)
        return self._read[path][1]


def _read(path: Path) -> Shelved:
    try:
        return Shelved(path.stem, read_key(path).homework)
    except (LessonError, SealError) as error:
        return Shelved(path.stem, None, str(error))
