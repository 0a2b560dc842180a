"""Sweeping: an experiment run over values of settings and over seeds, on all processors.

Of each run, only some numbers are kept. They stay in a cache, so the same sweep is there at once, and a
sweep that was ended goes on where it stopped.
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import product
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
from lab.experiment.ensembles.seeds import (
    ASKED_EVERY,
    at_fast_rate,
    counted,
    memory_of,
    seed_numbers,
    thread_count,
)
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.sweep import Sweep
from lab.missions import LogMission, mission
from lab.run.memory import at_once
from lab.sensors.cards import Card, card

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

    from lab.experiment.ensembles.parcel import Unpacked


KEPT = StageCache(limit=4 * 2**20)
"""The numbers of single runs by their settings: 16,000 runs with 256 bytes each."""
WIDE = len(QUANTITIES)
NUMBERS = 3 * WIDE + 5
"""How many numbers are kept of a run; see `measure`."""
SHARES, LEAST_SHARE, LARGEST_SHARE = 64, 4, 64
"""Number of shares that the runs of a sweep are cut into for a cluster, and the fewest and most runs in each:
some 0.2 to 5 s of work."""
REPORT_EVERY = 0.1
"""Shortest time between two reports of the progress [s]."""
CARD = "card"
"""What is swept like a setting, although it sets many: the card of the sensors."""
STOPPED = "not done, because the sweep was stopped"
"""Why runs are missing of a sweep that was cancelled."""


class Swept(NamedTuple):
    """A swept setting: its path, the name of its dimension, and its values."""

    path: str
    dim: str
    values: list[Any]


class Numbers(NamedTuple):
    """The numbers of one run in the order of `measure`, and why they are NaN; empty if they are not."""

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
    numbers = seeds_of(experiment, points, seeds)
    hashes = {name: mission(name).content_hash for name in {point.mission for point in points}}
    keys = [
        digest(hashes[point.mission], {**point.to_dict(), "seed": None}, point.hidden) for point in points
    ]

    def one(index: int, seed: int) -> Numbers:
        return KEPT.get("run", f"{keys[index]} {seed}", lambda: run(points[index], seed))

    # Runs with the same seed follow one another, because they share the stages before the swept setting.
    tasks = [(index, seed) for seed in numbers for index in range(len(points))]
    found: dict[tuple[int, int], Numbers] = {}
    if client is not None:
        keyed = {task: f"{keys[task[0]]} {task[1]}" for task in tasks}
        found = run_on_cluster(client, workers, points, keyed, progress, cancelled)
    threads = at_once(max(map(memory_of, points)), thread_count(workers))
    pool = ThreadPoolExecutor(threads, thread_name_prefix="sweep")
    left, running = deque(tasks if client is None else ()), dict[Future[Numbers], tuple[int, int]]()
    is_cancelled = cancelled or (lambda: False)
    began = reported = time.monotonic()
    try:
        while (left or running) and not is_cancelled():
            while left and len(running) < 2 * threads:
                task = left.popleft()
                running[pool.submit(one, *task)] = task
            for future in wait(running, ASKED_EVERY, FIRST_COMPLETED).done:
                found[running.pop(future)] = future.result()
            now, is_last = time.monotonic(), not (left or running)
            if progress is not None and found and (now > reported + REPORT_EVERY or is_last):
                reported = now
                progress(counted(len(found), len(tasks), began), len(found) / len(tasks))
    finally:
        pool.shutdown(cancel_futures=True)
    # Of cancelled work: what was begun is done by now.
    found |= {task: future.result() for future, task in running.items() if not future.cancelled()}
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
    )


def run_on_cluster(
    client: Client,
    workers: int | None,
    points: Sequence[Experiment],
    keyed: Mapping[tuple[int, int], str],
    progress: Progress | None,
    cancelled: Callable[[], bool] | None = None,
) -> dict[tuple[int, int], Numbers]:
    """Return the numbers of the runs, done on the workers of a cluster unless they are kept.

    Parameters
    ----------
    client, workers, progress, cancelled
        As of `sweep`.
    points
        The experiments.
    keyed
        Experiment and seed of each run, and its key in the cache.
    """
    from lab.experiment.ensembles import cluster  # noqa: PLC0415 - imports Dask, which need not be installed

    cluster.check_client(client, workers)
    found = {task: one for task, key in keyed.items() if (one := kept(key)) is not None}
    left = [task for task in keyed if task not in found]
    size = min(max(-(-len(left) // SHARES), LEAST_SHARE), LARGEST_SHARE)
    shares = [tuple(left[first : first + size]) for first in range(0, len(left), size)]

    began = time.monotonic()

    def done(index: int, numbers: list[Numbers]) -> None:
        for task, one in zip(shares[index], numbers, strict=True):
            found[task] = one
            keep(keyed[task], one)
        if progress is not None:
            progress(counted(len(found), len(keyed), began), len(found) / len(keyed))

    if not shares:
        return found
    ended = cluster.run_pieces(
        client,
        cluster.Parcel.of(points),
        run_share,
        [(share,) for share in shares],
        done,
        tell=lambda step: None if progress is None else progress(step, 0.0),
        warming=(((0, 0),),),
        cancelled=cancelled,
    )
    lost = {task: Numbers(np.full(NUMBERS, np.nan), ended) for task in keyed} if ended else {}
    return lost | found


def run_share(given: Unpacked, share: Sequence[tuple[int, int]]) -> list[Numbers]:
    """Return the numbers of some runs on a worker; each is given by its experiment and its seed."""
    return [run(given.experiments[index], seed) for index, seed in share]


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


def read(experiment: Experiment, settings: Mapping[str, Sequence[Any]]) -> list[Swept]:
    """Return the swept settings; each value has been accepted by its setting.

    Raises
    ------
    SettingError
        If there is no such setting or card, or a value is not accepted, missing or given twice.
    MissionError
        If there is no such mission.
    """
    if not isinstance(settings, Mapping) or not settings:
        raise SettingError(
            'sweep: no setting named; accepted is, for instance, {"sensors.gyro.noise_density": [0.01, 0.1]}'
        )
    values = {path: accepted(experiment, path, given) for path, given in settings.items()}
    for form in experiment.OTHER_FORMS:
        if form in values and (other := experiment.derived(form).setting) in values:
            raise SettingError(f"{form} and {other} are two forms of one setting; accepted is one of them")
    return [Swept(path, dim_of(path, values), taken) for path, taken in values.items()]


def accepted(experiment: Experiment, path: str, given: Sequence[Any]) -> list[Any]:
    """Return the values of a setting after a check of each, or the named cards; errors as of `read`."""
    if not isinstance(path, str):
        raise SettingError(f"sweep: {path!r} is no name of a setting, such as sensors.gyro.noise_density")
    if path == "seed":
        raise SettingError("seed: every sweep runs over seeds; give their number or a list as `seeds`")
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise SettingError(f"{path}: {given!r} is one value; accepted is a list of values")
    values = [value.tolist() if isinstance(value, np.ndarray | np.generic) else value for value in given]
    if not values:
        raise SettingError(f"{path}: there is no value in the list")
    if path == CARD:
        values = [_card(value) for value in values]
    names = _named(values)
    twice = [name for at, name in enumerate(names) if name in names[:at]]
    if twice:
        raise SettingError(f"{path}: {twice[0]!r} is in the list twice")
    trial = experiment.copy()
    for value in values:
        _set(trial, path, value)
        if path == "mission":
            mission(value)
    return values


def _card(value: Any) -> Card:
    if isinstance(value, Card):
        return value
    if not isinstance(value, str | os.PathLike):
        raise SettingError(f"card: {value!r} is no card; accepted is a card, or its name or .toml file")
    return card(value)


def _named(values: list[Any]) -> list[Any]:
    """Return values with the names of cards in their place."""
    return [value.name if isinstance(value, Card) else value for value in values]


def _set(point: Experiment, path: str, value: Any) -> None:
    """Give an experiment a value of a setting, or the sensors of a card with a filter that suits them."""
    if path == CARD:
        value.load(point)
    else:
        point.set(path, value)


def dim_of(path: str, paths: Mapping[str, object]) -> str:
    """Return the name of a setting's dimension: the end of its path that no other swept setting has."""
    words = path.split(".")
    ends = (words[-count:] for count in range(1, len(words) + 1))
    own = next(end for end in ends if sum(other.split(".")[-len(end) :] == end for other in paths) == 1)
    return "_".join(own)


