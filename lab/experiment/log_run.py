"""Log run: an experiment on a sensor log: nothing is simulated, the settings are assumptions."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from typing import TypeVar

import numpy as np

from lab.base.aid_table import AIDS
from lab.base.arrays import FloatArray
from lab.base.cache import StageCache, digest
from lab.data.checks.full_scale import range_remarks
from lab.data.log.log_remarks import clock_text
from lab.data.log.log_section import cut_section
from lab.data.log.vehicle import vehicle_of
from lab.experiment.log_result import LogResult
from lab.experiment.result import Runnable
from lab.missions import LogMission, SensorLog
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import NO_AIDS
from lab.navigation.algorithm import Algorithm, run_algorithm
from lab.navigation.belief import assumed_latency, assumed_lever_arm, chosen_blocks
from lab.navigation.filters.blocks import CORE
from lab.navigation.filters.error_models import POS
from lab.navigation.log_navigation import RecordedRun, navigate_log
from lab.navigation.log_readings import collect_readings
from lab.navigation.model_choice import is_ready
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.run.log_reference import comparison_remark, interpolate_reference
from lab.run.memory import bytes_per_run, check_memory
from lab.run.run import Recorded
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.sensors.suite import OTHER_SENSORS

T = TypeVar("T")

_IMU_TERMS = (
    "noise_density",
    "bias",
    "bias_sigma",
    "instability",
    "correlation_time",
    "flicker",
    "rate_random_walk",
    "scale_factor",
    "scale_factor_sigma",
)
IN_EFFECT = frozenset(
    (
        *(f"sensors.{triad}.{term}" for triad in ("gyro", "accelerometer") for term in _IMU_TERMS),
        "sensors.accelerometer.vibration_density",
        "sensors.gps.position_variance",
        "sensors.gps.velocity_variance",
        "sensors.gps.outages",
        "sensors.gps.period",
        "sensors.assumed",
        "sensors.lacking",
        *(f"sensors.{aid.name}.{term}" for aid in AIDS for term in aid.settings.effective_in_a_log()),
    )
)
"""Settings of the sensors with an effect on the navigation of a log: the filter's assumptions, the terms that
a card assumed, and outages."""
OF_FURTHER_STATES = {
    "sensors.gyro.misalignment": "estimate_misalignments",
    "sensors.accelerometer.misalignment": "estimate_misalignments",
    "sensors.gyro.g_sensitivity": "estimate_g_sensitivity",
    "sensors.gps.correlated_sigma": "estimate_gps_drift",
    "sensors.gps.correlation_time": "estimate_gps_drift",
}
"""Settings that the filter of a log assumes for further states, and the settings that add these states."""

_OF_THE_START = ("position", "velocity", "attitude")
WITHOUT_EFFECT = frozenset(
    f"navigator.{part}_{kind}" for part in _OF_THE_START for kind in ("sigma", "error")
)
"""Settings of the navigator that the log itself provides: the start and its uncertainty."""

_LONG_COASTING = 10.0
"""Time without a fix from which it is reported [s]: consumer IMUs are off by metres after it. Outages of the
settings are the user's own and are not."""
_SAME_CLOCK = 1e-3  # largest offset at which the clock of the file counts as the time of the log [s]


def has_effect(
    path: str, navigator: NavigatorSettings | None = None, fitted: Collection[str] = OTHER_SENSORS
) -> bool:
    """Return whether a setting affects the navigation of a log.

    Parameters
    ----------
    path
        The setting.
    navigator
        The filter; None for one with all states.
    fitted
        The sensors besides IMU and GPS that it uses, by their groups.
    """
    group = path.split(".")[1] if path.startswith("sensors.") else ""
    if path == "sensors.odometer.lever_arm" and navigator is not None and navigator.no_slip:
        return True  # the place that does not slip
    if group in OTHER_SENSORS and group not in fitted and not path.endswith(".fitted"):
        return False
    if path in OF_FURTHER_STATES:
        return navigator is None or bool(getattr(navigator, OF_FURTHER_STATES[path]))
    if group in ("gyro", "accelerometer") and ".scale_factor" in path:
        return navigator is None or navigator.states > CORE
    if path.startswith("sensors."):
        return path in IN_EFFECT
    return path not in WITHOUT_EFFECT | {"seed"} and not path.startswith("trajectory.")


