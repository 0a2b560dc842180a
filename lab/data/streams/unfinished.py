"""Unfinished recordings: raw recordings of which nobody has made a mission yet, or thrown away.

A file beside the recording marks it while it runs and until somebody decides, so a browser that is reloaded
or a server that is killed loses none. Whoever makes a mission of it, or throws it away, holds the lock of
that file: nobody else is offered the recording meanwhile.
"""

from __future__ import annotations

import contextlib
import errno
import threading
import time
from collections.abc import Collection
from pathlib import Path
from typing import BinaryIO, Final

from lab.base.files.deleted_files import DeletedFiles
from lab.base.files.locks import locked
from lab.data.streams.raw_recording import FLUSH, SUFFIX

MARK: Final = ".unfinished"
"""Added to the name of a recording for the file that marks it."""
RUNS: Final = 3 * FLUSH
"""Age of the last bytes below which another process may still record [s]: they are flushed each `FLUSH`."""

SETTLED: Final = 2_000_000_000
"""Age of the last change of a folder from which another one has another time [ns]: the 2 s of FAT."""

_held: dict[Path, BinaryIO] = {}
"""The recordings in work in this process, and the locked files that mark them."""
_holding = threading.Lock()


def mark(path: Path) -> None:
    """Mark a recording that begins; raises `OSError`."""
    _mark_path(path).touch()


def unmark(path: Path) -> None:
    """Remove the mark of a recording: it is a mission now, or its owner was told why not."""
    release(path)
    with contextlib.suppress(OSError):
        _mark_path(path).unlink()


def hold_recording(path: Path) -> bool:
    """Take an unfinished recording until `unmark` or `release`.

    Returns
    -------
    bool
        False if another page or program has it, or has made a mission of it.
    """
    with _holding:
        if path in _held:
            return False
        try:
            file = _mark_path(path).open("r+b")
        except OSError:
            return False
        try:
            is_free = locked(file)
        except OSError:  # this file system has no locks: only this process knows
            is_free = True
        if is_free:
            _held[path] = file
        else:
            file.close()
        return is_free


def release(path: Path) -> None:
    """Leave a recording that was held to others."""
    with _holding:
        file = _held.pop(path, None)
        if file is not None:
            file.close()


def discard(path: Path) -> DeletedFiles:
    """Delete an unfinished recording, with its mark; the recording may still be brought back.

    Raises
    ------
    OSError
        If it cannot be deleted, or somebody makes a mission of it.
    """
    if not hold_recording(path):
        raise OSError(errno.EBUSY, "a mission is made of it")
    try:
        deleted = DeletedFiles.taken(path.name, path.parent, [path] if path.exists() else [])
    except OSError:
        release(path)
        raise
    unmark(path)
    return deleted


def restore_recording(deleted: DeletedFiles, path: Path) -> None:
    """Bring a recording back that was discarded; raises `MissionError` or `OSError`."""
    deleted.restore()
    mark(path)


class UnfinishedRecordings:
    """The unfinished recordings in a folder, which is read again only when its entries have changed."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._entries = 0  # when the entries of the folder changed, when it was read [ns]
        self._marked: list[Path] = []

    def found(self, folder: Path, running: Collection[Path] = ()) -> list[Path]:
        """Return the unfinished recordings, the newest first.

        Parameters
        ----------
        folder
            The folder, which need not exist.
        running
            Recordings of this process that still run; they are left out, as those of other processes and
            those that somebody holds are.
        """
        self._read(folder)
        found = []
        for path in self._marked:
            try:
                changed = path.stat().st_mtime
            except OSError:  # it was never begun, or somebody deleted it
                unmark(path)
                continue
            if path not in running and time.time() - changed > RUNS and hold_recording(path):
                release(path)
                found.append((changed, path))
        return [path for _, path in sorted(found, reverse=True)]

    def _read(self, folder: Path) -> None:
        """Find the marked recordings, if the folder may have others than before."""
        try:
            entries = folder.stat().st_mtime_ns
        except OSError:
            entries = 0
        if folder == self._folder and entries == self._entries:
            return
        marks = folder.glob(f"*{SUFFIX}{MARK}")
        self._marked = [one.with_name(one.name.removesuffix(MARK)) for one in marks]
        # Two changes within a tick of the file system have the same time: a young one is not believed.
        settled = time.time_ns() - entries > SETTLED
        self._folder, self._entries = (folder if settled else None), entries


def _mark_path(path: Path) -> Path:
    return path.with_name(path.name + MARK)
