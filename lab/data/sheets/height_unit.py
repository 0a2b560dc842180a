"""Height unit: whether heights without a unit are feet or centimetres, by the accelerometers.

Over a few seconds the specific force integrated twice shows how the height changes, but for a parabola: an
unknown height and velocity at the start, and a bias. The heights follow it with the factor of their unit.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.log_check import windows_of
from lab.data.checks.velocity_matching import Window, match, turned
from lab.data.files.unit_names import UNITS
from lab.data.log.log_section import piece
from lab.data.log.sensor_log import SensorLog

_UNITS = ("m", "ft", "cm", "mm")
"""Units that loggers write heights in."""
_MIN_FIXES = 6
"""Fewest fixes in a window, of which three fit the parabola."""
_CLEARLY = 8.0
"""Least factor of the heights in its σ: those of windows are not quite independent."""
_LIKE = 0.3
"""Largest distance of the factor from that of a unit, as a logarithm: a quarter of that between m and ft.
Measured: 0.90 to 1.08 in five minutes of a flight."""


def unit_that_agrees(log: SensorLog, taken: str) -> tuple[str, float]:
    """Return the unit that the motion shows of heights, and how much their numbers change per metre.

    Parameters
    ----------
    log
        The log, in forward, right, down.
    taken
        The unit in which its heights were read.

    Returns
    -------
    str, float
        The unit; that in which they were read if the motion shows no other one.
    """
    log = piece(log)
    pairs = [pair for window in windows_of(log) if (pair := _changes(log, window)) is not None]
    if not pairs:
        return taken, 1.0
    moved, written = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    power = float(moved @ moved)
    factor = float(moved @ written) / power if power else 0.0
    spread = float(np.sqrt(np.mean((written - factor * moved) ** 2)))
    if factor <= 0 or factor * np.sqrt(power) < _CLEARLY * spread:
        return taken, 1.0
    factor /= UNITS["length"][taken]
    near = min(_UNITS, key=lambda unit: abs(np.log(factor * UNITS["length"][unit])))
    return (near if abs(np.log(factor * UNITS["length"][near])) < _LIKE else taken), factor


def _changes(log: SensorLog, window: Window) -> tuple[FloatArray, FloatArray] | None:
    """Return the heights by the accelerometers and by the fixes, each without its parabola."""
    time, height = log.gnss.time - log.gnss.latency, log.gnss.position[:, 2]
    inside = (time >= window.time[0]) & (time <= window.time[-1])
    if inside.sum() < _MIN_FIXES:
        return None
    found, dt = match(window), np.diff(window.time)
    attitude = found.C_nb * turned(window.dtheta - found.gyro_bias * dt[:, None])[:-1]
    velocity = np.cumsum(-attitude.apply(window.dvelocity)[:, 2] - STANDARD_GRAVITY * dt)
    risen = np.append(0.0, np.cumsum(velocity * dt))
    since = time[inside] - window.time[0]
    both = np.column_stack((np.interp(time[inside], window.time, risen), height[inside]))
    parabola = np.vander(since, 3)
    left = both - parabola @ np.linalg.lstsq(parabola, both, rcond=None)[0]
    return left[:, 0], left[:, 1]
