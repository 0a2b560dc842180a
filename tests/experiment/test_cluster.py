"""Clusters: runs on other processes are those of threads; what is lost costs no more than it must."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from clusters import PATIENCE, ROOT, scheduler, wait_for, worker
from distributed import Client, LocalCluster
from nbclient import NotebookClient

import lab.experiment.ensembles.seeds as seeds_module
from lab import Experiment, compare, run_ensemble
from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import StoppedError
from lab.experiment.ensembles import cluster as cluster_module
from lab.experiment.ensembles import outages as outages_module
from lab.experiment.ensembles import parcel as parcel_module
from lab.experiment.ensembles import sweeping
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.ensembles.parcel import MissionFiles, Parcel, VersionError
from lab.experiment.ensembles.sweeping import sweep
from lab.missions import mission
from lab.navigation.algorithm import load_algorithm
from lab.navigation.filters.user_states import _DECLARED, declare_states
from tests.simulated_logs import log_of

SEEDS = 40
OVER = {"sensors.gyro.noise_density": [0.01, 0.02, 0.05]}


def short(**changes: object) -> Experiment:
    """Return an experiment with short runs."""
    return Experiment(mission="los_angeles").update({"trajectory.imu_rate": 50.0, **changes})


def assert_same(one: Ensemble, other: Ensemble) -> None:
    """Compare ensembles to the bit."""
    assert one.seeds == other.seeds
    assert one.errors.identical(other.errors)
    assert one.consistency.identical(other.consistency)
    assert one.coverage.equals(other.coverage)
    assert one.whiteness.equals(other.whiteness)
    for name in ("rms", "largest", "most", "at_outage_ends", "mean_nees", "mean_nis"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
    assert one.verdict == other.verdict
    assert one.verdicts == other.verdicts
    assert one.innovation_verdict == other.innovation_verdict


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Client]:
    """Yield a client of two workers with one thread each, in processes of their own."""
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as found,
        Client(found, set_as_default=False) as client,
    ):
        yield client


def test_many_runs_on_two_processes_are_those_of_threads(two_workers: Client, tmp_path: Path) -> None:
    """Of a flight that only this process knows; and what is refused."""
    recording = tmp_path / "mine.csv.gz"
    recording.write_bytes(mission("los_angeles").recording_path.read_bytes())
    experiment = short(mission=str(recording))
    told: list[tuple[str, float]] = []
    there = run_ensemble(experiment, 20, lambda *step: told.append(step), client=two_workers)
    assert_same(there, run_ensemble(experiment, 20))
    assert not there.ended
    assert told[0] == ("Preparing 2 workers", 0.0)
    assert told[-1] == ("20 of 20 runs", 1.0)
    with pytest.raises(ValueError, match="workers: 2 is for threads of this computer"):
        run_ensemble(experiment, 20, workers=2, client=two_workers)
    with pytest.raises(ValueError, match=r"client: 'tcp://x' is of type str; accepted is a client"):
        experiment.sweep(OVER, 3, client="tcp://x")  # type: ignore[arg-type]


@pytest.mark.proof
def test_a_sweep_on_two_processes_is_that_of_threads(two_workers: Client) -> None:
    experiment = short()
    swept = experiment.sweep(OVER, 3, client=two_workers)
    sweeping.KEPT.clear()
    assert swept.dataset.identical(experiment.sweep(OVER, 3).dataset)
    assert swept.refused == ()
    again = experiment.sweep(OVER, 4, client=two_workers)  # three of four are kept
    assert again.dataset.isel(seed=slice(3)).identical(swept.dataset)


@pytest.mark.proof
def test_a_sweep_whose_first_value_is_done_goes_on_at_the_second(two_workers: Client) -> None:
    experiment = short(seed=31)
    (name, values), *_ = OVER.items()
    kept = experiment.sweep({name: values[:1]}, 3)
    both = experiment.sweep({name: values[:2]}, 3, client=two_workers)
    assert both.dataset.isel({name.rpartition(".")[2]: [0]}).identical(kept.dataset)
    assert both.refused == ()


@pytest.mark.proof
def test_outages_on_two_processes_are_those_of_threads(two_workers: Client) -> None:
    """With and without a perfect filter beside that of the row; what the lab refuses is a row's reason."""
    experiment, told = short(**{"navigator.q_scale": 0.1}), list[tuple[str, float]]()
    asked: dict[str, Any] = {"seconds": 10, "seeds": 17, "wish": 5.0}
    there = experiment.outage(**asked, client=two_workers, progress=lambda *step: told.append(step))
    outages_module.KEPT.clear()
    here = experiment.outage(**asked)
    assert there.dataset.identical(here.dataset)
    assert there.to_dict() == here.to_dict()
    assert there.rows[0].perfect != here.rows[0].most
    assert told[0] == ("Preparing 2 workers", 0.0)
    assert told[-1][1] == 1.0
    refused = short(**{"navigator.smoother": True, "navigator.model": "nonlinear"})
    with pytest.raises(SettingError, match=r"navigator\.smoother"):
        refused.outage(seconds=10, seeds=2, client=two_workers)
    with pytest.raises(ValueError, match="workers: 2 is for threads of this computer"):
        experiment.outage(seconds=10, seeds=2, workers=2, client=two_workers)


