"""Upload: a button that takes dropped files into a folder of the session, deleted when the session ends."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import panel_material_ui as pmui

from dashboards.messages import CHUNK
from lab.base.files.locks import LOCK_FILE, lock_folder
from lab.data.formats import MAX_FILES
from lab.missions.mission_name import PUNCTUATION

MAX_BYTES = 512 * 2**20
"""Largest upload of a flight accepted, all files together [bytes]."""
LONGEST_NAME = 60
SAME_FILE_AGAIN = """
document.addEventListener("click", (event) => {
  const field = event.composedPath()[0];
  if (field instanceof HTMLInputElement && field.type === "file") field.value = "";
}, true);
"""
"""Allows choosing the same file again, such as after a correction.

A browser reports no choice of a file that the field already holds. The button empties its field only two
seconds after an upload, and never after a refused one.
"""
PREFIX = "ins-lab-upload-"
"""Prefix of the folders of uploads, in the folder for temporary files; the process number follows."""


def without_folder(text: str) -> str:
    """Return a text in which uploaded files stand by their names: no visitor is told where they were put."""
    return re.sub(rf"{re.escape(tempfile.gettempdir())}/{PREFIX}[^/]+/\d+/", "", text)


class Upload(pmui.FileInput):
    """A button that receives files in pieces, so that they are never whole in memory.

    Parameters
    ----------
    arrived
        Called with the paths of the files once all have arrived; the previous files are deleted then.
    refused
        Called with the reason when an upload is not accepted.
    most
        Most files accepted at once.
    largest
        Largest upload accepted, all files together [bytes]; `MAX_BYTES` by default.
    """

    def __init__(
        self,
        arrived: Callable[[list[Path]], None],
        refused: Callable[[str], None],
        *,
        most: int = MAX_FILES,
        largest: int | None = None,
        **params: Any,
    ) -> None:
        self._most, self._largest = most, MAX_BYTES if largest is None else largest
        super().__init__(  # type: ignore[no-untyped-call]
            multiple=most > 1, max_file_size=self._largest, chunk_size=CHUNK, **params
        )
        self._arrived = arrived
        self._refused = refused
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._number = 0
        self._closed = False
        self._begin()

    def delete(self) -> None:
        """Delete all files, and accept no more."""
        self._closed = True
        if self._temporary is not None:
            self._lock.close()
            self._temporary.cleanup()

    def _begin(self) -> None:
        self._paths: dict[str, Path] = {}
        self._chunks: dict[str, int] = {}
        self._bytes = 0
        self._problem = ""

    @property
    def _folder(self) -> Path:
        """The folder of all uploads of the session; it is deleted with the session or the server."""
        if self._temporary is None:
            remove_abandoned()
        while self._temporary is None:
            made = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-", ignore_cleanup_errors=True)
            lock = lock_folder(Path(made.name))
            if lock is not None:  # None means that a starting server would treat the folder as abandoned
                self._temporary, self._lock = made, lock
        return Path(self._temporary.name)

    def _handle_msg(self, msg: Any) -> None:
        """Handle the browser's messages about an upload; the base class does not expect a refused file."""
        if isinstance(msg, dict) and msg.get("status") == "error":
            self._problem = self._problem or (
                f"The browser did not send the files; accepted are up to {self._largest // 2**20} MB in all."
            )
            self._flush_buffer()
            return
        super()._handle_msg(msg)

    def _process_chunk(self, msg: dict[str, Any]) -> None:
        """Write a piece of a file; a piece that no browser would send is refused."""
        name, chunk, data = msg.get("name"), msg.get("chunk"), msg.get("data")
        if self._closed or self._problem or not isinstance(name, str):
            return
        if not isinstance(data, bytes | bytearray | memoryview):  # bytes(n) of a number n would be n zeros
            data = b""
        if name not in self._paths and len(self._paths) >= self._most:
            self._problem = f"More than {self._most} files; accepted are up to {self._most} at once."
            return
        self._bytes += len(data)
        if self._bytes > self._largest or chunk != self._chunks.get(name, 0) + 1:
            self._problem = (
                f"{name}: too large, or incomplete; accepted are up to {self._largest // 2**20} MB in all."
            )
            return
        if name not in self._paths:
            folder = self._folder / str(self._number + 1)
            folder.mkdir(exist_ok=True)
            taken = {path.name for path in self._paths.values()}
            plain = plain_name(name)
            self._paths[name] = folder / (plain if plain not in taken else f"{len(taken)}_{plain}")
        self._chunks[name] = chunk
        with self._paths[name].open("ab") as file:
            file.write(data)

    def _flush_buffer(self) -> None:
        """Report the uploaded files."""
        paths, problem = list(self._paths.values()), self._problem
        self._begin()
        if self._closed:
            return
        if problem:
            if self._temporary is not None:
                shutil.rmtree(self._folder / str(self._number + 1), ignore_errors=True)
            self._refused(problem)
        elif not paths:  # a browser cuts a file without content into no pieces
            self._refused("The file is empty; accepted are files with content.")
        else:
            shutil.rmtree(self._folder / str(self._number), ignore_errors=True)
            self._number += 1
            self._arrived(paths)


def plain_name(name: str) -> str:
    """Return a plain file name, as close as possible to the name that the browser sent."""
    last = name.replace("\\", "/").rpartition("/")[2]
    plain = "".join(sign if sign.isalnum() or sign in PUNCTUATION else "_" for sign in last)
    return plain[-LONGEST_NAME:].strip(" .") or "file"


def remove_abandoned() -> None:
    """Remove the uploads of killed servers: no process holds the lock of those folders."""
    for folder in _folders(""):
        if (folder / LOCK_FILE).exists():
            with contextlib.suppress(OSError):
                lock = lock_folder(folder)
                if lock is not None:
                    lock.close()
                    shutil.rmtree(folder, ignore_errors=True)


def remove_all_here() -> None:
    """Remove all uploads of this process when it ends."""
    for folder in _folders(f"{os.getpid()}-"):
        shutil.rmtree(folder, ignore_errors=True)


def _folders(more: str) -> Iterator[Path]:
    """Yield the upload folders that belong to this user and are not links."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}{more}*"):
        with contextlib.suppress(OSError):
            found = path.lstat()
            if stat.S_ISDIR(found.st_mode) and found.st_uid == (os.getuid() if hasattr(os, "getuid") else 0):
                yield path
