"""How fast a cluster on this computer is beside threads: two workers of one thread, and two threads."""

from __future__ import annotations

import time

import pytest
from distributed import Client, LocalCluster

from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment

pytestmark = pytest.mark.benchmark

RUNS = 64 * 64
"""Runs in each measurement: 64 blocks."""
LEAST = 0.9
"""Least ratio of the rates."""


def test_two_workers_are_nearly_as_fast_as_two_threads() -> None:
    """In turns, so that what else the computer does falls on both."""
    experiment, seconds = Experiment(mission="los_angeles"), {"threads": 0.0, "cluster": 0.0}
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        for first in (10, 100_000, 200_000):
            for name, how in (("threads", {"workers": 2}), ("cluster", {"client": client})):
                runs = 100 if first == 10 else RUNS  # the first ones load what the others need
                begin = time.perf_counter()
                run_ensemble(experiment, range(first, first + runs), **how)  # type: ignore[arg-type]
                seconds[name] += 0.0 if first == 10 else time.perf_counter() - begin
    rates = {name: 2 * RUNS / taken for name, taken in seconds.items()}
    ratio = rates["cluster"] / rates["threads"]
    print(
        f"\n{rates['threads']:.0f} runs/s on two threads, {rates['cluster']:.0f} on two workers: {ratio:.2f}"
    )
    assert ratio > LEAST
