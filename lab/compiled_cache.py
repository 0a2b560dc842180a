"""Compiled cache: kernels on disk that are checked before they are loaded; what is damaged is compiled anew.

Numba reads its files as they are: an empty one ends every command, and damaged machine code would be run.
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
        """Return the compiled code of a key; None if there is none, or if it was damaged and is removed."""
        try:
            return super().load(key)
        except Exception as error:  # a damaged pickle raises whatever its bytes happen to mean
            self._remove(error)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Keep compiled code."""
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
            raise ValueError(f"{path} is not what was written")
        # Numba reads to the end of what it has written, and leaves out the checksum.
        return super()._load_data(name)

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(content + hashlib.sha256(content).digest())

    def _remove(self, error: Exception) -> None:
        """Remove all files of the kernel."""
        log.warning("%s: the compiled code is damaged (%s) and is compiled anew", self._index_path, error)
        index = Path(self._index_path)
        for path in (index, *index.parent.glob(f"{index.stem}.*.nbc")):
            with contextlib.suppress(OSError):
                path.unlink()


def check_files(function: Any) -> None:
    """Have the files of a compiled function checked, if it is kept on disk at all."""
    own = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if isinstance(own, IndexDataCacheFile):
        function._cache._cache_file = CheckedCacheFile(
            own._cache_path, own._index_name.removesuffix(".nbi"), own._source_stamp
        )
