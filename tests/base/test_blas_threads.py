"""BLAS threads: one within the lab's own work, and as many as before after it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from lab import Experiment
from lab.analysis import allan
from lab.analysis.verdicts import fix_evidence
from lab.base.blas_threads import OneBlasThread
from lab.experiment.ensembles.seeds import run_ensemble


def threads() -> set[int]:
    """Return the numbers of threads of all BLAS libraries."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def three() -> Iterator[None]:
    """Give BLAS three threads, whatever the machine has."""
    with threadpool_limits(3, user_api="blas"):
        if threads() != {3}:
            pytest.skip("the BLAS of this NumPy has a fixed number of threads")
        yield


def test_the_number_from_before_returns() -> None:
    with OneBlasThread():
        assert threads() == {1}
        with OneBlasThread():
            pass
        assert threads() == {1}
    assert threads() == {3}


def test_the_last_of_several_returns_it() -> None:
    """As of two computations in threads, of which the first ends first."""
    first, second = OneBlasThread(), OneBlasThread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert threads() == {1}
    second.__exit__(None, None, None)
    assert threads() == {3}


def test_an_error_returns_it() -> None:
    with pytest.raises(ZeroDivisionError), OneBlasThread():
        _ = 1 / 0
    assert threads() == {3}


def test_the_work_of_the_lab_takes_one(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    coloured, weighted = fix_evidence.coloured, allan._weighted

    def counting(function):  # type: ignore[no-untyped-def]
        return lambda *arguments: (seen.append(threads()), function(*arguments))[1]

    monkeypatch.setattr(fix_evidence, "coloured", counting(coloured))
    monkeypatch.setattr(allan, "_weighted", counting(weighted))
    experiment = Experiment(mission="montreal").update({"trajectory.imu_rate": 20.0})
    experiment.run().verdict  # noqa: B018 - made when asked for
    run_ensemble(experiment, 2)
    record = experiment.run().gyro.increments
    allan.fit(allan.deviation(record, 0.05, increments=True))
    assert len(seen) > 3
    assert all(found == {1} for found in seen)
    assert threads() == {3}


PROCESS = """
import numpy
from dashboards.computing import share_interpreter
from lab.base.blas_threads import OneBlasThread
with OneBlasThread():
    pass
import scipy.linalg
from threadpoolctl import threadpool_info
def threads():
    return sorted(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
with OneBlasThread():
    print(threads())
print(threads())
share_interpreter()
share_interpreter()
print(threads())
"""
LOADING = """
import numpy
from threadpoolctl import threadpool_info
from lab.base.blas_threads import OneBlasThread
def threads():
    return sorted(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
with OneBlasThread():
    import scipy.special
    with OneBlasThread():
        print(threads())
print(threads())
"""


def printed(code: str) -> list[set[int]]:
    """Return the numbers of threads that a process with two of them prints."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2", "MKL_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return [set(json.loads(line)) for line in done.stdout.splitlines()]


def test_libraries_that_are_loaded_later_count_too_and_a_server_keeps_one() -> None:
    assert printed(PROCESS) == [{1}, {2}, {1}]


def test_a_library_that_is_loaded_inside_counts_from_the_next_entry_on() -> None:
    assert printed(LOADING) == [{1}, {2}]
