"""Value steps: how finely a file records each quantity, told from the numbers alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.repair.raw_flight import RawFlight

FloatArray = NDArray[np.float64]

_LOOKED_AT = 20_000
_FINEST = 1e-12
_FEW, _ENOUGH = 20, 8


def value_step(values: FloatArray) -> float:
    """Return the step of which all differences between values are multiples; 0 if there is none.

    Parameters
    ----------
    values : (n,) array
        Samples of one quantity.
    """
    different = np.diff(np.unique(values[:_LOOKED_AT]))
    different = different[different > _FINEST * max(float(np.abs(values).max(initial=0.0)), 1e-3)]
    if len(different) < 3:
        return 0.0
    step = float(different.min())
    for _ in range(2):
        multiple = np.round(different / step)
        near = (multiple > 0) & (multiple < _FEW)
        if near.sum() < min(_ENOUGH, len(different)):
            return 0.0
        step = float(different[near] @ multiple[near] / (multiple[near] @ multiple[near]))
    off = np.abs(different[near] - multiple[near] * step)
    # Numbers that are not rounded lie between the multiples as often as on them.
    return step if np.quantile(off, 0.9) < 0.1 * step else 0.0


def value_steps(raw: RawFlight) -> dict[str, tuple[float, str]]:
    """Return the step of each quantity of a flight with its unit: position [m], velocity [m/s], attitude [°].

    Zero for one recorded more finely than its samples tell.
    """
    steps: dict[str, tuple[float, str]] = {}
    if raw.latitude is not None and raw.longitude is not None:
        meridian, transverse = earth.radii(np.sin(raw.latitude[0]))
        north = value_step(raw.latitude) * meridian
        east = value_step(raw.longitude) * transverse * np.cos(raw.latitude[0])
        steps["position"] = float(max(north, east)), "m"
    if raw.height is not None:
        steps["height"] = value_step(raw.height), "m"
    if raw.velocity_n is not None:
        steps["velocity"] = max(value_step(column) for column in raw.velocity_n.T), "m/s"
    if raw.euler is not None:
        steps["attitude"] = float(np.degrees(max(value_step(column) for column in raw.euler.T))), "°"
    if raw.airspeed is not None:
        steps["airspeed"] = value_step(raw.airspeed), "m/s"
    return steps
