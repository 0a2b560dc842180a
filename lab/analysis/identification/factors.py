"""Factors: one on R and one on Q, chosen by the prediction of withheld fixes.

They are a last resort if no sensor noise explains the innovations, such as with correlated errors of the
fixes or a flexible mounting. The choice is judged by other fixes than those used for it: for each set of
outages, the other sets make the choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from lab.analysis.identification.identification import HeldOut, predicts_better
from lab.analysis.identification.renavigation import Subject
from lab.analysis.identification.withheld import Predicted, judge_prediction, predict_withheld
from lab.base.arrays import Flags
from lab.run.experiment_settings import ExperimentSettings

# As for ON_Q, below.
ON_R = (1.0, 0.03, 0.1, 0.3, 3.0, 10.0, 30.0)
ON_Q = (1.0, 0.1, 10.0, 100.0, 1000.0, 10000.0)
"""Tried factors. On eight real sensor logs, the best factors of a grid were 0.1 to 30 for R and 0.1 to 10,000
for Q. Of equally good factors, the first one is kept: 1."""
GAINED = 0.5
"""Least part of the largest gain of the log-likelihood that a choice must have. On a drive of a minute, the
choices by the error among all pairs that gain anything failed in the other outages; with a half, all choose
the same factors."""
FEWEST = 3
"""Fewest sets of outages: with two sets, a few outages make each choice."""


class Factors(NamedTuple):
    """The chosen factors.

    Attributes
    ----------
    r, q : float
        Factors on R and Q of the filter.
    before, after : HeldOut
        Prediction of withheld fixes; `after` uses, for each set, the choice of the other sets.
    """

    r: float
    q: float
    before: HeldOut
    after: HeldOut


def scale_noise(experiment: ExperimentSettings, r: float, q: float) -> ExperimentSettings:
    """Return a copy of an experiment whose filter assumes more or less noise.

    Raises
    ------
    SettingError
        If a scale is out of bounds.
    """
    changed = experiment.copy()
    changed.set("navigator.r_scale", r * changed.navigator.r_scale)
    changed.set("navigator.q_scale", q * changed.navigator.q_scale)
    return changed


def choose(
    subject: Subject,
    experiment: ExperimentSettings,
    turns: Sequence[Flags],
    dropped: Flags,
    least: float = 0.0,
) -> Factors | None:
    """Return the factors that predict withheld fixes best; None if no factors are better than 1.

    Parameters
    ----------
    subject
        The run.
    experiment
        Settings of the run.
    turns
        Mask (m,) of the withheld fixes for each set of outages.
    dropped : (m,) array
        Mask of the outliers, which are ignored.
    least
        Smallest factor on R.
    """
    if len(turns) < FEWEST:
        return None
    tried = [pair for pair in product(ON_R, ON_Q) if pair[0] >= least and _allows_factors(experiment, *pair)]

    def predict_each_turn(pair: tuple[float, float]) -> list[Predicted] | None:
        changed = scale_noise(experiment, *pair)
        try:
            return [predict_withheld(subject, changed, mask, dropped) for mask in turns]
        except ValueError:  # a filter that diverges
            return None

    with ThreadPoolExecutor(max_workers=2) as pool:
        found = dict(zip(tried, pool.map(predict_each_turn, tried), strict=True))
    seen = {pair: parts for pair, parts in found.items() if parts is not None}
    if (1.0, 1.0) not in seen:
        return None
    # Each set is predicted with the choice of the others: no factor is judged by what chose it.
    after = judge_prediction([seen[_best_pair(_drop_turn(seen, turn))][turn] for turn in range(len(turns))])
    r, q = _best_pair(seen)
    chosen = Factors(r, q, judge_prediction(seen[1.0, 1.0]), after)
    return chosen if predicts_better(chosen.before, chosen.after) else None


def _allows_factors(experiment: ExperimentSettings, r: float, q: float) -> bool:
    navigator = experiment.navigator
    bounds = (navigator.param[name].bounds for name in ("r_scale", "q_scale"))
    values = (r * navigator.r_scale, q * navigator.q_scale)
    return all(low <= value <= high for value, (low, high) in zip(values, bounds, strict=True))


def _drop_turn(
    seen: dict[tuple[float, float], list[Predicted]], turn: int
) -> dict[tuple[float, float], list[Predicted]]:
    return {pair: parts[:turn] + parts[turn + 1 :] for pair, parts in seen.items()}


def _best_pair(seen: dict[tuple[float, float], list[Predicted]]) -> tuple[float, float]:
    """Return the pair with the smallest error, among those that gain a good part of the likelihood.

    The error alone would prefer filters that are too sure of themselves, whose predictions fail elsewhere.
    """
    judgements = {pair: judge_prediction(parts) for pair, parts in seen.items()}
    now = judgements[1.0, 1.0].log_likelihood
    most = float(np.nanmax([one.log_likelihood for one in judgements.values()]))
    least = now + GAINED * (most - now)
    fine = {pair: _error(one) for pair, one in judgements.items() if one.log_likelihood >= least}
    return min(fine, key=lambda pair: fine[pair])


def _error(one: HeldOut) -> float:
    """Return the error of the positions [m]; for a log without positions, that of the velocities [m/s]."""
    return one.position_error if np.isfinite(one.position_error) else one.velocity_error
