"""Folder lock: one process or thread at a time changes what is in a folder; a crash gives the lock back."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

LOCK_FILE = ".lock"
"""The file that is locked; it stays."""

PATIENCE = 10.0
"""Longest wait for a lock [s]: it is held for as long as a few small files take to write."""

_PAUSE = 0.02
"""Time from one attempt to the next [s]: short beside what a person notices."""


@contextlib.contextmanager
def folder_lock(folder: Path, patience: float = PATIENCE) -> Iterator[None]:
    """Wait until nobody else holds the lock of a folder, and hold it.

    Raises
    ------
    TimeoutError
        If somebody holds it for longer than the patience [s].
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


def hold(folder: Path) -> BinaryIO | None:
    """Take the lock of a folder, and hold it until the file returned is closed; None if somebody has it.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    return hold_file(folder / LOCK_FILE)


def hold_file(path: Path) -> BinaryIO | None:
    """Take the lock of a file, made if there is none, until the file returned is closed; None as of `hold`.

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


if sys.platform == "win32":
    import msvcrt

    def locked(file: BinaryIO) -> bool:
        """Take the lock of an open file, until it is closed; return False if somebody has it."""
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def locked(file: BinaryIO) -> bool:
        """Take the lock of an open file, until it is closed; return False if somebody has it."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
