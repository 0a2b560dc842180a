"""Stages: one run computed from its settings in cached stages into a `SimulatedResult`.

Each stage is cached by the content of the settings on which it depends. A change of R recomputes only the
navigation; a change of a gyro's noise does not recompute the flight, the accelerometers or the fixes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.cache import digest
from lab.base.histories import LONG, SINGLE, shrink_history
from lab.base.parameters.units import si
from lab.base.progress import Progress
from lab.experiment.log_run import time_navigation
from lab.experiment.result import Runnable
from lab.experiment.sensor_stages import CACHE, SensorStages
from lab.experiment.simulated_navigation import navigate_simulated
from lab.experiment.simulated_result import SimulatedResult
from lab.missions import Mission
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.algorithm import Algorithm, run_algorithm
from lab.navigation.alignment import rest_alignment
from lab.navigation.alignment.rest_alignment import Aligned
from lab.navigation.belief import (
    belief,
    chosen_blocks,
)
from lab.navigation.filters.user_states import declared_states
from lab.navigation.model_choice import is_missing, is_ready
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start
from lab.run.memory import Retiring, give_back, large_blocks_given_back
from lab.run.run import in_one
from lab.sensors import gps
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.readings import Readings
from lab.sensors.suite import SensorSuite

_COMMAND = (
    "import json, sys; from lab.experiment.variants import compile_variant; "
    "compile_variant(json.load(sys.stdin))"
)
"""What another process does: the compiler keeps some 200 MB of a filter and its smoother in the process that
compiled them. The code itself is loaded from the disk, and takes a fifth of that."""


class Stages(SensorStages):
    """One computation of an experiment: its stages, each with the key of all its inputs.

    Parameters
    ----------
    experiment
        The settings, which do not change any more.
    found
        The mission that they name.
    progress
        As of `Experiment.run`.
    algorithm
        The user's navigator, if one takes the place of that of the settings.
    """

    hidden = ""
    """What changes the navigation besides the settings, as a part of its key; nothing."""

    def __init__(
        self, experiment: Runnable, found: Mission, progress: Progress, algorithm: Algorithm | None = None
    ) -> None:
        super().__init__(experiment, found)
        self.algorithm = algorithm
        self.progress = progress
        self._retiring: tuple[Retiring, ...] = ()

    def result(self) -> SimulatedResult:
        """Compute the stages in order."""
        self.progress("Reading the flight", 0.0)
        with ExitStack() as run:
            return self._result(run)

    def _result(self, run: ExitStack) -> SimulatedResult:
        flight = self.kept_flight()
        run.enter_context(large_blocks_given_back(flight.truth.time.size))
        self.progress("Simulating the sensors", 0.3)
        aligned = self.begin(flight.trajectory.at(0.0))
        fixes, readings = self.fixes(flight), self.readings(flight)
        gyro = self.triad("gyro", flight, aligned.gyro_bias)
        accelerometer = self.triad("accelerometer", flight)
        # The curve and its exact increments are not needed any more.
        truth, ideal = flight.truth, flight.ideal.as_kept()
        del flight
        is_long = truth.time.size > LONG
        if is_long:
            gyro, accelerometer = in_one(gyro, accelerometer)
            self._retiring = Retiring(gyro.increments), Retiring(accelerometer.increments)
            give_back()
        self._prepare_navigator(truth.time.size, ideal.dt)
        assumed = self.belief(aligned)
        (solution, aids), seconds = self._navigate_start(
            truth,
            ideal.dt,
            gyro.increments,
            accelerometer.increments,
            fixes,
            aligned.start,
            assumed,
            readings,
        )
        if is_long:
            # The navigator is done with the exact increments, and a smoother with copies of its filter.
            give_back()
            gyro, accelerometer = (
                triad._replace(increments=shrink_history(triad.increments) if one.left else one.kept)
                for triad, one in zip((gyro, accelerometer), self._retiring, strict=True)
            )
            self._retiring = ()
            give_back()
        self.progress("Done", 1.0)
        return SimulatedResult(
            experiment=self.experiment,
            mission=self.mission,
            truth_arrays=truth,
            ideal=ideal,
            gyro=gyro,
            accelerometer=accelerometer,
            fixes=fixes,
            belief=assumed,
            solution_arrays=solution,
            aligned=aligned,
            seconds=seconds,
            algorithm="" if self.algorithm is None else type(self.algorithm).__name__,
            blocks=() if self.algorithm is not None else chosen_blocks(self.navigator, self.sensors),
            aids=aids,
            readings=readings,
        )

    def _prepare_navigator(self, samples: int, dt: float) -> None:
        """Report the navigation, and compile the filter of a long flight in a process of its own."""
        ready = self.algorithm is not None or is_ready(self.navigator, self.sensors)
        self.progress("Navigating" if ready else "Preparing the navigator (compiled once)", 0.4)
        if self.algorithm is None and samples > SINGLE:
            compile_apart(self.navigator, self.sensors, 1 / dt)

    def _navigate_start(
        self,
        truth: Truth,
        dt: float,
        dtheta: FloatArray,
        dvelocity: FloatArray,
        fixes: gps.GpsFixes,
        start: Start,
        assumed: Belief,
        readings: Mapping[str, Readings],
    ) -> tuple[tuple[Solution, Aids], float]:
        """Return the solution with the measurements besides GPS, and its computing time [s].

        It is computed once for all experiments with the same settings; a user's algorithm runs every time.
        """
        increments = Imu(truth.time, dtheta, dvelocity)
        if self.algorithm is not None:
            return time_navigation(lambda: self.user_solution(increments, fixes, start))
        names = chosen_blocks(self.navigator, self.sensors)
        own = [one.block for one in declared_states(self.sensors.own_errors, "sensors.own_errors")]
        parts = self.sensors.to_dict(), self.navigator.to_dict(), names, own
        key = digest(self.flight_key, self.experiment.seed, *parts, self.hidden)

        def navigated() -> tuple[Solution, Aids]:
            self.check_memory(truth.time.size)
            return navigate_simulated(
                self.experiment,
                increments,
                dt,
                fixes,
                start,
                assumed,
                readings,
                truth.latitude,
                lambda done: self.progress("Navigating", 0.4 + 0.6 * done),
                self._retire,
            )

        return CACHE.get("navigation", key, lambda: time_navigation(navigated))

    def begin(self, truth: Truth) -> Aligned:
        """Return the start of the navigator, after its alignment if it has one."""
        return begin(truth, self.experiment)

    def belief(self, aligned: Aligned) -> Belief:
        """Return what the filter assumes."""
        return belief(self.sensors, self.navigator, aligned.P if self.navigator.alignment else None)

    def user_solution(self, increments: Imu, fixes: gps.GpsFixes, begin: Start) -> tuple[Solution, Aids]:
        """Navigate with the user's algorithm, which gets no measurements besides GPS."""
        assert self.algorithm is not None
        seen = Fixes(fixes.time, fixes.position, fixes.velocity_n)
        return run_algorithm(self.algorithm, increments, seen, begin), NO_AIDS

    def _retire(self, first: int) -> None:
        """Keep the increments of a long flight from number `first` on in float32: the smoother used them."""
        for one in self._retiring:
            one.retire(first)


