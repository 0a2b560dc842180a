"""Ensembles of the pages: who runs them, and what is kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from dashboards import ensembles
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Yield what stands for a client, given to the pages by whoever serves."""
    client = SimpleNamespace(status="running")
    ensembles.use_cluster(client)  # type: ignore[arg-type]
    yield client
    ensembles.use_cluster(None)


def test_the_cluster_of_the_server_runs_what_may_leave_it(cluster: Any) -> None:
    """A hidden fault may not; and threads run all once the cluster is lost."""
    threads, fault = {"workers": ensembles.WORKERS}, next(iter(FAULTS.values()))
    assert ensembles.who_runs(Experiment()) == {"client": cluster}
    assert ensembles.who_runs(FaultyExperiment(fault)) == threads
    cluster.status = "closed"
    assert ensembles.who_runs(Experiment()) == threads
    ensembles.use_cluster(None)
    assert ensembles.who_runs(Experiment()) == threads


def test_an_ensemble_that_was_cut_short_is_shown_and_not_kept(
    cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next one is run by threads."""
    result = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 20.0, "seed": 444}).run()
    asked: list[dict[str, Any]] = []

    def lost(*given: Any, client: Any = None, **options: Any) -> Any:
        asked.append({"client": client})
        found = run_ensemble(*given, **options)
        return found if client is None else replace(found, ended="The cluster was lost.")

    monkeypatch.setattr(ensembles, "run_ensemble", lost)
    first = ensembles.ensemble(result, 2, lambda _stage, _fraction: None)
    assert first.remark.startswith("The cluster was lost.")
    cluster.status = "closed"
    for _ in range(2):
        assert not ensembles.ensemble(result, 2, lambda _stage, _fraction: None).ended
    assert asked == [{"client": cluster}, {"client": None}]
