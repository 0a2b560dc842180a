"""Shelf: the homework of a teacher's own server, read from the keys in a folder, again when they change.

A server with the keys runs the homework itself, so that nothing hidden leaves it.
"""

from __future__ import annotations

import base64
import binascii
import hmac
from pathlib import Path
from typing import NamedTuple

from lab.classroom.homework.hand_in import LONGEST_NAME
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.homework_file import Keyed, read_key
from lab.classroom.homework.sealing import SealError
from lab.classroom.homework.variant import variant_tag
from lab.classroom.lessons.catalogue import Stamp, files_in
from lab.classroom.lessons.fields import LessonError

MOST_FILES = 100
"""Most keys of a folder that are read; more are left out, in the order of their names."""
OWN_LINK = "Each student has another one: open yours with the link, or the file, that your teacher gave you."
"""Said of a homework with variants."""


class Shelved(NamedTuple):
    """A homework of the shelf.

    Attributes
    ----------
    file : str
        Name of the key, without its ending.
    keyed : Keyed or None
        The homework with its key; None if the key is not accepted.
    problem : str
        Why nobody can open it from the list; empty if everybody can.
    """

    file: str
    keyed: Keyed | None
    problem: str = ""

    @property
    def homework(self) -> Homework | None:
        """The homework that everybody can open; None if there is none, or each student has a variant."""
        return None if self.keyed is None or self.keyed.varies else self.keyed.homework


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

    def find(self, link: str) -> Homework | None:
        """Return the homework that a link names, as `Homework.link` writes it; None if there is none.

        The variant of a student is found with its tag, which only the teacher's secret gives.
        """
        name, _, rest = link.partition(".")
        for entry in self.entries:
            keyed = entry.keyed
            if keyed is not None and keyed.homework.name == name:
                return _variant(keyed, rest) if keyed.varies else keyed.homework if not rest else None
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
        keyed = read_key(path)
    except (LessonError, SealError) as error:
        return Shelved(path.stem, None, str(error))
    return Shelved(path.stem, keyed, OWN_LINK if keyed.varies else "")


def _variant(keyed: Keyed, rest: str) -> Homework | None:
    """Return the variant of a student that the rest of a link names: its tag, and the name in Base64."""
    tag, _, name = rest.partition(".")
    try:
        student = base64.urlsafe_b64decode(name + "=" * (-len(name) % 4)).decode()
    except (binascii.Error, ValueError):
        return None
    if not 0 < len(student) <= LONGEST_NAME or not student.isprintable():
        return None
    if not hmac.compare_digest(tag.encode(), variant_tag(keyed.key, student).encode()):
        return None
    return keyed.judge_for(student).homework
