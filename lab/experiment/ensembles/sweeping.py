"""Sweeping: an experiment run over values of settings and over seeds, on all processors.

Of each run, only some numbers are kept. They stay in a cache, so the same sweep is there at once, and a
sweep that was ended goes on where it stopped.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.base.cache import StageCache, digest
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import value_text
from lab.base.progress import Progress, StoppedError
from lab.experiment.ensembles.ensemble import HORIZONTAL_95, QUANTITIES, UNITS
from lab.experiment.ensembles.run_at_fixes import WIDE, figures_of_result
from lab.experiment.ensembles.seed_lanes import LANES, SeedLanes
from lab.experiment.ensembles.seeds import (
    ASKED_EVERY,
    FEW,
    MANY,
    at_fast_rate,
    estimate_memory,
    format_progress,
    seed_numbers,
    thread_count,
)
from lab.experiment.ensembles.swept_values import CARD, Swept, combinations, name_cards, read
from lab.experiment.experiment import Experiment
from lab.experiment.sweep import Sweep
from lab.missions import LogMission, mission
from lab.run.memory import at_once
from lab.run.provenance import SWEEP, collect_facts

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

    from lab.experiment.ensembles.parcel import Unpacked


KEPT = StageCache(limit=4 * 2**20)
"""The numbers of single runs by their settings: 16,000 runs with 256 bytes each."""
NUMBERS = 3 * WIDE + 5
"""How many numbers are kept of a run; see `run_at_fixes.figures_of_run`."""
SHARES, LEAST_SHARE, LARGEST_SHARE = 64, 4, 64
"""Number of shares that the runs of a sweep are cut into for a cluster, and the fewest and most runs in each:
some 0.2 to 5 s of work."""
FEWEST_SEEDS = 3
"""Fewest seeds that are run abreast: eight abreast take as long as one or two alone."""
REPORT_EVERY = 0.1
"""Shortest time between two reports of the progress [s]."""
STOPPED = "not done, because the sweep was stopped"
"""Why runs are missing of a sweep that was cancelled."""


class Block(NamedTuple):
    """Runs of an experiment, given by its number, with some seeds: alone, or up to eight abreast."""

    point: int
    seeds: tuple[int, ...]
    abreast: bool


class Numbers(NamedTuple):
    """Numbers of a run in the order of `figures_of_run`, and why they are NaN; empty if they are not."""

    values: FloatArray
    refusal: str


@OneBlasThread()
def sweep(
    experiment: Experiment,
    settings: Mapping[str, Sequence[Any]],
    seeds: int | Sequence[int],
    progress: Progress | None,
    workers: int | None,
    *,
    fast: bool = False,
    fixed: Mapping[str, Any] = MappingProxyType({}),
    cancelled: Callable[[], bool] | None = None,
    client: Client | None = None,
) -> Sweep:
    """Run all combinations of values with all seeds; see `Experiment.sweep`.

    Parameters
    ----------
    experiment, settings, seeds, progress, workers, fast, client
        As of `Experiment.sweep`.
    fixed
        Values of settings that override those of a swept card.
    cancelled
        Asked ten times a second; once it says so, no further run begins, and the values of runs that have not
        begun are NaN.

    Raises
    ------
    StoppedError
        If it is cancelled before a run has begun.
    """
    swept = read(experiment, settings)
    if fast and "navigator.filter_rate" in settings:
        raise SettingError("navigator.filter_rate: is swept; accepted without fast, which sets it")
    points = [at_fast_rate(one) if fast else one for one in combinations(experiment, swept, fixed)]
    numbers = seeds_of_runs(experiment, points, seeds)
    hashes = {name: mission(name).content_hash for name in {point.mission for point in points}}
    keys = [
        digest(hashes[point.mission], {**point.to_dict(), "seed": None}, point.hidden) for point in points
    ]

    # Runs with the same seed follow one another, because they share the stages before the swept setting.
    tasks = {(index, seed): f"{keys[index]} {seed}" for seed in numbers for index in range(len(points))}
    found = {task: one for task, key in tasks.items() if (one := kept(key)) is not None}
    blocks = plan_blocks(points, tasks.keys() - found, numbers)
    done = _Done(found, tasks, progress)
    threads = at_once(max(map(estimate_memory, points)), thread_count(workers))
    if client is None:
        run_on_threads(threads, points, blocks, done, cancelled or (lambda: False))
    else:
        run_on_cluster(client, workers, points, blocks, done, cancelled)
    if not found:
        raise StoppedError(f"stopped before the first of {len(tasks):,} runs was done")
    refusals = Counter(one.refusal for one in found.values() if one.refusal)
    if refusals.total() == len(found):
        raise ValueError(f"No run of the sweep is possible: {refusals.most_common(1)[0][0]}")
    refusals[STOPPED] = len(tasks) - len(found)
    missing = Numbers(np.full(NUMBERS, np.nan), STOPPED)
    values = np.array(
        [[found.get((index, seed), missing).values for seed in numbers] for index in range(len(points))]
    )
    missions = ", ".join(dict.fromkeys(point.mission for point in points))
    base = experiment.copy()
    for path, value in fixed.items():
        base.set(path, value)
    return Sweep(
        missions,
        tuple(one.path for one in swept),
        dataset(base, missions, swept, numbers, values),
        tuple(f"{count} of {len(tasks)} runs: {reason}" for reason, count in refusals.items() if count),
        refusals[STOPPED],
        _describe_origin(base, swept),
        {"fast": fast, "fixed": dict(fixed)},
    )


def _describe_origin(experiment: Experiment, swept: Sequence[Swept]) -> dict[str, Any]:
    """Return what made a sweep, and the given values of each setting with those of the dataset."""
    pairs = {
        one.path: list(zip(name_cards(one.values), coordinate(experiment, one)[1], strict=True))
        for one in swept
    }
    return collect_facts(experiment, mission(experiment.mission), SWEEP) | {"swept": pairs}


class _Done:
    """The numbers of the runs that are done, and who is told of them.

    Parameters
    ----------
    found
        Those that are known before.
    tasks
        Experiment and seed of each run, and its key in the cache.
    progress
        As of `sweep`.
    """

    def __init__(
        self,
        found: dict[tuple[int, int], Numbers],
        tasks: Mapping[tuple[int, int], str],
        progress: Progress | None,
    ) -> None:
        self.found, self._tasks, self._progress = found, tasks, progress
        self._began = self._reported = time.monotonic()
        if found:
            self._report()

    def keep(self, block: Block, numbers: Sequence[Numbers]) -> None:
        """Keep the numbers of a block in the cache, from any thread: they are there if the sweep ends now."""
        for seed, one in zip(block.seeds, numbers, strict=True):
            keep(self._tasks[block.point, seed], one)

    def add(self, block: Block, numbers: Sequence[Numbers]) -> None:
        """Add the numbers of a block, and tell of it."""
        self.found |= {(block.point, seed): one for seed, one in zip(block.seeds, numbers, strict=True)}
        if time.monotonic() > self._reported + REPORT_EVERY or len(self.found) == len(self._tasks):
            self._report()

    def tell(self, step: str) -> None:
        """Tell of a step before the first run."""
        if self._progress is not None:
            self._progress(step, 0.0)

    def _report(self) -> None:
        self._reported = time.monotonic()
        if self._progress is not None:
            count, wanted = len(self.found), len(self._tasks)
            self._progress(format_progress(count, wanted, self._began), count / wanted)


def plan_blocks(
    points: Sequence[Experiment], left: Collection[tuple[int, int]], seeds: Sequence[int]
) -> list[Block]:
    """Return the runs to do, of some experiments with some seeds: alone, or up to eight seeds abreast.

    Runs alone with the same seed follow one another, because they share the stages before the swept setting.
    """
    count = len(points) * len(seeds)
    abreast = [
        count >= FEW and len(seeds) >= FEWEST_SEEDS and _can_run_abreast(one, count >= MANY) for one in points
    ]
    blocks = [
        Block(index, (seed,), abreast=False)
        for seed in seeds
        for index in range(len(points))
        if not abreast[index] and (index, seed) in left
    ]
    for index in np.flatnonzero(abreast).tolist():
        own = [seed for seed in seeds if (index, seed) in left]
        parts = [tuple(own[first : first + LANES]) for first in range(0, len(own), LANES)]
        blocks += [Block(index, part, abreast=True) for part in parts]
    return blocks


def _can_run_abreast(point: Experiment, many: bool) -> bool:
    """Return whether runs of an experiment can be abreast; `many` are worth waiting for a compiler."""
    try:
        lanes = SeedLanes.of(point)
    except ValueError:  # refused, as each of its runs is
        return False
    return lanes is not None and (many or lanes.is_compiled)


def run_on_threads(
    threads: int,
    points: Sequence[Experiment],
    blocks: Sequence[Block],
    done: _Done,
    is_cancelled: Callable[[], bool],
) -> None:
    """Run blocks on the threads of this computer."""
    pool, room = ThreadPoolExecutor(threads, thread_name_prefix="sweep"), threading.local()
    left, running = deque(blocks), dict[Future[list[Numbers]], Block]()

    def work(block: Block) -> list[Numbers]:
        numbers = run_block(points[block.point], block, room)
        done.keep(block, numbers)
        return numbers

    try:
        while (left or running) and not is_cancelled():
            while left and len(running) < 2 * threads:
                block = left.popleft()
                running[pool.submit(work, block)] = block
            for future in wait(running, ASKED_EVERY, FIRST_COMPLETED).done:
                done.add(running.pop(future), future.result())
    finally:
        pool.shutdown(cancel_futures=True)
    for future, block in running.items():  # of cancelled work: what was begun is done by now
        if not future.cancelled():
            done.add(block, future.result())


def run_on_cluster(
    client: Client,
    workers: int | None,
    points: Sequence[Experiment],
    blocks: Sequence[Block],
    done: _Done,
    cancelled: Callable[[], bool] | None = None,
) -> None:
    """Run blocks on the workers of a cluster; what a lost one has not done has that as its refusal."""
    from lab.experiment.ensembles import cluster  # noqa: PLC0415 - imports Dask, which need not be installed

    cluster.check_client(client, workers)
    if not blocks:
        return
    runs = sum(len(block.seeds) for block in blocks)
    size = min(max(-(-runs // SHARES), LEAST_SHARE), LARGEST_SHARE)
    shares: list[list[Block]] = [[]]
    for block in blocks:
        if sum(len(one.seeds) for one in shares[-1]) >= size:
            shares.append([])
        shares[-1].append(block)

    def add(index: int, numbers: list[list[Numbers]]) -> None:
        for block, own in zip(shares[index], numbers, strict=True):
            done.keep(block, own)
            done.add(block, own)

    ended = cluster.run_pieces(
        client,
        cluster.Parcel.of(points),
        run_share,
        [(tuple(share),) for share in shares],
        add,
        tell=done.tell,
        warming=((blocks[0]._replace(point=0),),),  # the only one there; that of the sweep may be done
        cancelled=cancelled,
    )
    if ended:
        lost = Numbers(np.full(NUMBERS, np.nan), ended)
        done.found |= {
            (block.point, seed): lost
            for block in blocks
            for seed in block.seeds
            if (block.point, seed) not in done.found
        }


def run_share(given: Unpacked, share: Sequence[Block]) -> list[list[Numbers]]:
    """Return the numbers of some blocks of runs on a worker."""
    room = threading.local()
    return [run_block(given.experiments[block.point], block, room) for block in share]


def run_block(point: Experiment, block: Block, room: threading.local) -> list[Numbers]:
    """Return the numbers of the runs of a block, in memory that other blocks of this thread share."""
    abreast: Iterable[FloatArray | None] = [None] * len(block.seeds)
    if block.abreast:
        try:
            lanes = SeedLanes.of(point, along=True, room=room)
            abreast = abreast if lanes is None else lanes.figures(block.seeds)
        except ValueError as error:
            return [Numbers(np.full(NUMBERS, np.nan), str(error))] * len(block.seeds)
    return [
        run(point, seed) if found is None else Numbers(found, "")
        for seed, found in zip(block.seeds, abreast, strict=True)
    ]


def keep(key: str, one: Numbers) -> None:
    """Keep the numbers of a run that another process did."""
    KEPT.get("run", key, lambda: one)


def kept(key: str) -> Numbers | None:
    """Return the numbers of a run that was done before; None if it was not."""

    def missing() -> Numbers:
        raise LookupError(key)

    try:
        return KEPT.get("run", key, missing)
    except LookupError:
        return None


def seeds_of_runs(
    experiment: Experiment, points: list[Experiment], seeds: int | Sequence[int]
) -> tuple[int, ...]:
    """Return the seed of each run.

    Raises
    ------
    ValueError
        If there is none, one is no whole number, or there are several for a sensor log.
    """
    numbers = tuple(dict.fromkeys(seed_numbers(experiment, seeds)))
    logs = [name for name in {one.mission for one in points} if isinstance(mission(name), LogMission)]
    if logs and len(numbers) > 1:
        raise ValueError(
            f"seeds: {len(numbers)} runs of the sensor log {logs[0]} would all be the same, since it has no "
            "random draws; accepted is seeds=1"
        )
    return numbers


def run(point: Experiment, seed: int) -> Numbers:
    """Return the numbers of one run; NaN and the reason if it is refused or diverges."""
    mine = point.copy()
    mine.set("seed", seed)
    try:
        return Numbers(figures_of_result(mine.run()), "")
    except ValueError as error:
        return Numbers(np.full(NUMBERS, np.nan), str(error))


def dataset(
    experiment: Experiment, missions: str, swept: list[Swept], seeds: tuple[int, ...], values: FloatArray
) -> xr.Dataset:
    """Return the numbers (points, seeds, k) of all runs with their dimensions and units."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    dims = [one.dim for one in swept]
    shaped = values.reshape(*(len(one.values) for one in swept), len(seeds), -1)
    errors = (("rms", "root mean square error"), ("max", "largest error"), ("sigma", "rms of the filter's σ"))
    variables: dict[str, Any] = {
        name: (
            (*dims, "seed", "quantity"),
            shaped[..., at * WIDE : (at + 1) * WIDE],
            {"long_name": words, "units": ", ".join(dict.fromkeys(UNITS))},
        )
        for at, (name, words) in enumerate(errors)
    }
    for at, name in enumerate(("nees", "nees_degrees", "nis", "nis_degrees"), 3 * WIDE):
        words = "expected value" if name.endswith("degrees") else "mean over the fixes"
        about = {"long_name": f"{name.partition('_')[0].upper()}, {words}", "units": "1"}
        variables[name] = ((*dims, "seed"), shaped[..., at], about)
    about = {"long_name": HORIZONTAL_95, "units": "m"}
    variables["horizontal_95"] = ((*dims, "seed"), shaped[..., -1], about)
    coords: dict[str, Any] = {one.dim: coordinate(experiment, one) for one in swept}
    # The seed of a run that hides something is in no file: its runs are numbered.
    numbers = list(range(1, len(seeds) + 1)) if experiment.hidden else list(seeds)
    coords |= {
        "seed": ("seed", numbers, {"long_name": "seed of the run", "units": "1"}),
        "quantity": list(QUANTITIES),
        "unit": ("quantity", list(UNITS)),
    }
    return xr.Dataset(variables, coords, {"mission": missions, "settings": experiment.to_toml()})


def coordinate(experiment: Experiment, swept: Swept) -> tuple[str, list[Any], dict[str, str]]:
    """Return the values of a setting as a coordinate: numbers, or texts if any value is no number."""
    if swept.path == CARD:
        about = {"units": "", "long_name": "Card", "setting": CARD}
        return swept.dim, name_cards(swept.values), about
    declaration = experiment.declaration(swept.path)
    plain = all(isinstance(value, Real) and not isinstance(value, bool) for value in swept.values)
    texts = [value_text(declaration, value) for value in swept.values]
    about = {
        "units": getattr(declaration, "unit", ""),
        "long_name": declaration.label or swept.dim,
        "setting": swept.path,
    }
    return swept.dim, swept.values if plain else texts, about
