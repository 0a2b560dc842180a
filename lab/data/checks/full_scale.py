"""Full scale: samples of an IMU that stand at the end of its range.

A sensor at the end of its range shows one value again and again, with no sample beyond it and few just below
it; the largest values of noise and motion differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.data.checks import limits
from lab.data.checks.imu_axes import NAMES


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
            f"{np.count_nonzero(self.at)} samples ({format_number(100 * self.at.mean())} %), and is never "
            "beyond"
        )


def range_remarks(rates: FloatArray) -> list[str]:
    """Return a remark about each axis that stands at an end of its range, as `full_scales`."""
    kinds = ("gyros", "accelerometers")
    return [
        f"The {kinds[one.axis // 3]} are at the end of their range: {one.words}; the filter does not model "
        "this."
        for one in full_scales(rates)
    ]


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
    at = np.asarray(values >= top - limits.LOG.equal_samples * abs(top))
    if at.all() or (
        at.mean() > limits.LOG.most_samples and top < limits.LOG.symmetric_range * np.abs(values).max()
    ):
        return np.zeros_like(at)
    middle = float(np.median(values[~at]))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], at, [False])).astype(np.int8)))
    below = ~at & (values >= top - limits.LOG.below_end * (top - middle))
    in_a_row = int((edges[1::2] - edges[::2]).max())
    if in_a_row < limits.LOG.samples_at_end or at.sum() <= below.sum():
        return np.zeros_like(at)
    levels = np.unique(values[values > middle]).size
    return at if levels > limits.LOG.levels else np.zeros_like(at)
