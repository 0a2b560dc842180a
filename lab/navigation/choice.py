"""Choice: the linear error model that a navigator's settings name, and whether its filter is ready."""

from __future__ import annotations

from lab.navigation import navigator, unscented
from lab.navigation.error_models import ErrorModel, with_states
from lab.navigation.settings import NavigatorSettings
from lab.navigation.wander_models import linear_model


def chosen_model(settings: NavigatorSettings) -> ErrorModel:
    """Return the error model of a linear filter by name, mechanization and number of states."""
    return with_states(linear_model(settings.model, settings.mechanization), settings.states)


def is_ready(settings: NavigatorSettings) -> bool:
    """Return whether the filter is ready in this process: compiled, or loaded from the disk."""
    if settings.model == "nonlinear":
        return unscented.is_compiled()
    return navigator.is_compiled(chosen_model(settings))
