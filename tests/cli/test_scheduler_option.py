"""--scheduler: a command whose runs are done by a cluster."""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path

import pytest
from asking import ask, refused
from clusters import scheduler, worker

from lab.experiment.ensembles.cluster import connected


@pytest.mark.proof
def test_a_scheduler_is_named_by_its_file_or_its_address(tmp_path: Path) -> None:
    arguments = "compare", "los_angeles", "--models", "phi", "--seeds", "9", "--set", "trajectory.imu_rate=50"
    many = "los_angeles", "--seeds", "9", "--set", "trajectory.imu_rate=50", "--json"
    over = "--over", "sensors.gps.period=1,2"
    with scheduler(tmp_path) as (_, file), worker(tmp_path, file):
        with connected(str(file)) as client:
            address = client.scheduler.address
        compared = [ask(*arguments, "--json", "--scheduler", place) for place in (str(file), address)]
        ensembles, sweeps, outages = [
            [ask(name, *many, *more, *where) for where in (("--scheduler", str(file)), ())]
            for name, more in (("ensemble", ()), ("sweep", over), ("outage", ("--seconds", "20")))
        ]
    for answer in (*compared, *ensembles, *sweeps, *outages):
        assert answer.exit_code == 0, (answer.stderr, traceback.format_exception(answer.exception))
    rows = [
        json.loads(answer.stdout)[0] | {"seconds": 0} for answer in (*compared, ask(*arguments, "--json"))
    ]
    assert rows[0] == rows[1] == rows[2]
    assert rows[0]["verdict"].startswith("Consistent")
    for pair in (ensembles, sweeps, outages):
        there, here = (json.loads(answer.stdout) | {"seconds": 0, "made": ""} for answer in pair)
        assert there == here


def test_a_file_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    answer = ask("compare", "los_angeles", "--scheduler", str(tmp_path / "none.json"))
    refused(answer, "--scheduler", "there is no such file; accepted is an address")


def test_dask_that_is_not_installed_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lab.experiment.ensembles.cluster", None)
    answer = ask("compare", "los_angeles", "--scheduler", "tcp://127.0.0.1:1")
    refused(answer, "--scheduler: needs Dask", 'pip install "ins-lab[cluster]"')
