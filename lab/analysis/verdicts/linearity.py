"""Linearity: how far the attitude errors of a filter are from those that its linear model holds for.

A linear filter neglects products of errors. The largest is that of attitude errors φ with themselves, which
the specific force f turns into an acceleration φ × (φ × f) / 2. Its mean is not zero, so it acts like a bias
of the accelerometers, which the filter believes to know.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import normalised_squares
from lab.analysis.fix_causes import MotionAtFixes, of_fixes
from lab.analysis.verdicts.sums import Kept, Sum
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT
from lab.navigation.solution import Belief, Solution


@dataclass(frozen=True)
class Linearity(Sum):
    """How far the attitude errors of a filter are from small, run by run.

    Attributes
    ----------
    start : (runs,) array
        Largest σ of the attitude at the start [rad].
    largest : (runs,) array
        The same of the whole flight.
    neglected : (runs,) array
        Mean square of the mean neglected acceleration in σ of the accelerometer biases, over the fixes.
    """

    start: Kept
    largest: Kept
    neglected: Kept


def linearity(solution: Solution, belief: Belief, motion: MotionAtFixes, seen: NDArray[np.intp]) -> Linearity:
    """Return how far the attitude errors of a run are from small.

    Parameters
    ----------
    solution, belief
        The solution of a filter, and its assumptions.
    motion
        Motion at the fixes `seen` (m,), used or not.
    """
    start = float(np.sqrt(np.diag(belief.P0)[ATT].max()))
    used = np.flatnonzero(solution.fix_sample[seen] >= 0)
    largest, neglected = start, 0.0
    if used.size and solution.fix_covariance.size:
        P = of_fixes(solution.fix_covariance, seen[used])
        about, force = P[:, ATT, ATT], motion.force_n[used]
        largest = max(start, float(np.sqrt(np.diagonal(about, axis1=1, axis2=2).max())))
        # The mean of φ × (φ × f) is (P − tr P) f.
        trace = np.trace(about, axis1=1, axis2=2)[:, None]
        mean_n = (np.einsum("mij,mj->mi", about, force) - trace * force) / 2
        mean_b = np.einsum("mji,mj->mi", motion.C_nb[used], mean_n)
        neglected = float(normalised_squares(mean_b, P[:, ACCEL_BIAS, ACCEL_BIAS]).mean())
    return Linearity(*(Kept(np.array([value])) for value in (start, largest, neglected)))
