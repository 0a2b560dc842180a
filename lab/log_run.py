"""Log run: an experiment on a log of real sensors: nothing is simulated, the settings say what is assumed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from lab import earth
from lab.cache import StageCache, digest
from lab.missions import LogMission, SensorLog
from lab.missions.sensor_log import Reference
from lab.navigation.algorithm import Algorithm, run_algorithm
from lab.navigation.belief import assumed_latency
from lab.navigation.choice import is_ready
from lab.navigation.recorded import RecordedRun, navigate_log
from lab.navigation.solution import Solution
from lab.result import Recorded, Result
from lab.rotation import quaternion_from_euler, wrap
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.trajectory import Truth

if TYPE_CHECKING:
    from lab.experiment import Experiment

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
    )
)
"""Settings of the sensors a log's navigation depends on: what its filter assumes of them, and outages."""

_OF_THE_START = ("position", "velocity", "attitude")
WITHOUT_EFFECT = frozenset(
    f"navigator.{part}_{kind}" for part in _OF_THE_START for kind in ("sigma", "error")
)
"""Settings of the navigator that a log answers itself: where it starts, and how uncertain that is."""

_LONGEST = 1.0
"""Longest time between two rows of a reference that is bridged [s]."""


def has_effect(path: str, states: int = 21) -> bool:
    """Return whether a setting changes anything in a log's navigation by a filter with so many states."""
    if ".scale_factor" in path and states == 15:
        return False
    if path.startswith("sensors."):
        return path in IN_EFFECT
    return path not in WITHOUT_EFFECT | {"seed"} and not path.startswith("trajectory.")


def run_log(
    experiment: Experiment,
    mission: LogMission,
    cache: StageCache,
    progress: Callable[[str, float], None],
    algorithm: Algorithm | None = None,
) -> Result:
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
    content = mission.content_hash
    log = cache.get("log", content, lambda: mission.log)
    sensors, navigator = experiment.sensors, experiment.navigator
    progress("Navigating" if is_ready(navigator) else "Preparing the navigator (compiled once)", 0.4)
    states = navigator.states
    settings = {path: experiment.get(path) for path, *_ in experiment.leaves() if has_effect(path, states)}
    made, seconds = cache.get(
        "log navigation",
        digest(content, settings | {"mission": ""}),
        lambda: timed(lambda: navigate_log(log, sensors, navigator, sensors.gps.outages)),
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
    experiment: Experiment,
    mission: LogMission,
    log: SensorLog,
    made: RecordedRun,
    solution: Solution,
    seconds: float,
    truth: Truth | None,
    algorithm: Algorithm | None,
) -> Result:
    samples, fixes = made.imu.dtheta.shape[0], made.fixes.time.size
    nothing = np.broadcast_to(np.nan, (max(samples, fixes), 3))
    latency = assumed_latency(experiment.navigator, log.gnss.latency)
    rows = np.searchsorted(log.gnss.time - latency, made.fixes.time)
    # The filter was given something in place of what the receiver does not measure.
    seen = np.where(np.isnan(log.gnss.velocity_n[rows]), np.nan, made.fixes.velocity_n)
    notes = list(made.remarks)
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
    return Result(
        experiment=experiment,
        mission=mission,
        truth_arrays=truth,
        ideal=None,
        gyro=Measured(made.imu.dtheta, nothing[:samples], nothing[:samples], 0),
        accelerometer=Measured(made.imu.dvelocity, nothing[:samples], nothing[:samples], 0),
        fixes=GpsFixes(made.fixes.time, made.fixes.position, seen, nothing[:fixes], nothing[:fixes]),
        belief=made.belief,
        solution_arrays=solution,
        seconds=seconds,
        algorithm="" if algorithm is None else type(algorithm).__name__,
        recorded=Recorded(log, made.imu.time, made.alignment, tuple(notes)),
    )


def timed(navigate: Callable[[], T]) -> tuple[T, float]:
    """Return what a navigator gives, and the time it took [s]."""
    begun = time.perf_counter()
    return navigate(), time.perf_counter() - begun


def reference_at(reference: Reference, time: FloatArray) -> Truth | None:
    """Return a reference at other times; None where it has no row within them.

    Positions follow a cubic curve through the rows with their velocities, or straight lines where velocities
    are not known; velocities straight lines, attitudes rotations at a constant rate. NaN outside the time of
    the reference, where it does not know, and between rows that are far apart.

    Parameters
    ----------
    reference
        The reference.
    time : (n,) array
        Times [s].
    """
    rows = reference.time
    step = np.diff(rows)
    after = np.clip(np.searchsorted(rows, time), 1, rows.size - 1)
    far = np.asarray(step > max(_LONGEST, 2.5 * float(np.median(step))))
    known = (time >= rows[0]) & (time <= rows[-1])
    known &= ~far[after - 1] | (time >= rows[after])
    if not known.any():
        return None
    position = np.where(known[:, None], _positions(reference, time), np.nan)
    velocity = np.stack([np.interp(time, rows, column) for column in reference.velocity_n.T], axis=-1)
    q_nb, euler = _attitudes(reference, time, after)
    velocity[~known], q_nb[~known], euler[~known] = np.nan, np.nan, np.nan
    latitude, longitude, height = position.T
    return Truth(time, latitude, wrap(longitude), height, velocity, q_nb, euler)


def _positions(reference: Reference, time: FloatArray) -> FloatArray:
    latitude, _, height = reference.position.T
    values = np.column_stack((latitude, np.unwrap(reference.position[:, 1]), height))
    if np.isnan(reference.velocity_n).any():
        return np.stack([np.interp(time, reference.time, column) for column in values.T], axis=-1)
    meridian, transverse = earth.radii(np.sin(latitude))
    north, east, down = reference.velocity_n.T
    slopes = np.column_stack(
        (north / (meridian + height), east / ((transverse + height) * np.cos(latitude)), -down)
    )
    return np.asarray(CubicHermiteSpline(reference.time, values, slopes)(time))


def _attitudes(
    reference: Reference, time: FloatArray, after: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return quaternions (n, 4) and Euler angles (n, 3), NaN where either neighbour is not known."""
    q_nb, euler = np.full((time.size, 4), np.nan), np.full((time.size, 3), np.nan)
    given = np.asarray(np.isfinite(reference.euler).all(axis=1))
    if given.sum() < 2:
        return q_nb, euler
    attitude = Rotation.from_quat(quaternion_from_euler(reference.euler[given]), scalar_first=True)
    rows = reference.time[given]
    between = np.asarray(given[after] & given[after - 1] & (time >= rows[0]) & (time <= rows[-1]))
    there = Slerp(rows, attitude)(time[between])
    q_nb[between] = there.as_quat(scalar_first=True)
    euler[between] = there.as_euler("ZYX")[:, ::-1]
    return q_nb, euler