def run_log(
    experiment: Runnable,
    mission: LogMission,
    cache: StageCache,
    progress: Callable[[str, float], None],
    algorithm: Algorithm | None = None,
) -> LogResult:
    """Run an experiment on a log.

    Parameters
    ----------
    experiment
        The settings. Those of the sensors are the filter's assumptions; those of the simulation, such as the
        seed, have no effect.
    mission
        The log.
    cache
        Cache for the log and its navigation.
    progress
        Called with a sentence about the current work and the fraction done, from 0 to 1.
    algorithm
        The user's navigator; it gets the same input as the filter of the settings.

    Raises
    ------
    MissionError
        If the log cannot be read, or has too few fixes.
    SettingError
        If the settings are incompatible, or cannot be applied to a log.
    ValueError
        If the log cannot be navigated; or if the `algorithm` fails (`AlgorithmError`).
    """
    progress("Reading the log", 0.0)
    sensors, navigator = experiment.sensors, experiment.navigator
    vehicle = "" if navigator.vehicle == "auto" else str(navigator.vehicle)
    content = digest(mission.content_hash, {"vehicle": vehicle})
    whole = cache.get("log", content, lambda: mission.log_of(vehicle))
    log = cut_section(whole, navigator.log_from, navigator.log_to)
    outages = outages_in(log, sensors.gps.outages)
    progress("Navigating" if is_ready(navigator) else "Preparing the navigator (compiled once)", 0.4)
    needed = bytes_per_run(
        log.time.size,
        log.gnss.time.size,
        states=navigator.states,
        drifting=0,
        exact=False,
        arm=bool(assumed_lever_arm(navigator, log.gnss.lever_arm).any()),
        aids=sum(one.time.size for one in collect_readings(log, sensors).values()),
    )
    check_memory(needed, log.time.size, log.time.size / max(log.duration, 1.0))
    settings = {path: experiment.get(path) for path, *_ in experiment.leaves() if has_effect(path, navigator)}
    made, seconds = cache.get(
        "log navigation",
        digest(content, settings | {"mission": ""}, chosen_blocks(navigator, sensors)),
        lambda: time_navigation(lambda: navigate_log(log, sensors, navigator, outages)),
    )
    solution = made.solution
    if algorithm is not None:
        solution, seconds = time_navigation(
            lambda: run_algorithm(algorithm, made.imu, made.fixes, made.alignment.start)
        )
    truth = None if log.reference is None else interpolate_reference(log.reference, made.imu.time)
    progress("Done", 1.0)
    return _result(experiment, mission, log, made, solution, seconds, truth, algorithm)


def _result(
    experiment: Runnable,
    mission: LogMission,
    log: SensorLog,
    made: RecordedRun,
    solution: Solution,
    seconds: float,
    truth: Truth | None,
    algorithm: Algorithm | None,
) -> LogResult:
    samples, fixes = made.imu.dtheta.shape[0], made.fixes.time.size
    nothing = np.broadcast_to(np.nan, (max(samples, fixes), 3))
    fix_times = log.gnss.time - assumed_latency(experiment.navigator, log.gnss.latency)
    rows = np.searchsorted(fix_times, made.fixes.time)
    # The filter got substitutes for components that the receiver does not measure.
    seen = np.where(np.isnan(log.gnss.velocity_n[rows]), np.nan, made.fixes.velocity_n)
    remarks = (
        *made.remarks,
        *clock_remarks(log, experiment.sensors.gps.outages),
        *coasting_remarks(log, made.imu.time, fix_times, solution),
        *range_remarks(np.concatenate(log.rates, axis=1)),
        *_vehicle_remarks(experiment, log, made),
        *(comparison_remark(other, made.imu.time, solution) for other in log.auxiliary.comparisons),
        _reference_remark(log, truth),
        *_idle_remarks(experiment),
    )
    return LogResult(
        experiment=experiment,
        mission=mission,
        truth_arrays=truth,
        gyro=Measured(made.imu.dtheta, nothing[:samples], nothing[:samples], 0),
        accelerometer=Measured(made.imu.dvelocity, nothing[:samples], nothing[:samples], 0),
        fixes=GpsFixes(made.fixes.time, made.fixes.position, seen, nothing[:fixes], nothing[:fixes]),
        belief=made.belief,
        solution_arrays=solution,
        seconds=seconds,
        algorithm="" if algorithm is None else type(algorithm).__name__,
        recorded=Recorded(log, made.imu.time, made.alignment, remarks),
        blocks=() if algorithm is not None else made.blocks,
        aids=NO_AIDS if algorithm is not None else made.aids,
    )


