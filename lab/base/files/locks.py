"""Locks: only one process or thread holds a file, or changes a folder; a crash releases the lock."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

if sys.platform == "win32":
    import msvcrt

    def locked(file: BinaryIO) -> bool:
        """Take the lock of an open file, until it is closed; return False if it is taken."""
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def locked(file: BinaryIO) -> bool:
        """Take the lock of an open file, until it is closed; return False if it is taken."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


LOCK_FILE = ".lock"
"""The file that is locked; it stays."""

PATIENCE = 10.0
"""Longest wait for a lock [s]: a holder writes a few small files meanwhile."""

_PAUSE = 0.02
"""Time between two attempts [s]: too short for a person to notice."""


@contextlib.contextmanager
def folder_lock(folder: Path, patience: float = PATIENCE) -> Iterator[None]:
    """Wait until the lock of a folder is free, and hold it.

    Raises
    ------
    TimeoutError
        If another process holds the lock for longer than the patience [s].
    OSError
        If the folder cannot be written.
    """
    with (folder / LOCK_FILE).open("ab") as file:
        until = time.monotonic() + patience
        while not locked(file):
            if time.monotonic() >= until:
                raise TimeoutError(
                    f"another program has been changing this folder for {patience:g} s; try again later"
                )
            time.sleep(_PAUSE)
        yield


def lock_folder(folder: Path) -> BinaryIO | None:
    """Lock a folder until the returned file is closed; return None if it is taken.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    return hold_file(folder / LOCK_FILE)


def hold_file(path: Path) -> BinaryIO | None:
    """Lock a file, made if absent, until the returned file is closed; return None if it is taken.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    file = path.open("ab")
    if locked(file):
        return file
    file.close()
    return None
