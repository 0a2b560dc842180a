"""Stages: one run computed from its settings in cached stages into a `SimulatedResult`.

Each stage is cached by the content of the settings on which it depends. A change of R recomputes only the
navigation; a change of a gyro's noise does not recompute the flight, the accelerometers or the fixes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.cache import StageCache, digest
from lab.base.histories import LONG, SINGLE, kept
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import si
from lab.base.progress import Progress
from lab.experiment.log_run import timed
from lab.experiment.result import Runnable
from lab.experiment.simulated_result import SimulatedResult
from lab.missions import Mission
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.navigation.aiding import aids_of, most_aids, needs_rest
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.algorithm import Algorithm, run_algorithm
from lab.navigation.alignment import rest_alignment
from lab.navigation.alignment.rest_alignment import Aligned
from lab.navigation.belief import (
    assumed_latency,
    belief,
    chosen_blocks,
    schedule_of,
)
from lab.navigation.checks import (
    check_bias_decay,
    check_engine,
    check_finite,
    check_mechanization,
    check_own_states,
    check_place,
    check_r,
    check_smoother,
    diverged,
)
from lab.navigation.filters import blocks, smoother, unscented
from lab.navigation.filters.own_states import declared_states
from lab.navigation.filters.schedule import Schedule
from lab.navigation.model_choice import chosen_model, is_ready
from lab.navigation.navigator import navigate
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import NO_REST, NO_VECTOR, Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import at_rest, standing_still
from lab.run.compiling_apart import compile_apart
from lab.run.further_truth import simulated_own_errors
from lab.run.memory import Retiring, bytes_per_run, check_memory, give_back, large_blocks_given_back
from lab.run.run import in_one
from lab.sensors import gps, imu
from lab.sensors.draws import unit_draws
from lab.sensors.readings import Readings, measure
from lab.sensors.suite import SensorSuite
from lab.sensors.triad import Conditions, output

T = TypeVar("T")

CACHE = StageCache(limit=256 * 2**20)
"""Results of the stages of all experiments of this process."""


@dataclass(frozen=True)
class SampledFlight:
    """The flight stage: the true trajectory, and truth and ideal IMU on the IMU's grid."""

    trajectory: Trajectory
    truth: Truth
    ideal: IdealImu


