"""Python file: objects out of a Python file that the user names, such as an algorithm or a decoder.

The file is executed, so only whoever runs the laboratory may name it.
"""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any


class PythonFileError(ValueError):
    """What was named cannot be loaded; the message says why and where, and what is accepted."""


def load_object(place: str, form: str, call: str, listed: str) -> Any:
    """Return the object with a method that a place names.

    Parameters
    ----------
    place
        ``FILE.py:Name``. The name is that of a class, called without arguments, or of a ready object.
    form
        How a place is written, with an example, for messages.
    call
        The method that it must have, as it is called, such as ``"feed(data)"``.
    listed
        What the list of such objects begins with in a message, such as ``"algorithms in the file"``.

    Raises
    ------
    PythonFileError
        If there is no such file or name, if the file or the class fails, or if the object has no such method.
    """
    method = call.partition("(")[0]
    file, colon, name = place.rpartition(":")
    if not colon or not name.isidentifier() or not file.endswith(".py"):
        raise PythonFileError(f"{place!r}: accepted is {form}")
    module = _module(Path(file))
    names = _list_offered(module, method, listed)
    if not hasattr(module, name):
        raise PythonFileError(f"{file}: has no {name!r}{names}")
    found = getattr(module, name)
    if isinstance(found, type):
        try:
            found = found()
        except (Exception, SystemExit) as error:
            raise PythonFileError(
                f"{place}: called without arguments, it fails: {describe_error(error)}"
            ) from error
    if not callable(getattr(found, method, None)):
        raise PythonFileError(f"{place}: is of type {type(found).__name__}, without a method {call}{names}")
    return found


def describe_error(error: BaseException) -> str:
    """Return text that describes an exception and the place, in the called code or beside it, that raised it.

    Parameters
    ----------
    error
        The exception, as caught by the function that called the code.
    """
    what = type(error).__name__ + (f": {error}" if str(error) else "")
    frames = traceback.extract_tb(error.__traceback__)[1:]
    called = [frame for frame in frames if not frame.filename.startswith("<")]
    if not called:
        return what
    # A failure inside NumPy is reported at the line that called NumPy.
    folder = Path(called[0].filename).parent
    place = [frame for frame in called if Path(frame.filename).parent == folder][-1]
    return f"{Path(place.filename).name}, line {place.lineno}, in {place.name}: {what}"


def _module(path: Path) -> ModuleType:
    """Execute a Python file and return its module; it can import files beside it, like any script."""
    if not path.is_file():
        raise PythonFileError(f"{path}: there is no such file")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    # A unique name, because a file called numpy.py must not replace NumPy.
    name = f"python file:{path.resolve()}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look it up there
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise PythonFileError(f"{error.filename}, line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise PythonFileError(f"{path}: raised an exception: {describe_error(error)}") from error
    return module


def _list_offered(module: ModuleType, method: str, listed: str) -> str:
    """Return text that lists the names of a module whose objects have a method."""
    names = [
        name
        for name, value in inspect.getmembers(module)
        if callable(getattr(value, method, None)) and not name.startswith("_")
    ]
    return f"; {listed}: {', '.join(names)}" if names else ""
