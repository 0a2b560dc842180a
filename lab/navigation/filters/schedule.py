"""Schedule: when a filter propagates, corrects and rejects, for the whole flight or by stretch."""

from __future__ import annotations

import math
from typing import NamedTuple

from lab.base.arrays import FloatArray

SLACK = 1e-6
"""Part of a sample by which the time of a fix may miss that of a sample: stamps are rounded."""


class Schedule(NamedTuple):
    """The schedule of a filter.

    Attributes
    ----------
    feedback : bool
        True corrects the navigator with the estimated error and resets the estimate. False lets the navigator
        run free and subtracts the estimate from its output.
    correction_period : float
        Shortest time between two feedback corrections [s]; 0 corrects at each fix.
    stride : int
        Number of IMU samples per propagation of P, with the sum of F dt over them; P is also propagated at
        each fix.
    gate : float
        Largest NIS of a fix that is used, a quantile of χ² with as many degrees of freedom as the fix has
        measurements; infinite uses all.
    robust : int
        Weight of a fix: `kalman.EVERY`, `HUBER` or `STUDENT_T`.
    implausible : float
        NIS above which consecutive fixes indicate a wrong filter; infinite if it uses every fix.
    agreeing, any_of : int
        Number of such consecutive fixes that indicate a wrong filter, if their innovations agree, and if they
        do not.
    aid_gate : float
        Largest NIS of one measurement of `aids` that is used.
    hold_heading : bool
        Whether fixes that show the heading at most by chance leave it as it is; see
        `heading_observability`.
    """

    feedback: bool = True
    correction_period: float = 0.0
    stride: int = 1
    gate: float = math.inf
    robust: int = 0
    implausible: float = math.inf
    agreeing: int = 4
    any_of: int = 10
    aid_gate: float = math.inf
    hold_heading: bool = True


class Stretch(NamedTuple):
    """Samples of a log with constant conditions.

    Attributes
    ----------
    end : int
        The last sample.
    gate, implausible : float
        As in `Schedule`, for the measurements of its fixes.
    noise : (12,) array
        As in `Belief`, with the unknown motion in a gap of the IMU.
    """

    end: int
    gate: float
    implausible: float
    noise: FloatArray


EVERY_FIX = Schedule()
"""Feedback at each fix, and propagation of P at each sample."""