def test_a_piece_of_work_raises_what_it_would_raise_here(two_workers: Client) -> None:
    rows = compare(short(**{"navigator.smoother": True}), ["phi", "nonlinear"], 2, client=two_workers)
    assert rows[0].refusal == ""
    assert 0 < rows[0].seconds < 5
    with pytest.raises(SettingError, match=re.escape(rows[1].refusal)):
        short(**{"navigator.smoother": True, "navigator.model": "nonlinear"}).run()


def test_blocks_depend_on_nothing_but_the_number_of_runs() -> None:
    for count in (1, 7, 8, 9, 100, 256, 257, 1000, 4096, 4097, 10_000, 10**6):
        blocks = seeds_module.blocks(count)
        assert [place for block in blocks for place in (block.start, block.stop)][1:-1:2] == [
            block.start for block in blocks[1:]
        ]
        assert (blocks[0].start, blocks[-1].stop) == (0, count)
        sizes = {len(block) for block in blocks[:-1]} or {8}
        assert len(sizes) == 1
        assert sizes == {8} if count <= 256 else sizes <= set(range(64, 257, 8))


@pytest.mark.proof
def test_one_two_and_four_workers_give_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Abreast and alone; also one worker with two threads."""
    monkeypatch.setattr(seeds_module, "FEW", 20)
    monkeypatch.setattr(seeds_module, "MANY", 20)
    abreast, alone = short(), short(**{"navigator.smoother": True})
    here = run_ensemble(abreast, SEEDS), run_ensemble(alone, 12)
    for workers, threads in ((1, 1), (2, 1), (4, 1), (1, 2)):
        with (
            LocalCluster(n_workers=workers, threads_per_worker=threads, dashboard_address=":0") as found,
            Client(found, set_as_default=False) as client,
        ):
            assert_same(run_ensemble(abreast, SEEDS, client=client), here[0])
            assert_same(run_ensemble(alone, 12, client=client), here[1])


@contextlib.contextmanager
def connected(file: Path, workers: int) -> Iterator[Client]:
    """Yield a client of a scheduler once its workers are there."""
    with cluster_module.connected(str(file)) as client:
        client.wait_for_workers(workers, timeout=PATIENCE)
        yield client


@pytest.mark.proof
def test_a_killed_worker_costs_its_block_only(tmp_path: Path) -> None:
    killed: list[str] = []

    def kill(step: str, _fraction: float) -> None:
        if "of 64" in step and not killed:
            killed.append(step)
            victim.kill()

    with (
        scheduler(tmp_path) as (_, file),
        worker(tmp_path, file),
        worker(tmp_path, file) as victim,
        connected(file, 2) as client,
    ):
        found = run_ensemble(short(), 64, kill, client=client)
        assert killed
        assert len(client.nthreads()) == 1
    assert not found.ended
    assert_same(found, run_ensemble(short(), 64))


@pytest.mark.proof
def test_a_lost_scheduler_ends_with_what_is_done(tmp_path: Path) -> None:
    """What is asked next of the same client is refused."""

    def kill(_step: str, fraction: float) -> None:
        if fraction > 0:
            process.kill()

    with (
        scheduler(tmp_path) as (process, file),
        worker(tmp_path, file),
        connected(file, 1) as client,
    ):
        began = time.monotonic()
        found = run_ensemble(short(), 64, kill, client=client)
        assert time.monotonic() - began < PATIENCE
        assert 8 <= len(found.seeds) < 64
        assert found.remark.startswith("The connection to the cluster was lost")
        assert found.verdict.headline
        assert "lost" in repr(found)
        with pytest.raises(ValueError, match=r"client: is c\w+, and not connected"):
            run_ensemble(short(), 3, client=client)


@pytest.mark.proof
def test_a_sweep_whose_scheduler_is_lost_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if there is more to be sent."""
    monkeypatch.setattr(cluster_module, "AHEAD", 2)
    monkeypatch.setattr(cluster_module, "AHEAD_OF_EACH", 2)

    def kill(_step: str, fraction: float) -> None:
        if fraction > 0:
            process.kill()

    sweeping.KEPT.clear()
    with (
        scheduler(tmp_path) as (process, file),
        worker(tmp_path, file),
        connected(file, 1) as client,
    ):
        part = short().sweep(OVER, 20, kill, client=client)
    missing = np.isnan(part.dataset["rms"].values[..., 0])
    assert 0 < missing.mean() < 1
    assert part.refused == (f"{missing.sum()} of 60 runs: {cluster_module.LOST}",)
    whole = short().sweep(OVER, 20)
    assert sweeping.KEPT.computed["run"] == 60
    assert np.array_equal(whole.dataset["rms"].values[~missing], part.dataset["rms"].values[~missing])


