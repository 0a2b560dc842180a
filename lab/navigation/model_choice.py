"""Model choice: the linear error model that a navigator's settings name, and whether its filter is ready."""

from __future__ import annotations

from lab.base.compiling import compiled_cache
from lab.navigation import navigator
from lab.navigation.belief import chosen_blocks, is_aided, schedule_filter
from lab.navigation.filters import smoother, unscented
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.kernels.driver import driver
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

MANY = 2**20
"""Samples of a flight that is longer than any interval between two propagations of the covariance."""


def chosen_model(settings: NavigatorSettings, sensors: SensorSuite | None = None) -> ErrorModel:
    """Return the error model of a linear filter by name, mechanization and states.

    Parameters
    ----------
    settings
        The filter.
    sensors
        The sensors that it uses besides IMU and GPS; None for none.
    """
    model = linear_model(settings.model, settings.mechanization)
    return with_blocks(model, chosen_blocks(settings, sensors))


def is_ready(settings: NavigatorSettings, sensors: SensorSuite | None = None) -> bool:
    """Return whether the filter waits for no compiler: compiled here, or on the disk."""
    aided = sensors is not None and is_aided(settings, sensors)
    if settings.model == "nonlinear":
        return unscented.is_compiled(aided=aided)
    return navigator.is_compiled(chosen_model(settings, sensors), aided=aided)


def is_missing(settings: NavigatorSettings, sensors: SensorSuite, rate: float) -> bool:
    """Return whether a part of the filter is neither ready nor on the disk, so it will be compiled.

    Parameters
    ----------
    settings, sensors
        The filter, and the sensors that it uses.
    rate
        Rate of the samples [Hz].
    """
    aided = is_aided(settings, sensors)
    if settings.model == "nonlinear":
        return compiled_cache.is_missing(unscented.driver(aided=aided))
    model = chosen_model(settings, sensors)
    forward = driver(model, summed=schedule_filter(settings, 1 / rate, MANY).stride > 1, aided=aided)
    parts = [forward, smoother.backward_pass(model, aided=aided)] if settings.smoother else [forward]
    return any(map(compiled_cache.is_missing, parts))
