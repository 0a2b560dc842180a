"""Ensembles: an experiment over many seeds, cached by its settings for all pages of this process."""

from __future__ import annotations

import os

from lab.cache import StageCache, digest
from lab.ensemble import Ensemble, Progress, run_ensemble
from lab.result import Result

KEPT = StageCache(limit=64 * 2**20)
"""Ensembles by the settings they were run with."""

WORKERS = max(1, (os.cpu_count() or 1) - 1)
"""Threads of an ensemble: one core is left for the runs of the sliders."""


def ensemble(result: Result, runs: int, progress: Progress) -> Ensemble:
    """Return runs of a result's experiment, with its seed and the following ones."""
    experiment = result.experiment
    key = digest(result.mission.content_hash, experiment.to_dict(), runs)
    return KEPT.get("ensemble", key, lambda: run_ensemble(experiment, runs, progress, workers=WORKERS))
