"""Algorithms: those of whoever started the server, compared beside the built-in models."""

from __future__ import annotations

import os
from collections.abc import Sequence

from lab.algorithm_file import load_algorithm
from lab.navigation.algorithm import Algorithm, AlgorithmError, Estimate
from lab.navigation.solution import Fixes, Imu, Start

VARIABLE = "INS_LAB_ALGORITHMS"
"""Environment variable that names them for ``panel serve``: ``FILE.py:Name`` with commas between.

No visitor can set it.
"""

_given: list[str] = []
"""Algorithms of the server of this process, which stand in place of those of the environment."""


def use_algorithms(places: Sequence[str]) -> None:
    """Have all sessions of this process compare these algorithms, as ``FILE.py:Name``."""
    _given[:] = places


class Unusable:
    """Stands for an algorithm that could not be loaded.

    Parameters
    ----------
    reason
        Why.
    """

    def __init__(self, reason: str) -> None:
        self._reason = reason

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Say why there is none."""
        raise AlgorithmError(self._reason)


def served_algorithms() -> dict[str, Algorithm]:
    """Return the server's algorithms by name, loaded anew: sessions share no object of them."""
    found: dict[str, Algorithm] = {}
    places = _given or [part.strip() for part in os.environ.get(VARIABLE, "").split(",")]
    for place in filter(None, places):
        name = place.rpartition(":")[2]
        try:
            algorithm = load_algorithm(place)
        except AlgorithmError as error:
            algorithm = Unusable(str(error))
        found[place if name in found else name] = algorithm
    return found
