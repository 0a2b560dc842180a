"""Quantisation: the step in which a file records each quantity, estimated from the numbers alone."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.rebuild.raw_flight import JUDGED_SAMPLES, RawFlight
from lab.motion.frames.displacement import metres_per_radian

_FINEST = 1e-12
"""Smallest difference counted as one, relative to the largest value: below it lies the rounding of
doubles."""
_LEAST_SIZE = 1e-3
"""Value to which that is relative at least, so that differences about zero are not counted at any size."""
_MIN_DIFFERENCES = 3
"""Fewest distinct differences that show a step: two of them are multiples of something by chance."""
_MAX_MULTIPLE = 20
"""Differences of fewer steps than this are fitted: the rounding of a larger one says little of the step."""
_MIN_NEAR = 8
"""Fewest such differences, where there are as many at all."""
_ON_STEPS = 0.9
"""Part of the differences that has to lie on multiples of the step."""
_MAX_OFF_STEP = 0.1
"""How far off a multiple that is, in steps: numbers that are not rounded lie evenly, up to 0.5."""


def value_step(values: FloatArray) -> float:
    """Return the step of which all differences between values are multiples; 0 if there is none.

    Parameters
    ----------
    values : (n,) array
        Samples of one quantity.
    """
    different = np.diff(np.unique(values[:JUDGED_SAMPLES]))
    different = different[different > _FINEST * max(float(np.abs(values).max(initial=0.0)), _LEAST_SIZE)]
    if len(different) < _MIN_DIFFERENCES:
        return 0.0
    step = float(different.min())
    for _ in range(2):
        multiple = np.round(different / step)
        near = (multiple > 0) & (multiple < _MAX_MULTIPLE)
        if near.sum() < min(_MIN_NEAR, len(different)):
            return 0.0
        step = float(different[near] @ multiple[near] / (multiple[near] @ multiple[near]))
    off = np.abs(different[near] - multiple[near] * step)
    # Numbers that are not rounded lie between the multiples as often as on them.
    return step if np.quantile(off, _ON_STEPS) < _MAX_OFF_STEP * step else 0.0


def value_steps(raw: RawFlight) -> dict[str, tuple[float, str]]:
    """Return the step of each quantity of a flight with its unit: position [m], velocity [m/s], attitude [°].

    Zero where the step is finer than the samples show.
    """
    steps: dict[str, tuple[float, str]] = {}
    if raw.latitude is not None and raw.longitude is not None:
        per_latitude, per_longitude = metres_per_radian(raw.latitude[:1], 0.0)
        north = value_step(raw.latitude) * per_latitude.item()
        east = value_step(raw.longitude) * per_longitude.item()
        steps["position"] = max(north, east), "m"
    if raw.height is not None:
        steps["height"] = value_step(raw.height), "m"
    if raw.velocity_n is not None:
        steps["velocity"] = max(map(value_step, raw.velocity_n.T)), "m/s"
    if raw.euler is not None:
        steps["attitude"] = float(np.degrees(max(map(value_step, raw.euler.T)))), "°"
    if raw.airspeed is not None:
        steps["airspeed"] = value_step(raw.airspeed), "m/s"
    return steps
