"""Simulated navigation: the lab's own navigator on simulated sensors, with the engine of its settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.result import Runnable
from lab.navigation.aiding import collect_aids, needs_rest
from lab.navigation.aids import Aids
from lab.navigation.belief import (
    assumed_latency,
    chosen_blocks,
    schedule_filter,
)
from lab.navigation.checks import (
    check_bias_decay,
    check_engine,
    check_finite,
    check_mechanization,
    check_place,
    check_r,
    check_smoother,
    check_user_states,
    divergence_error,
)
from lab.navigation.filters import smoother, unscented
from lab.navigation.model_choice import chosen_model
from lab.navigation.navigator import navigate
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import NO_REST, Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import at_rest, standing_still
from lab.sensors import gps
from lab.sensors.readings import Readings
from lab.sensors.suite import SensorSuite


def navigate_simulated(
    experiment: Runnable,
    imu: Imu,
    dt: float,
    fixes: gps.GpsFixes,
    begin: Start,
    assumed: Belief,
    readings: Mapping[str, Readings],
    latitude: FloatArray,
    progress: Callable[[float], None],
    used: Callable[[int], None],
) -> tuple[Solution, Aids]:
    """Navigate; return also the measurements besides GPS that were used.

    Parameters
    ----------
    experiment
        The settings of the navigator and of the sensors.
    imu, dt
        The output of the IMU, and its step [s].
    fixes, readings
        The outputs of the GPS receiver and of the other sensors.
    begin, assumed
        The start, and what the filter assumes.
    latitude : (n,) array
        The true latitude [rad], for the places that a model cannot navigate.
    progress
        Called with the fraction done, by a slow engine.
    used
        Called with the number of the first increment of which a smoother makes no more use.

    Raises
    ------
    SettingError
        If the settings contradict each other.
    DivergedError
        If the solution is not finite.
    """
    navigator, sensors = experiment.navigator, experiment.sensors
    check_mechanization(navigator)
    check_engine(navigator)
    check_user_states(navigator)
    check_r(assumed.R)
    schedule = schedule_filter(navigator, dt, imu.dtheta.shape[0])
    check_smoother(navigator, schedule)
    check_bias_decay(schedule.stride * dt, assumed.decay)
    latency = assumed_latency(navigator, sensors.gps.latency)
    try:
        seen = Fixes(fixes.time - latency, fixes.position, fixes.velocity_n)
        rest = at_rest(imu, seen, assumed) if needs_rest(navigator) else NO_REST
        standing = rest
        if navigator.zero_velocity:
            standing, _ = standing_still(rest, imu, seen, assumed)
        other = collect_aids(sensors, navigator, readings, imu, standing)
        if navigator.rest_updates:
            imu = imu._replace(rest=rest)
        engine = _engine(navigator, sensors, progress, used)
        solution = engine(imu, seen, begin, assumed, schedule, aids=other)
    except SettingError:
        raise
    except ValueError as error:  # the reference's linear algebra stops at values that are not finite
        raise divergence_error("the filter cannot go on", error) from error
    check_finite(solution, imu.time)
    check_place(solution, latitude)
    return solution, other


def _engine(
    navigator: NavigatorSettings,
    sensors: SensorSuite,
    progress: Callable[[float], None],
    used: Callable[[int], None],
) -> Callable[..., Solution]:
    """Return the navigator with the model and the engine of the settings."""
    if navigator.model == "nonlinear":
        return partial(unscented.navigate, names=chosen_blocks(navigator, sensors))
    model = chosen_model(navigator, sensors)
    if navigator.engine == "filterpy":
        from lab.navigation import reference  # noqa: PLC0415 - filterpy takes half a second to import

        return partial(reference.navigate, model=model, progress=progress)
    if navigator.smoother:
        return partial(smoother.navigate, model=model, used=used)
    return partial(navigate, model=model)
