"""Choice: the linear error model that a navigator's settings name, and whether its filter is ready."""

from __future__ import annotations

from lab.navigation import navigator, unscented
from lab.navigation.belief import chosen_blocks, is_aided
from lab.navigation.error_models import ErrorModel
from lab.navigation.further_columns import with_blocks
from lab.navigation.settings import NavigatorSettings
from lab.navigation.wander_models import linear_model
from lab.sensors.suite import SensorSuite


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
    """Return whether the filter is ready in this process: compiled, or loaded from the disk."""
    aided = sensors is not None and is_aided(settings, sensors)
    if settings.model == "nonlinear":
        return unscented.is_compiled(aided=aided)
    return navigator.is_compiled(chosen_model(settings, sensors), aided=aided)
