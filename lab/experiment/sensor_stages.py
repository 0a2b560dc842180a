"""Sensor stages: the flight of an experiment and the sensors on it, computed in cached stages.

Each stage is cached by the content of the settings on which it depends. A change of a gyro's noise does not
recompute the flight, the accelerometers or the fixes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from lab.base.arrays import FloatArray
from lab.base.cache import StageCache, digest
from lab.base.histories import LONG
from lab.base.parameters.units import si
from lab.experiment.result import Runnable
from lab.missions import Mission
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.navigation.aiding import most_aids
from lab.navigation.belief import (
    assumed_lever_arm,
    chosen_blocks,
)
from lab.navigation.filters import blocks
from lab.navigation.filters.user_states import declared_states
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import NO_VECTOR
from lab.run.further_truth import simulated_user_errors
from lab.run.memory import bytes_per_run, check_memory, large_blocks_given_back
from lab.sensors import gps, imu
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


class SensorStages:
    """The flight and the simulated sensors of an experiment, each with the key of all its inputs.

    Parameters
    ----------
    experiment
        The settings, which do not change any more.
    found
        The mission that they name.
    """

    def __init__(self, experiment: Runnable, found: Mission) -> None:
        self.experiment = experiment
        self.mission = found
        self.sensors: SensorSuite = experiment.sensors
        self.navigator: NavigatorSettings = experiment.navigator
        self.flight_key = digest(self.mission.content_hash, experiment.trajectory.to_dict())

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
            arm=bool(assumed_lever_arm(navigator, si(self.sensors.gps, "lever_arm")).any()),
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
        keep = _compute_uncached if samples > LONG else CACHE.get
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
        more = simulated_user_errors(self.experiment, ideal)[:, triad : triad + 3]
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
            lambda: gps.measure(truth, errors, gps.GpsDraws.of(seed, truth.time.size, errors), seen),
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


def _long_draws(errors: imu.GyroErrors | imu.AccelerometerErrors) -> dict[str, bool]:
    """Return which draws with a value for each sample a triad needs besides its noise."""
    return {
        "instability": any(errors.instability),
        "flicker": any(errors.flicker),
        "walk": any(errors.rate_random_walk),
    }


def _compute_uncached(_stage: str, _key: str, compute: Callable[[], T]) -> T:
    """Return the result of a stage that is not cached."""
    return compute()
