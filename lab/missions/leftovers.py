"""Leftovers: files that a process left in a folder when it was killed while it wrote; they are swept later.

Only what the lab itself writes under names of its own is swept: temporary files and folders, and recordings
that stand beside a note that their mission is not written yet.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

TEMPORARY = ".ins-lab-"
"""How the names of temporary folders begin."""
NOTE = ".unfinished"
"""How the names of notes end."""
OLD = 24 * 3600.0
"""Age from which on nobody is writing any more [s]: no file of the lab takes an hour."""

_FILE = re.compile(r"\..+\.(toml|csv|csv\.gz)\.[a-z0-9_]{8}")


def note_of(recording: Path) -> Path:
    """Return the file that stands beside a recording while its mission is not written."""
    return recording.with_name(f".{recording.name}{NOTE}")


@contextlib.contextmanager
def unfinished(recording: Path) -> Iterator[None]:
    """Note that a recording has no mission yet, until it has or is gone."""
    note = note_of(recording)
    note.touch()
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def sweep(folder: Path, is_named: Callable[[Path], bool], now: float | None = None) -> list[str]:
    """Remove what killed processes left in a folder, and return the names of it.

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
            if _newest(path) > limit or entry.is_symlink():
                continue
            if entry.is_dir() and entry.name.startswith(TEMPORARY):
                shutil.rmtree(path)
            elif entry.is_file() and entry.name.endswith(NOTE):
                swept += _unwritten(path, is_named)
                path.unlink()
            elif entry.is_file() and _FILE.fullmatch(entry.name):
                path.unlink()
            else:
                continue
            swept.append(entry.name)
    return swept


def _unwritten(note: Path, is_named: Callable[[Path], bool]) -> list[str]:
    """Remove the recording of a note, unless a mission names it."""
    recording = note.with_name(note.name.removeprefix(".").removesuffix(NOTE))
    if not recording.is_file() or recording.is_symlink() or is_named(recording):
        return []
    recording.unlink()
    return [recording.name]


def _newest(path: Path) -> float:
    """Return when a file, or anything in a folder, was last changed [s]."""
    inside = path.rglob("*") if path.is_dir() and not path.is_symlink() else ()
    return float(max(one.lstat().st_mtime for one in (path, *inside)))
