"""Aid table: a new sensor costs a row and two files, and is then everywhere.

A radar altimeter above flat ground, whose beam points where the floor of the vehicle does, is added to a copy
of the lab, in the way of CONTRIBUTING: the row, the truth side and the belief side. Its kernels run as plain
Python.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lab.base.aid_table import AIDS
from lab.data.checks.auxiliary_check import CHECKS

ROOT = Path(__file__).parents[2]
ROW = '''    Aid(
        name="radar_altimeter",
        words="radar altimeter",
        title="Radar altimeter",
        about="Errors of a radar altimeter.",
        sensor="lab.sensors.radar_altimeter:RadarAltimeterErrors",
        kinds=("height above ground",),
        unit="m",
        shown_unit="m",
        state="radar altimeter {error}",
        file="radar.csv",
        column=Column("radar_height_m", 0.0, 2000.0, may_be_empty=True),
        check="height",
        live="radar_height",
        common="{sigma}",
        belief="lab.navigation.radar_altimeter",
    ),
)
"""All of them'''
BIAS = """    bias_sigma = readings.bias_sigma(2.0, unit="m", bounds=(0, 100))
    drift_sigma = readings.drift_sigma(0.5, unit="m", bounds=(0, 100))
    correlation_time = readings.correlation_time(100.0)
"""
SCALE = """    scale_factor_sigma = Quantity(1.0, unit="%", bounds=(0, 50), doc="Of its scale factor.")
"""
TRUTH = '''"""Radar altimeter: the distance to flat ground along the axis of the vehicle that points down."""

import numpy as np

from lab.base.parameters.setting_kinds import Quantity
from lab.sensors import readings
from lab.sensors.readings import AidSensor

GROUND = 20.0
"""Height of the ground above the ellipsoid [m]."""


class RadarAltimeterErrors(AidSensor):
    """Errors and timing of a radar altimeter."""

    NAME = "radar_altimeter"
    fitted = readings.fitted("a radar altimeter.")
    period = readings.period(0.5)
    noise = readings.noise(0.4, unit="m", bounds=(1e-3, 100))
{errors}    outages = readings.outages()

    def truth(self, trajectory, seed, times):
        """Return the true distances (a,) at times (a,) [m]."""
        truth = trajectory.at(times)
        return (truth.height - GROUND) / (np.cos(truth.euler[:, 0]) * np.cos(truth.euler[:, 1]))
'''
BELIEF = '''"""Radar altimeter: how a filter sees the distance to flat ground."""

import numpy as np

from lab.motion.frames.rotation import skew
from lab.navigation import strapdown
from lab.navigation.kernels.compilation import inline_kernel
from lab.sensors.radar_altimeter import GROUND


@inline_kernel
def see(state, C, v, age, H):
    """Return the distance by the navigator at the time of the reading."""
    level = C[2][2]
    seen = (state[strapdown.HEIGHT] + age * v[2] - GROUND) / level
    H[2], H[5] = -1.0 / level, age / level
    H[6], H[7] = seen * C[1][2] / level, -seen * C[0][2] / level
    return seen


def see_by_matrices(state, C_nb, velocity, age):
    """Return the same, and its row of H for the first 15 states."""
    row, axis = np.zeros(15), C_nb[:, 2]
    seen = (state[strapdown.HEIGHT] + age * velocity[2] - GROUND) / axis[2]
    row[[2, 5]] = np.array([-1.0, age]) / axis[2]
    row[6:9] = -seen / axis[2] * skew(axis)[2]  # the axis changes by c × φ
    return seen, row
'''


def lab_with_radar(folder: Path, error: str) -> Path:
    """Return a folder with a copy of the lab, in which a radar altimeter has a bias or a scale factor."""
    for name in ("lab", "dashboards"):
        shutil.copytree(ROOT / name, folder / name, copy_function=os.symlink)
    shutil.copytree(ROOT / "missions", folder / "missions")
    table = folder / "lab/base/aid_table.py"
    text = table.read_text("utf-8")
    is_scale = error == "scale"
    row = ROW.format(error=error, sigma="scale_factor_sigma" if is_scale else "bias_sigma")
    assert text.count(')\n"""All of them') == 1
    table.unlink()
    table.write_text(text.replace(')\n"""All of them', row), "utf-8")
    truth = TRUTH.format(errors=SCALE if is_scale else BIAS)
    (folder / "lab/sensors/radar_altimeter.py").write_text(truth, "utf-8")
    (folder / "lab/navigation/radar_altimeter.py").write_text(BELIEF, "utf-8")
    return folder


def test_each_row_names_a_comparison_that_there_is() -> None:
    assert {aid.check for aid in AIDS} <= {"", *CHECKS}


@pytest.mark.parametrize(
    ("error", "models"),
    [
        ("bias", ("phi",)),
        pytest.param("bias", (), marks=pytest.mark.proof),
        pytest.param("scale", (), marks=pytest.mark.proof),
    ],
)
def test_a_row_and_two_files_make_a_sensor(error: str, models: tuple[str, ...], tmp_path: Path) -> None:
    copy = lab_with_radar(tmp_path / "copy", error)
    done = subprocess.run(
        [sys.executable, ROOT / "tests/radar_altimeter.py", error, tmp_path, *models],
        env=os.environ
        | {
            "PYTHONPATH": f"{copy}{os.pathsep}{ROOT / 'tests'}",
            "NUMBA_DISABLE_JIT": "1",
            "XDG_CACHE_HOME": str(tmp_path / "cache"),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert Path(done.stdout.split()[0]).is_relative_to(copy)
