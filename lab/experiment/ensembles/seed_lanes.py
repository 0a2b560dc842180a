"""Seed lanes: runs of one experiment with many seeds, eight abreast, as far as this gives the same runs.

Flight, settings and times are those of all runs, and computed once. Draws and sensors are those of a single
run, so that each run of an ensemble is the run of its seed alone, within rounding. A run that needs more,
such as the causes of outliers or updates at rest, is left to a run of its own.
"""

from __future__ import annotations

import copy
import math
import threading
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lab.analysis import fix_figures
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.innovation_evidence import needs_explanation
from lab.base.arrays import FloatArray
from lab.base.histories import LONG
from lab.base.parameters.units import si
from lab.experiment.ensembles import lane_sensors
from lab.experiment.ensembles.lane_draws import seeds_abreast
from lab.experiment.ensembles.lane_results import LaneResults
from lab.experiment.ensembles.lane_runs import Navigated, Samples, Sensed
from lab.experiment.ensembles.lane_sensors import SensorRoom, can_sense, triads
from lab.experiment.ensembles.run_at_fixes import RunAtFixes
from lab.experiment.experiment import Experiment
from lab.experiment.sensor_stages import SampledFlight, SensorStages
from lab.experiment.stages import draw_starts
from lab.missions import LogMission, mission
from lab.navigation.aiding import needs_rest
from lab.navigation.alignment import rest_alignment
from lab.navigation.belief import (
    assumed_latency,
    belief,
    chosen_blocks,
    is_aided,
    of_bias_states,
    schedule_filter,
)
from lab.navigation.checks import check_bias_decay
from lab.navigation.filters.blocks import CONSIDERED, SCALES
from lab.navigation.kernels.lane_views import LANES
from lab.navigation.kernels.lanes import Lane, LaneSolution, can_batch, is_compiled, navigate_lanes
from lab.navigation.model_choice import chosen_model
from lab.navigation.solution import NO_VECTOR, Fixes, Start
from lab.navigation.standstill import at_rest
from lab.navigation.strapdown import MAX_LATITUDE
from lab.sensors import gps, imu

__all__ = ["LANES", "SeedLanes"]

T = TypeVar("T")

LARGEST_TURN = 0.4
"""Largest rotation within a sample for runs abreast [rad]; the series of their rotation holds up to 0.5."""


