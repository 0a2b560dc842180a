"""Ensemble card: how often the averages are in their intervals, and what of the rest chance explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.experiment.ensembles.epoch_sums import EpochSums
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.views.ensemble_cards import describe_coverage


@pytest.mark.parametrize(
    ("high", "said"),
    [(0, "chance explains all (NEES) and all (NIS)"), (20, "chance explains 25 % (NEES) and all (NIS)")],
)
def test_a_sentence_says_what_share_of_the_fixes_outside_chance_explains(high: int, said: str) -> None:
    """Of a hundred fixes after 20 s, of which NEES is far above its interval at some."""
    time = np.arange(21.0, 121.0)
    nees, nis = np.full((2, 100), 15.0) * [[1.0], [0.4]]
    nees[:high] = 100.0
    sums = EpochSums()
    sums.add(time, {"nees": nees, "nis": nis})
    one = run_ensemble(Experiment(mission="los_angeles").update({"trajectory.imu_rate": 20.0}), 1)
    sentence = describe_coverage(replace(one, at_fixes=sums))
    assert f"interval at {100 - high} % (NEES) and 100 % (NIS) of the fixes" in sentence
    assert said in sentence