def combinations(
    experiment: Experiment, swept: list[Swept], fixed: Mapping[str, Any]
) -> Iterator[Experiment]:
    """Iterate over the experiments of all combinations of values, the last setting fastest.

    Settings override the card, whatever their order; those that are `fixed` are set at every point.
    """
    for values in product(*(one.values for one in swept)):
        point = experiment.copy()
        pairs = [(one.path, value) for one, value in zip(swept, values, strict=True)]
        # A card sets many settings. The other form of a setting depends on further settings.
        for path, value in sorted(
            [*fixed.items(), *pairs], key=lambda pair: (pair[0] != CARD, pair[0] in point.OTHER_FORMS)
        ):
            _set(point, path, value)
        yield point


def seeds_of(experiment: Experiment, points: list[Experiment], seeds: int | Sequence[int]) -> tuple[int, ...]:
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
        return Numbers(measure(mine.run()), "")
    except ValueError as error:
        return Numbers(np.full(NUMBERS, np.nan), str(error))


def measure(result: Result) -> FloatArray:
    """Return rms, maximum and σ of nine errors, NEES and NIS with their degrees, and 95 % of the position."""
    squares, count, largest = np.zeros(WIDE), np.zeros(WIDE), np.zeros(WIDE)
    variances, samples, horizontal = np.zeros(WIDE), 0, [np.zeros(0)]
    for part in result.parts():
        sigma = nine(part.sigma)
        variances += np.sum(sigma**2, axis=0)
        samples += len(sigma)
        if result.missing_reason("errors"):
            continue
        errors = np.abs(nine(part.errors))
        known = np.isfinite(errors)
        horizontal.append(np.hypot(errors[:, 0], errors[:, 1])[known[:, :2].all(axis=1)])
        squares += np.sum(errors**2, axis=0, where=known)
        count += known.sum(axis=0)
        largest = np.maximum(largest, np.max(errors, axis=0, where=known, initial=0.0))
    rms = np.sqrt(np.divide(squares, count, out=np.full(WIDE, np.nan), where=count > 0))
    largest[count == 0] = np.nan
    nis = result.innovations["nis"]
    nees = None if result.missing_reason("consistency") else result.consistency["nees"]
    tests = [
        number
        for test in (nees, nis)
        for number in (
            (np.nan, np.nan) if test is None else (average(test.values), float(test.attrs["degrees"]))
        )
    ]
    sizes = np.concatenate(horizontal)
    most = np.quantile(sizes, 0.95) if sizes.size else np.nan
    return np.concatenate((rms, largest, np.sqrt(variances / samples), tests, [most]))


