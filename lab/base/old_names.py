"""Old names: modules of version 0.1 that notebooks import by their whole name, and what they are called now.

>>> from lab.frames.displacement import displacement  # now lab.motion.frames.displacement

An old name is imported as before, with a warning that has the new one.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

OLD_NAMES = {
    "lab.algorithm_file": "lab.navigation.algorithm",
    "lab.analysis.finding": "lab.analysis.verdicts.finding",
    "lab.analysis.verdict": "lab.analysis.verdicts.verdict",
    "lab.datasets.innovations": "lab.experiment.datasets.innovations",
    "lab.ensembles.comparison": "lab.experiment.ensembles.comparison",
    "lab.ensembles.ensemble": "lab.experiment.ensembles.ensemble",
    "lab.ensembles.seeds": "lab.experiment.ensembles.seeds",
    "lab.exercises.catalogue": "lab.classroom.exercises.exercise",
    "lab.exercises.exercise": "lab.classroom.exercises.exercise",
    "lab.experiment_settings": "lab.run.experiment_settings",
    "lab.export": "lab.views.export",
    "lab.frames.displacement": "lab.motion.frames.displacement",
    "lab.frames.earth": "lab.motion.frames.earth",
    "lab.frames.rotation": "lab.motion.frames.rotation",
    "lab.homework.hand_in": "lab.classroom.homework.hand_in",
    "lab.homework.homework_file": "lab.classroom.homework.homework_file",
    "lab.html_frame": "lab.base.notebook_card",
    "lab.live.axis_check": "lab.live.bench.axis_check",
    "lab.live.recorded_log": "lab.data.streams.recorded_log",
    "lab.live.simulated_flight": "lab.live.simulated.simulated_flight",
    "lab.navigation.error_models": "lab.navigation.filters.error_models",
    "lab.navigation.further_columns": "lab.navigation.filters.further_columns",
    "lab.navigation.kalman": "lab.navigation.filters.kalman",
    "lab.navigation.own_states": "lab.navigation.filters.user_states",
    "lab.navigation.propagation": "lab.navigation.kernels.propagation",
    "lab.navigation.rest_alignment": "lab.navigation.alignment.rest_alignment",
    "lab.navigation.smoother": "lab.navigation.filters.smoother",
    "lab.navigation.unscented": "lab.navigation.filters.unscented",
    "lab.navigation.unscented_aids": "lab.navigation.filters.unscented_aids",
    "lab.parameters.setting_help": "lab.base.parameters.setting_kinds",
    "lab.parameters.setting_kinds": "lab.base.parameters.setting_kinds",
    "lab.parameters.settings": "lab.base.parameters.settings",
    "lab.parameters.units": "lab.base.parameters.units",
    "lab.result": "lab.experiment.result",
    "lab.result_plots": "lab.experiment.result_plots",
    "lab.sensors.noise_variance": "lab.sensors.imu_errors",
    "lab.sweep": "lab.experiment.sweep",
    "lab.truth.trajectory": "lab.motion.truth.trajectory",
}
"""Each module that a notebook or a document of version 0.1 names, and that module today."""


class OldNames(MetaPathFinder, Loader):
    """Finds the modules of the table, and the packages that they were in."""

    def find_spec(
        self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how a module of the table, or a package of one, is loaded; None for any other."""
        if name in OLD_NAMES:
            return ModuleSpec(name, self)
        is_package = any(old.startswith(f"{name}.") for old in OLD_NAMES)
        return ModuleSpec(name, self, is_package=True) if is_package else None

    def exec_module(self, module: ModuleType) -> None:
        """Give a module the content of the one that has its place today."""
        new = OLD_NAMES.get(module.__name__)
        if new is not None:
            warnings.warn(f"{module.__name__} is {new} now", DeprecationWarning, stacklevel=2)
            module.__getattr__ = partial(getattr, importlib.import_module(new))  # type: ignore[method-assign]


def find_old_names() -> None:
    """Let Python find the modules of the table, after all others; may be repeated."""
    if not any(isinstance(finder, OldNames) for finder in sys.meta_path):
        sys.meta_path.append(OldNames())
