"""Catalogue: the lessons that ship, the gallery, and a teacher's own, read again when they change."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lab.base.parameters.toml_file import read_toml
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.lessons.fields import LessonError
from lab.classroom.lessons.lesson import Lesson
from lab.classroom.lessons.lesson_file import make_lesson, read_lesson

SHIPPED = Path(__file__).with_name("shipped")
MOST_FILES = 200
"""Most files of a folder that are read; more are left out, in the order of their names."""

Stamp = tuple[int, int, int]


class Entry(NamedTuple):
    """One lesson of the catalogue.

    Attributes
    ----------
    name : str
        Name of its file.
    origin : str
        ``"own"``, ``"shipped"`` or ``"gallery"``.
    lesson : Lesson or None
        The lesson; None if its file is not accepted.
    problem : str
        Why it is not accepted; empty if it is.
    """

    name: str
    origin: str
    lesson: Lesson | None
    problem: str = ""


class Catalogue:
    """The lessons of one server.

    Parameters
    ----------
    folder
        The teacher's own folder; None without one.

    Attributes
    ----------
    entries : list of Entry
        The teacher's lessons first, then those that ship, then the gallery.
    version : int
        A number that grows with every change of the entries.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._read: dict[Path, tuple[Stamp, Entry]] = {}
        self._rest = [*(_entry(path, "shipped") for path in files_in(SHIPPED, ".toml"))]
        self._rest += [Entry(lesson.name, "gallery", lesson) for lesson in gallery_lessons()]
        self.entries: list[Entry] = []
        self.version = 0
        self.refresh()

    def refresh(self) -> None:
        """Read the files of the folder that have changed."""
        before = self.entries
        own = {path: self._own(path) for path in (files_in(self._folder, ".toml") if self._folder else [])}
        self._read = {path: self._read[path] for path in own if path in self._read}
        self.entries = [*own.values(), *self._rest]
        self.version += [id(entry) for entry in before] != [id(entry) for entry in self.entries]

    def find(self, origin: str, name: str) -> Lesson | None:
        """Return a lesson; None if there is none of this name that is accepted."""
        for entry in self.entries:
            if (entry.name, entry.origin) == (name, origin):
                return entry.lesson
        return None

    def after(self, key: tuple[str, str]) -> tuple[str, str] | None:
        """Return origin and name of the lesson after another of the same origin; None behind the last one."""
        keys = [(entry.origin, entry.name) for entry in self.entries if entry.lesson is not None]
        following = keys[keys.index(key) + 1 :][:1] if key in keys else []
        return following[0] if following and following[0][0] == key[0] else None

    def _own(self, path: Path) -> Entry:
        try:
            status = path.stat()
        except OSError as error:
            self._read.pop(path, None)
            return Entry(path.stem, "own", None, f"{path.name}: cannot be read: {error.strerror or error}")
        stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
        if path not in self._read or self._read[path][0] != stamp:
            self._read[path] = stamp, _entry(path, "own")
        return self._read[path][1]


def _entry(path: Path, origin: str) -> Entry:
    try:
        return Entry(path.stem, origin, read_lesson(path))
    except LessonError as error:
        return Entry(path.stem, origin, None, str(error))


def files_in(folder: Path, ending: str, most: int = MOST_FILES) -> list[Path]:
    """Return the first files of a folder with an ending, by name; none if it cannot be read."""
    try:
        with os.scandir(folder) as found:
            names = sorted(entry.name for entry in found if entry.name.endswith(ending))
    except OSError:
        return []
    return [folder / name for name in names[:most]]


SUMMARY = "Something is wrong in this run. Find it from errors, innovations, NEES and verdict."


def gallery_lessons() -> list[Lesson]:
    """Return the lessons of the gallery; their names and titles do not give the fault away."""
    table = read_toml(Path(__file__).with_name("gallery.toml"))
    return [_lesson(number, row, table) for number, row in enumerate(table["fault"], 1)]


def _lesson(number: int, row: Mapping[str, Any], table: Mapping[str, Any]) -> Lesson:
    seen, known, named, repaired = (dict(step) for step in table["step"])
    seen["answer"], known["answer"] = row["innovations"], row["nees"]
    named["choices"] = sorted(fault.title for fault in FAULTS.values())
    named |= {"answer": FAULTS[row["name"]].title, "because": row["because"]}
    steps = [seen, known, named]
    if "repair" in row:
        repaired["text"] = f"{row['repair']}\n\n{repaired['text']}"
        steps.append(repaired | {key: row[key] for key in ("check", "solution", "wrong")})
    return make_lesson(
        f"break-it-{number:02}",
        {
            "title": f"Break it {number}",
            "summary": SUMMARY,
            "settings": table["settings"],
            "fault": row["name"],
            "step": steps,
        },
    )
