"""Spread: deviations of the innovations from a Gaussian with the covariance that the filter states."""

from __future__ import annotations

import numpy as np
from scipy import special

from lab.analysis.identification.likelihood import InnovationSeries, squares
from lab.navigation.filters.error_models import STATES

BY_CHANCE = 1e-3
"""Significance level of a difference between the halves of a log, and of the size of the innovations: chance
shows each in one log in 1,000. A convention."""
HEAVY = 6.0
"""Kurtosis of a channel above which its tails count as heavy: a Gaussian has 3, a Laplace density 6."""
FEWEST = 20
"""Fewest values for a useful kurtosis: its σ is √(24 / n)."""

CHANNELS = STATES[:6]
"""Position and velocity, the parts of a fix."""


def describe_spread(seen: InnovationSeries) -> str:
    """Return a sentence about the spread of innovations; empty if nothing is wrong.

    Parameters
    ----------
    seen
        The innovations, in the order of time.
    """
    return _describe_halves(seen) or _tails(seen) or _size(seen)


def _describe_halves(seen: InnovationSeries) -> str:
    """Return whether NIS is larger in one half of the log than in the other."""
    nis, degrees = squares(seen)
    middle = nis.size // 2
    parts = [
        (float(nis[half].sum()), int(degrees[half].sum())) for half in (slice(middle), slice(middle, None))
    ]
    if min(count for _, count in parts) < FEWEST:
        return ""
    first, second = (total / count for total, count in parts)
    larger, smaller = (0, 1) if first > second else (1, 0)
    ratio = max(first, second) / max(min(first, second), 1e-12)
    if 2 * special.fdtrc(parts[larger][1], parts[smaller][1], ratio) > BY_CHANCE:
        return ""
    return (
        f"The noise is not constant: NIS per degree of freedom is {first:.2g} in the first half of the log "
        f"and {second:.2g} in the second. No single R and Q fit both."
    )


def _tails(seen: InnovationSeries) -> str:
    """Return whether a channel has a few innovations that are far larger than the rest."""
    normalised = seen.innovation / np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    heaviest, where = 0.0, ""
    for name, channel in zip(CHANNELS, normalised.T, strict=True):
        known = channel[np.isfinite(channel)]
        if known.size < FEWEST:
            continue
        kurtosis = float(np.mean(known**4) / max(float(np.mean(known**2)) ** 2, 1e-300))
        if kurtosis > heaviest:
            heaviest, where = kurtosis, name
    if heaviest < HEAVY:
        return ""
    return (
        f"A few innovations are far larger than the rest: the kurtosis of {where} is {heaviest:.2g}, that of "
        "Gaussian ones is 3."
    )


def _size(seen: InnovationSeries) -> str:
    """Return whether all innovations are larger or smaller than the filter states."""
    nis, degrees = squares(seen)
    count = int(degrees.sum())
    if not count:
        return ""
    mean = float(nis.sum()) / count
    if min(special.chdtr(count, mean * count), special.chdtrc(count, mean * count)) > BY_CHANCE / 2:
        return ""
    word = "larger" if mean > 1 else "smaller"
    return f"The innovations are {word} than the filter states: NIS per degree of freedom is {mean:.2g}."
