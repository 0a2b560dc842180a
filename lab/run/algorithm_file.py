"""Algorithm file: the user's own algorithm, from a Python file that the user names."""

from __future__ import annotations

from collections.abc import Sequence

from lab.base.python_file import PythonFileError, load_object
from lab.navigation.algorithm import Algorithm, AlgorithmError

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
    try:
        found, offered = load_object(place, FORM, "navigate", "algorithms in the file")
    except PythonFileError as error:
        raise AlgorithmError(str(error)) from (error.__cause__ or error)
    if not isinstance(found, Algorithm) or not callable(found.navigate):
        raise AlgorithmError(
            f"{place}: is of type {type(found).__name__}, without a method navigate(imu, fixes, start)"
            f"{offered}"
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
