"""Apart: how far two solutions of the same flight are from each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.analysis.errors import attitude_error, position_error
from lab.experiment.result import Result


def apart(one: Result, other: Result) -> NDArray[np.float64]:
    """Return how far position, velocity, attitude, biases and scale factors lie apart, in σ of the first."""
    a, b, truth = one.solution_arrays, other.solution_arrays, one.known_truth("truth")
    difference = np.concatenate(
        (
            position_error(a.position, truth) - position_error(b.position, truth),
            a.velocity_n - b.velocity_n,
            attitude_error(a.q_nb, b.q_nb),
            a.bias - b.bias,
            a.scale - b.scale,
        ),
        axis=1,
    )
    return np.asarray(np.abs(difference) / np.sqrt(a.variance))
