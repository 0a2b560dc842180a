"""Receiver drift: size and time of the slow position error of a receiver, from the innovations.

A first-order Gauss-Markov error is added to the white errors of the fixes, and the innovations have a
likelihood for each of its sizes and times (`hypotheses`). Over a time T far below the correlation time τ,
such an error is a random walk: the innovations then show σ²/τ well, and σ alone badly.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_causes import matrices
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.hypotheses import HYPOTHESES, Hypothesis
from lab.analysis.verdicts.innovation_evidence import Record
from lab.analysis.verdicts.likely_factor import likely_factor

TIMES = (10.0, 30.0, 100.0, 300.0)
"""Tried correlation times [s]: from the filter of a receiver to the atmosphere and the orbits, half a decade
apart."""
RATIOS = tuple(10.0 ** (half / 2) for half in range(-2, 5))
"""Tried variances relative to R: half decades, between which `likely_factor` interpolates."""
WHITE = (1.0, 0.5, 0.7, 1.4)
"""Tried factors on R of the position: an R that was fitted without the slow error contains a part of it,
which is a half at the most if the innovations are hardly larger than the white errors."""
MOST = 1000
"""Most fixes that are used, the first ones: about two seconds of computing time."""


class ReceiverDrift(NamedTuple):
    """A slow position error of a receiver.

    Attributes
    ----------
    sigma : float
        Its σ on each axis [m].
    time : float
        Its correlation time [s].
    white : float
        Factor on R of the position beside it.
    gain : float
        Gain in log-likelihood over white errors alone, minus the price of another R.
    """

    sigma: float
    time: float
    white: float
    gain: float


def likely_drift(record: Record, skipped: NDArray[np.bool_]) -> ReceiverDrift | None:
    """Return the most likely slow error; None if rounding does not let the likelihoods be computed.

    Parameters
    ----------
    record
        The fixes of a run whose filter has no state for such an error.
    skipped : (m,) array
        Mask of the fixes to leave out, such as outliers.
    """
    record, skipped = record.cut(MOST), skipped[:MOST]
    kinds = list(product(WHITE, TIMES))
    tried = [_drift(ratio, time, white) for white, time in kinds for ratio in RATIOS]
    try:
        gains = record.tried(skipped, [HYPOTHESES[0], *tried]).likelihoods[1:].reshape(len(kinds), -1)
    except np.linalg.LinAlgError:
        return None
    _, R = matrices(record.solution, record.belief, record.seen)
    position = float(np.mean(np.diagonal(R, axis1=1, axis2=2)[:, :3]))
    found = []
    for (white, time), own in zip(kinds, gains, strict=True):
        if np.isfinite(own).sum() > 1:
            likely = likely_factor(np.array(RATIOS), own)
            sigma = float(np.sqrt(position * likely.factor))
            price = limits.VERDICT.white_ratio if white != 1 else 0.0
            found.append(ReceiverDrift(sigma, time, white, likely.gain - price))
    return max(found, key=lambda one: one.gain, default=None)


def _drift(ratio: float, time: float, white: float) -> Hypothesis:
    r = (*(white,) * 3, *(1.0,) * 3)
    return Hypothesis("GPS correlation", ratio, r=r, correlated=(ratio, time))
