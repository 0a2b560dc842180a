"""Outages: which error a time without GPS leaves at its end, over seeds, begins and sensors.

Each run has one outage. The begins are spread evenly over the part of the flight in which the filter has
converged and the outage ends, so that the errors are those of an outage at any time of this flight, with any
turn-on errors and noise. Runs eight abreast share a begin: 100 runs have 13 begins. Every sensor has the same
seeds and begins.

An outage begins with the first sample after a fix. At its end, the navigator has been without GPS for exactly
its length. A run that diverges counts with an infinite error.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.base.cache import StageCache, digest
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress, StoppedError
from lab.experiment.ensembles.log_outages import log_outages
from lab.experiment.ensembles.outage_blocks import (
    SHORTEST,
    Block,
    errors_in,
    offset_of_turn,
    plan_blocks,
    times_since,
)
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import (
    ASKED_EVERY,
    MANY,
    at_fast_rate,
    estimate_memory,
    format_progress,
    seed_numbers,
    thread_count,
)
from lab.experiment.experiment import Experiment
from lab.experiment.outage_table import OutageErrors, OutageRow, OutageTable, Perfect
from lab.missions import LogMission, mission
from lab.run.memory import at_once
from lab.sensors.cards import card, card_in_force
from lab.sensors.cards import cards as catalogue

if TYPE_CHECKING:
    from distributed import Client

    from lab.experiment.ensembles.parcel import Unpacked

ENLARGED = 4
"""How many times as many runs a sensor gets at most whose 95 % is close to the wish."""
SURE = 0.985
"""Confidence of the interval that ends the search for a decision: with looks after 100, 200, 300 and 400
runs, a sensor whose 95 % is the wish itself is decided wrongly in 3 % of the cases."""
AGREEMENT = 0.1
"""Largest difference of rms errors from their σ, as a fraction, at which the linear covariance stands for the
runs of a filter."""
SHOWN_EVERY = 2.0
"""Time between two partial tables [s]."""
SHARE = 8
"""Number of blocks of runs that a worker of a cluster gets at a time: 64 runs take it 0.6 s."""
KEPT = StageCache(limit=64 * 2**20)
"""The errors of blocks of runs by their settings: 12 kB for eight runs with an outage of a minute."""
TUNING = (
    "q_scale",
    "r_scale",
    "p0_scale",
    "r_factors",
    "q",
    "r",
    "p0",
    "lever_arm",
    "latency",
    "gate",
    "robust",
)
"""Settings of the navigator whose defaults are those of a filter that is matched to its sensors."""
AS_SET = "as set"
"""Name of the sensors of the settings, if they are those of no card."""


WARM_BLOCK = Block(40.0, (0,))
"""A run on the usual mission whose short outage compiles what those of a worker need."""


@OneBlasThread()
def outage(
    experiment: Experiment,
    seconds: float,
    cards: str | Sequence[str] | None,
    seeds: int | Sequence[int],
    wish: float | None,
    *,
    fast: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
    partial: Callable[[OutageTable], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    client: Client | None = None,
) -> OutageTable:
    """Return which errors outages of GPS leave; see `Experiment.outage`."""
    seconds = _number("seconds", seconds, SHORTEST)
    wish = None if wish is None else _number("wish", wish, 0.0)
    numbers, threads = tuple(dict.fromkeys(seed_numbers(experiment, seeds))), thread_count(workers)
    rows, experiments = _rows(experiment, cards)
    table = OutageTable(experiment.mission, seconds, wish, times_since(seconds), rows)
    if isinstance(mission(experiment.mission), LogMission):
        return log_outages(table, experiments, progress, partial, cancelled)
    for one in experiments:
        one.set("sensors.gps.outages", [])
    chosen = [at_fast_rate(one) if fast else one for one in experiments]
    work = _Work(table, chosen, progress, partial, cancelled)
    if client is not None:
        from lab.experiment.ensembles import cluster  # noqa: PLC0415 - imports Dask, which need not be installed

        cluster.check_client(client, workers)
        return work.run(numbers, functools.partial(work.run_on_cluster, client))
    threads = at_once(max(map(estimate_memory, chosen)), threads)
    with ThreadPoolExecutor(threads, thread_name_prefix="outage") as pool:
        return work.run(numbers, functools.partial(work.run_on_threads, pool))


def match_filter(experiment: Experiment) -> Experiment:
    """Return a copy whose filter is matched to its sensors: it assumes their noise, and has all their states.

    Scales, given matrices, gates and assumed places go back to their defaults, and the filter has states for
    the errors that the sensors have. Its model, its rates and its alignment stay.
    """
    perfect, sensors = experiment.copy(), experiment.sensors
    declared = perfect.navigator.param
    for name in TUNING:
        perfect.set(f"navigator.{name}", declared[name].default)
    triads = sensors.gyro, sensors.accelerometer
    present = {
        "states": any(any(one.scale_factor) or any(one.scale_factor_sigma) for one in triads),
        "estimate_misalignments": any(any(one.misalignment) for one in triads),
        "estimate_g_sensitivity": any(sensors.gyro.g_sensitivity),
        "estimate_gps_drift": any(sensors.gps.correlated_sigma),
    }
    for name, is_present in present.items():
        if is_present:
            perfect.set(f"navigator.{name}", max(declared["states"].objects) if name == "states" else True)
    return perfect


@dataclass
class _Filter:
    """A filter with its sensors, and what is known of it: the errors by the number of set and block."""

    row: int
    is_perfect: bool
    experiment: Experiment
    key: str
    blocks: dict[tuple[int, int], OutageErrors] = field(default_factory=dict)
    refusal: str = ""

    @cached_property
    def lanes(self) -> SeedLanes | None:
        """The runs of the filter abreast; None if they would not be those of its seeds alone."""
        return SeedLanes.of(self.experiment)

    def block(self, block: Block, since: FloatArray, *, many: bool) -> OutageErrors:
        """Return the errors of a block; with `many` runs, it is worth waiting for a compiler."""
        lanes = self.lanes
        if lanes is not None and not (many or lanes.is_ready):
            lanes = None
        return KEPT.get(
            "outage", f"{self.key} {block}", lambda: errors_in(self.experiment, block, since, lanes)
        )

    def errors(self) -> OutageErrors | None:
        """Return the errors of its runs so far, in their order."""
        if self.refusal or not self.blocks:
            return None
        return OutageErrors.joined([self.blocks[at] for at in sorted(self.blocks)])


class _Task(NamedTuple):
    """A block of runs of a filter, with its place: the number of the set, and of the block in it."""

    filter: _Filter
    at: tuple[int, int]
    block: Block


def run_share(
    given: Unpacked, number: int, blocks: Sequence[Block], seconds: float, many: bool
) -> list[OutageErrors] | str:
    """Return the errors of blocks of runs of a filter, on a worker of a cluster; or why it is refused.

    Parameters
    ----------
    given
        The experiments of all filters.
    number
        That of the filter.
    blocks
        The blocks.
    seconds
        Length of the outages [s].
    many
        Whether runs abreast are worth waiting for a compiler.
    """
    experiment = given.experiments[number]
    try:
        lanes = given.kept(SeedLanes.of, experiment)
        abreast = lanes if lanes is not None and (many or lanes.is_ready) else None
        return [errors_in(experiment, block, times_since(seconds), abreast) for block in blocks]
    except ValueError as error:
        return str(error)


class _Work:
    """The runs of all filters of a table on all processors, and the table of those that are done."""

    def __init__(
        self,
        table: OutageTable,
        experiments: Sequence[Experiment],
        progress: Progress | None,
        partial: Callable[[OutageTable], None] | None,
        cancelled: Callable[[], bool] | None,
    ) -> None:
        self._empty, self._progress, self._partial = table, progress, partial
        self._is_cancelled = cancelled or (lambda: False)
        self._patience = None if cancelled is None else ASKED_EVERY
        self._filters = [one for row, given in enumerate(experiments) for one in _filters(row, given, table)]
        self._done, self._wanted, self._ended = 0, 0, ""
        self._began = self._shown = time.monotonic()

    def run(self, seeds: tuple[int, ...], run_tasks: Callable[[Sequence[_Task], bool], None]) -> OutageTable:
        """Run all filters, then those on the border again, until all is done, cancelled or lost."""
        chosen = self._filters
        for turn in range(ENLARGED):
            tasks = self._tasks(chosen, seeds, turn)
            self._wanted += sum(len(task.block.seeds) for task in tasks)
            run_tasks(tasks, len(seeds) * len(chosen) >= MANY)
            chosen = self._undecided_filters()
            if not chosen or self._is_cancelled() or self._ended:
                break
            seeds = tuple(range(max(seeds) + 1, max(seeds) + 1 + len(seeds)))
        if not self._done:
            raise StoppedError(self._ended or f"stopped before the first of {self._wanted:,} runs was done")
        refusals = {one.row: one.refusal for one in self._filters if one.refusal}
        if len(refusals) == len(self._empty.rows):
            raise SettingError("; ".join(dict.fromkeys(refusals.values())))
        return replace(self._table(), ended=self._ended)

    def _tasks(self, chosen: Sequence[_Filter], seeds: tuple[int, ...], turn: int) -> list[_Task]:
        """Return the blocks of some filters; begins far from each other are first, for partial tables."""
        found = [
            _Task(one, (turn, number), block)
            for one in chosen
            for number, block in enumerate(plan_blocks(one.experiment, self._empty.seconds, seeds, turn))
        ]
        return sorted(found, key=lambda task: offset_of_turn(task.at[1]))

    def run_on_threads(self, pool: ThreadPoolExecutor, tasks: Sequence[_Task], many: bool) -> None:
        """Run blocks on the threads of this computer."""
        running: dict[Future[OutageErrors], _Task] = {}
        for task in tasks:
            if self._is_cancelled():
                break
            running[pool.submit(task.filter.block, task.block, self._empty.since, many=many)] = task
        while running and not self._is_cancelled():
            for future in wait(running, self._patience, FIRST_COMPLETED).done:
                self._take(future, running.pop(future))
        # Of cancelled work, what was begun is done soon.
        for future in [future for future in running if not future.cancel()]:
            self._take(future, running[future])

    def run_on_cluster(self, client: Client, tasks: Sequence[_Task], many: bool) -> None:
        """Run blocks on the workers of a cluster, `SHARE` blocks of a filter at a time."""
        from lab.experiment.ensembles import cluster  # noqa: PLC0415 - imports Dask, which need not be installed

        shares = []
        for number, one in enumerate(self._filters):
            own = [task for task in tasks if task.filter is one]
            shares += [(number, own[first : first + SHARE]) for first in range(0, len(own), SHARE)]

        def done(index: int, found: list[OutageErrors] | str) -> None:
            for place, task in enumerate(shares[index][1]):
                self._add(task, found if isinstance(found, str) else found[place])

        self._ended = cluster.run_pieces(
            client,
            cluster.Parcel.of([one.experiment for one in self._filters]),
            run_share,
            [(number, [task.block for task in own], self._empty.seconds, many) for number, own in shares],
            done,
            tell=lambda step: None if self._progress is None else self._progress(step, 0.0),
            warming=(0, (WARM_BLOCK,), SHORTEST, many),
            cancelled=self._is_cancelled,
        )

    def _take(self, future: Future[OutageErrors], task: _Task) -> None:
        """Add the runs of a block that a thread has done, or why the lab refuses them."""
        try:
            self._add(task, future.result())
        except ValueError as error:
            self._add(task, str(error))

    def _add(self, task: _Task, found: OutageErrors | str) -> None:
        """Add the errors of a block, or why the lab refuses it."""
        if isinstance(found, str):
            task.filter.refusal = found
        else:
            task.filter.blocks[task.at] = found
        self._done += len(task.block.seeds)
        self._report()

    def _undecided_filters(self) -> list[_Filter]:
        """Return the filters whose 95 % is too close to the wish."""
        wish, rows = self._empty.wish, self._table().rows
        if wish is None:
            return []
        return [one for one in self._filters if not one.is_perfect and rows[one.row].is_border(wish, SURE)]

    def _report(self) -> None:
        now = time.monotonic()
        if self._progress is not None:
            self._progress(format_progress(self._done, self._wanted, self._began), self._done / self._wanted)
        if self._partial is not None and now - self._shown > SHOWN_EVERY:
            self._shown = now
            self._partial(self._table())

    def _table(self) -> OutageTable:
        """Return the table of the runs that are done."""
        rows = list(self._empty.rows)
        for one in self._filters:
            errors, row = one.errors(), rows[one.row]
            if not one.is_perfect:
                row = replace(row, errors=errors, refusal=one.refusal)
                perfect = Perfect(row.most.value, "itself") if row.runs else None
                rows[one.row] = replace(row, perfect=perfect)
            else:
                rows[one.row] = replace(
                    row, perfect=None if errors is None else perfect_filter_errors(errors)
                )
        return replace(self._empty, rows=tuple(rows))


def perfect_filter_errors(errors: OutageErrors) -> Perfect:
    """Return what a perfect filter leaves, of its errors: its covariance if these agree with it, or they."""
    row = OutageRow("", "", errors)
    known = np.isfinite(errors.sigma[:, -1])
    rms, sigma = (np.sqrt(np.mean(part[known, -1] ** 2)) for part in (errors.horizontal, errors.sigma))
    if known.all() and abs(rms / sigma - 1) <= AGREEMENT:
        return Perfect(row.believed, "covariance")
    return Perfect(row.most.value, "ensemble")


def _filters(row: int, experiment: Experiment, table: OutageTable) -> list[_Filter]:
    """Return the filter of a row, and the perfect one on its sensors unless it is the same."""
    content = mission(experiment.mission).content_hash
    found: list[_Filter] = []
    for is_perfect, one in enumerate((experiment, match_filter(experiment))):
        settings = {**one.to_dict(), "seed": None}
        key = digest(content, settings, experiment.hidden, table.seconds)
        if not found or key != found[0].key:
            found.append(_Filter(row, bool(is_perfect), one, key))
    return found


def _rows(
    experiment: Experiment, cards: str | Sequence[str] | None
) -> tuple[tuple[OutageRow, ...], list[Experiment]]:
    """Return the empty rows of some cards, and their experiments.

    Raises
    ------
    SettingError
        If there is no such card, or none at all.
    """
    if cards is None:
        name = card_in_force(experiment.sensors) or AS_SET
        known = catalogue().get(name)
        return (OutageRow(name, known.grade if known else "", None),), [experiment.copy()]
    names = list(catalogue()) if cards == "all" else [cards] if isinstance(cards, str) else list(cards)
    chosen = {found.name: found for found in map(card, names)}
    if not chosen:
        raise SettingError('cards: none named; accepted are "all", or names such as "BMI088"')
    experiments = []
    for found in chosen.values():
        variant = experiment.copy()
        found.load(variant)
        experiments.append(variant)
    return tuple(OutageRow(one.name, one.grade, None) for one in chosen.values()), experiments


def _number(name: str, value: float, least: float) -> float:
    """Return a number that a user gives.

    Raises
    ------
    ValueError
        If it is none, or too small.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool | str) or not math.isfinite(number) or number < least or not number:
        bounds = f"of {least:g} or more" if least else "above 0"
        raise ValueError(f"{name}: {value!r} is not accepted; accepted is a number {bounds}")
    return number
