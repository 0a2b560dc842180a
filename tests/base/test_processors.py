"""Processors and memory: what a container may use of a computer, and how many runs at once that allows."""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lab import Experiment
from lab.base.processors import processors, system_text
from lab.experiment.ensembles import seeds, sweeping
from lab.experiment.ensembles.seeds import estimate_memory, run_ensemble, thread_count
from lab.run import memory


def in_groups(groups: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put this process into control groups whose files are in a folder."""
    own = Path("/proc/self/cgroup")
    shown = lambda path: groups if path == own else system_text(path)  # noqa: E731
    for module in ("lab.base.processors", "lab.run.memory"):
        monkeypatch.setattr(f"{module}.system_text", shown)
    monkeypatch.setattr("lab.base.processors.CONTROL_GROUPS", folder)


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("0::/lab/run\n", {"lab/cpu.max": "350000 100000", "lab/run/cpu.max": "max 100000"}, 4),
        ("0::/\n", {"cpu.max": "20000 100000\n"}, 1),
        (
            "5:cpu,cpuacct:/host\n",
            {"cpu/cpu.cfs_quota_us": "250000\n", "cpu/cpu.cfs_period_us": "100000\n"},
            3,
        ),
        ("5:cpu,cpuacct:/\n", {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 6),
        ("0::/\n", {"cpu.max": "what 0"}, 6),
        pytest.param(
            "0::/lab/a:b\n",
            {"lab/cpu.max": "350000 100000", "lab/a:b/cpu.max": "150000 100000"},
            2,
            marks=pytest.mark.skipif(sys.platform == "win32", reason="no colons in the names of files"),
        ),
        ("", {}, 6),
    ],
)
def test_a_container_has_its_share_of_the_processors(
    groups: str, files: dict[str, str], expected: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of 64 processors, of which the process is bound to six."""
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    in_groups(groups, tmp_path, monkeypatch)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: set(range(6)), raising=False)
    assert processors() == expected
    assert thread_count(None) == expected


@pytest.mark.parametrize(
    ("groups", "files"),
    [
        (
            "0::/lab/run\n",
            {
                "lab/memory.max": "3000",
                "lab/memory.current": "2500",
                "lab/memory.stat": "anon 1\ninactive_file 400\n",
                "lab/run/memory.max": "max",
                "lab/run/memory.current": "2000",
            },
        ),
        (
            "5:cpu,memory:/of/the/host\n",
            {
                "memory/memory.limit_in_bytes": "1000",
                "memory/memory.usage_in_bytes": "200",
                "memory/memory.stat": "total_inactive_file 100\n",
            },
        ),
    ],
)
def test_a_container_has_less(
    groups: str, files: dict[str, str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    in_groups(groups, tmp_path, monkeypatch)
    assert memory.available() == 900


@pytest.mark.parametrize(("there", "expected"), [(20_000_000_000, 4), (500_000_000, 2), (10_000_000, 1)])
def test_runs_at_once_fit_into_the_memory(there: int, expected: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 410,000 samples, with some 200 MB; a run that does not fit alone refuses that itself."""
    experiment = Experiment(mission="montreal").update({"trajectory.imu_rate": 2000.0})
    monkeypatch.setattr(memory, "available", lambda: there)
    needed = estimate_memory(experiment)
    assert needed == pytest.approx(0.19e9, rel=0.2)
    assert memory.at_once(needed, 4) == expected


def test_an_ensemble_and_a_sweep_run_as_many_at_once_as_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = Experiment(mission="montreal").update({"trajectory.imu_rate": 10.0})
    pools: list[int] = []

    class Pool(ThreadPoolExecutor):
        def __init__(self, threads: int, **given: str) -> None:
            pools.append(threads)
            super().__init__(threads, **given)  # type: ignore[arg-type]

    monkeypatch.setattr(seeds, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(sweeping, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(memory, "ALWAYS", 2**40)  # no single run is refused
    values = {"sensors.gyro.noise_density": [[0.01] * 3, [0.1] * 3]}
    for there in (memory.available(), int(2.5 * estimate_memory(experiment) / memory.SPARE)):
        monkeypatch.setattr(memory, "available", lambda there=there: there)
        run_ensemble(experiment, 2, workers=4)
        experiment.sweep(values, 1, workers=4)
    assert pools == [4, 4, 2, 2]


@pytest.mark.parametrize("values", [[21, 15], [15, 21]])
def test_the_largest_run_of_a_sweep_has_to_fit(values: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = Experiment(mission="montreal").update({"trajectory.imu_rate": 10.0})
    sizes = []
    monkeypatch.setattr(sweeping, "at_once", lambda needed, wanted: sizes.append(needed) or wanted)
    experiment.sweep({"navigator.states": values}, 1, workers=1)
    assert sizes == [estimate_memory(experiment.update({"navigator.states": 21}))]


def test_a_refused_run_needs_no_memory() -> None:
    experiment = Experiment(mission="montreal")
    experiment.mission = "nowhere"
    assert estimate_memory(experiment) == 0
