"""Cross checks: how good a navigation is where nobody knows the truth.

Fixes are withheld from the filter for some seconds, and compared with what it predicts meanwhile: they are
measured, but not used. The filter, which knows the past, is compared with the smoother, which knows the
future, too: the smoother's error is uncorrelated with what it changes, so the covariance of the difference is
that of the filter minus that of the smoother.

References
----------
A. Gelb (ed.), *Applied Optimal Estimation*, MIT Press (1974), chapter 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lab.analysis.errors import euler_sigma
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import OUTAGE, innovations_of_withheld, outages
from lab.analysis.verdicts.trial import Repeatable
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import wrap
from lab.navigation.filters.error_models import ATT, POS
from lab.sensors.gps import GpsFixes

SETTLING = 30.0
"""Time after the start in which no fixes are withheld [s]: initial errors would dominate."""
LARGEST_PART = 0.2
"""Largest fraction of a short run that is omitted for this."""
_ROUNDING = 1e-9
"""Of time stamps [s]."""


@dataclass(frozen=True)
class CrossChecks:
    """What a run tells of its own errors.

    Attributes
    ----------
    time : (n + 1,) array
        Times of the samples [s].
    fixes : GpsFixes
        The fixes.
    withheld, withheld_sigma : (m,) array
        Horizontal distance of each withheld fix from its prediction, and its σ [m]; NaN and 0 for the
        others.
    apart, apart_sigma : (n + 1,) array
        Horizontal distance of the filter's solution from the smoothed one, and its σ [m].
    turned, turned_sigma : (n + 1,) array
        The filter's heading minus the smoothed one, and its σ [°].
    problem : str
        Why there is no smoothed solution; empty if there is.
    """

    time: FloatArray
    fixes: GpsFixes
    withheld: FloatArray
    withheld_sigma: FloatArray
    apart: FloatArray
    apart_sigma: FloatArray
    turned: FloatArray
    turned_sigma: FloatArray
    problem: str


def cross_checks(run: Repeatable, progress: Progress) -> CrossChecks:
    """Return what a run tells of its own errors: of withheld fixes, and of the smoothed solution.

    This takes some four navigations.

    Parameters
    ----------
    run
        A run of a filter of the laboratory that is not long.
    progress
        Called with a phrase and the fraction done, from 0 to 1.
    """
    withheld, withheld_sigma = _predict_withheld_fixes(run, progress)
    progress("smoothing", 0.75)
    nothing, problem = np.full(run.time.shape, np.nan), ""
    between = nothing, nothing, nothing, nothing
    try:
        between = _forward_and_smoothed(run)
    except SettingError as error:
        problem = str(error)
    return CrossChecks(run.time, run.fixes, withheld, withheld_sigma, *between, problem)


def _predict_withheld_fixes(run: Repeatable, progress: Progress) -> tuple[FloatArray, FloatArray]:
    """Return the distances (m,) of withheld fixes from their predictions, and their σ [m]."""
    again = subject(run)
    first, last = again.span
    settled = first + min(SETTLING, LARGEST_PART * (last - first))
    size, sigma = np.full((2, again.stamps.size), np.nan)
    masks = outages(again.stamps, settled, last)
    for number, mask in enumerate(masks):
        progress(f"predicting fixes withheld for {OUTAGE:g} s", 0.75 * number / len(masks))
        seen = innovations_of_withheld(again, run.experiment, mask)
        size[mask] = np.hypot(*seen.innovation[mask, :2].T)
        sigma[mask] = np.sqrt(np.trace(seen.covariance[mask, :2, :2], axis1=1, axis2=2))
    rows = np.searchsorted(again.stamps - run.latency, run.fix_validity - _ROUNDING)
    size, sigma = size[rows], sigma[rows]
    sigma[~np.isfinite(size)] = 0
    return size, sigma


def _forward_and_smoothed(run: Repeatable) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return how far the filter's solution is from the smoothed one, in distance and heading, with σ each."""
    other = run.experiment.copy()
    other.navigator.smoother = not other.navigator.smoother
    again = run.repeated(other)
    forward, smoothed = (again, run) if run.experiment.navigator.smoother else (run, again)
    known, better = forward.solution_arrays, smoothed.solution_arrays
    # The better estimate has all data of the other: the variance of their difference is that between theirs.
    variance = np.maximum(known.variance - better.variance, 0)
    north, east, _down = displacement(better.position, known.position).T
    turned = np.degrees(wrap(forward.euler[:, 2] - smoothed.euler[:, 2]))
    sigma = euler_sigma(forward.euler, variance[:, ATT], known.covariance[:, 1] - better.covariance[:, 1])
    return (
        np.hypot(north, east),
        np.sqrt(variance[:, POS][:, :2].sum(axis=1)),
        turned,
        np.degrees(sigma[:, 2]),
    )
