"""Classroom: the lessons and the homework of this server, among them those of a teacher's own folders."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from lab.classroom.homework.shelf import Shelf
from lab.classroom.lessons.catalogue import Catalogue

VARIABLE = "INS_LAB_LESSONS"
"""Environment variable that names the teacher's folder for ``panel serve``; visitors cannot set it."""

HOMEWORK_VARIABLE = "INS_LAB_HOMEWORK"
"""Environment variable that names the folder with the keys of homework; visitors cannot set it."""

_given: dict[str, Path | None] = {}
"""The folders set by the server of this process, by the variable in whose place they are."""
_catalogue_of, _shelf_of = cache(Catalogue), cache(Shelf)
"""Those of each folder, shared by all sessions: each file is read once."""


def use_lessons(folder: Path | None) -> None:
    """Set the folder whose lessons all sessions of this process show besides those that ship."""
    _given[VARIABLE] = folder


def use_homework(folder: Path | None) -> None:
    """Set the folder with the keys of the homework that all sessions of this process show."""
    _given[HOMEWORK_VARIABLE] = folder


def catalogue() -> Catalogue:
    """Return the lessons of this server; they are read at the first use."""
    return _catalogue_of(_folder(VARIABLE))


def shelf() -> Shelf:
    """Return the homework of this server; the keys are read at the first use."""
    return _shelf_of(_folder(HOMEWORK_VARIABLE))


def _folder(variable: str) -> Path | None:
    named = os.environ.get(variable, "")
    return _given.get(variable) or (Path(named) if named else None)
