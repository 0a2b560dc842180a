"""Folder lock: one process or thread at a time changes what is in a folder; a crash gives the lock back."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

LOCK_FILE = ".lock"
"""The file that is locked; it stays."""


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Wait until nobody else holds the lock of a folder, and hold it.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    with (folder / LOCK_FILE).open("ab") as file:
        _lock(file)
        yield


if sys.platform == "win32":
    import msvcrt

    def _lock(file: BinaryIO) -> None:
        # Gives up after ten seconds; nobody holds it for so long.
        msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)

else:
    import fcntl

    def _lock(file: BinaryIO) -> None:
        fcntl.flock(file, fcntl.LOCK_EX)
