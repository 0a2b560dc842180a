"""Upload: a button files are dropped on; they go to a folder of the session, which ends with it."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import panel_material_ui as pmui

from dashboards.messages import CHUNK
from lab.missions.mission_name import PUNCTUATION
from lab.readers import MAX_FILES
from lab.recordings.folder_lock import LOCK_FILE, hold

MAX_BYTES = 512 * 2**20
"""Largest upload of a flight accepted, all files together [bytes]."""
LONGEST_NAME = 60
SAME_FILE_AGAIN = """
document.addEventListener("click", (event) => {
  const field = event.composedPath()[0];
  if (field instanceof HTMLInputElement && field.type === "file") field.value = "";
}, true);
"""
"""Lets a person choose the file of before once more, such as after it was corrected.

A browser says nothing of a choice of what the field holds already, and the button empties its field only two
seconds after an upload, and never after one that it refused.
"""
PREFIX = "ins-lab-upload-"
"""How the folders of uploads begin, in the folder for temporary files; the number of the process follows."""


class Upload(pmui.FileInput):
    """A button that takes files, piece by piece, so that they are never whole in memory.

    Parameters
    ----------
    arrived
        Called with the paths of the files once all are there; those of before are gone then.
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
        """Delete all files, and take no more."""
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
        """The folder of all uploads here; it goes with the session, or with the server."""
        if self._temporary is None:
            remove_abandoned()
        while self._temporary is None:
            made = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-", ignore_cleanup_errors=True)
            lock = hold(Path(made.name))
            if lock is not None:  # None: a server that starts takes the folder for abandoned
                self._temporary, self._lock = made, lock
        return Path(self._temporary.name)

    def _handle_msg(self, msg: Any) -> None:
        """Do what the browser says of an upload; the button itself does not expect that it refuses a file."""
        if isinstance(msg, dict) and msg.get("status") == "error":
            self._problem = self._problem or (
                f"The browser did not send the files; accepted are up to {self._largest // 2**20} MB in all."
            )
            self._flush_buffer()
            return
        super()._handle_msg(msg)

    def _process_chunk(self, msg: dict[str, Any]) -> None:
        """Write a piece of a file; what a browser would not send is refused."""
        name, chunk, data = msg.get("name"), msg.get("chunk"), msg.get("data")
        if self._closed or self._problem or not isinstance(name, str):
            return
        if not isinstance(data, bytes | bytearray | memoryview):  # a number would make as many zeros
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
        """Hand the files over."""
        paths, problem = list(self._paths.values()), self._problem
        self._begin()
        if self._closed:
            return
        if problem:
            if self._temporary is not None:
                shutil.rmtree(self._folder / str(self._number + 1), ignore_errors=True)
            self._refused(problem)
        elif paths:
            shutil.rmtree(self._folder / str(self._number), ignore_errors=True)
            self._number += 1
            self._arrived(paths)


def plain_name(name: str) -> str:
    """Return a name that is one of a file in a folder, as near as can be to what a browser claims."""
    last = name.replace("\\", "/").rpartition("/")[2]
    plain = "".join(sign if sign.isalnum() or sign in PUNCTUATION else "_" for sign in last)
    return plain[-LONGEST_NAME:].strip(" .") or "file"


def remove_abandoned() -> None:
    """Remove the uploads of servers that were killed: of those folders nobody holds the lock."""
    for folder in _folders(""):
        if (folder / LOCK_FILE).exists():
            with contextlib.suppress(OSError):
                lock = hold(folder)
                if lock is not None:
                    lock.close()
                    shutil.rmtree(folder, ignore_errors=True)


def remove_all_here() -> None:
    """Remove all uploads of this process, which ends."""
    for folder in _folders(f"{os.getpid()}-"):
        shutil.rmtree(folder, ignore_errors=True)


def _folders(more: str) -> Iterator[Path]:
    """Yield the folders of uploads that are this user's own, and no links."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}{more}*"):
        with contextlib.suppress(OSError):
            found = path.lstat()
            if stat.S_ISDIR(found.st_mode) and found.st_uid == (os.getuid() if hasattr(os, "getuid") else 0):
                yield path
