"""Atomic file: a file that appears whole under its name, or not at all."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from lab.base.files.locks import locked
from lab.base.files.temporary_files import TEMPORARY, clear


@contextlib.contextmanager
def atomic_file(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing bytes; it takes its name only when everything has been written.

    What killed processes have left of the same file is removed.

    Parameters
    ----------
    path
        The file.
    private
        Whether only the user can read it.

    Raises
    ------
    OSError
        If it cannot be written; a file already there is left as it was.
    """
    own = f".{path.name}{TEMPORARY}"  # a hidden file of the user, such as .a.csv.original, is another one
    clear(path.parent, re.compile(rf"{re.escape(own)}[a-z0-9_]{{8}}").fullmatch)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=own)
    try:
        with os.fdopen(handle, "wb") as file:
            with contextlib.suppress(OSError):  # not every file system knows locks
                locked(file)  # so that no sweep removes it, however long writing takes
            yield file
        # mkstemp makes files only their owner can read; others get the permissions of an ordinary new file.
        if not private:
            # The system tells it only to whoever sets it.
            umask = os.umask(0)
            os.umask(umask)
            Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in {None, temporary}:
            error.filename = str(path)  # the system does not name the file when the disk is full
        raise


def write_file(path: Path, content: str | bytes, *, private: bool = False) -> None:
    """Write a whole file, text as UTF-8; see `atomic_file`."""
    with atomic_file(path, private=private) as file:
        file.write(content.encode() if isinstance(content, str) else content)
