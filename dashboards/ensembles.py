"""Ensembles: an experiment over many seeds, cached by its settings for all pages of this process."""

from __future__ import annotations

from collections.abc import Callable

from dashboards.computing import SupersededError
from lab.base.cache import StageCache, digest
from lab.base.processors import processors
from lab.base.progress import Progress
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.result import Result

KEPT = StageCache(limit=192 * 2**20)
"""Ensembles by the settings they were run with; of a flight of three minutes, each takes 3 to 20 MB, most of
it evidence."""

WORKERS = max(1, processors() - 1)
"""Threads of an ensemble: one core is left for the runs of the sliders."""


def ensemble(
    result: Result, runs: int, progress: Progress, partial: Callable[[Ensemble], None] | None = None
) -> Ensemble:
    """Return runs of a result's experiment, with its seed and the following ones.

    `partial` is called with the runs that are done so far; see `run_ensemble`.
    """
    experiment = result.experiment
    key = digest(result.mission.content_hash, experiment.to_dict(), experiment.hidden, runs)
    while True:
        try:
            return KEPT.get(
                "ensemble",
                key,
                lambda: run_ensemble(experiment, runs, progress, workers=WORKERS, partial=partial),
            )
        except SupersededError:  # perhaps of another page, for whose runs this one has waited
            progress("Running", 0.0)
