"""Compiled cache: kernels on disk that are checked before they are loaded; damaged ones are recompiled.

Numba does not check its files: an empty one makes every command fail, and damaged machine code would run.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

log = logging.getLogger(__name__)

DIGEST = hashlib.sha256().digest_size
"""Length of the checksum after the compiled code [bytes]."""


class CheckedCacheFile(IndexDataCacheFile):
    """The index and the files of one kernel's compiled code, each with a checksum."""

    def load(self, key: Any) -> Any:
        """Return the compiled code of a key; None if there is none, or if it was damaged (then removed)."""
        try:
            return super().load(key)
        except Exception as error:  # a damaged pickle can raise any exception
            self._remove(error)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Store compiled code."""
        try:
            super().save(key, data)
        except OSError:
            raise
        except Exception as error:  # as above
            self._remove(error)
            super().save(key, data)

    def _load_data(self, name: str) -> Any:
        path = Path(self._data_path(name))
        content = path.read_bytes()
        if hashlib.sha256(content[:-DIGEST]).digest() != content[-DIGEST:]:
            raise ValueError(f"{path} does not match its checksum")
        # Numba reads only its own part of the file, without the checksum.
        return super()._load_data(name)

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(content + hashlib.sha256(content).digest())

    def _remove(self, error: Exception) -> None:
        """Remove all files of the kernel."""
        log.warning("%s: the compiled code is damaged (%s) and is compiled again", self._index_path, error)
        index = Path(self._index_path)
        for path in (index, *index.parent.glob(f"{index.stem}.*.nbc")):
            with contextlib.suppress(OSError):
                path.unlink()


def check_files(function: Any) -> None:
    """Check the files of a compiled function, if it is cached on disk."""
    own = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if isinstance(own, IndexDataCacheFile):
        function._cache._cache_file = CheckedCacheFile(
            own._cache_path, own._index_name.removesuffix(".nbi"), own._source_stamp
        )
