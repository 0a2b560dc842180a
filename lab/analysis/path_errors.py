"""Path errors: errors of a solution along its path, at the samples that an ensemble keeps.

A thousand runs with all samples would not fit into memory, so that errors over a whole flight are taken ten
times a second.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lab.analysis.errors import position_error
from lab.base.arrays import FloatArray
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.truth.trajectory import Truth

APART = 0.1
"""Time between two samples of the path [s]: errors change little in it, and the rms by 0.1 %."""


def path_of(time: FloatArray, period: float) -> NDArray[np.int64]:
    """Return the samples of the path.

    Errors jump at the fixes. So the number of samples from one to the next has no factor in common with that
    from fix to fix: the path then has as many samples soon after a fix as soon before one.

    Parameters
    ----------
    time : (n + 1,) array
        Times of the IMU samples [s].
    period
        Time between the fixes [s].
    """
    step = float(time[-1] - time[0]) / max(time.size - 1, 1)
    from_fix = max(1, round(period / step)) if step else 1
    apart = max(1, int(APART / step + 0.5)) if step else 1
    while math.gcd(apart, from_fix) > 1:
        apart -= 1
    return np.arange(0, time.size, apart)


def errors_of(position: FloatArray, velocity_n: FloatArray, q_nb: FloatArray, truth: Truth) -> FloatArray:
    """Return errors (m, 9) east, north, up [m], [m/s], and of roll, pitch, heading [°].

    Parameters
    ----------
    position, velocity_n, q_nb : (m, 3), (m, 3), (m, 4) arrays
        As of `Solution`.
    truth
        Truth at the same times.
    """
    return np.concatenate(
        (
            east_north_up(position_error(position, truth)),
            east_north_up(velocity_n - truth.velocity_n),
            np.degrees(wrap(euler_from_quaternion(q_nb) - truth.euler)),
        ),
        axis=1,
    )
