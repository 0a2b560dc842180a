"""Classroom: the lessons and the homework of this server, among them those of a teacher's own folders."""

from __future__ import annotations

import os
from pathlib import Path

from lab.classroom.homework.shelf import Shelf
from lab.classroom.lessons.catalogue import Catalogue

VARIABLE = "INS_LAB_LESSONS"
"""Environment variable that names the teacher's folder for ``panel serve``; visitors cannot set it."""

HOMEWORK_VARIABLE = "INS_LAB_HOMEWORK"
"""Environment variable that names the folder with the keys of homework; visitors cannot set it."""

_given: list[Path] = []
"""The folder set by the server of this process; it replaces that of the environment."""
_made: dict[Path | None, Catalogue] = {}
"""The catalogue of each folder, shared by all sessions: each file is read once."""
_keys: list[Path] = []
"""The folder with keys set by the server of this process; it replaces that of the environment."""
_shelves: dict[Path | None, Shelf] = {}
"""The shelf of each folder, shared by all sessions."""


def use_lessons(folder: Path | None) -> None:
    """Set the folder whose lessons all sessions of this process show besides those that ship."""
    _given[:] = [] if folder is None else [folder]


def catalogue() -> Catalogue:
    """Return the lessons of this server; they are read at the first use."""
    named = os.environ.get(VARIABLE, "")
    folder = _given[0] if _given else Path(named) if named else None
    if folder not in _made:
        _made[folder] = Catalogue(folder)
    return _made[folder]


def use_homework(folder: Path | None) -> None:
    """Set the folder with the keys of the homework that all sessions of this process show."""
    _keys[:] = [] if folder is None else [folder]


def shelf() -> Shelf:
    """Return the homework of this server; the keys are read at the first use."""
    named = os.environ.get(HOMEWORK_VARIABLE, "")
    folder = _keys[0] if _keys else Path(named) if named else None
    if folder not in _shelves:
        _shelves[folder] = Shelf(folder)
    return _shelves[folder]