class Stages:
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
        self.experiment = experiment
        self.algorithm = algorithm
        self.progress = progress
        self.mission = found
        self.sensors: SensorSuite = experiment.sensors
        self.navigator: NavigatorSettings = experiment.navigator
        self.flight_key = digest(self.mission.content_hash, experiment.trajectory.to_dict())
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
        (solution, aids), seconds = self._solution_of(
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
                triad._replace(increments=kept(triad.increments) if one.left else one.kept)
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

    def _solution_of(
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
        if self.algorithm is not None:
            return timed(lambda: self.own_solution(truth, dtheta, dvelocity, fixes, start))
        names = chosen_blocks(self.navigator, self.sensors)
        own = [one.block for one in declared_states(self.sensors.own_errors, "sensors.own_errors")]
        parts = self.sensors.to_dict(), self.navigator.to_dict(), names, own
        key = digest(self.flight_key, self.experiment.seed, *parts, self.hidden)
        return CACHE.get(
            "navigation",
            key,
            lambda: timed(
                lambda: self.solution(truth, dt, dtheta, dvelocity, fixes, start, assumed, readings)
            ),
        )

    def begin(self, truth: Truth) -> Aligned:
        """Return the start of the navigator, after its alignment if it has one."""
        return begin(truth, self.experiment)

    def kept_flight(self) -> SampledFlight:
        """Return the flight, computed once for all experiments with the same."""
        return CACHE.get("flight", self.flight_key, self.flight)

    def recording(self) -> Recording:
        """Return the recording, kept by itself: another IMU rate or curve needs no other reading."""
        return CACHE.get("recording", self.mission.content_hash, lambda: self.mission.recording)

    def samples(self) -> int:
        """Return the number of samples of the flight."""
        return int(self.recording().duration * self.experiment.trajectory.imu_rate) + 1

    def flight(self) -> SampledFlight:
        """Compute the trajectory, and truth and ideal IMU on its grid."""
        settings, recording, samples = self.experiment.trajectory, self.recording(), self.samples()
        self.check_memory(samples)
        with large_blocks_given_back(samples):
            trajectory = Trajectory.from_recording(recording, settings.imu_rate, settings.attitude_curve)
            ideal = trajectory.increments(settings.imu_rate)
            return SampledFlight(trajectory, trajectory.at(ideal.time), ideal)

    def belief(self, aligned: Aligned) -> Belief:
        """Return what the filter assumes."""
        return belief(self.sensors, self.navigator, aligned.P if self.navigator.alignment else None)

    def check_memory(self, samples: int) -> None:
        """Raise `TooLongError` if a flight with this number of samples needs too much memory."""
        check_memory(self.memory(samples), samples, float(self.experiment.trajectory.imu_rate))

    def memory(self, samples: int) -> int:
        """Return the memory that a run with this number of samples needs [bytes]."""
        rate, navigator = float(self.experiment.trajectory.imu_rate), self.navigator
        triads = (self.sensors.gyro, self.sensors.accelerometer)
        return bytes_per_run(
            samples,
            int(samples / rate / self.sensors.gps.period),
            states=blocks.count(chosen_blocks(navigator, self.sensors)),
            drifting=sum(imu.is_drifting(errors) for errors in triads),
            exact=navigator.engine == "filterpy",
            arm=bool(belief(self.sensors, navigator).lever_arm.any()),
            aids=most_aids(self.sensors, navigator, samples / rate),
        )

    def triad(self, sensor: str, flight: SampledFlight, found: FloatArray = NO_VECTOR) -> imu.Measured:
        """Simulate the gyros or the accelerometers, with temperature compensation if set.

        A bias estimated by an alignment is subtracted.
        """
        errors = self.sensors.groups()[sensor]
        assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
        seed, samples, long = self.experiment.seed, flight.ideal.dtheta.shape[0], _long_draws(errors)

        def draw() -> imu.ImuDraws:
            return imu.ImuDraws.of(seed, sensor, samples, **long)

        # Draws of a long flight are not kept, because drawing them again is cheaper than their memory.
        draws = draw() if samples > LONG else CACHE.get("draws", digest(seed, sensor, samples, long), draw)
        shaken = sensor == "accelerometer" or any(self.sensors.gyro.g_sensitivity)
        key = digest(
            self.flight_key,
            seed,
            errors.to_dict(),
            self.sensors.temperature.to_dict(),
            self.sensors.accelerometer.vibration_density if shaken else None,
        )
        # Neither is their output kept: the flight is too long to be kept, and takes longer.
        keep = _computed if samples > LONG else CACHE.get
        own = declared_states(self.sensors.own_errors, "sensors.own_errors")
        if own:
            key = digest(key, [one.block for one in own])
        measured = keep(sensor, key, lambda: imu.as_kept(self.measured(errors, flight, draws, seed)))
        if not found.any():
            return measured
        return keep(
            "alignment",
            digest(key, found.tolist()),
            lambda: imu.without_bias(measured, flight.ideal.dt, found),
        )

    def measured_with(
        self, sensor: str, flight: SampledFlight, seed: int, found: FloatArray = NO_VECTOR
    ) -> imu.Measured:
        """Return the output of the gyros or the accelerometers with another seed, which is not cached."""
        errors = self.sensors.groups()[sensor]
        assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
        draws = imu.ImuDraws.of(seed, sensor, flight.ideal.dtheta.shape[0], **_long_draws(errors))
        measured = self.measured(errors, flight, draws, seed)
        if not found.any():
            return measured
        return imu.without_bias(measured, flight.ideal.dt, found)

    def measured(
        self,
        errors: imu.GyroErrors | imu.AccelerometerErrors,
        flight: SampledFlight,
        draws: imu.ImuDraws,
        seed: int,
    ) -> imu.Measured:
        """Return the output of a triad with the temperature and the vibration of the flight."""
        ideal = flight.ideal
        height = flight.truth.height[1:] - flight.truth.height[0]
        conditions = Conditions.of(self.sensors, seed, ideal.time[1:], height, ideal.dvelocity, ideal.dt)
        measured = output(errors, ideal.dtheta, ideal.dt, draws, conditions)
        if not self.sensors.own_errors:
            return measured
        triad = 3 * isinstance(errors, imu.AccelerometerErrors)
        more = simulated_own_errors(self.experiment, ideal)[:, triad : triad + 3]
        return measured._replace(increments=measured.increments + more * ideal.dt)

    def fix_truth(self, flight: SampledFlight) -> tuple[Truth, Truth | None]:
        """Return the truth of the IMU at the fixes, and that of the antenna if they differ."""
        errors = self.sensors.gps
        times = gps.fix_times(errors, flight.trajectory.duration)
        truth = CACHE.get(
            "truth at fixes", digest(self.flight_key, errors.period), lambda: flight.trajectory.at(times)
        )
        seen = None
        if errors.latency or any(errors.lever_arm):
            seen = CACHE.get(
                "antenna",
                digest(self.flight_key, errors.period, errors.latency, errors.lever_arm),
                lambda: gps.antenna(flight.trajectory, errors, times),
            )
        return truth, seen

    def fixes(self, flight: SampledFlight) -> gps.GpsFixes:
        """Simulate the GPS receiver."""
        errors, seed = self.sensors.gps, self.experiment.seed
        truth, seen = self.fix_truth(flight)
        return CACHE.get(
            "gps",
            digest(self.flight_key, seed, errors.to_dict()),
            lambda: gps.measure(truth, errors, gps.GpsDraws.of(seed, truth.time.size), seen),
        )

    def readings(self, flight: SampledFlight) -> dict[str, Readings]:
        """Simulate the sensors besides IMU and GPS."""
        found = {}
        for name, errors in self.sensors.aids().items():
            if errors.get("fitted"):
                seed, trajectory = self.experiment.seed, flight.trajectory
                key = digest(self.flight_key, seed, errors.to_dict())
                found[name] = CACHE.get(name, key, partial(measure, trajectory, errors, seed))
        return found

    def solution(
        self,
        truth: Truth,
        dt: float,
        dtheta: FloatArray,
        dvelocity: FloatArray,
        fixes: gps.GpsFixes,
        begin: Start,
        assumed: Belief,
        readings: Mapping[str, Readings],
    ) -> tuple[Solution, Aids]:
        """Navigate; return also the measurements besides GPS that were used."""
        settings = self.navigator
        self.check_memory(truth.time.size)
        check_mechanization(settings)
        check_engine(settings)
        check_own_states(settings)
        check_r(assumed.R)
        schedule = schedule_of(settings, dt, dtheta.shape[0])
        check_smoother(settings, schedule)
        check_bias_decay(schedule.stride * dt, assumed.decay)
        latency = assumed_latency(settings, self.sensors.gps.latency)
        try:
            increments = Imu(truth.time, dtheta, dvelocity)
            seen = Fixes(fixes.time - latency, fixes.position, fixes.velocity_n)
            rest = at_rest(increments, seen, assumed) if needs_rest(settings) else NO_REST
            standing = rest
            if settings.zero_velocity:
                standing, _ = standing_still(rest, increments, seen, assumed)
            other = aids_of(self.sensors, settings, readings, increments, standing)
            if settings.rest_updates:
                increments = increments._replace(rest=rest)
            solution = self.engine(increments, seen, begin, assumed, schedule, other)
        except SettingError:
            raise
        except ValueError as error:  # the reference's linear algebra stops at values that are not finite
            raise diverged("the filter cannot go on", error) from error
        check_finite(solution, truth.time)
        check_place(solution, truth.latitude)
        return solution, other

    def own_solution(
        self,
        truth: Truth,
        dtheta: FloatArray,
        dvelocity: FloatArray,
        fixes: gps.GpsFixes,
        begin: Start,
    ) -> tuple[Solution, Aids]:
        """Navigate with the user's algorithm, which gets no measurements besides GPS."""
        assert self.algorithm is not None
        solution = run_algorithm(
            self.algorithm,
            Imu(truth.time, dtheta, dvelocity),
            Fixes(fixes.time, fixes.position, fixes.velocity_n),
            begin,
        )
        return solution, NO_AIDS

    def engine(
        self, imu: Imu, fixes: Fixes, start: Start, belief: Belief, schedule: Schedule, aids: Aids
    ) -> Solution:
        """Navigate with the model and the engine of the settings."""
        if self.navigator.model == "nonlinear":
            names = chosen_blocks(self.navigator, self.sensors)
            return unscented.navigate(imu, fixes, start, belief, schedule, aids=aids, names=names)
        model = chosen_model(self.navigator, self.sensors)
        if self.navigator.engine == "filterpy":
            from lab.navigation import reference  # noqa: PLC0415 - filterpy takes half a second to import

            return reference.navigate(
                imu,
                fixes,
                start,
                belief,
                schedule,
                model,
                aids,
                progress=lambda done: self.progress("Navigating", 0.4 + 0.6 * done),
            )
        arguments = imu, fixes, start, belief, schedule, model
        if self.navigator.smoother:
            return smoother.navigate(*arguments, aids=aids, used=self._retire)
        return navigate(*arguments, aids=aids)

    def _retire(self, first: int) -> None:
        """Keep the increments of a long flight from number `first` on in float32: the smoother used them."""
        for one in self._retiring:
            one.retire(first)


def _long_draws(errors: imu.GyroErrors | imu.AccelerometerErrors) -> dict[str, bool]:
    """Return which draws with a value for each sample a triad needs besides its noise."""
    return {
        "instability": any(errors.instability),
        "flicker": any(errors.flicker),
        "walk": any(errors.rate_random_walk),
    }


def _computed(_stage: str, _key: str, compute: Callable[[], T]) -> T:
    """Return the result of a stage that is not cached."""
    return compute()


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
    draw = unit_draws(seed, "initial error", (9,))
    position = si(settings, "position_error") + si(settings, "position_sigma") * draw[:3]
    velocity = si(settings, "velocity_error") + si(settings, "velocity_sigma") * draw[3:6]
    attitude = si(settings, "attitude_error") + si(settings, "attitude_sigma") * draw[6:]
    return Start.off(truth, position, velocity, attitude)


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
    return rest_alignment.begin(start(truth, navigator, seed), true, sensors, navigator, seed)