@pytest.mark.proof
@pytest.mark.parametrize("other", ["package", "lab"])
def test_another_version_is_refused_before_work_starts(other: str, tmp_path: Path) -> None:
    """Of a package, and of the lab: one that says the same of itself, and has other lines."""
    folder = tmp_path / "other"
    if other == "package":
        (folder / "numba-0.1.dist-info").mkdir(parents=True)
        metadata = "Metadata-Version: 2.1\nName: numba\nVersion: 0.1\n"
        (folder / "numba-0.1.dist-info/METADATA").write_text(metadata, "utf-8")
    else:
        shutil.copytree(ROOT / "lab", folder / "lab", ignore=shutil.ignore_patterns("__pycache__"))
        with (folder / "lab/base/arrays.py").open("a", encoding="utf-8") as file:
            file.write("ANOTHER = 1\n")
    words = {"package": r"numba 0\.1 in place of \d", "lab": r"source of the lab \w+ in place of \w"}[other]
    told: list[str] = []
    paths = os.pathsep.join((str(folder), str(ROOT)))
    with (
        scheduler(tmp_path) as (_, place),
        worker(tmp_path, place, {"PYTHONPATH": paths}),
        connected(place, 1) as client,
        pytest.raises(VersionError, match=f"client: the worker tcp://.* has {words}.*; accepted are"),
    ):
        run_ensemble(short(), 8, lambda step, _done: told.append(step), client=client)
    assert not any("of 8" in step for step in told)


@pytest.mark.proof
@pytest.mark.skipif(sys.platform == "win32", reason="a signal to one's own process ends it on Windows")
def test_an_interrupt_cancels_what_is_left(two_workers: Client) -> None:
    def interrupt(step: str, fraction: float) -> None:
        if fraction > 0:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # another test may have set its own
    try:
        with pytest.raises(KeyboardInterrupt):
            run_ensemble(short(seed=900), 200, interrupt, client=two_workers)
    finally:
        signal.signal(signal.SIGINT, before)

    def left(dask_scheduler: Any) -> list[str]:
        plugins = [name for name in dask_scheduler.worker_plugins if "ins-lab" in name]
        return [*dask_scheduler.tasks, *plugins]

    wait_for(lambda: not two_workers.run_on_scheduler(left))
    assert len(run_ensemble(short(), 8, client=two_workers).seeds) == 8


