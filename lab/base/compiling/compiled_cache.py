"""Compiled cache: kernels on disk that are checked before they are loaded; damaged ones are recompiled.

Numba does not check its files: an empty one makes every command fail, and damaged machine code would run. It
compares the file of a kernel, not the functions that the kernel calls: here, their fingerprint is compared.
Nor does it know what other processes compile: several that need the same kernel would each compile it.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from lab.base.collection_pause import collection_pause
from lab.base.compiling.fingerprint import fingerprint
from lab.base.files.locks import locked

log = logging.getLogger(__name__)

DISABLE_JIT: bool = vars(numba.config)["DISABLE_JIT"]
"""Whether kernels stay plain Python, by the environment variable NUMBA_DISABLE_JIT=1."""

DIGEST = hashlib.sha256().digest_size
"""Length of the checksum after the compiled code [bytes]."""

PATIENCE = 300.0
"""Longest wait for another process that compiles [s]: ten times what the largest kernel takes on a busy
computer. After it, the process compiles the kernel itself."""

LOWEST_PRIORITY = 19
"""Niceness of a process that works only when no other does [POSIX]."""

_PAUSE = 0.05
"""Time between two looks whether the other process is done [s]: short beside a compilation of seconds."""


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

    def has_code_for(self, processor: object) -> bool:
        """Return whether there is compiled code of this version for a processor, for any arguments."""
        try:
            return any(key[1] == processor for key in self._load_index())
        except Exception:  # a damaged pickle can raise any exception
            return False

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


class KernelCache(FunctionCache):
    """The compiled code of one kernel, which is loaded without the compiler."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for some types of arguments; None if there is none.

        Numba first imports all functions that it can compile, which takes ten times as long as loading. Code
        needs of them only the runtime; the compiler imports the rest if there is no code.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class CachedKernel(CPUDispatcher):
    """A function called from Python whose compiled code is kept on disk, and is compiled by one process."""

    _cache: Any
    targetctx: Any

    def enable_caching(self) -> None:
        """Keep compiled code on the disk."""
        self._cache = KernelCache(self.py_func)

    def compile(self, sig: Any) -> Any:
        """Load the code for some types of arguments, or compile it; wait for a process that does."""
        # The lock of the compiler first: a thread that compiles another kernel has it, and may need this one.
        with global_compiler_lock:
            file = self._files()
            with _lock_kernel(file) if file else contextlib.nullcontext(), collection_pause():
                return super().compile(sig)

    @property
    def is_ready(self) -> bool:
        """Whether the kernel is compiled, in this process or on the disk, for any arguments."""
        if self.signatures:
            return True
        file = self._files()
        return file is not None and file.has_code_for(self.targetctx.codegen().magic_tuple())

    def _files(self) -> CheckedCacheFile | None:
        """Return the files of the kernel; None if they cannot be kept anywhere."""
        if isinstance(self._cache, NullCache):
            with contextlib.suppress(RuntimeError):  # no file of the source, or no folder that can be written
                self.enable_caching()
        own = getattr(self._cache, "_cache_file", None)
        if own is not None and not isinstance(own, CheckedCacheFile):
            name = own._index_name.removesuffix(".nbi")
            own = CheckedCacheFile(own._cache_path, name, fingerprint(self))
            self._cache._cache_file = own
        return own


@contextlib.contextmanager
def _lock_kernel(kernel: CheckedCacheFile) -> Iterator[None]:
    """Wait until no other process compiles a kernel, and keep others waiting.

    Nobody waits for a process of the lowest priority, which on a busy computer may take long.
    """
    if hasattr(os, "nice") and os.nice(0) >= LOWEST_PRIORITY:
        yield
        return
    path = Path(kernel._index_path).with_suffix(".lock")
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # where nothing can be written, nothing can be shared
            path.parent.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(path.open("ab"))
            until = time.monotonic() + PATIENCE
            while not locked(file) and time.monotonic() < until:
                time.sleep(_PAUSE)
        yield


def is_missing(kernel: object) -> bool:
    """Return whether the code of a function called from Python belongs on the disk, and is not there."""
    return isinstance(kernel, CachedKernel) and not kernel.is_ready and kernel._files() is not None


def compile_cached(function: Any, options: dict[str, Any]) -> Any:
    """Return a function that is compiled with some options when first called, and kept on disk.

    Parameters
    ----------
    function
        A function that Numba can compile.
    options
        Options of the compiler.
    """
    return function if DISABLE_JIT else CachedKernel(function, targetoptions=options)
