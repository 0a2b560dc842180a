"""Seed lanes: runs of one experiment with many seeds, eight abreast, as far as this gives the same runs.

Flight, settings and times are those of all runs, and computed once. Draws and sensors are those of a single
run, so that each run of an ensemble is the run of its seed alone, within rounding. A run that needs more,
such as the causes of outliers or updates at rest, is left to a run of its own.
"""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, fix_causes, fix_figures
from lab.analysis.errors import path_of
from lab.analysis.feedforward import CORRECTED
from lab.analysis.fix_figures import FixFigures, TruthArrays
from lab.analysis.verdicts.evidence import Evidence, evidence, whole_seconds
from lab.analysis.verdicts.innovation_evidence import may_have_outliers, needs_explanation, offered
from lab.analysis.verdicts.sensor_evidence import Exact, Reference, exacts, sensor_errors, window_means
from lab.base.arrays import FloatArray
from lab.base.histories import LONG
from lab.base.parameters.units import si
from lab.experiment.ensembles import lane_sensors
from lab.experiment.ensembles.lane_sensors import are_constant, constant_triads, empty_increments
from lab.experiment.ensembles.run_at_fixes import ChannelSums, RunAtFixes
from lab.experiment.experiment import Experiment
from lab.experiment.stages import Stages, start
from lab.missions import LogMission, mission
from lab.navigation.aiding import needs_rest
from lab.navigation.alignment import rest_alignment
from lab.navigation.belief import (
    assumed_latency,
    belief,
    bias_processes,
    chosen_blocks,
    hidden_by_fixes,
    is_aided,
    schedule_of,
)
from lab.navigation.filters.blocks import SCALES
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import SLACK
from lab.navigation.kernels.lane_step import LANES
from lab.navigation.kernels.lanes import Lane, LaneSolution, can_batch, is_compiled, navigate_lanes
from lab.navigation.model_choice import chosen_model
from lab.navigation.solution import NO_VECTOR, Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import at_rest
from lab.navigation.strapdown import MAX_LATITUDE
from lab.run.run import at_samples
from lab.sensors import gps, imu
from lab.sensors import temperature as thermal

__all__ = ["LANES", "SeedLanes"]

Samples = NDArray[np.int64]

LARGEST_TURN = 0.4
"""Largest rotation within a sample for runs abreast [rad]; the series of their rotation holds up to 0.5."""


class _Sensed(NamedTuple):
    """What the sensors of one run measured, and what its filter assumes."""

    start: Start
    belief: Belief
    constants: FloatArray | None
    gyro: imu.Measured
    accelerometer: imu.Measured
    fixes: gps.GpsFixes


