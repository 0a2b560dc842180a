"""Receiver drift: size and time of the slow position error of a receiver, from the innovations.

A first-order Gauss-Markov error is added to the white errors of the fixes, and the innovations have a
likelihood for each of its sizes and times (`hypotheses`). Over a time T far below the correlation time τ,
such an error is a random walk: the innovations then show σ²/τ well, and σ alone badly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_causes import matrices
from lab.analysis.hypotheses import HYPOTHESES, Hypothesis
from lab.analysis.innovation_evidence import Record
from lab.analysis.likely_factor import likely_factor

FloatArray = NDArray[np.float64]

TIMES = (10.0, 30.0, 100.0, 300.0)
"""Tried correlation times [s]: from the filter of a receiver to the atmosphere and the orbits, half a decade
apart."""
RATIOS = tuple(10.0 ** (half / 2) for half in range(-2, 5))
"""Tried variances relative to R: half decades, between which `likely_factor` interpolates."""
MOST = 1000
"""Most fixes that are used, the first ones: about a second of computing time."""


class ReceiverDrift(NamedTuple):
    """A slow position error of a receiver.

    Attributes
    ----------
    sigma : float
        Its σ on each axis [m].
    time : float
        Its correlation time [s].
    gain : float
        Gain in log-likelihood over white errors alone.
    """

    sigma: float
    time: float
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
    tried = [_drift(ratio, time) for time in TIMES for ratio in RATIOS]
    try:
        gains = record.tried(skipped, [HYPOTHESES[0], *tried]).likelihoods[1:].reshape(len(TIMES), -1)
    except np.linalg.LinAlgError:
        return None
    _, R = matrices(record.solution, record.belief, record.seen)
    position = float(np.mean(np.diagonal(R, axis1=1, axis2=2)[:, :3]))
    found = []
    for time, own in zip(TIMES, gains, strict=True):
        if np.isfinite(own).sum() > 1:
            likely = likely_factor(np.array(RATIOS), own)
            found.append(ReceiverDrift(float(np.sqrt(position * likely.factor)), time, likely.gain))
    return max(found, key=lambda one: one.gain, default=None)


def _drift(ratio: float, time: float) -> Hypothesis:
    return Hypothesis("GPS correlation", ratio, correlated=(ratio, time))
