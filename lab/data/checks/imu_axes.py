"""IMU axes: other orders and signs of the axes of an IMU that may be the right ones, and how to set them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError

NAMES = ("forward", "right", "down")
"""The axes of the body."""
SAME = np.eye(3)
"""No change of any axis."""


XYZ = ("x", "y", "z")
"""The axes of an IMU, each also with a minus before it."""


def axes_matrix(axes: Sequence[str], where: str = "") -> FloatArray:
    """Return the matrix (3, 3) that takes vectors in the axes of the IMU to forward, right, down.

    Parameters
    ----------
    axes
        The axes of the IMU that point there, such as y, x, -z.
    where
        What the message begins with.

    Raises
    ------
    MissionError
        If the axes are not three different ones that make a right-handed set.
    """
    C = np.zeros((3, 3))
    if len(axes) == len(XYZ) and all(axis.removeprefix("-") in XYZ for axis in axes):
        for row, axis in enumerate(axes):
            C[row, XYZ.index(axis[-1])] = -1 if axis.startswith("-") else 1
    if round(np.linalg.det(C)) != 1:
        raise MissionError(
            f"{where}axes {','.join(axes)} are not a right-handed set; accepted are the axes of the IMU that "
            "point forward, right and down, such as y,x,-z for an IMU with x right, y forward, z up"
        )
    return C


class ImuAxes(NamedTuple):
    """Axes that are tried: (3, 3) matrices applied to the gyros and to the accelerometers of a log."""

    gyros: FloatArray
    forces: FloatArray

    @property
    def words(self) -> str:
        """What has to be changed."""
        if np.array_equal(self.forces, SAME):
            return f"gyros about {_describe(self.gyros)}"
        if np.array_equal(self.gyros, SAME):
            return f"accelerometers along {_describe(self.forces)}"
        return f"left-handed axes, which are {_describe(self.forces)}"

    def seen_in(self, C: FloatArray) -> ImuAxes:
        """Return the same change in other axes, of which C (3, 3) times a vector is that in these."""
        return ImuAxes(C.T @ self.gyros @ C, C.T @ self.forces @ C)

    @property
    def remedy(self) -> str:
        """How to change it."""
        return remedy(("rate", "rad/s", self.gyros), ("force", "m/s²", self.forces))


AS_IT_IS = ImuAxes(SAME, SAME)
"""No change of any axis."""
GYROS_REVERSED = ImuAxes(np.diag([1.0, 1.0, -1.0]), SAME)
"""The gyro about down has the other sign."""
LEFT_HANDED = ImuAxes(np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, 1.0]))
"""Axes of a mirrored IMU: other left-handed ones are these, turned with the IMU."""


def others() -> Iterator[ImuAxes]:
    """Yield all other axes and signs of the gyros, those of the level accelerometers, and left-handed ones.

    Gravity shows the vertical accelerometer.
    """
    for matrix in iterate_signed_axes(range(3)):
        if not np.array_equal(matrix, SAME):
            yield ImuAxes(matrix, SAME)
    for matrix in level():
        yield ImuAxes(SAME, matrix)
    yield LEFT_HANDED


def level() -> Iterator[FloatArray]:
    """Yield all other orders and signs of the two horizontal axes, as (3, 3) matrices."""
    for inner in iterate_signed_axes(range(2)):
        if not np.array_equal(inner, np.eye(2)):
            matrix = np.eye(3)
            matrix[:2, :2] = inner
            yield matrix


def iterate_signed_axes(axes: range) -> Iterator[FloatArray]:
    """Yield the matrices of all orders and signs of some axes."""
    for order in itertools.permutations(axes):
        for signs in itertools.product((1.0, -1.0), repeat=len(axes)):
            matrix = np.zeros((len(axes), len(axes)))
            matrix[axes, order] = signs
            yield matrix


def _describe(matrix: FloatArray) -> str:
    """Return which axis of the file each of forward, right, down is."""
    places = np.argmax(np.abs(matrix), axis=1)
    return ", ".join(
        f"{'minus ' if row[place] < 0 else ''}{NAMES[place]}"
        for row, place in zip(matrix, places, strict=True)
    )


def mark_down_axis(axis: int, sign: int) -> FloatArray:
    """Return the matrix that tells only which axis of the file is down."""
    matrix = np.zeros((3, 3))
    matrix[2, axis] = sign
    return matrix


def remedy(*parts: tuple[str, str, FloatArray]) -> str:
    """Return which columns have to be called otherwise, and how.

    Parameters
    ----------
    parts
        Quantity, unit and matrix of each triad; rows of zeros say nothing.
    """
    changes = [
        (
            f"{quantity}_{'xyz'[place]}",
            f"{'-' if matrix[axis, place] < 0 else ''}{quantity}_{'xyz'[axis]}",
            unit,
        )
        for quantity, unit, matrix in parts
        for axis, place in zip(*np.nonzero(matrix), strict=True)
        if axis != place or matrix[axis, place] < 0
    ]
    found = ", ".join(f"{called} is {real}" for called, real, _ in changes)
    options = " ".join(f'--column "{called.upper()}={real}[{unit}]"' for called, real, unit in changes)
    return (
        f"It seems that {found}: swap or negate the columns. With other headings in place of the capitals, "
        f"and their unit, these options do it: {options}."
    )
