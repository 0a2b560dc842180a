"""Aid verdict: whether the noise of measurements other than GPS fixes is as the filter assumes.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.analysis.finding import Weighed, judge_size
from lab.analysis.sums import Squares
from lab.navigation.aids import AIRSPEED, DOWNWARD, FORWARD, HEADING, HEIGHT, MAGNETIC, NAMES, RIGHTWARD
from lab.navigation.solution import Solution

SENSORS = {
    HEIGHT: "barometer",
    HEADING: "heading",
    MAGNETIC: "heading",
    FORWARD: "odometer",
    AIRSPEED: "airspeed",
}
"""Sensors that measure, by the group of their settings; the other kinds are conditions without a sensor."""


def aid_squares(solution: Solution, kinds: NDArray[np.int64]) -> Squares:
    """Return the squared innovations of each kind of measurement, and their numbers.

    Parameters
    ----------
    solution
        The solution of the filter.
    kinds : (a,) array
        Kinds of the measurements that it was given.
    """
    squares = solution.aid_innovation**2 / solution.aid_variance
    known = np.isfinite(squares)
    total, number = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    np.add.at(total, kinds[known], squares[known])
    np.add.at(number, kinds[known], 1.0)
    return Squares(total, number)


def judge_aids(squares: Squares) -> list[Weighed]:
    """Judge the assumed noise of each kind of measurement by the size of its innovations.

    A condition, such as zero velocity at rest, may hold better than assumed: only its violation is reported.
    """
    found: list[Weighed] = []
    for kind, name in enumerate(NAMES):
        total, number = squares.total[kind], squares.number[kind]
        if kind not in SENSORS and total <= number:
            continue
        found += judge_size(
            Squares(total, number),
            f"R {name}",
            f"The innovations of the {name} are {{root}} × as large as the filter says: their assumed noise "
            "is too {wrong}.",
            _advice(kind),
            f"innovations of the {name}",
        )
    return found


def _advice(kind: int) -> str:
    """Return what to change."""
    if kind in SENSORS:
        return (
            f"Set sensors.{SENSORS[kind]}.noise to the noise that applies, or multiply "
            "navigator.aiding_scale, first by {multiply}, if all other measurements are wrong alike. Check "
            "the times and the axes too."
        )
    if kind in (RIGHTWARD, DOWNWARD):
        return (
            "Raise navigator.slip_sigma. Check that the axes of the IMU point along the vehicle, and that it "
            "does not slip: aeroplanes and boats do."
        )
    return "Raise navigator.zero_velocity_sigma. Check that the vehicle stands still."
