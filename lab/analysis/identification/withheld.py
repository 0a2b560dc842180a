"""Withheld fixes: their choice, and the accuracy of their prediction."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.identification.identification import HeldOut
from lab.analysis.identification.likelihood import InnovationSeries, log_likelihoods, squares
from lab.analysis.identification.renavigation import Subject
from lab.base.arrays import Flags, FloatArray
from lab.run.experiment_settings import ExperimentSettings

OUTAGE, EVERY, TURNS = 10.0, 60.0, 3
"""Length of the outages for the test of the prediction, time from one to the next [s], and number of sets of
outages at different times."""


def outages(stamps: FloatArray, start: float, end: float, shift: float = 0.0) -> list[Flags]:
    """Return the mask of the withheld fixes for each set of outages.

    Parameters
    ----------
    stamps : (m,) array
        Time stamps of all fixes [s].
    start, end
        Start and end of the part of the run in which fixes are withheld [s].
    shift
        Delay of the outages of the first set [s].
    """
    since = stamps - start - shift
    masks = []
    for turn in range(TURNS):
        within = np.mod(since - turn * EVERY / TURNS, EVERY) < OUTAGE
        masks.append((since >= turn * EVERY / TURNS) & within & (stamps <= end))
    return [mask for mask in masks if mask.any()]


def innovations_of_withheld(
    subject: Subject, experiment: ExperimentSettings, withheld: Flags
) -> InnovationSeries:
    """Return the innovations of all fixes, where those of a set are withheld, with their H P Hᵀ + R."""
    settings = experiment.copy()
    settings.navigator.smoother, settings.navigator.engine = False, "compiled"
    return subject.navigate(settings, withheld)[1]


class Predicted(NamedTuple):
    """Innovations of the fixes of one set that are no outliers, and the number of the outage of each (m,)."""

    seen: InnovationSeries
    outage: NDArray[np.int64]


def predict_withheld(
    subject: Subject, experiment: ExperimentSettings, withheld: Flags, dropped: Flags
) -> Predicted:
    """Return the innovations of the fixes withheld in one set, without outliers (`dropped`)."""
    seen = innovations_of_withheld(subject, experiment, withheld)
    known = withheld & ~dropped & np.isfinite(seen.innovation).any(axis=1)
    outage = np.cumsum(np.diff(withheld.astype(np.int64), prepend=0) > 0, dtype=np.int64)
    return Predicted(InnovationSeries(seen.innovation[known], seen.covariance[known]), outage[known])


def held_out(
    subject: Subject, experiment: ExperimentSettings, masks: Sequence[Flags], dropped: Flags
) -> HeldOut:
    """Return the accuracy of a filter's prediction of the fixes of all sets."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        return judge_prediction(
            list(pool.map(lambda mask: predict_withheld(subject, experiment, mask, dropped), masks))
        )


def judge_prediction(parts: Sequence[Predicted]) -> HeldOut:
    """Return the accuracy of the prediction."""
    seen = InnovationSeries(
        *(np.concatenate(arrays) for arrays in zip(*(part.seen for part in parts), strict=True))
    )
    nis, degrees = squares(seen)
    position, velocity = (
        float(np.sqrt(np.mean(np.nansum(block**2, axis=1)))) if np.isfinite(block).any() else float("nan")
        for block in (seen.innovation[:, :3], seen.innovation[:, 3:])
    )
    return HeldOut(
        seen.innovation.shape[0],
        position,
        velocity,
        float(np.sqrt(nis.sum() / max(1, int(degrees.sum())))),
        float(log_likelihoods(seen).mean()),
        tuple(chain.from_iterable(map(_by_outage, parts))),
    )


def _by_outage(part: Predicted) -> list[float]:
    """Return the mean square error of the positions in each outage of a set that has any [m²]."""
    square = np.sum(part.seen.innovation[:, :3] ** 2, axis=1)
    known = np.isfinite(square)
    return [float(square[known & (part.outage == one)].mean()) for one in np.unique(part.outage[known])]
