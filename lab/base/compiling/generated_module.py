"""Generated module: Python code that the lab writes, in a file that can be read and stepped through.

The file is for people, and for the cache of compiled code beside it. What runs is the text in memory: a file
that differs from it, because it is damaged or not of the lab, is written anew and never executed. Where no
folder can be written, the module is in memory only, and its code is compiled in each process.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import linecache
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numba

VERSIONS = 4
"""Versions of a module that are kept beside each other: some clones of the lab may share a folder."""
LONGEST_NAME = 60
"""Longest name of a file before its digest [characters]: the compiler makes longer names of it."""
_LOCK = threading.RLock()


def load_module(name: str, text: str, *, in_memory: bool = False) -> ModuleType:
    """Return the module with some text: that which this process has already, or a new one.

    Parameters
    ----------
    name
        What it is, as an identifier; the name of the module also has a digest of the text.
    text
        The whole text.
    in_memory
        Whether to write no file.
    """
    if len(name) > LONGEST_NAME:
        name = f"{name[:LONGEST_NAME]}_{_digest(name)}"
    stem = f"{name}_{_digest(text)}"
    with _LOCK:
        if stem in sys.modules:
            return sys.modules[stem]
        path = None if in_memory else _write_module(name, stem, text)
        module = ModuleType(stem)
        module.__file__ = str(path or f"<{stem}>")
        if path is None:  # a debugger and tracebacks find the lines here
            linecache.cache[module.__file__] = len(text), None, text.splitlines(True), module.__file__
        sys.modules[stem] = module
        try:
            exec(compile(text, module.__file__, "exec"), module.__dict__)
        except BaseException:
            del sys.modules[stem]
            raise
        return module


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _write_module(name: str, stem: str, text: str) -> Path | None:
    """Write the file of a module unless it is there with the same text; return None if that is impossible."""
    folder = generated_folder()
    if folder is None:
        return None
    path = folder / f"{stem}.py"
    try:
        if path.is_file() and path.read_bytes() == text.encode():
            return path
        _write(path, text)
        _remove_old(folder, name)
    except OSError:
        return None
    return path


def _write(path: Path, text: str) -> None:
    """Write a file as a whole."""
    new = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        new.write_bytes(text.encode())
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _remove_old(folder: Path, name: str) -> None:
    """Remove the oldest versions of a module, with their compiled code."""
    # An underscore and twelve digits of the digest: no module whose name only begins alike.
    versions = [path for path in folder.glob(f"{name}_*.py") if len(path.stem) == len(name) + 13]
    for path in sorted(versions, key=lambda one: one.stat().st_mtime)[:-VERSIONS]:
        for file in (path, *folder.rglob(f"{path.stem}.*")):
            file.unlink(missing_ok=True)


@functools.cache
def generated_folder() -> Path | None:
    """Return the folder of the generated modules, the first that can be written; None if none can.

    The modules are in the folder that `NUMBA_CACHE_DIR` names for compiled code, else in one for this copy
    of the lab in the user's cache, else in a temporary folder of this process. None is within the lab: its
    tools would take the modules for sources.
    """
    for folder in _folders():
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    return None


def _folders() -> Iterator[Path]:
    """Iterate over the folders for generated modules, the best one first."""
    named: str = vars(numba.config)["CACHE_DIR"]
    if named:
        yield Path(named) / "generated"
    from platformdirs import user_cache_path  # noqa: PLC0415 - only needed without the variable

    yield user_cache_path("ins-lab") / f"generated_{_digest(str(Path(__file__).resolve()))}"
    with contextlib.suppress(OSError):
        yield Path(_temporary().name)


@functools.cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    """Return a folder that is removed at the end of the process."""
    return tempfile.TemporaryDirectory(prefix="ins-lab-")
