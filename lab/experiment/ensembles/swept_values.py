"""Swept values: the settings, cards and missions of a sweep, checked, and the experiments that they make."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.missions import mission
from lab.sensors.cards import Card, card

CARD = "card"
"""What is swept like a setting, although it sets many: the card of the sensors."""


class Swept(NamedTuple):
    """A swept setting: its path, the name of its dimension, and its values."""

    path: str
    dim: str
    values: list[Any]


def read(experiment: Experiment, settings: Mapping[str, Sequence[Any]]) -> list[Swept]:
    """Return the swept settings; each value has been accepted by its setting.

    Raises
    ------
    SettingError
        If there is no such setting or card, or a value is not accepted, missing or given twice.
    MissionError
        If there is no such mission.
    """
    if not isinstance(settings, Mapping) or not settings:
        raise SettingError(
            'sweep: no setting named; accepted is, for instance, {"sensors.gyro.noise_density": [0.01, 0.1]}'
        )
    values = {path: check_values(experiment, path, given) for path, given in settings.items()}
    for form in experiment.OTHER_FORMS:
        if form in values and (other := experiment.derived(form).setting) in values:
            raise SettingError(f"{form} and {other} are two forms of one setting; accepted is one of them")
    return [Swept(path, name_dimension(path, values), taken) for path, taken in values.items()]


def check_values(experiment: Experiment, path: str, given: Sequence[Any]) -> list[Any]:
    """Return the values of a setting after a check of each, or the named cards; errors as of `read`."""
    if not isinstance(path, str):
        raise SettingError(f"sweep: {path!r} is no name of a setting, such as sensors.gyro.noise_density")
    if path == "seed":
        raise SettingError("seed: every sweep runs over seeds; give their number or a list as `seeds`")
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise SettingError(f"{path}: {given!r} is one value; accepted is a list of values")
    values = [value.tolist() if isinstance(value, np.ndarray | np.generic) else value for value in given]
    if not values:
        raise SettingError(f"{path}: there is no value in the list")
    if path == CARD:
        values = [_card(value) for value in values]
    names = name_cards(values)
    twice = [name for at, name in enumerate(names) if name in names[:at]]
    if twice:
        raise SettingError(f"{path}: {twice[0]!r} is in the list twice")
    trial = experiment.copy()
    for value in values:
        _set(trial, path, value)
        if path == "mission":
            mission(value)
    return values


def _card(value: Any) -> Card:
    if isinstance(value, Card):
        return value
    if not isinstance(value, str | os.PathLike):
        raise SettingError(f"card: {value!r} is no card; accepted is a card, or its name or .toml file")
    return card(value)


def name_cards(values: list[Any]) -> list[Any]:
    """Return values with the names of cards in their place."""
    return [value.name if isinstance(value, Card) else value for value in values]


def _set(point: Experiment, path: str, value: Any) -> None:
    """Give an experiment a value of a setting, or the sensors of a card with a filter that suits them."""
    if path == CARD:
        value.load(point)
    else:
        point.set(path, value)


def name_dimension(path: str, paths: Mapping[str, object]) -> str:
    """Return the name of a setting's dimension: the end of its path that no other swept setting has."""
    words = path.split(".")
    ends = (words[-count:] for count in range(1, len(words) + 1))
    own = next(end for end in ends if sum(other.split(".")[-len(end) :] == end for other in paths) == 1)
    return "_".join(own)


def combinations(
    experiment: Experiment, swept: list[Swept], fixed: Mapping[str, Any]
) -> Iterator[Experiment]:
    """Iterate over the experiments of all combinations of values, the last setting fastest.

    Settings override the card, whatever their order; those that are `fixed` are set at every point.
    """
    for values in product(*(one.values for one in swept)):
        point = experiment.copy()
        pairs = [(one.path, value) for one, value in zip(swept, values, strict=True)]
        # A card sets many settings. The other form of a setting depends on further settings.
        for path, value in sorted(
            [*fixed.items(), *pairs], key=lambda pair: (pair[0] != CARD, pair[0] in point.OTHER_FORMS)
        ):
            _set(point, path, value)
        yield point