def start(truth: Truth, settings: NavigatorSettings, seed: int) -> Start:
    """Return the assumed start before any alignment: the truth plus the initial error.

    Parameters
    ----------
    truth
        The flight; its first sample is used.
    settings
        The given initial errors, and the standard deviations of the drawn ones.
    seed
        Seed of the run.
    """
    return draw_starts(truth, settings, [seed])[0]


def draw_starts(truth: Truth, settings: NavigatorSettings, seeds: Sequence[Seed]) -> list[Start]:
    """Return the assumed starts of the runs of some seeds; see `start`."""
    draws = np.stack([unit_draws(seed, "initial error", (9,)) for seed in seeds])
    position, velocity, attitude = (
        si(settings, f"{name}_error") + si(settings, f"{name}_sigma") * draws[:, first : first + 3]
        for first, name in ((0, "position"), (3, "velocity"), (6, "attitude"))
    )
    return Start.each_off(truth, position, velocity, attitude)


def begin(truth: Truth, experiment: Runnable) -> Aligned:
    """Return the start of an experiment's navigator, after its alignment if it has one.

    Parameters
    ----------
    truth
        The flight; its first sample is used.
    experiment
        Sensors, navigator and seed.
    """
    sensors, navigator, seed = experiment.sensors, experiment.navigator, experiment.seed
    nothing = np.zeros(3)
    true = Start.off(truth, nothing, nothing, nothing)
    return rest_alignment.align_simulated(start(truth, navigator, seed), true, sensors, navigator, seed)


def compile_apart(navigator: NavigatorSettings, sensors: SensorSuite, rate: float) -> None:
    """Compile the filter of a long flight in another process, into the cache on the disk, if it is not there.

    If that fails, nothing happens: this process then compiles the filter when it needs it.

    Parameters
    ----------
    navigator, sensors
        The settings.
    rate
        Rate of the samples [Hz].
    """
    if not sys.executable or not is_missing(navigator, sensors, rate):
        return
    groups = {"navigator": navigator.to_dict(), "sensors": sensors.to_dict()}
    subprocess.run(
        [sys.executable, "-c", _COMMAND],
        input=json.dumps({"trajectory.imu_rate": rate, **groups}),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        text=True,
        check=False,
    )
