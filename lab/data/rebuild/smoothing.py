"""Smoothing: the natural cubic spline that trades closeness to noisy samples against curvature.

Among all curves g the one with the least Σ (y − g(t))² + λ ∫ g''² dt, so that λ = 0 goes through the
samples and a large λ gives a straight line. With samples h apart it averages over about (λ h)^¼ seconds.

References
----------
P. J. Green, B. W. Silverman, *Nonparametric Regression and Generalized Linear Models*, 1994, ch. 2.3
(Reinsch's algorithm) and 3.2 (generalised cross-validation); M. F. Hutchinson, *A stochastic estimator of the
trace of the influence matrix*, Commun. Stat. 18 (1989).
"""

from __future__ import annotations

import itertools

import numpy as np
import scipy
from scipy.linalg import LinAlgError, solveh_banded

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError

LIVELINESS = 0.1
"""Density of the acceleration that coarse or noisy positions can show [(m/s²)²/Hz]."""

WIDEST_STEPS = 300.0
"""Largest width (λ/h)^¼ of a smoothing spline in steps h: beyond it its equations lose their digits."""
_EQUIVALENT_KERNEL = 0.0884
"""∫ ω² / (1 + ω⁴)² dω / 2π (Green & Silverman, ch. 3.7)."""
_WINDOWS = 6
"""Stretches of a long record by which its smoothing is chosen: its start, its end, and four between."""
_WINDOW = 1200
"""Samples of a stretch. A plain choice: six of them are quick to smooth 34 times."""
_PROBES = 8
"""Random sign vectors by which the trace is estimated (Hutchinson). A plain choice: each costs one
smoothing."""
_WIDTHS = 33
"""Widths tried, evenly in their logarithm: 10 to 20 % apart, while the minimum is flat."""
_NARROWEST = 0.3
"""Narrowest of them in steps: a narrower spline goes through the samples."""
_WIDEST = 3.0
"""Widest of them [s], so that no manoeuvre is smoothed away."""
_LEAST_WIDEST = 4.0
"""The same in steps at least, of slow recordings."""
_HARDLY_SMOOTHED = 1e-3
"""λ relative to the least tried that stands for none: exactly none leaves no residual to divide."""


def evaluate_smoothed(time: FloatArray, values: FloatArray, smoothing: float) -> FloatArray:
    """Return the values of the smoothing spline at the times of the samples (Green & Silverman 2.3.3).

    Parameters
    ----------
    time : (n,) array
        Increasing times, at least three [s].
    values : (n, m) array
        Samples of m quantities.
    smoothing
        λ [s³].

    Raises
    ------
    MissionError
        If the times are so uneven that the equations cannot be solved.
    """
    if not smoothing:
        return values
    step = np.diff(time)
    slopes = np.diff(values, axis=0) / step[:, None]
    bend = np.diff(slopes, axis=0)
    before, after = 1 / step[:-1], 1 / step[1:]
    middle = before + after
    banded = np.zeros((3, len(bend)))
    banded[2] = (step[:-1] + step[1:]) / 3 + smoothing * (before**2 + middle**2 + after**2)
    banded[1, 1:] = step[1:-1] / 6 - smoothing * after[:-1] * (middle[:-1] + middle[1:])
    banded[0, 2:] = smoothing * after[:-2] * before[2:]
    try:
        second = solveh_banded(banded, bend, check_finite=False)
    except LinAlgError as error:
        raise MissionError(
            "the samples lie too unevenly in time to be smoothed; accepted here is --set smoothing=none"
        ) from error
    jumps = np.diff(np.pad(second, ((1, 1), (0, 0))), axis=0) / step[:, None]
    return np.asarray(values - smoothing * np.diff(np.pad(jumps, ((1, 1), (0, 0))), axis=0))


