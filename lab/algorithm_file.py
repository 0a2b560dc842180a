"""Algorithm file: the user's own algorithm, from a Python file that the user names."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from lab.navigation.algorithm import Algorithm, AlgorithmError, described

FORM = "FILE.py:Name, such as my_filter.py:MyFilter"


def load_algorithm(place: str) -> Algorithm:
    """Execute a Python file and return its algorithm.

    Parameters
    ----------
    place
        ``FILE.py:Name``. The name is that of a class, which is called without arguments, or of an object.

    Raises
    ------
    AlgorithmError
        If the file or the name does not exist, if the file or the class fails, or if the object has no method
        `navigate`.
    """
    file, colon, name = place.rpartition(":")
    if not colon or not name.isidentifier() or not file.endswith(".py"):
        raise AlgorithmError(f"{place!r}: accepted is {FORM}")
    module = _module(Path(file))
    if not hasattr(module, name):
        raise AlgorithmError(f"{file}: has no {name!r}{_offered(module)}")
    found = getattr(module, name)
    if isinstance(found, type):
        try:
            found = found()
        except (Exception, SystemExit) as error:
            raise AlgorithmError(
                f"{place}: called without arguments, it fails: {described(error)}"
            ) from error
    if not isinstance(found, Algorithm) or not callable(found.navigate):
        raise AlgorithmError(
            f"{place}: is of type {type(found).__name__}, without a method navigate(imu, fixes, start)"
            f"{_offered(module)}"
        )
    return found


def load_algorithms(places: Sequence[str]) -> dict[str, Algorithm]:
    """Return algorithms of Python files by name; by place if two have the same name.

    Parameters
    ----------
    places
        Place of each, as for `load_algorithm`.

    Raises
    ------
    AlgorithmError
        If one cannot be loaded.
    """
    names = [place.rpartition(":")[2] for place in places]
    return {
        name if names.count(name) == 1 else place: load_algorithm(place)
        for name, place in zip(names, places, strict=True)
    }


def _module(path: Path) -> ModuleType:
    """Execute a Python file and return its module; it can import files beside it, like any script."""
    if not path.is_file():
        raise AlgorithmError(f"{path}: there is no such file")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    # A unique name, because a file called numpy.py must not replace NumPy.
    name = f"algorithm:{path.resolve()}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look it up there
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise AlgorithmError(f"{error.filename}, line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise AlgorithmError(f"{path}: raised an exception: {described(error)}") from error
    return module


def _offered(module: ModuleType) -> str:
    """Return text that lists the algorithms of a module."""
    names = [
        name
        for name, value in inspect.getmembers(module)
        if callable(getattr(value, "navigate", None)) and not name.startswith("_")
    ]
    return f"; algorithms in the file: {', '.join(names)}" if names else ""
