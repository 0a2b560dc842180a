"""East, north, up: the axes of datasets, plots and settings; inside the lab, axes are north, east, down."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation from north, east, down to east, north, up; it is its own inverse."""


def east_north_up(vectors_n: FloatArray) -> FloatArray:
    """Return vectors (..., 3) north, east, down as east, north, up; or the other way round."""
    return vectors_n[..., [1, 0, 2]] * (1.0, 1.0, -1.0)


def east_north_up_sizes(sizes_n: FloatArray) -> FloatArray:
    """Return variances or σ (..., 3) of north, east, down in the order of east, north, up; or back."""
    return sizes_n[..., [1, 0, 2]]