def smoothing_spline(
    time: FloatArray, values: FloatArray, smoothing: float
) -> scipy.interpolate.CubicSpline[np.float64]:
    """Return the smoothing spline itself; for λ = 0 the not-a-knot spline through the samples.

    Parameters
    ----------
    time : (n,) array
        Increasing times, at least four [s].
    values : (n, m) array
        Samples of m quantities.
    smoothing
        λ [s³].

    Raises
    ------
    MissionError
        If the times are so uneven that the equations cannot be solved.
    """
    if not smoothing:
        return scipy.interpolate.CubicSpline(time, values)
    return scipy.interpolate.CubicSpline(time, evaluate_smoothed(time, values, smoothing), bc_type="natural")


def slope_noise(time: FloatArray, sigma: float, smoothing: float) -> float:
    """Return σ of the slope of a smoothing spline through samples with white noise of σ = `sigma`.

    By the equivalent kernel of bandwidth b = (λ h)^¼: σ² h / b³ ∫ ω² / (1 + ω⁴)² dω / 2π, the integral being
    0.0884 (Green & Silverman, ch. 3.7).

    Parameters
    ----------
    time : (n,) array
        Increasing times of the samples [s].
    sigma
        Their noise.
    smoothing
        λ [s³].
    """
    step = float(np.mean(np.diff(time)))
    return (
        sigma * float(np.sqrt(_EQUIVALENT_KERNEL * step / (smoothing * step) ** 0.75)) if smoothing else 0.0
    )


def best_smoothing(time: FloatArray, values: FloatArray) -> float:
    """Return the λ [s³] that predicts left-out samples best, zero where any smoothing makes it worse.

    Generalised cross-validation (Green & Silverman 3.2.2) with the trace estimated on random signs
    (Hutchinson), on a few stretches spread over long records. It supposes errors that are independent from
    sample to sample.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Samples of m quantities of the same unit.
    """
    windows = _windows(len(time))
    step = float(np.median(np.diff(time)))
    widths = step * np.geomspace(_NARROWEST, min(max(_WIDEST / step, _LEAST_WIDEST), WIDEST_STEPS), _WIDTHS)
    scores = []
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(_WINDOW, _PROBES))
    for width in (0.0, *widths):
        smoothing = width**4 / step
        left, freedom = 0.0, 0.0
        for window in windows:
            at, samples, probe = time[window], values[window], signs[: window.stop - window.start]
            both = np.column_stack((samples - samples.mean(axis=0), probe))
            rest = both - evaluate_smoothed(at, both, smoothing or _HARDLY_SMOOTHED * widths[0] ** 4 / step)
            left += float(np.sum(rest[:, : values.shape[1]] ** 2))
            freedom += float(np.sum(probe * rest[:, values.shape[1] :])) / _PROBES
        scores.append(left / max(freedom, 1e-9) ** 2)
    best = int(np.argmin(scores))
    return float(widths[best - 1] ** 4 / step) if best else 0.0


def smoothing_of_steps(time: FloatArray, values: FloatArray, step: float) -> float:
    """Return the λ [s³] that positions recorded in coarse steps need at least.

    Rounding to a step q has σ = q/√12. Samples closer together than the step have equal errors, which
    cross-validation takes for motion; so many count as one. λ is the variance over the density of the
    acceleration, `LIVELINESS`.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Positions [m].
    step
        The step they are recorded in [m].
    """
    apart = float(np.mean(np.linalg.norm(np.diff(values, axis=0), axis=1)))
    alike = max(1.0, step / apart) if apart > 0 else 1.0
    widest = WIDEST_STEPS**4 * float(np.mean(np.diff(time))) ** 3
    variance = step**2 / 12
    return min(variance * alike / LIVELINESS, widest)


def _windows(samples: int) -> list[slice]:
    """Return stretches of a long record to judge by, or the whole of a short one."""
    if samples <= _WINDOWS * _WINDOW:
        pieces = -(-samples // _WINDOW)
        edges = np.linspace(0, samples, pieces + 1).astype(int)
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
    starts = np.linspace(0, samples - _WINDOW, _WINDOWS).astype(int)
    return [slice(int(start), int(start) + _WINDOW) for start in starts]