class SeedLanes:
    """The runs of an experiment with many seeds, eight abreast; see `of`.

    Parameters
    ----------
    experiment
        The experiment; its seed has no effect.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._stages = Stages(experiment.copy(), mission(experiment.mission), lambda _stage, _done: None)
        self._sensors, self._navigator = self._stages.sensors, self._stages.navigator
        flight = self._stages.kept_flight()
        self._flight, self._truth, self._ideal = flight, flight.truth, flight.ideal
        self._model = chosen_model(self._navigator, self._sensors)
        self._belief = belief(self._sensors, self._navigator)
        self._drive = bias_processes(self._sensors)[0]
        self._hidden = np.append(np.zeros(3), hidden_by_fixes(self._sensors))
        self._schedule = schedule_of(self._navigator, self._ideal.dt, self._ideal.dtheta.shape[0])
        self._exact: tuple[Exact, Exact] | None = None
        self._room = threading.local()
        self._span = float(self._truth.time[0]), float(self._truth.time[-1])
        self._true_start = Start.off(self._truth, NO_VECTOR, NO_VECTOR, NO_VECTOR)
        self._lay_out()

    @classmethod
    def of(cls, experiment: Experiment) -> SeedLanes | None:
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
            or set(chosen_blocks(navigator, sensors)) - set(SCALES)
        ):
            return None
        found = cls(experiment)
        turn = float(si(sensors.gyro, "range")) * found._ideal.dt
        usable = (
            can_batch(found._model, found._schedule, found._belief)
            and found._truth.time.size <= LONG
            and turn < LARGEST_TURN
            and np.abs(found._truth.latitude).max() < MAX_LATITUDE
        )
        return found if usable else None

    def _lay_out(self) -> None:
        """Find the samples to store, which are those of all runs."""
        time, dt = self._truth.time, self._ideal.dt
        latency = assumed_latency(self._navigator, self._sensors.gps.latency)
        self._fix_truth, self._seen = self._stages.fix_truth(self._flight)
        fixed = np.searchsorted(time, self._fix_truth.time - latency - SLACK * dt)
        fixed = fixed[(fixed > 0) & (fixed < time.size)]
        seconds = whole_seconds(time)
        self._before = np.maximum(seconds - 1, 1)
        ends = np.array([0, min(1, time.size - 1), time.size - 1])
        self._stored = np.unique(np.concatenate((ends, fixed - 1, fixed, seconds, self._before)))
        self._width = fix_causes.window_width(time)
        self._grid = path_of(time, float(self._sensors.gps.period))
        first = np.maximum(fixed - 1 - self._width, 0)
        self._path = np.unique(np.concatenate((self._grid, self._stored, first)))
        self._of_grid = np.searchsorted(self._path, self._grid)
        self._of_before = np.searchsorted(self._stored, self._before)
        self._there = self._truth.taken(self._stored)
        self._true_there = TruthArrays.of(self._there)
        self._on_grid = self._truth.taken(self._grid)
        self._true_path = TruthArrays.of(self._on_grid)
        profile = self._sensors.temperature
        self._temperature = (
            thermal.temperature(profile, time[1:], self._truth.height[1:] - self._truth.height[0])
            if profile.profile != "none"
            else None
        )

    @property
    def is_compiled(self) -> bool:
        """Whether these runs need not wait for a compiler."""
        triads = (self._sensors.gyro, self._sensors.accelerometer)
        plain = any(are_constant(errors, self._sensors) for errors in triads)
        ready = is_compiled(self._model) and fix_figures.is_ready()
        return ready and (lane_sensors.is_ready() or not plain)

    def run(self, seeds: Sequence[int], *, explain: bool = False) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds, with their evidence; a run is None if it must be run alone.

        Parameters
        ----------
        seeds
            The seeds.
        explain
            Whether suspicious innovations are to be explained: such a run must be run alone.
        """
        for found in self._each(seeds, judged=True):
            asked = found is not None and explain and needs_explanation(_evidence_of(found).innovations)
            yield None if asked else found

    def measure(self, seeds: Sequence[int]) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds as `run` does, without evidence; a run is None if it must be run alone.

        Parameters
        ----------
        seeds
            The seeds.
        """
        return self._each(seeds, judged=False)

    def _each(self, seeds: Sequence[int], *, judged: bool) -> Iterator[RunAtFixes | None]:
        """Run up to eight seeds, and return what is kept of each."""
        increments = self._increments()
        sensed = self._sense(seeds, increments)
        first, usable = sensed[0].belief, []
        for index, one in enumerate(sensed):
            same = np.array_equal(one.belief.noise, first.noise) and np.array_equal(
                one.belief.decay, first.decay
            )
            if same and not self._rests(one):
                usable.append(index)
        found: dict[int, RunAtFixes | None] = {}
        if usable:
            began = clock.perf_counter()
            solutions = self._navigate(sensed, usable, increments)
            seconds = (clock.perf_counter() - began) / len(usable)
            means = self._means(increments) if judged else None
            for index in usable:
                own = None if means is None else (means[0][..., index], means[1][..., index])
                found[index] = self._kept(sensed[index], solutions[index], seconds, own)
        return (found.get(index) for index in range(len(seeds)))

    def _increments(self) -> FloatArray:
        """Return room for the increments of a block, kept for each thread: new memory takes time."""
        if not hasattr(self._room, "increments"):
            self._room.increments = empty_increments(self._ideal.dtheta.shape[0])
        found: FloatArray = self._room.increments
        return found

    def _sense(self, seeds: Sequence[int], increments: FloatArray) -> list[_Sensed]:
        """Simulate the sensors of some runs; their `increments` are written, and referred to."""
        navigator, sensors, truth = self._navigator, self._sensors, self._truth
        aligned = [self._aligned(start(truth, navigator, seed), seed) for seed in seeds]
        gyros = self._triads("gyro", seeds, [bias for _, bias, _ in aligned], increments)
        accelerometers = self._triads("accelerometer", seeds, [NO_VECTOR] * len(seeds), increments)
        found = []
        for seed, (begun, _, P), gyro, accelerometer in zip(
            seeds, aligned, gyros, accelerometers, strict=True
        ):
            assumed = self._belief if P is None else belief(sensors, navigator, P)
            constants = None if P is None else np.diag(P)
            draws = gps.GpsDraws.of(seed, self._fix_truth.time.size)
            fixes = gps.measure(self._fix_truth, sensors.gps, draws, self._seen)
            found.append(_Sensed(begun, assumed, constants, gyro, accelerometer, fixes))
        return found

    def _aligned(self, begun: Start, seed: int) -> tuple[Start, FloatArray, FloatArray | None]:
        """Return start, found gyro bias and covariance of a run after its alignment, if it has one."""
        if not self._navigator.alignment:
            return begun, NO_VECTOR, None
        found = rest_alignment.begin(begun, self._true_start, self._sensors, self._navigator, seed)
        return found.start, found.gyro_bias, found.P

    def _triads(
        self, sensor: str, seeds: Sequence[int], found: Sequence[FloatArray], increments: FloatArray
    ) -> list[imu.Measured]:
        """Simulate the gyros or the accelerometers of some runs, minus the bias that an alignment found."""
        errors = self._sensors.groups()[sensor]
        assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
        if are_constant(errors, self._sensors):
            ideal = self._ideal.dtheta if sensor == "gyro" else self._ideal.dvelocity
            return constant_triads(seeds, errors, ideal, self._ideal.dt, found, increments)
        measured = []
        own = slice(0, 3) if sensor == "gyro" else slice(3, 6)
        for lane, (seed, bias) in enumerate(zip(seeds, found, strict=True)):
            one = self._stages.measured_with(sensor, self._flight, seed, bias)
            increments[:, own, lane] = one.increments
            measured.append(one)
        increments[:, own, len(seeds) :] = increments[:, own, len(seeds) - 1 : len(seeds)]
        return measured

    def _imu(self, one: _Sensed) -> Imu:
        return Imu(self._truth.time, one.gyro.increments, one.accelerometer.increments)

    def _fixes(self, one: _Sensed) -> Fixes:
        latency = assumed_latency(self._navigator, self._sensors.gps.latency)
        return Fixes(one.fixes.time - latency, one.fixes.position, one.fixes.velocity_n)

    def _rests(self, one: _Sensed) -> bool:
        """Return whether the filter would find that the vehicle stands still."""
        return needs_rest(self._navigator) and bool(
            at_rest(self._imu(one), self._fixes(one), one.belief).any()
        )

    def _navigate(
        self, sensed: Sequence[_Sensed], usable: Sequence[int], increments: FloatArray
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
            self._fixes(sensed[0]).time,
            lanes,
            self._schedule,
            self._model,
            self._stored,
            self._path,
        )

    def _means(self, increments: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean increments (windows, 6, LANES) in the windows of the tests of the sensors."""
        short, long = self._moved()
        means = window_means(increments, short)
        return means, means if long is short else window_means(increments, long)

    def _kept(
        self,
        one: _Sensed,
        navigated: LaneSolution,
        seconds: float,
        means: tuple[FloatArray, FloatArray] | None,
    ) -> RunAtFixes | None:
        """Return what is kept of a run; None if it must be run alone: for an outlier, or as it diverged.

        A run is judged if the means of its increments (windows, 6) are given.
        """
        if _diverged(navigated):
            return None
        solution = self._in_stored(navigated.solution)
        judged = None if means is None else self._evidence(one, solution, navigated, means)
        if means is not None and judged is None:
            return None
        found = self._figures(one, solution, navigated.motion)
        used = solution.fix_sample >= 0
        P, nu, S = _used(solution, used)
        nees = found.nees if np.isfinite(found.nees).all() else consistency.normalised_squares(found.x, P)
        nis = found.nis if np.isfinite(found.nis).all() else consistency.normalised_squares(nu, S)
        return RunAtFixes(
            time=one.fixes.time[used],
            nees=nees,
            nis=nis,
            grid=self._truth.time[self._before],
            between=found.between,
            between_degrees=3,
            error=found.error,
            sigma=found.sigma,
            rms=found.rms,
            largest=found.largest,
            degrees=int(consistency.uncertain(P).size) if P.size else 0,
            nis_degrees=MEASUREMENTS,
            innovations=ChannelSums.of_used(nu, S) if judged is None else ChannelSums.of(judged.innovations),
            span=self._span,
            evidence=judged,
            free=CORRECTED,
            seconds=seconds,
            algorithm="",
        )

    def _figures(self, one: _Sensed, solution: Solution, motion: FloatArray) -> FixFigures:
        """Return the figures of a run."""
        true = self._reference(one)
        scale = np.zeros((self._stored.size, 0)) if true.scale is None else true.scale
        path = np.ascontiguousarray(motion[self._of_grid])
        return fix_figures.fix_figures(
            solution, self._of_before, self._true_there, true.bias, scale, path, self._true_path
        )

    def _in_stored(self, solution: Solution) -> Solution:
        """Return a solution whose fixes tell their places among the stored samples."""
        at = np.searchsorted(self._stored, solution.fix_sample)
        return solution._replace(fix_sample=np.where(solution.fix_sample >= 0, at, -1))

    def _evidence(
        self,
        one: _Sensed,
        solution: Solution,
        navigated: LaneSolution,
        means: tuple[FloatArray, FloatArray],
    ) -> Evidence | None:
        """Return the evidence of a run; None if its innovations may have outliers, which need all samples."""
        fixes = self._fixes(one)
        stored = Imu(
            self._truth.time[self._stored], one.gyro.increments[:0], one.accelerometer.increments[:0]
        )
        seen, samples = offered(solution, fixes, stored)
        if may_have_outliers(solution.innovation[seen], solution.innovation_covariance[seen]):
            return None
        return evidence(
            solution,
            one.belief,
            fixes,
            stored,
            self._reference(one),
            gate=float(self._navigator.gate),
            latency=assumed_latency(self._navigator, self._sensors.gps.latency),
            explain=False,
            motion=self._motion(one, solution, navigated, samples),
            sensors=sensor_errors(
                one.belief, self._imu(one), self._whole_reference(one), self._moved(), means
            ),
        )

    def _motion(
        self, one: _Sensed, solution: Solution, navigated: LaneSolution, samples: Samples
    ) -> fix_causes.MotionAtFixes:
        """Return the motion at the fixes, whose places among the stored samples are given."""
        last = np.maximum(self._stored[samples] - 1, 0)
        first = np.maximum(last - self._width, 0)
        here = np.searchsorted(self._stored, last)
        before = navigated.motion[np.searchsorted(self._path, first)]
        return fix_causes.motion_of(
            self._truth.time,
            (first, last),
            (before[:, 3:6], solution.velocity_n[here]),
            solution.q_nb[here],
            one.gyro.increments,
            np.append(self._stored[samples], self._stored[-1]),
            navigated.force[np.append(samples, self._stored.size - 1)],
        )

    def _reference(self, one: _Sensed) -> Reference:
        """Return the truth at the stored samples, with that of the flight to interpolate in."""
        whole = self._whole_reference(one)
        scale = None if whole.scale is None else whole.scale[self._stored]
        return whole._replace(
            truth=self._there, bias=whole.bias[self._stored], scale=scale, flight=self._truth
        )

    def _moved(self) -> tuple[Exact, Exact]:
        """Return the true motion in windows, which is that of all runs."""
        if self._exact is None:
            ideal = self._ideal
            true = Reference(
                self._truth,
                self._truth.time[:0],
                ideal.dtheta,
                ideal.dvelocity,
                temperature=self._temperature,
            )
            self._exact = exacts(true, self._truth.time)
        return self._exact

    def _whole_reference(self, one: _Sensed) -> Reference:
        """Return the truth at all samples."""
        scaled = set(self._model.blocks) & set(SCALES)
        return Reference(
            self._truth,
            at_samples(one.gyro.bias, one.accelerometer.bias),
            self._ideal.dtheta,
            self._ideal.dvelocity,
            at_samples(one.gyro.scale, one.accelerometer.scale) if scaled else None,
            self._temperature,
            (one.gyro.saturated, one.accelerometer.saturated),
            self._drive if one.constants is None else bias_processes(self._sensors, one.constants)[0],
            hidden=self._hidden,
        )


def _evidence_of(run: RunAtFixes) -> Evidence:
    """Return the evidence of a run that is judged."""
    assert run.evidence is not None
    return run.evidence


def _used(solution: Solution, used: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return covariance, innovation and its covariance of the used fixes, without a copy if all are used."""
    every: Samples | slice = slice(None) if used.all() else np.flatnonzero(used)
    return (
        solution.fix_covariance[every],
        solution.innovation[every],
        solution.innovation_covariance[every],
    )


def _diverged(navigated: LaneSolution) -> bool:
    """Return whether a run is not finite, or came too close to a pole for its frame."""
    motion = navigated.motion
    finite = np.isfinite(motion).all() and np.isfinite(navigated.solution.variance).all()
    return not finite or bool(np.abs(motion[:, 0]).max() > MAX_LATITUDE)
