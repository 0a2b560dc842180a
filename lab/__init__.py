"""INS Lab: an interactive laboratory for MEMS inertial navigation.

A flight becomes a smooth true trajectory; an IMU and a GPS receiver are simulated on it; a strapdown
navigator with an error-state Kalman filter computes position, velocity and attitude; the lab shows how good
they are, and why.

>>> from lab import Experiment
>>> result = Experiment(mission="montreal", seed=1).run()
>>> result.summary
>>> result.errors.position.sel(axis="north").plot()

The language, the same everywhere:

- Frames: i inertial, e Earth, n navigation (north, east, down), b body (forward, right, down). A vector
  ``v`` resolved in n is ``v_n``; the rotation taking b to n is ``C_nb``, as a quaternion ``q_nb``, scalar
  first.
- Inside: float64, SI units, radians, time first: ``(n, 3)``. Settings, datasets, files and plots: degrees,
  datasheet units, east-north-up; every number that leaves carries its unit.
- Error is estimate minus truth, always. Error states, in order: position, velocity, attitude, gyro bias,
  accelerometer bias, and with 21 states gyro and accelerometer scale
  (`lab.navigation.filters.error_models.STATES`).
- Truth and belief are different: `lab.sensors` describes the real errors of the sensors,
  `lab.navigation.settings` the filter's assumptions about them.
- The same settings and seed give the same result, bit for bit.
"""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from typing import TYPE_CHECKING, Any

from lab.base.collection_pause import collection_pause
from lab.base.old_names import find_old_names
from lab.views.cards import register_cards

if TYPE_CHECKING:
    from lab.analysis import allan, budget
    from lab.base.parameters.setting_error import SettingError
    from lab.classroom.exercises.exercise import check
    from lab.experiment.calibration import calibrate_imu, calibrate_magnetometer, calibrate_mounting
    from lab.experiment.ensembles.comparison import compare
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.ensembles.seeds import run_ensemble
    from lab.experiment.experiment import Experiment
    from lab.experiment.imu_numbers import numbers
    from lab.experiment.judged_log import judge
    from lab.experiment.receiver import receiver
    from lab.experiment.result import Result
    from lab.experiment.saved_result import SavedResult, open_result
    from lab.experiment.sweep import Sweep
    from lab.missions import Mission, MissionError, Recording
    from lab.missions.catalogue import mission
    from lab.motion.frames import earth, rotation
    from lab.motion.truth.trajectory import Trajectory
    from lab.navigation.algorithm import Algorithm, Estimate
    from lab.navigation.filters.user_states import declare_states
    from lab.run.run import ResultError
    from lab.sensors.cards import card, cards
    from lab.views import plots
    from lab.views.export import export_track

__all__ = [
    "Algorithm",
    "Ensemble",
    "Estimate",
    "Experiment",
    "Mission",
    "MissionError",
    "Recording",
    "Result",
    "ResultError",
    "SavedResult",
    "SettingError",
    "Sweep",
    "Trajectory",
    "__version__",
    "allan",
    "budget",
    "calibrate_imu",
    "calibrate_magnetometer",
    "calibrate_mounting",
    "card",
    "cards",
    "check",
    "compare",
    "declare_states",
    "earth",
    "export_track",
    "judge",
    "mission",
    "numbers",
    "open_result",
    "plots",
    "receiver",
    "rotation",
    "run_ensemble",
]

__version__ = "0.2.0"

_HOMES = {
    "Algorithm": "lab.navigation.algorithm",
    "Estimate": "lab.navigation.algorithm",
    "Ensemble": "lab.experiment.ensembles.ensemble",
    "Experiment": "lab.experiment.experiment",
    "Mission": "lab.missions",
    "MissionError": "lab.missions",
    "Recording": "lab.missions",
    "Result": "lab.experiment.result",
    "ResultError": "lab.run.run",
    "SavedResult": "lab.experiment.saved_result",
    "SettingError": "lab.base.parameters.setting_error",
    "Sweep": "lab.experiment.sweep",
    "Trajectory": "lab.motion.truth.trajectory",
    "calibrate_imu": "lab.experiment.calibration",
    "calibrate_magnetometer": "lab.experiment.calibration",
    "calibrate_mounting": "lab.experiment.calibration",
    "card": "lab.sensors.cards",
    "cards": "lab.sensors.cards",
    "check": "lab.classroom.exercises.exercise",
    "compare": "lab.experiment.ensembles.comparison",
    "declare_states": "lab.navigation.filters.user_states",
    "export_track": "lab.views.export",
    "judge": "lab.experiment.judged_log",
    "mission": "lab.missions",
    "numbers": "lab.experiment.imu_numbers",
    "open_result": "lab.experiment.saved_result",
    "receiver": "lab.experiment.receiver",
    "run_ensemble": "lab.experiment.ensembles.seeds",
}
_MODULES = {
    "allan": "lab.analysis.allan",
    "budget": "lab.analysis.budget",
    "earth": "lab.motion.frames.earth",
    "plots": "lab.views.plots",
    "rotation": "lab.motion.frames.rotation",
}


def warn_of_foreign_files(folder: str) -> None:
    """Warn if another package called ``lab`` has modules beside this file, where this package has none."""
    try:
        names = os.listdir(folder)  # noqa: PTH208 - pathlib loads slowly
    except OSError:  # the package is imported from an archive
        return
    foreign = sorted(name for name in names if name.endswith(".py") and name != "__init__.py")
    if foreign:
        warnings.warn(
            f"{folder} has modules of another package called lab: {', '.join(foreign)}. Each overwrites "
            "files of the other, so the two cannot be in one environment. Uninstall both (python -m pip "
            "uninstall lab ins-lab), and install ins-lab again, the other in an environment of its own.",
            UserWarning,
            stacklevel=2,
        )


warn_of_foreign_files(__path__[0])
find_old_names()
register_cards()
if "IPython" in sys.modules:  # one that is not loaded does not run; loading it would take half a second
    from lab.views.completion import register_completion

    register_completion()


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, because the compiler and the plotting libraries load slowly."""
    home = _MODULES.get(name) or _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'lab' has no attribute {name!r}")
    with collection_pause():
        module = importlib.import_module(home)
    return module if name in _MODULES else getattr(module, name)


def __dir__() -> list[str]:
    return __all__
