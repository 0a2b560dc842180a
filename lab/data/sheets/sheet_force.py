"""Sheet force: accelerations without a unit that may be milli-g or cm/s²: gravity is 1000 or 981 of them."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import STANDARD_GRAVITY

_AVERAGED = 1.0
"""Time over which the specific force is averaged against vibration [s]."""
_CALM = 0.25
"""Part of the averages with the slowest turns, by which gravity is judged: a banked turn adds to it."""
_AMBIGUOUS = (0.971, 0.9905)
"""Gravity read in mg [g] that may be cm/s² (0.9807) within 1 %. Measured: 0.996 to 1.009 in five minutes of a
flight with turns. A bias of 20 mg, usual for MEMS, makes the same of mg."""


def refuse_cm_per_s2(time: FloatArray, samples: FloatArray, place: str) -> None:
    """Raise if accelerations that are read as mg may be cm/s².

    Parameters
    ----------
    time : (n,) array
        Time stamps [s].
    samples : (n, 6) array
        Angular rate, and specific force read as mg [m/s²].
    place
        Their first column, and where it stands.

    Raises
    ------
    MissionError
        If gravity is as long as that in cm/s².
    """
    known = np.isfinite(samples).all(axis=1) & np.isfinite(time)
    samples = samples[known]
    step = float(np.median(np.diff(time[known]))) if len(samples) > 1 else 0.0
    count = min(max(1, round(_AVERAGED / step)) if step > 0 else 1, max(len(samples), 1))
    parts = samples[: len(samples) // count * count].reshape(-1, count, 6)
    if not len(parts):
        return
    turn = np.linalg.norm(parts[:, :, :3], axis=2).mean(axis=1)
    force = np.linalg.norm(parts[:, :, 3:].mean(axis=1), axis=1)
    size = float(np.median(force[turn <= np.quantile(turn, _CALM)])) / STANDARD_GRAVITY
    if _AMBIGUOUS[0] < size < _AMBIGUOUS[1]:
        raise MissionError(
            f"{place}: the accelerometers measure {1000 * size:.0f} without turns, which may be gravity in "
            "cm/s² (981) or in mg (1000) with a bias, and the headings name no unit; accepted are columns "
            "with their unit: for each of the three --unit HEADING=cm/s² or --unit HEADING=mg"
        )
