"""Checks: whether the settings of a navigator are compatible, and whether its solution is usable."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.motion.frames.ecef import near_pole
from lab.navigation.filters.error_models import MODELS, NORTH_SLAVED
from lab.navigation.filters.schedule import Schedule
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution


def check_mechanization(settings: NavigatorSettings) -> None:
    """Raise `SettingError` if a mechanization is incompatible with the model or the engine."""
    if settings.mechanization == NORTH_SLAVED:
        return
    if settings.engine == "filterpy":
        raise SettingError(
            "navigator.engine: the reference in filterpy is a north-slaved navigator, which "
            f"navigator.mechanization = {settings.mechanization} is not; accepted with it is the compiled "
            "engine"
        )


def check_smoother(settings: NavigatorSettings, schedule: Schedule) -> None:
    """Raise `SettingError` if the smoother cannot use the steps of the filter."""
    if not settings.smoother:
        return
    reason = None
    if settings.model == "nonlinear":
        reason = f"needs the steps of a linear filter, and the model nonlinear is not linear; {_SMOOTHED}"
    elif settings.engine == "filterpy":
        reason = f"needs the steps of the compiled filter, not of the one in filterpy; {_SMOOTHED}"
    elif schedule.stride > 1:
        reason = (
            f"needs the covariance at every sample, and navigator.filter_rate = {settings.filter_rate:g} Hz "
            f"propagates the covariance less often; {_SMOOTHED}"
        )
    if reason:
        raise SettingError(f"navigator.smoother: {reason}")


_SMOOTHED = f"accepted with it are the models {', '.join(MODELS)}, the compiled engine, and filter_rate = 0"


def check_engine(settings: NavigatorSettings) -> None:
    """Raise `SettingError` if the reference in filterpy does not support the settings."""
    if settings.engine != "filterpy":
        return
    if settings.model == "nonlinear":
        raise SettingError(
            "navigator.engine: the reference in filterpy is a linear filter, and the model nonlinear is "
            "not; accepted is compiled"
        )
    if settings.robust != "none":
        raise SettingError(
            "navigator.engine: the reference in filterpy uses each fix with its full weight, and "
            f"navigator.robust = {settings.robust} does not; accepted is compiled, or robust = none"
        )


def check_user_states(settings: NavigatorSettings) -> None:
    """Raise `SettingError` if a navigator cannot have the states that a user declared."""
    if settings.model == "nonlinear" and settings.own_states:
        raise SettingError(
            "navigator.own_states: your own states are an effect on F, and the sigma points of the model "
            f"nonlinear have no F; accepted with them are the models {', '.join(MODELS)}"
        )


def check_r(R: FloatArray) -> None:
    """Raise `SettingError` if a covariance (6, 6) of the fixes, or one of many, has no inverse."""
    try:
        np.linalg.cholesky(R)
    except np.linalg.LinAlgError as error:
        raise SettingError(
            "navigator.r: is singular: some measurement, or a combination of measurements, has no noise; "
            "accepted is a positive definite matrix (very small variances are possible)"
        ) from error


def check_bias_decay(step: float, decay: FloatArray) -> None:
    """Raise `SettingError` if a step of the filter is longer than the correlation time of a bias.

    Parameters
    ----------
    step
        Longest time between two propagations of P [s].
    decay : (6,) array
        Decay rates of the biases [1/s].
    """
    fastest = float(decay.max())
    if step * fastest > 1 + 1e-9:
        raise SettingError(
            f"navigator.filter_rate: the filter's step of {step:g} s is longer than the shortest "
            f"correlation time of a bias, {1 / fastest:g} s (sensors.gyro.correlation_time, "
            "sensors.accelerometer.correlation_time, the process that models their flicker, or those of "
            f"other sensors); accepted here is a rate from {fastest:g} Hz, or 0 for every IMU sample"
        )


class DivergedError(ValueError):
    """The solution of a run diverged; with another seed it need not."""


def check_finite(solution: Solution, time: FloatArray) -> None:
    """Raise `DivergedError` if a solution, at times (n + 1,), is not finite or has negative variances."""
    # A value that is not finite stays so: checking the last sample is enough.
    states = (
        *(solution.position, solution.velocity_n, solution.q_nb),
        *(solution.bias, solution.scale, solution.variance),
    )
    if all(np.isfinite(values[-1]).all() for values in states) and solution.variance.min() >= 0:
        return
    bad = (solution.variance < 0).any(axis=1)
    for values in states:
        bad |= ~np.isfinite(values).all(axis=1)
    raise divergence_error(f"the numbers are not usable from t = {time[int(np.argmax(bad))]:.3f} s on")


def check_place(solution: Solution, latitude: FloatArray) -> None:
    """Raise `DivergedError` if a solution comes to a pole, and the flight, at latitudes (m,) [rad], does not.

    A pole is 100 km from every place that is not near one.
    """
    if np.abs(solution.position[:, 0]).max() > AT_POLE and not near_pole(latitude).any():
        raise divergence_error("the estimate moved to a pole, and the flight does not come near one")


AT_POLE = np.radians(89.9)
"""Latitude at which an estimate has moved to a pole [rad]: 11 km from it."""


def divergence_error(what: str, error: Exception | None = None) -> DivergedError:
    """Return the exception for a solution that diverged; `what` says how, `error` is the cause."""
    detail = f" ({error})" if error else ""
    return DivergedError(
        f"the navigation solution diverged: {what}{detail}. Check for extreme settings of the navigator "
        "(p0, q, r, their scales, the initial σ, filter_rate) and of the sensors"
    )
