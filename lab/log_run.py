"""Log run: an experiment on a log of real sensors: nothing is simulated, the settings say what is assumed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.cache import StageCache, digest
from lab.log_reference import comparison_remark, reference_at
from lab.log_result import LogResult
from lab.logs.log_section import piece
from lab.logs.vehicle import vehicle_of
from lab.memory import check_memory
from lab.missions import LogMission, SensorLog
from lab.navigation.algorithm import Algorithm, run_algorithm
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.navigation.choice import is_ready
from lab.navigation.recorded import RecordedRun, navigate_log
from lab.navigation.solution import Solution
from lab.result import Runnable
from lab.run import Recorded
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.trajectory import Truth

FloatArray = NDArray[np.float64]
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
        "sensors.assumed",
    )
)
"""Settings of the sensors that say something of a log's navigation: what its filter assumes of them, which of
them a card assumed in turn, and outages."""

_OF_THE_START = ("position", "velocity", "attitude")
WITHOUT_EFFECT = frozenset(
    f"navigator.{part}_{kind}" for part in _OF_THE_START for kind in ("sigma", "error")
)
"""Settings of the navigator that a log answers itself: where it starts, and how uncertain that is."""

_SAME_CLOCK = 1e-3  # from where on the clock of the file differs from the time of the log [s]


def has_effect(path: str, states: int = 21) -> bool:
    """Return whether a setting changes anything in a log's navigation by a filter with so many states."""
    if ".scale_factor" in path and states == 15:
        return False
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
    """Return what an experiment on a log gives.

    Parameters
    ----------
    experiment
        The settings: those of the sensors are what the filter assumes of them; those of the simulation, such
        as the seed, have no effect.
    mission
        The log.
    cache
        Keeps the log, and its navigation.
    progress
        Called with a sentence about what is being done and the fraction done, from 0 to 1.
    algorithm
        A navigator of the user's own, given what the filter of the settings would be given.

    Raises
    ------
    MissionError
        If the log cannot be read, or has too few fixes.
    SettingError
        If the settings do not go together, or cannot be applied to a log.
    ValueError
        If the log cannot be navigated; or if the `algorithm` fails (`AlgorithmError`).
    """
    progress("Reading the log", 0.0)
    sensors, navigator = experiment.sensors, experiment.navigator
    vehicle = "" if navigator.vehicle == "auto" else str(navigator.vehicle)
    content = digest(mission.content_hash, {"vehicle": vehicle})
    whole = cache.get("log", content, lambda: mission.log_of(vehicle))
    log = piece(whole, navigator.log_from, navigator.log_to)
    outages = outages_in(log, sensors.gps.outages)
    progress("Navigating" if is_ready(navigator) else "Preparing the navigator (compiled once)", 0.4)
    states = navigator.states
    check_memory(
        log.time.size,
        log.gnss.time.size,
        log.time.size / max(log.duration, 1.0),
        states=states,
        drifting=0,
        exact=navigator.smoother or navigator.model == "nonlinear",
        arm=bool(assumed_lever_arm(navigator, log.gnss.lever_arm).any()),
    )
    settings = {path: experiment.get(path) for path, *_ in experiment.leaves() if has_effect(path, states)}
    made, seconds = cache.get(
        "log navigation",
        digest(content, settings | {"mission": ""}),
        lambda: timed(lambda: navigate_log(log, sensors, navigator, outages)),
    )
    solution = made.solution
    if algorithm is not None:
        solution, seconds = timed(
            lambda: run_algorithm(algorithm, made.imu, made.fixes, made.alignment.start)
        )
    truth = None if log.reference is None else reference_at(log.reference, made.imu.time)
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
    latency = assumed_latency(experiment.navigator, log.gnss.latency)
    rows = np.searchsorted(log.gnss.time - latency, made.fixes.time)
    # The filter was given something in place of what the receiver does not measure.
    seen = np.where(np.isnan(log.gnss.velocity_n[rows]), np.nan, made.fixes.velocity_n)
    notes = [*made.remarks, *clock_remarks(log, experiment.sensors.gps.outages)]
    unnamed = experiment.navigator.vehicle == "auto" and not vehicle_of(log.auxiliary.vehicle).name
    if unnamed and made.alignment.heading.is_course:
        notes.append(
            "Nobody named the vehicle: the course is taken for its heading, which the motion does not "
            "contradict. --vehicle or vehicle in log.toml names it."
        )
    notes += [comparison_remark(other, made.imu.time, solution) for other in log.auxiliary.comparisons]
    if log.reference is None:
        notes.append("There is no reference: errors are not known, innovations are.")
    elif truth is None:
        notes.append("The reference has no rows while the IMU recorded: errors are not known.")
    else:
        notes.append(
            "Errors are differences to the reference, which has errors of its own: NEES is not claimed, and "
            "the verdict rests on the innovations."
        )
    idle = [
        path
        for path, owner, name in experiment.leaves()
        if getattr(owner, name) != owner.param[name].default
        and not has_effect(path, experiment.navigator.states)
    ]
    if idle:
        notes.append(f"Nothing is simulated for a log: {', '.join(idle)} changes nothing.")
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
        recorded=Recorded(log, made.imu.time, made.alignment, tuple(notes)),
    )


def outages_in(log: SensorLog, outages: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return outages given in the clock of a log's file in the time of the log [s]."""
    return [(start - log.epoch, end - log.epoch) for start, end in outages]


def clock_remarks(log: SensorLog, outages: Sequence[tuple[float, float]]) -> list[str]:
    """Say where time 0 is in the clock of the file, and which outages lie outside the log."""
    remarks = []
    if abs(log.epoch) > _SAME_CLOCK:
        remarks.append(
            f"Time 0 is {log.epoch:.10g} s in the clock of the file, in which --from, --to and outages are "
            "given."
        )
    outside = [f"{a:g} to {b:g} s" for a, b in outages if b <= log.epoch or a >= log.epoch + log.duration]
    if outside:
        remarks.append(
            f"GPS outages outside the log change nothing: {', '.join(outside)}; in the clock of the file it "
            f"lasts from {log.epoch:.10g} to {log.epoch + log.duration:.10g} s."
        )
    return remarks


def timed(navigate: Callable[[], T]) -> tuple[T, float]:
    """Return what a navigator gives, and the time it took [s]."""
    begun = time.perf_counter()
    return navigate(), time.perf_counter() - begun
