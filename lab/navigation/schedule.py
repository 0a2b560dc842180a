"""Schedule: when a filter propagates, corrects and refuses, throughout or stretch by stretch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SLACK = 1e-6
"""Part of a sample by which the time of a fix may miss that of a sample: stamps are rounded."""


class Schedule(NamedTuple):
    """When a filter does what.

    Attributes
    ----------
    feedback : bool
        True corrects the navigator with the estimated error and resets the estimate; False lets the
        navigator run free and subtracts the estimate from what it puts out.
    correction_period : float
        Shortest time between two feedback corrections [s]; 0 corrects at each fix.
    stride : int
        P is propagated once in so many IMU samples, with the sum of F dt over them, and whenever a fix comes.
    gate : float
        Largest NIS of a fix that is used, a quantile of χ² with as many degrees of freedom as the fix has
        measurements; infinite uses all.
    robust : int
        How a fix is weighed: `kalman.EVERY`, `HUBER` or `STUDENT_T`.
    implausible : float
        NIS from which on fixes in a row accuse the filter; infinite if it uses every fix as it is.
    agreeing, any_of : int
        How many such fixes in a row accuse the filter: if their innovations agree, and if they do not.
    """

    feedback: bool = True
    correction_period: float = 0.0
    stride: int = 1
    gate: float = math.inf
    robust: int = 0
    implausible: float = math.inf
    agreeing: int = 4
    any_of: int = 10


class Stretch(NamedTuple):
    """Samples of a log for which the same holds.

    Attributes
    ----------
    end : int
        The sample it ends with.
    gate, implausible : float
        As of `Schedule`, for the measurements that the fixes in it have.
    noise : (12,) array
        As of `Belief`, with what is not known in a gap of the IMU.
    """

    end: int
    gate: float
    implausible: float
    noise: FloatArray


EVERY_FIX = Schedule()
"""Feedback at each fix, P propagated at each sample."""