class SeedLanes:
    """The runs of an experiment with many seeds, eight abreast; see `of`.

    Parameters
    ----------
    experiment
        The experiment; its seed has no effect.
    along
        Whether σ of the filter is asked for along the path, as `figures` does.
    room
        Memory of each thread for the sensors, which other runs may share, one after the other.
    """

    def __init__(
        self, experiment: Experiment, *, along: bool = False, room: threading.local | None = None
    ) -> None:
        self._stages = SensorStages(experiment.copy(), mission(experiment.mission))
        self._sensors, self._navigator = self._stages.sensors, self._stages.navigator
        flight = self._stages.kept_flight()
        self._flight, self._truth, self._ideal = flight, flight.truth, flight.ideal
        self._model = chosen_model(self._navigator, self._sensors)
        self._of_bias_states = of_bias_states(self._sensors, self._navigator)
        self._belief = belief(self._sensors, self._navigator)
        self._schedule = schedule_filter(self._navigator, self._ideal.dt, self._ideal.dtheta.shape[0])
        self._room = threading.local() if room is None else room
        self._withheld: list[tuple[float, float]] = []
        self._true_start = Start.off(self._truth, NO_VECTOR, NO_VECTOR, NO_VECTOR)
        self._latency = assumed_latency(self._navigator, self._sensors.gps.latency)
        self._fix_truth, self._seen = self._stages.fix_truth(flight)
        self._results = LaneResults(
            self._stages.experiment, self._model, flight, self._fix_truth.time, along=along
        )

    @classmethod
    def of(
        cls, experiment: Experiment, *, along: bool = False, room: threading.local | None = None
    ) -> SeedLanes | None:
        """Return the runs of an experiment; None if runs abreast would not be those of its seeds alone."""
        navigator, sensors = experiment.navigator, experiment.sensors
        if (
            isinstance(mission(experiment.mission), LogMission)
            or navigator.model == "nonlinear"
            or navigator.engine != "compiled"
            or navigator.smoother
            or sensors.own_errors
            or experiment.hidden
            or is_aided(navigator, sensors)
            or set(chosen_blocks(navigator, sensors)) - {*SCALES, *CONSIDERED}
        ):
            return None
        found = cls(experiment, along=along, room=room)
        usable = (
            can_batch(found._model, found._schedule, found._belief)
            and found._truth.time.size <= LONG
            and np.abs(found._truth.latitude).max() < MAX_LATITUDE
        )
        return found if usable else None

    @property
    def is_compiled(self) -> bool:
        """Whether these runs need not wait for a compiler."""
        return self.is_ready and fix_figures.is_ready()

    @property
    def is_ready(self) -> bool:
        """Whether `navigate` needs not wait for a compiler."""
        both = (self._sensors.gyro, self._sensors.accelerometer)
        plain = any(can_sense(errors, self._sensors) for errors in both)
        ready = is_compiled(self._model, summed=self._schedule.stride > 1)
        return ready and (lane_sensors.is_ready() or not plain)

    def during(self, outage: tuple[float, float], until: float, room: threading.local) -> SeedLanes:
        """Return these runs with an outage, and up to a time [s]; for `navigate` alone.

        The `room` keeps the memory that each thread needs for the next runs, also those of other sensors.
        """
        found = copy.copy(self)
        found._flight = _cut_flight(self._flight, until)
        found._truth, found._ideal = found._flight.truth, found._flight.ideal
        found._withheld, found._room = [outage], room
        return found

    def run(self, seeds: Sequence[int], *, explain: bool = False) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds, with their evidence; a run is None if it must be run alone.

        Parameters
        ----------
        seeds
            The seeds.
        explain
            Whether suspicious innovations are to be explained: such a run must be run alone.
        """
        for found in self._run_seeds(seeds, judged=True):
            asked = found is not None and explain and needs_explanation(_require_evidence(found).innovations)
            yield None if asked else found

    def measure(self, seeds: Sequence[int]) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds as `run` does, without evidence; a run is None if it must be run alone.

        Parameters
        ----------
        seeds
            The seeds.
        """
        return self._run_seeds(seeds, judged=False)

    def figures(self, seeds: Sequence[int]) -> Iterator[FloatArray | None]:
        """Return what a sweep keeps of up to eight seeds; None of a run that must be run alone.

        Parameters
        ----------
        seeds
            The seeds.
        """
        return self._navigated(seeds, self._results.figures)

    def navigate(self, seeds: Sequence[int], samples: Samples) -> list[LaneSolution | None]:
        """Navigate up to eight seeds; of each, only the solution at some samples is computed.

        Parameters
        ----------
        seeds
            The seeds.
        samples : (k,) array
            The samples, increasing.

        Returns
        -------
        list of LaneSolution or None
            The solution of each seed; None if it must be run alone.
        """
        room = self._sensor_room()
        sensed = self._sense(seeds, room)
        usable = self._find_usable_runs(sensed)
        if not usable:
            return [None] * len(seeds)
        found = self._navigate(sensed, usable, room.increments, samples)
        return [one if index in usable else None for index, one in enumerate(found)]

    def _find_usable_runs(self, sensed: Sequence[Sensed]) -> list[int]:
        """Return the runs that can be abreast."""
        return [
            index
            for index, one in enumerate(sensed)
            if not (self._turns_too_fast(one) or self._would_rest(one))
        ]

    def _run_seeds(self, seeds: Sequence[int], *, judged: bool) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds, and return what is kept of each."""

        def kept(runs: Sequence[Navigated], seconds: float) -> list[RunAtFixes | None]:
            if judged:
                return self._results.judged(runs, seconds, self._sensor_room().increments)
            return self._results.kept(runs, seconds)

        return self._navigated(seeds, kept)

    def _navigated(
        self, seeds: Sequence[int], kept: Callable[[Sequence[Navigated], float], Sequence[T | None]]
    ) -> Iterator[T | None]:
        """Run up to eight seeds, and return what a function keeps of those that can be abreast.

        The function takes these, and the computing time of each [s].
        """
        room = self._sensor_room()
        sensed = self._sense(seeds, room)
        usable = self._find_usable_runs(sensed)
        found: dict[int, T | None] = {}
        if usable:
            began = clock.perf_counter()
            solutions = self._navigate(sensed, usable, room.increments)
            seconds = (clock.perf_counter() - began) / len(usable)
            runs = [(index, sensed[index], solutions[index]) for index in usable]
            found = dict(zip(usable, kept(runs, seconds), strict=True))
        return (found.get(index) for index in range(len(seeds)))

    def _sensor_room(self) -> SensorRoom:
        """Return room for the sensors of a block, kept for each thread."""
        samples = self._ideal.dtheta.shape[0]
        kept: SensorRoom | None = getattr(self._room, "sensors", None)
        if kept is None or kept.samples < samples:
            kept = self._room.sensors = SensorRoom(samples)
        return kept.part(samples)

    def _sense(self, seeds: Sequence[int], room: SensorRoom) -> list[Sensed]:
        """Simulate the sensors of some runs; the room is written, and referred to."""
        navigator, sensors, truth = self._navigator, self._sensors, self._truth
        abreast = seeds_abreast(seeds)
        begun = draw_starts(truth, navigator, abreast)
        aligned = [self._aligned(one, seed) for one, seed in zip(begun, seeds, strict=True)]
        gyros = self._triads("gyro", seeds, [bias for _, bias, _ in aligned], room)
        accelerometers = self._triads("accelerometer", seeds, [NO_VECTOR] * len(seeds), room)
        found = []
        for seed, drawn, (own, _, P), gyro, accelerometer in zip(
            seeds, abreast, aligned, gyros, accelerometers, strict=True
        ):
            assumed = self._belief if P is None else belief(sensors, navigator, P, self._of_bias_states)
            constants = None if P is None else np.diag(P)
            draws = gps.GpsDraws.of(drawn, self._fix_truth.time.size, sensors.gps)
            fixes = gps.measure(self._fix_truth, sensors.gps, draws, self._seen)
            if self._withheld:
                kept = ~gps.mask_within(self._withheld, fixes.time)
                fixes = gps.GpsFixes(*(part[kept] for part in fixes))
            seen = Fixes(fixes.time - self._latency, fixes.position, fixes.velocity_n)
            check_bias_decay(self._schedule.stride * self._ideal.dt, assumed.decay)
            found.append(Sensed(seed, own, assumed, constants, gyro, accelerometer, fixes, seen))
        return found

    def _aligned(self, begun: Start, seed: int) -> tuple[Start, FloatArray, FloatArray | None]:
        """Return start, found gyro bias and covariance of a run after its alignment, if it has one."""
        if not self._navigator.alignment:
            return begun, NO_VECTOR, None
        found = rest_alignment.align_simulated(
            begun, self._true_start, self._sensors, self._navigator, seed, single=self._of_bias_states
        )
        return found.start, found.gyro_bias, found.P

    def _triads(
        self, sensor: str, seeds: Sequence[int], found: Sequence[FloatArray], room: SensorRoom
    ) -> list[imu.Measured]:
        """Simulate the gyros or the accelerometers of some runs, minus the bias that an alignment found."""
        errors = self._sensors.groups()[sensor]
        assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
        if can_sense(errors, self._sensors):
            return triads(seeds, errors, self._sensors, self._flight, found, room)
        measured, increments = [], room.increments
        own = slice(0, 3) if sensor == "gyro" else slice(3, 6)
        for lane, (seed, bias) in enumerate(zip(seeds, found, strict=True)):
            one = self._stages.measured_with(sensor, self._flight, seed, bias)
            increments[:, own, lane] = one.increments
            measured.append(one)
        # The kernel computes all eight lanes: those without a seed repeat the last one, and stay harmless.
        increments[:, own, len(seeds) :] = increments[:, own, len(seeds) - 1 : len(seeds)]
        return measured

    def _turns_too_fast(self, one: Sensed) -> bool:
        """Return whether the gyros show a rotation within a sample that may be too large for runs abreast."""
        largest = float(si(self._sensors.gyro, "range")) * self._ideal.dt
        # A gyro that saturates below the limit needs no search of its samples.
        if largest >= LARGEST_TURN:
            # Three components at most, each as large as the largest.
            largest = math.sqrt(3) * max(float(one.gyro.increments.max()), -float(one.gyro.increments.min()))
        # Written so that NaN counts as too fast.
        return not largest < LARGEST_TURN

    def _would_rest(self, one: Sensed) -> bool:
        """Return whether the filter would find that the vehicle stands still."""
        return needs_rest(self._navigator) and bool(
            at_rest(one.imu(self._truth.time), one.seen, one.belief).any()
        )

    def _navigate(
        self,
        sensed: Sequence[Sensed],
        usable: Sequence[int],
        increments: FloatArray,
        samples: Samples | None = None,
    ) -> list[LaneSolution]:
        """Navigate a block; in the place of a run that is not usable, another is navigated."""
        lanes = []
        for index in range(len(sensed)):
            own = index if index in usable else usable[0]
            if own != index:
                increments[:, :, index] = increments[:, :, own]
            one = sensed[own]
            lanes.append(Lane(one.fixes.position, one.fixes.velocity_n, one.start, one.belief))
        return navigate_lanes(
            self._truth.time,
            increments,
            sensed[0].seen.time,
            lanes,
            self._schedule,
            self._model,
            self._results.stored if samples is None else samples,
            self._results.path if samples is None else samples,
        )


def _cut_flight(flight: SampledFlight, end: float) -> SampledFlight:
    """Return a flight up to the first sample that is not before a time [s]."""
    samples = int(np.searchsorted(flight.ideal.time, end)) + 1
    if samples >= flight.ideal.time.size:
        return flight
    return replace(flight, truth=flight.truth.taken(slice(samples)), ideal=flight.ideal.part(0, samples))


def _require_evidence(run: RunAtFixes) -> Evidence:
    """Return the evidence of a run that is judged."""
    assert run.evidence is not None
    return run.evidence
