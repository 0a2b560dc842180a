"""Experiment: all settings of one run, which is computed into a `Result`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lab.base.parameters.setting_kinds import is_changed
from lab.base.progress import Progress
from lab.base.registry import find
from lab.experiment.log_run import run_log
from lab.experiment.outage_table import OutageTable
from lab.experiment.result import Result, Runnable
from lab.experiment.sensor_stages import CACHE
from lab.experiment.stages import Stages
from lab.experiment.sweep import Sweep
from lab.missions import LogMission, mission
from lab.navigation.algorithm import Algorithm

if TYPE_CHECKING:
    from distributed import Client


class Experiment(Runnable):
    """One run: a mission, a seed, and all settings.

    >>> from lab import Experiment
    >>> experiment = Experiment(mission="montreal", seed=3)
    >>> experiment.set("sensors.gyro.noise_density", 0.02)
    >>> result = experiment.run()
    """

    def run(self, progress: Progress | None = None, *, algorithm: Algorithm | None = None) -> Result:
        """Compute this experiment; stages that were computed for the same settings are reused.

        A sensor log is navigated without simulation: the settings of the sensors are then the filter's
        assumptions, and settings of the simulation, such as the seed, have no effect
        (`lab.experiment.log_run`).

        Parameters
        ----------
        progress
            Called with a sentence about the current stage and the fraction done, from 0 to 1.
        algorithm
            The user's navigator, in place of the one of the settings; its solution is never cached.

        Raises
        ------
        MissionError
            If the mission cannot be found or read.
        SettingError
            If settings are incompatible, or the navigator cannot work with them.
        ValueError
            If the flight cannot be navigated, such as across a pole, or the filter diverges to values that
            are not finite; if there is not enough memory (`TooLongError`); or if the `algorithm` fails
            (`AlgorithmError`).
        """
        settings, tell = self.copy(), progress or (lambda _stage, _fraction: None)
        found = mission(settings.mission)
        if isinstance(found, LogMission):
            return run_log(settings, found, CACHE, tell, algorithm)
        return Stages(settings, found, tell, algorithm).result()

    def sweep(
        self,
        settings: Mapping[str, Sequence[Any]],
        seeds: int | Sequence[int] = 20,
        progress: Progress | None = None,
        *,
        workers: int | None = None,
        fast: bool = False,
        client: Client | None = None,
    ) -> Sweep:
        """Run all combinations of values of settings over seeds, on all processors.

        Runs that were done before are taken from a cache. An interrupt, or an exception raised by `progress`,
        ends the sweep; the runs that are done stay in the cache.

        Parameters
        ----------
        settings
            The values of each setting by its dotted path, such as
            ``{"sensors.gyro.noise_density": [0.01, 0.03, 0.1]}``, in the unit of the setting. ``"card"``
            takes cards, or their names: each brings its sensors and a filter that suits them, as `Card.load`
            does, in place of those of the experiment; other swept settings override it. ``"mission"`` takes
            names.
        seeds
            Number of runs of each combination, from the seed of the experiment on, or the seed of each; a
            sensor log has one.
        progress
            Called with a sentence about the current work and the fraction done, from 0 to 1; by default, a
            notebook shows a bar.
        workers
            Number of threads; by default one for each processor. There are fewer if so many runs at once do
            not fit into the memory.
        fast
            True propagates the covariance of the filter at 20 Hz, where no rate is set and no smoother needs
            it at every sample: σ differs by some 0.1 %.
        client
            A client of a Dask cluster, whose workers do the runs in place of this computer's threads. If the
            cluster is lost on the way, the runs that were done stay in the cache.

        Raises
        ------
        SettingError
            If there is no such setting or card, or it does not accept a value, or `fast` would override it.
        MissionError
            If the mission cannot be found or read.
        ValueError
            If there is no seed, or more than one for a log, or no thread, or no run is possible. If only
            some runs are impossible, their values are NaN, and `Sweep.refused` has the reasons.
        """
        with find("experiment", "progress")(progress) as tell:
            found: Sweep = find("experiment", "sweep")(
                self, settings, seeds, tell, workers, fast=fast, client=client
            )
        return found

    def outage(
        self,
        seconds: float = 60.0,
        cards: str | Sequence[str] | None = None,
        seeds: int | Sequence[int] = 100,
        wish: float | None = None,
        *,
        fast: bool = True,
        workers: int | None = None,
        progress: Progress | None = None,
        partial: Callable[[OutageTable], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        client: Client | None = None,
    ) -> OutageTable:
        """Return which errors outages of GPS leave, sensor by sensor; each run has one outage.

        The begins are spread evenly over the flight after the filter has converged. Up to eight seeds share a
        begin, and all sensors have the same seeds and begins. Outages of the settings have no effect.

        For a sensor log, the fixes are withheld for `seconds`, from one begin to the next three times as
        long, and in three turns, so that all of the log is covered. The errors are the differences from the
        last withheld fix of each. `seeds`, `fast` and `workers` have no effect on a log.

        Parameters
        ----------
        seconds
            Length of an outage [s], 1 or more.
        cards
            Names of sensor cards, or ``"all"``: each is loaded with the filter that suits it, and gives a
            row. By default the sensors and the filter of the settings.
        seeds
            Number of runs with each sensor, from the seed of the experiment on, or the seed of each.
        wish
            Horizontal error that 95 % of the outages shall not exceed [m]. A sensor whose 95 % is too close
            to it gets up to four times as many runs.
        fast
            Whether the covariance is propagated 20 times a second, unless the settings give another rate.
        workers
            Number of threads; by default one for each processor, or as many runs as fit into the memory.
        progress
            Called with a sentence about the current work and the fraction done, from 0 to 1; by default, a
            notebook shows a bar. An exception that it raises ends the work.
        partial
            Called every two seconds with the table of the runs that are done.
        cancelled
            Asked ten times a second; once it says so, no further run begins, and the table is that of the
            runs that are done.
        client
            A client of a Dask cluster, whose workers do the runs in place of this computer's threads, but for
            a log. If the cluster is lost on the way, `OutageTable.ended` says so, and the table is that of
            the runs that were done.

        Raises
        ------
        SettingError
            If there is no such card, or no sensor can run with these settings; if only some are refused,
            their rows say why.
        MissionError
            If the mission cannot be found or read.
        ValueError
            If a number is not accepted, or the outage does not fit into the flight or the log.
        """
        with find("experiment", "progress")(progress) as tell:
            told = {"progress": tell, "partial": partial, "cancelled": cancelled, "client": client}
            found: OutageTable = find("experiment", "outage")(
                self, seconds, cards, seeds, wish, fast=fast, workers=workers, **told
            )
        return found

    def __repr__(self) -> str:
        changed = sum(map(is_changed, self.leaves()))
        return f"<Experiment: mission {self.mission}, seed {self.seed}, {changed} settings not default>"
