"""Algorithms: those of whoever started the server, compared beside the built-in models."""

from __future__ import annotations

import os

from lab.algorithm_file import load_algorithm
from lab.navigation.algorithm import Algorithm, AlgorithmError, Estimate
from lab.navigation.solution import Fixes, Imu, Start

VARIABLE = "INS_LAB_ALGORITHMS"
"""Environment variable that names them, as ``FILE.py:Name``, with commas between; no visitor can set it."""


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
    """Return the algorithms of the environment by name, loaded anew: sessions share no object of them."""
    found: dict[str, Algorithm] = {}
    for place in filter(None, (part.strip() for part in os.environ.get(VARIABLE, "").split(","))):
        name = place.rpartition(":")[2]
        try:
            algorithm = load_algorithm(place)
        except AlgorithmError as error:
            algorithm = Unusable(str(error))
        found[place if name in found else name] = algorithm
    return found
