"""Ensembles: an experiment over many seeds, cached by its settings for all pages of this process.

They run on threads here, or on the cluster of whoever serves; a visitor names none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dashboards.computing import SupersededError
from lab.base.cache import StageCache, digest
from lab.base.processors import processors
from lab.base.progress import Progress
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.ensembles.parcel import why_not
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.result import Result, Runnable

if TYPE_CHECKING:
    from distributed import Client

KEPT = StageCache(limit=192 * 2**20)
"""Ensembles by the settings they were run with; of a flight of three minutes, each takes 3 to 20 MB, most of
it evidence."""

WORKERS = max(1, processors() - 1)
"""Threads of an ensemble: one core is left for the runs of the sliders."""

_given: list[Client] = []
"""The cluster of the server of this process, if it has one."""


class _CutShortError(Exception):
    """An ensemble was cut short by the loss of the cluster: it is shown, and not kept."""


def use_cluster(client: Client | None) -> None:
    """Set the cluster on which the pages of this process run what has many runs; None for threads."""
    _given[:] = [] if client is None else [client]


def who_runs(experiment: Runnable) -> dict[str, Any]:
    """Return who runs an experiment many times, as options: the cluster, or the threads of this computer.

    These also run what cannot leave this process, and all when the cluster is lost.
    """
    usable = [client for client in _given if client.status == "running"]
    return {"client": usable[0]} if usable and not why_not(experiment) else {"workers": WORKERS}


def ensemble(
    result: Result, runs: int, progress: Progress, partial: Callable[[Ensemble], None] | None = None
) -> Ensemble:
    """Return runs of a result's experiment, with its seed and the following ones.

    `partial` is called with the runs that are done so far; see `run_ensemble`.
    """
    experiment = result.experiment
    key = digest(result.mission.content_hash, experiment.to_dict(), experiment.hidden, runs)

    def whole() -> Ensemble:
        found = run_ensemble(experiment, runs, progress, partial=partial, **who_runs(experiment))
        if found.ended:
            raise _CutShortError(found)
        return found

    while True:
        try:
            return KEPT.get("ensemble", key, whole)
        except _CutShortError as cut:
            found: Ensemble = cut.args[0]
            return found
        except SupersededError:  # perhaps of another page, for whose runs this one has waited
            progress("Running", 0.0)
