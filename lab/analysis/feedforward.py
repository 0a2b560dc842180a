"""Feedforward: how far the free-running navigator of a feedforward filter is from the truth it estimates.

The filter's model is linear in the error of the free-running navigator, which is never corrected. Attitude
errors of a few degrees make the products it neglects, such as f φ² / 2, larger than its noise: then its
covariance is not that of its error.

References
----------
P. S. Maybeck, *Stochastic Models, Estimation, and Control*, vol. 1, ch. 6.4 (feedforward and feedback).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.analysis.errors import attitude_error
from lab.navigation.choice import chosen_model
from lab.navigation.navigator import PolarError, navigate
from lab.navigation.solution import Fixes, Imu, Schedule, Start

if TYPE_CHECKING:
    from lab.result import Result

LINEAR = np.radians(2.0)
"""Attitude error of the free-running navigator up to which the filter is linear enough: at 2° it neglects
6 mm/s² of the specific force, as much as the default accelerometer's turn-on bias [rad]."""


def drift(result: Result) -> float:
    """Return the largest attitude error of the free-running navigator, as estimated [rad].

    Zero of a filter that corrects its navigator, and of a user's algorithm.

    Parameters
    ----------
    result
        The run.
    """
    if result.algorithm or result.experiment.navigator.correction != "feedforward":
        return 0.0
    solution, nothing = result.solution_arrays, np.zeros((0, 3))
    start = Start(solution.position[0], solution.velocity_n[0], solution.q_nb[0], solution.bias[0, :3].copy())
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    alone = result.belief._replace(R=np.eye(6))
    try:
        model = chosen_model(result.experiment.navigator)
        none = Fixes(np.zeros(0), nothing, nothing)
        free = navigate(imu, none, start, alone, Schedule(feedback=False), model)
    except PolarError:  # it ran off to a pole
        return float(np.pi)
    return float(np.linalg.norm(attitude_error(free.q_nb, solution.q_nb), axis=1).max())
