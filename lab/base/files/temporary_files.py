"""Temporary files: files that a killed process left in a folder are removed later.

The sweep removes only files that the lab names itself: temporary files and folders, and recordings with a
note that their mission is not written yet. A writer holds a lock, which ends with its process; locked
files stay, however old they are. Other folders, such as those of exports, are not swept as a whole: who
writes a file first removes what a killed process has left of the same one.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from lab.base.files.locks import LOCK_FILE, hold_file

TEMPORARY = ".ins-lab-"
"""How the names of temporary folders begin; in that of a temporary file, it follows the name of the file."""
NOTE = ".unfinished"
"""How the names of notes end."""
OLD = 24 * 3600.0
"""Age above which a file is no longer being written, without locks [s]: writing takes less than an hour."""
SETTLED = 60.0
"""Age above which a file that nobody holds is no longer being written [s]: its writer takes the lock within
milliseconds."""

_FILE = re.compile(r"\..+\.(toml|csv|csv\.gz)\.(ins-lab-)?[a-z0-9_]{8}")


def note_path(recording: Path) -> Path:
    """Return the file that stands beside a recording while its mission is not written."""
    return recording.with_name(f".{recording.name}{NOTE}")


@contextlib.contextmanager
def mark_unfinished(recording: Path) -> Iterator[None]:
    """Mark a recording as having no mission yet, until its mission is written or it is removed."""
    note = note_path(recording)
    note.touch()
    try:
        with _hold_lock(note):
            yield
    finally:
        note.unlink(missing_ok=True)


@contextlib.contextmanager
def temporary_folder(where: Path) -> Iterator[Path]:
    """Make a folder for files that are then moved into another one; it is removed afterwards.

    Such folders that killed processes have left there are removed, too.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    clear(where, lambda name: name.startswith(TEMPORARY))
    with tempfile.TemporaryDirectory(dir=where, prefix=TEMPORARY) as name, _hold_lock(Path(name) / LOCK_FILE):
        yield Path(name)


@contextlib.contextmanager
def _hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock of a file, where the file system has locks."""
    lock = None
    with contextlib.suppress(OSError):
        lock = hold_file(path)
    try:
        yield
    finally:
        if lock is not None:
            lock.close()


def _is_held(path: Path) -> bool:
    """Return whether a file, or a folder's content, is being written."""
    lock = hold_file(path / LOCK_FILE if path.is_dir() else path)
    if lock is not None:
        lock.close()
    return lock is None


def clear(folder: Path, is_left: Callable[[str], object]) -> None:
    """Remove temporary files and folders of some names that nobody holds, and that are not quite new.

    What cannot be removed stays.
    """
    limit = time.time() - SETTLED
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(entry.path) for entry in entries if is_left(entry.name)]:
            with contextlib.suppress(OSError):
                if path.is_symlink() or _last_change(path) > limit or _is_held(path):
                    continue
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()


def sweep(folder: Path, is_named: Callable[[Path], bool], now: float | None = None) -> list[str]:
    """Remove what killed processes left in a folder, and return the names removed.

    Parameters
    ----------
    folder
        The folder; it need not exist.
    is_named
        Says whether a mission names a recording, which then stays.
    now
        The time [s]; by default that of the clock.
    """
    limit = (time.time() if now is None else now) - OLD
    try:
        with os.scandir(folder) as entries:
            hidden = [entry for entry in entries if entry.name.startswith(".")]
    except OSError:
        return []
    swept = []
    for entry in hidden:
        path = Path(entry.path)
        with contextlib.suppress(OSError):
            if entry.is_symlink() or not _is_own(entry) or _last_change(path) > limit or _is_held(path):
                continue
            if entry.is_dir():
                shutil.rmtree(path)
            else:
                if entry.name.endswith(NOTE):
                    swept += _remove_unwritten(path, is_named)
                path.unlink()
            swept.append(entry.name)
    return swept


def _is_own(entry: os.DirEntry[str]) -> bool:
    """Return whether this is a name of an unfinished file of the lab."""
    if entry.is_dir():
        return entry.name.startswith(TEMPORARY)
    return entry.is_file() and bool(entry.name.endswith(NOTE) or _FILE.fullmatch(entry.name))


def _remove_unwritten(note: Path, is_named: Callable[[Path], bool]) -> list[str]:
    """Remove the recording of a note, unless a mission names it."""
    recording = note.with_name(note.name.removeprefix(".").removesuffix(NOTE))
    if not recording.is_file() or recording.is_symlink() or is_named(recording):
        return []
    recording.unlink()
    return [recording.name]


def _last_change(path: Path) -> float:
    """Return when a file, or anything in a folder, was last changed [s]."""
    inside = path.rglob("*") if path.is_dir() and not path.is_symlink() else ()
    return float(max(one.lstat().st_mtime for one in (path, *inside)))
