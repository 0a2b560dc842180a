"""Scenario: the settings of a homework: which are shown, which may be changed, and which are hidden."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

from lab.base.cache import digest
from lab.base.parameters.setting_error import SettingError
from lab.classroom.gallery.faults import FAULTS, Fault
from lab.classroom.homework.sealing import seal_for_teacher
from lab.experiment.experiment import Experiment

CHANGEABLE = ("navigator", "sensors")
"""Groups of which settings may be changed or hidden."""
FIXED = ("mission", "trajectory", "sensors.own_errors", "sensors.gps.period")
"""Settings and groups that a run of a homework takes from the homework: they decide how long it takes."""
OF_CARDS = ("sensors.assumed", "sensors.lacking")
"""What a card says of its numbers: no error of a sensor."""
NEVER = (*FIXED, "seed", "navigator.engine", "navigator.own_states", "sensors.gps.outages", *OF_CARDS)
"""Settings and groups that no homework lets a student change.

The reference engine takes a hundred times as long. Fixes that are withheld from a filter make its
innovations few, and own states need a function of the student.
"""
START = tuple(
    f"navigator.{kind}_{what}" for kind in ("position", "velocity", "attitude") for what in ("error", "sigma")
)
"""Settings of the true error at the start; besides those of the sensors, these may be hidden."""
SEEDS = 2**32
"""Number of seeds."""


@dataclass(frozen=True, repr=False)
class Hidden:
    """What is hidden; it has no readable form, so that nothing shows it by accident.

    Attributes
    ----------
    faults : tuple of str
        Names of faults of the gallery.
    settings : mapping
        Settings of the sensors as they really are, and of the true error at the start, in nested tables.
    seed : int
        Seed of the run.
    """

    faults: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    seed: int = 1

    @property
    def found(self) -> list[Fault]:
        """The faults."""
        return [FAULTS[name] for name in self.faults]


@dataclass(frozen=True)
class Scenario:
    """The settings of a homework.

    Attributes
    ----------
    name : str
        Identity of the homework; see `lab.classroom.homework.sealing`.
    title : str
        Its title.
    settings : mapping
        The settings that are shown, in nested tables.
    change : tuple of str
        Paths of settings and groups that the student may change.
    hidden : Hidden
        What is hidden.
    public : bytes
        The teacher's public keys; empty if nothing is sealed for anybody.
    """

    name: str
    title: str
    settings: Mapping[str, Any]
    change: tuple[str, ...]
    hidden: Hidden = field(repr=False)
    public: bytes = field(default=b"", repr=False)

    def sealed(self, seed: int) -> str:
        """Return the name of the homework, and a seed other than the shown one, sealed for the teacher.

        Unlike `key`, it has no digest of what is hidden, against which a guess could be tried.
        """
        if seed == self.shown.seed or not self.public:
            return f"homework {self.name}"
        sealed = seal_for_teacher(self.public, str(seed).encode(), seed_context(self.name))
        return f"homework {self.name} {base64.b64encode(sealed).decode()}"

    @property
    def key(self) -> str:
        """Text that distinguishes the runs of this homework from all others with the same settings."""
        hidden = self.hidden
        return f"homework {digest(self.name, hidden.faults, dict(hidden.settings), hidden.seed)}"

    @cached_property
    def shown(self) -> Experiment:
        """The experiment that is shown at first; not to be changed."""
        return Experiment().update(self.settings)

    def allows(self, path: str) -> bool:
        """Return whether the student may change the setting at a path."""
        return path in self.leaves and _is_in(path, self.change) and not is_never(path)

    @cached_property
    def leaves(self) -> frozenset[str]:
        """The paths of all settings, without groups and other forms."""
        return frozenset(path for path, _, _ in self.shown.leaves())

    def check_change(self, path: str) -> None:
        """Raise `SettingError` if the student may not change a setting; another seed is always possible.

        A group is refused: there may be settings in it that he may not change.
        """
        if path != "seed" and not self.allows(path):
            raise SettingError(
                f"{path[:60]}: the homework “{self.title}” does not let you change it; accepted are "
                f"changes of {', '.join(self.change) or 'nothing'}"
            )

    def changes(self, experiment: Experiment) -> dict[str, Any]:
        """Return the settings that a student changed, by their path, in the order of the settings.

        Raises
        ------
        SettingError
            If a setting differs that the homework does not let him change.
        """
        found = {}
        for path, value in self._differences(experiment):
            self.check_change(path)
            if path != "seed":
                found[path] = value
        return found

    def check_fixed(self, experiment: Experiment) -> None:
        """Raise `SettingError` if an experiment differs in a setting that a run takes from the homework."""
        for path, _ in self._differences(experiment):
            if _is_in(path, FIXED) or path.endswith(".fitted"):
                raise SettingError(
                    f"{path}: a run of the homework “{self.title}” takes it from the homework; accepted is "
                    f"{self.shown.get(path)!r}"
                )

    def _differences(self, experiment: Experiment) -> Iterator[tuple[str, Any]]:
        for path, owner, name in experiment.leaves():
            value = getattr(owner, name)
            if value != self.shown.get(path):
                yield path, value

    def real(self, experiment: Experiment) -> Experiment:
        """Return the settings with which the sensors are simulated, and the start is drawn.

        Of the student's experiment, the seed chooses another realisation, and its outages are added.
        """
        real = Experiment().update(self.shown.to_dict()).update(self.hidden.settings)
        for fault in self.hidden.found:
            for path, value in fault.sensors.items():
                real.set(f"sensors.{path}", value)
        real.set("seed", (self.hidden.seed + experiment.seed - self.shown.seed) % SEEDS)
        outages = {*real.sensors.gps.outages, *experiment.sensors.gps.outages}
        real.set("sensors.gps.outages", sorted(outages))
        return real


def seed_context(name: str) -> str:
    """Return what the seed of a student's run is sealed as."""
    return f"seed of a run of the homework {name}"


def is_never(path: str) -> bool:
    """Return whether no homework lets a student change a setting."""
    return _is_in(path, NEVER) or path.endswith(".fitted")


def can_be_hidden(path: str) -> bool:
    """Return whether a setting can be hidden: an error of a sensor, or of the start."""
    is_sensor = path.startswith("sensors.") and not _is_in(path, (*FIXED, *OF_CARDS))
    return path in START or (is_sensor and not path.endswith(".fitted"))


def _is_in(path: str, places: tuple[str, ...]) -> bool:
    return any(path == place or path.startswith(f"{place}.") for place in places)
