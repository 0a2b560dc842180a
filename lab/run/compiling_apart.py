"""Compiling apart: the filter of a long flight is compiled in another process, which gives its memory back.

The compiler keeps some 200 MB of a filter and its smoother in the process that compiled them. The code itself
is loaded from the disk, and takes a fifth of that.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

from lab.navigation.model_choice import is_missing
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

_COMMAND = (
    "import json, sys; from lab.experiment.variants import compile_variant; "
    "compile_variant(json.load(sys.stdin))"
)


def compile_apart(navigator: NavigatorSettings, sensors: SensorSuite, rate: float) -> None:
    """Compile the filter of some settings into the cache on the disk, if it is not there.

    If that fails, nothing happens: this process then compiles the filter when it needs it.

    Parameters
    ----------
    navigator, sensors
        The settings.
    rate
        Rate of the samples [Hz].
    """
    if not sys.executable or not is_missing(navigator, sensors, rate):
        return
    groups = {"navigator": navigator.to_dict(), "sensors": sensors.to_dict()}
    subprocess.run(
        [sys.executable, "-c", _COMMAND],
        input=json.dumps({"trajectory.imu_rate": rate, **groups}),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        text=True,
        check=False,
    )