def _vehicle_remarks(experiment: Runnable, log: SensorLog, made: RecordedRun) -> list[str]:
    """Return a remark about the heading of an unknown vehicle, if it is the course."""
    unnamed = experiment.navigator.vehicle == "auto" and not vehicle_of(log.auxiliary.vehicle).name
    if not unnamed or not made.alignment.heading.is_course:
        return []
    return [
        "The vehicle is unknown: the course is used as its heading, and the motion does not contradict "
        "this. --vehicle, or vehicle in log.toml, sets the vehicle."
    ]


def _reference_remark(log: SensorLog, truth: Truth | None) -> str:
    """Return what the errors are, if they are known."""
    if log.reference is None:
        return "There is no reference: the errors are unknown, the innovations are known."
    if truth is None:
        return "The reference has no rows during the IMU data: the errors are unknown."
    return (
        "Errors are differences to the reference, which has errors of its own. NEES is therefore not "
        "given, and the verdict is based on the innovations."
    )


def _idle_remarks(experiment: Runnable) -> list[str]:
    """Return a remark about changed settings that have no effect on a log."""
    groups = experiment.sensors.groups()
    fitted = [name for name in OTHER_SENSORS if groups[name].get("fitted")]
    idle = [
        path
        for path, owner, name in experiment.leaves()
        if getattr(owner, name) != owner.param[name].default
        and not has_effect(path, experiment.navigator, fitted)
    ]
    return [f"Nothing is simulated for a log: {', '.join(idle)} has no effect."] if idle else []


def outages_in(log: SensorLog, outages: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Convert outages from the clock of a log's file to the time of the log [s]."""
    return [(start - log.epoch, end - log.epoch) for start, end in outages]


def clock_remarks(log: SensorLog, outages: Sequence[tuple[float, float]]) -> list[str]:
    """Return remarks about time 0 in the clock of the file, and about outages outside the log."""
    remarks = []
    if abs(log.epoch) > _SAME_CLOCK:
        remarks.append(
            f"Time 0 is {clock_text(log.epoch)} s in the clock of the file; navigator.log_from, "
            "navigator.log_to and sensors.gps.outages are given in this clock."
        )
    outside = [f"{a:g} to {b:g} s" for a, b in outages if b <= log.epoch or a >= log.epoch + log.duration]
    if outside:
        remarks.append(
            f"GPS outages outside the log have no effect: {', '.join(outside)}; in the clock of the file, "
            f"the log lasts from {clock_text(log.epoch)} to {clock_text(log.epoch + log.duration)} s."
        )
    return remarks


def coasting_remarks(log: SensorLog, time: FloatArray, fixes: FloatArray, solution: Solution) -> list[str]:
    """Return a remark about the longest time in which a log has no fix, if that is long.

    Parameters
    ----------
    log
        The log.
    time : (n,) array
        Times of the solution [s].
    fixes : (m,) array
        Times of validity of the fixes [s].
    solution
        What was navigated.
    """
    ends = np.concatenate((time[:1], fixes[(fixes > time[0]) & (fixes < time[-1])], time[-1:]))
    longest = int(np.argmax(np.diff(ends)))
    start, end = ends[longest : longest + 2]
    if end - start < _LONG_COASTING:
        return []
    rows = (time >= start) & (time <= end)
    sigma = float(np.sqrt(solution.variance[rows, POS][:, :2].max()))
    grew = "" if np.isnan(sigma) else f" The σ of its horizontal position reaches {sigma:.2g} m there."
    return [
        f"The log has no fix for up to {end - start:.3g} s, from {clock_text(log.epoch + start)} s "
        f"to {clock_text(log.epoch + end)} s in the clock of the file: the navigator coasts.{grew}"
    ]


def time_navigation(navigate: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a navigator, and its computing time [s]."""
    begun = time.perf_counter()
    return navigate(), time.perf_counter() - begun