@pytest.mark.proof
def test_cancelled_work_is_what_was_done(two_workers: Client) -> None:
    """As `ins-lab ensemble` and `ins-lab sweep` do on Ctrl-C."""
    told: list[float] = []
    found = run_ensemble(
        short(seed=300),
        200,
        lambda _step, fraction: told.append(fraction),
        client=two_workers,
        cancelled=lambda: any(told),
    )
    assert 8 <= len(found.seeds) < 200
    assert list(found.seeds) == sorted(set(range(300, 500)) & set(found.seeds))
    assert not found.ended
    with pytest.raises(StoppedError, match="stopped before the first of 200 runs"):
        run_ensemble(short(seed=600), 200, client=two_workers, cancelled=lambda: True)
    with pytest.raises(StoppedError, match="stopped before the first of 9 runs"):
        sweep(short(seed=600), OVER, 3, None, None, client=two_workers, cancelled=lambda: True)


DEADLY = """
import os

class Deadly:
    def navigate(self, imu, fixes, start):
        os._exit(1)
"""


@pytest.mark.proof
def test_runs_that_end_every_worker_end_the_work_with_a_sentence(two_workers: Client, tmp_path: Path) -> None:
    """The nannies start other workers, and these do other work."""
    (tmp_path / "deadly.py").write_text(DEADLY, "utf-8")
    deadly = load_algorithm(f"{tmp_path / 'deadly.py'}:Deadly")
    with pytest.raises(ValueError, match=r"^4 workers of the cluster ended in the middle of the same runs"):
        run_ensemble(short(), 2, client=two_workers, algorithm=deadly)
    assert len(run_ensemble(short(), 2, client=two_workers).seeds) == 2


NOTEBOOK = (
    """
import numpy as np
from distributed import Client, LocalCluster
from lab import Experiment, Estimate, run_ensemble
experiment = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 50.0})
cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
client = Client(cluster)
""",
    """
SIGMA = np.full(9, 20.0)

def held(fixes, imu):
    last = np.searchsorted(fixes.time, imu.time, side="right") - 1
    return np.maximum(last, 0)

class LastFix:
    def __init__(self, factor=1.0):
        self.factor = factor

    def navigate(self, imu, fixes, start) -> Estimate:
        at = held(fixes, imu)
        n = imu.time.size
        return Estimate(fixes.position[at].copy(), fixes.velocity_n[at].copy(), np.tile(start.q_nb, (n, 1)),
                        np.tile(self.factor * SIGMA, (n, 1)))
""",
    """
mine = LastFix(2.0)
there = run_ensemble(experiment, 12, algorithm=mine, client=client)
here = run_ensemble(experiment, 12, algorithm=mine)
assert np.array_equal(there.rms, here.rms) and there.errors.identical(here.errors), "not the same"
plain = run_ensemble(experiment, 12, client=client)
assert plain.errors.identical(run_ensemble(experiment, 12).errors)
mine.log = open("some.txt", "w")
try:
    run_ensemble(experiment, 12, algorithm=mine, client=client)
except ValueError as error:
    print("refused:", error)
client.close(); cluster.close()
""",
)


@pytest.mark.proof
def test_a_notebook_with_a_client_and_an_algorithm_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in NOTEBOOK])
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    printed = "".join(one.get("text", "") for one in notebook.cells[-1].outputs)
    assert "refused: LastFix: its attribute log is of type TextIOWrapper and cannot travel" in printed


@pytest.mark.proof
def test_the_log_of_a_vehicle_travels_with_its_files(two_workers: Client, tmp_path: Path) -> None:
    experiment = log_of(short().run(), tmp_path / "log")
    there, here = run_ensemble(experiment, 1, client=two_workers), run_ensemble(experiment, 1)
    assert_same(there, here)


JOB = """
from dask_jobqueue import SLURMCluster

if __name__ == "__main__":
    with SLURMCluster({}) as cluster:
        print(cluster.job_script())
"""