def nine(group: xr.Dataset) -> FloatArray:
    """Return position, velocity and attitude of a dataset in one array (n, 9)."""
    return np.concatenate([group[name].values for name in ("position", "velocity", "attitude")], axis=1)


def average(values: FloatArray) -> float:
    """Return the mean of the known values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


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
        about = {"long_name": f"{name.partition('_')[0].upper()}, {words}", "units": ""}
        variables[name] = ((*dims, "seed"), shaped[..., at], about)
    about = {"long_name": HORIZONTAL_95, "units": "m"}
    variables["horizontal_95"] = ((*dims, "seed"), shaped[..., -1], about)
    coords: dict[str, Any] = {one.dim: coordinate(experiment, one) for one in swept}
    coords |= {
        "seed": list(seeds),
        "quantity": list(QUANTITIES),
        "unit": ("quantity", list(UNITS)),
    }
    return xr.Dataset(variables, coords, {"mission": missions, "settings": experiment.to_toml()})


def coordinate(experiment: Experiment, swept: Swept) -> tuple[str, list[Any], dict[str, str]]:
    """Return the values of a setting as a coordinate: numbers, or texts if any value is no number."""
    if swept.path == CARD:
        about = {"units": "", "long_name": "Card", "setting": CARD}
        return swept.dim, _named(swept.values), about
    declaration = experiment.declaration(swept.path)
    plain = all(isinstance(value, Real) and not isinstance(value, bool) for value in swept.values)
    texts = [value_text(declaration, value) for value in swept.values]
    about = {
        "units": getattr(declaration, "unit", ""),
        "long_name": declaration.label or swept.dim,
        "setting": swept.path,
    }
    return swept.dim, swept.values if plain else texts, about
