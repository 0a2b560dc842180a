"""Full scale: samples of an IMU that stand at the end of its range.

A sensor at the end of its range shows one value again and again, with no sample beyond it and few just below
it; the largest values of noise and motion differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.checks.imu_axes import NAMES

_ROUNDING = 1e-9
"""Relative difference of two samples that are equal: rates are increments over their interval."""
_IN_A_ROW = 5
"""Fewest samples in a row at the end: four equal rows are a sensor polled too often
(`sensor_log.MAX_REPEAT`)."""
_LEVELS = 20
"""Fewest different values between the median of the others and the end: coarse sensors at rest show two or
three."""
_BELOW = 0.02
"""Part of the way from the median to the end in which few samples lie just below it."""
_MOST, _SYMMETRIC = 0.5, 0.8
"""Part of the samples that are most of them, and least size of an end where most are, relative to the largest
value on either side: a coarse sensor that mostly rests shows one small value, too, and a range is as wide to
both sides."""


class FullScale(NamedTuple):
    """An axis at the end of its range.

    Attributes
    ----------
    axis : int
        0 to 2 of the gyros, 3 to 5 of the accelerometers.
    limit : float
        The end: the largest or the smallest value [rad/s], [m/s²].
    at : (n,) array
        Mask of the samples there.
    """

    axis: int
    limit: float
    at: NDArray[np.bool_]

    @property
    def words(self) -> str:
        """The axis, the end and the number of samples there, as text."""
        sensor, axis = divmod(self.axis, 3)
        unit, factor = (("°/s", np.degrees(1.0)), ("m/s²", 1.0))[sensor]
        return (
            f"the {NAMES[axis]} one stands at {factor * self.limit:.4g} {unit} in "
            f"{np.count_nonzero(self.at)} samples ({100 * self.at.mean():.2g} %), and is never beyond"
        )


def full_scales(rates: FloatArray) -> list[FullScale]:
    """Return the axes at an end of their range, the upper and the lower end apart.

    Parameters
    ----------
    rates : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²].
    """
    found = []
    for axis in range(rates.shape[1]):
        for sign in (1.0, -1.0):
            at = _at_end(sign * rates[:, axis])
            if at.any():
                found.append(FullScale(axis, float(rates[at, axis][0]), at))
    return found


def _at_end(values: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the values at the upper end of a range; false for all if there is none."""
    top = float(values.max())
    at = np.asarray(values >= top - _ROUNDING * abs(top))
    if at.all() or (at.mean() > _MOST and top < _SYMMETRIC * np.abs(values).max()):
        return np.zeros_like(at)
    middle = float(np.median(values[~at]))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], at, [False])).astype(np.int8)))
    below = ~at & (values >= top - _BELOW * (top - middle))
    in_a_row = int((edges[1::2] - edges[::2]).max())
    if in_a_row < _IN_A_ROW or at.sum() <= below.sum():
        return np.zeros_like(at)
    levels = np.unique(values[values > middle]).size
    return at if levels > _LEVELS else np.zeros_like(at)