@pytest.mark.proof
def test_the_job_of_slurm_in_the_document_starts_workers(tmp_path: Path) -> None:
    """In a process of its own: the package takes Ctrl-C for itself where it is imported."""
    call = re.search(r"`cluster = SLURMCluster\((.*)\)`", (ROOT / "docs/cluster.md").read_text("utf-8"))
    assert call
    (tmp_path / "job.py").write_text(JOB.format(call[1]), "utf-8")
    how: dict[str, Any] = {"cwd": tmp_path, "capture_output": True, "text": True, "timeout": 120}
    made = subprocess.run([sys.executable, "job.py"], check=False, **how)
    assert "#SBATCH --cpus-per-task=8" in made.stdout, made.stderr
    assert re.search(r"tcp://\S+ .*--nthreads 1 .*--nworkers 8 ", made.stdout)


def test_the_files_of_a_mission_arrive_as_they_were_or_are_refused(tmp_path: Path) -> None:
    log = log_of(short().run(), tmp_path / "log", 'title = "Mine"\nlatency_s = 0.1\n')
    for name in ("los_angeles", log.mission, str(Path(log.mission) / "log.toml")):
        sent = MissionFiles.of(name)
        place = sent.written(tmp_path / "there")
        assert Path(place).is_relative_to(tmp_path / "there")
        assert mission(place).content_hash == mission(name).content_hash
    name, content = next(iter(sent.contents.items()))
    outside = sent._replace(contents={f"../../{name}": content, **sent.contents}, content_hash="x")
    with pytest.raises(MissionError, match="its files changed while they were sent"):
        outside.written(tmp_path / "there")
    assert not (tmp_path / name).exists()


def test_what_cannot_leave_this_process_is_refused_in_words() -> None:
    def asymmetry(rate: Any, force: Any, effect: Any) -> None:
        effect[2, 0] = abs(rate[2])

    declare_states("asymmetry", ["asymmetry z"], asymmetry, sigma=0.003)
    try:
        with pytest.raises(SettingError, match="own_states = 'asymmetry': states that are declared"):
            Parcel.of([short(**{"navigator.own_states": "asymmetry"})])
    finally:
        _DECLARED.clear()

    class Hidden(Experiment):
        pass

    with pytest.raises(SettingError, match="something is hidden in this experiment"):
        Parcel.of([Hidden()])


def test_a_parcel_is_refused_by_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent = Parcel.of([short()])
    assert sent.digest == Parcel.of([short()]).digest != Parcel.of([short(seed=2)]).digest
    assert sent.unpack(tmp_path) is sent.unpack(tmp_path)
    monkeypatch.setattr(parcel_module, "versions", lambda: {**sent.versions, "numpy": "1.0"})
    with pytest.raises(VersionError, match=r"numpy 1\.0 in place of"):
        sent.unpack(tmp_path)


def test_workers_of_other_hosts_keep_their_compiled_code_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two hosts with one home; a folder that the user names stays."""
    import numba

    monkeypatch.setitem(vars(numba.config), "CACHE_DIR", "")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    prepared = cluster_module.Preparation(Parcel.of([short()]), seeds_module.run_block, None)
    prepared.prepare()
    assert vars(numba.config)["CACHE_DIR"] == ""
    folders = []
    for host in ("one", "two"):
        monkeypatch.setitem(vars(numba.config), "CACHE_DIR", "")
        monkeypatch.setattr("socket.gethostname", lambda host=host: host)
        prepared.prepare()
        folders.append(vars(numba.config)["CACHE_DIR"])
    assert folders[0] != folders[1]
    assert folders[1].endswith("compiled_two")
    monkeypatch.setitem(vars(numba.config), "CACHE_DIR", "/mine")
    prepared.prepare()
    assert vars(numba.config)["CACHE_DIR"] == "/mine"


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("nowhere.json", "there is no such file"),
        ("wrong.json", "holds no address"),
        ("tcp://", "missing port number"),
        ("ftp://a:1", "unknown address scheme"),
        ("tls://127.0.0.1:1", "needs certificates"),
    ],
)
def test_a_place_without_a_scheduler_is_refused_at_once(place: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "wrong.json").write_text('["address"]', "utf-8")
    place = place if "://" in place else str(tmp_path / place)
    with (
        pytest.raises(ValueError, match=f"{words}.*accepted is an address"),
        cluster_module.connected(place),
    ):
        pass
