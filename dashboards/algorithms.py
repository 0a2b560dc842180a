"""Algorithms: the operator's own algorithms, compared beside the built-in models or beside live streams."""

from __future__ import annotations

import os
from collections.abc import Sequence

from lab.navigation.algorithm import Algorithm, AlgorithmError, Estimate, load_algorithm
from lab.navigation.solution import Fixes, Imu, Start

VARIABLE = "INS_LAB_ALGORITHMS"
"""Environment variable that names the algorithms for ``panel serve``: ``FILE.py:Name``, separated by commas.

Visitors cannot set it.
"""

LIVE_VARIABLE = "INS_LAB_LIVE_ALGORITHMS"
"""Environment variable that names the algorithms that follow live streams, written alike."""

_given: list[str] = []
"""Algorithms set by the server of this process; they replace those of the environment."""


def use_algorithms(places: Sequence[str]) -> None:
    """Set the algorithms, as ``FILE.py:Name``, that all sessions of this process compare."""
    _given[:] = places


def use_live_algorithms(places: Sequence[str]) -> None:
    """Set the algorithms, as ``FILE.py:Name``, beside live streams, also of processes that start later."""
    if places:
        os.environ[LIVE_VARIABLE] = ",".join(places)


class Unusable:
    """Placeholder for an algorithm that could not be loaded.

    Parameters
    ----------
    reason
        Why.
    """

    def __init__(self, reason: str) -> None:
        self._reason = reason

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Raise the error that loading the algorithm raised."""
        raise AlgorithmError(self._reason)


def served_names() -> tuple[str, ...]:
    """Return the names of the server's algorithms, which are not loaded."""
    return tuple(_by_name(_given, VARIABLE))


def served_algorithm(name: str) -> Algorithm:
    """Return one of the server's algorithms, loaded anew, so that sessions share no objects."""
    try:
        return load_algorithm(_by_name(_given, VARIABLE)[name])
    except AlgorithmError as error:
        return Unusable(str(error))


def live_places() -> dict[str, str]:
    """Return the places of the server's algorithms for live streams, by their names; nothing is loaded."""
    return _by_name((), LIVE_VARIABLE)


def _by_name(given: Sequence[str], variable: str) -> dict[str, str]:
    """Return places by their names: those given, or else those of a variable of the environment."""
    found: dict[str, str] = {}
    places = given or [part.strip() for part in os.environ.get(variable, "").split(",")]
    for place in filter(None, places):
        name = place.rpartition(":")[2]
        found[place if name in found else name] = place
    return found
