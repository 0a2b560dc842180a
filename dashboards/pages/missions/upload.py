"""Upload: a button files are dropped on; they go to a folder of the session, which ends with it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel_material_ui as pmui

from lab.missions.mission_name import PUNCTUATION
from lab.missions.readers import MAX_FILES

MAX_BYTES = 512 * 2**20
"""Largest upload accepted, all files together [bytes]."""
LONGEST_NAME = 60


class Upload(pmui.FileInput):
    """A button that takes files, piece by piece, so that they are never whole in memory.

    Parameters
    ----------
    arrived
        Called with the paths of the files once all are there; those of before are gone then.
    refused
        Called with the reason when an upload is not accepted.
    """

    def __init__(
        self, arrived: Callable[[list[Path]], None], refused: Callable[[str], None], **params: Any
    ) -> None:
        super().__init__(multiple=True, max_file_size=MAX_BYTES, **params)  # type: ignore[no-untyped-call]
        self._arrived = arrived
        self._refused = refused
        # It goes with the session, or with the server, whichever ends first.
        self._temporary = tempfile.TemporaryDirectory(prefix="ins-lab-upload-", ignore_cleanup_errors=True)
        self._folder = Path(self._temporary.name)
        self._number = 0
        self._closed = False
        self._begin()

    def delete(self) -> None:
        """Delete all files, and take no more."""
        self._closed = True
        self._temporary.cleanup()

    def _begin(self) -> None:
        self._paths: dict[str, Path] = {}
        self._chunks: dict[str, int] = {}
        self._bytes = 0
        self._problem = ""

    def _process_chunk(self, msg: dict[str, Any]) -> None:
        """Write a piece of a file; what a browser would not send is refused."""
        name, chunk, data = msg.get("name"), msg.get("chunk"), bytes(msg.get("data") or b"")
        if self._closed or self._problem or not isinstance(name, str):
            return
        if name not in self._paths and len(self._paths) >= MAX_FILES:
            self._problem = f"More than {MAX_FILES} files; accepted are up to {MAX_FILES} of one flight."
            return
        self._bytes += len(data)
        if self._bytes > MAX_BYTES or chunk != self._chunks.get(name, 0) + 1:
            self._problem = f"{name}: too large, or cut; accepted are up to {MAX_BYTES // 2**20} MB in all."
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
        shutil.rmtree(self._folder / str(self._number), ignore_errors=True)
        self._number += 1
        if problem:
            shutil.rmtree(self._folder / str(self._number), ignore_errors=True)
            self._refused(problem)
        elif paths:
            self._arrived(paths)


def plain_name(name: str) -> str:
    """Return a name that is one of a file in a folder, as near as can be to what a browser claims."""
    last = name.replace("\\", "/").rpartition("/")[2]
    plain = "".join(sign if sign.isalnum() or sign in PUNCTUATION else "_" for sign in last)
    return plain[-LONGEST_NAME:].strip(" .") or "file"
