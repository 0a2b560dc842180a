"""Axis map: which axes of a device point forward, right and down in the vehicle."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.data.streams.transport import TransportError

AXES = {
    f"{sign}{axis}": row
    for sign, factor in (("", 1.0), ("-", -1.0))
    for axis, row in zip("xyz", (factor * np.eye(3)).tolist(), strict=True)
}
"""Directions by name, in the axes of the device."""
INVERTED = "inverted force"
"""Stands behind the axes of a device that sends the negative of the specific force, as iPhones do."""
_DIRECTION = re.compile(r"[+-]?[xyz]")


@dataclass(frozen=True)
class AxisMap:
    """Axes of a device in those of the vehicle.

    Attributes
    ----------
    axes : tuple of three str
        Directions of the device, such as ``-y``, that point forward, right and down.
    inverted_force : bool
        Whether the device sends the negative of the specific force.
    """

    axes: tuple[str, str, str] = ("x", "y", "z")
    inverted_force: bool = False

    def __post_init__(self) -> None:
        if any(axis not in AXES for axis in self.axes) or len(self.axes) != 3:
            raise TransportError(f"axes = {self}; accepted are three of {', '.join(AXES)}")
        turn = np.linalg.det(self.matrix)
        if turn == 0:
            raise TransportError(
                f"axes = {self}: a direction is there twice; accepted are three that are perpendicular, such "
                "as y,x,-z"
            )
        if turn < 0:
            raise TransportError(
                f"axes = {self}: is a mirror image, which no turn of the device makes; accepted are "
                "right-handed axes, such as y,x,-z"
            )

    @classmethod
    def of(cls, text: str) -> AxisMap:
        """Return the map that a person wrote: forward, right and down, such as ``y,x,-z``.

        Raises
        ------
        TransportError
            If it is no right-handed set of three.
        """
        words = [word.strip() for word in text.split(",")]
        inverted = len(words) == 4 and words[3] == INVERTED
        if inverted:
            words = words[:3]
        if len(words) != 3 or not all(_DIRECTION.fullmatch(word) for word in words):
            raise TransportError(
                f"axes = {text!r}; accepted are the directions of the device that point forward, right and "
                f"down, such as y,x,-z, and behind them, if it sends the negative force, {INVERTED}"
            )
        forward, right, down = (word.removeprefix("+") for word in words)
        return cls((forward, right, down), inverted)

    @cached_property
    def matrix(self) -> FloatArray:
        """Matrix (3, 3) that resolves a vector of the device forward, right and down."""
        return np.array([AXES[axis] for axis in self.axes])

    @property
    def is_identity(self) -> bool:
        """Whether the device has the axes of the vehicle."""
        return self.axes == ("x", "y", "z") and not self.inverted_force

    def mapped(self, vectors: FloatArray, *, force: bool = False) -> FloatArray:
        """Return vectors (n, 3) of the device forward, right, down.

        Parameters
        ----------
        vectors
            Rates, forces or fields, in axes of the device.
        force
            Whether they are specific forces.
        """
        if self.is_identity:
            return vectors
        # Rows are picked, not multiplied: a NaN in one axis is not spread to the others.
        order = np.abs(self.matrix).argmax(axis=1)
        signs = self.matrix.sum(axis=1) * (-1.0 if force and self.inverted_force else 1.0)
        return np.asarray(vectors[..., order] * signs)

    def unmapped(self, vectors: FloatArray, *, force: bool = False) -> FloatArray:
        """Return vectors (n, 3) forward, right, down in axes of the device; undoes `mapped`."""
        if self.is_identity:
            return vectors
        order = np.abs(self.matrix).argmax(axis=0)
        signs = self.matrix.sum(axis=0) * (-1.0 if force and self.inverted_force else 1.0)
        return np.asarray(vectors[..., order] * signs)

    def attitude(self, q_nd: FloatArray) -> FloatArray:
        """Return attitudes (n, 4) of the device, with the scalar first, as those of the vehicle."""
        known = np.isfinite(q_nd).all(axis=1)
        made = np.full(q_nd.shape, np.nan)
        if known.any():
            to_device = Rotation.from_matrix(self.matrix.T)
            turned = Rotation.from_quat(q_nd[known], scalar_first=True) * to_device
            made[known] = turned.as_quat(scalar_first=True)
        return made

    def __str__(self) -> str:
        return ",".join((*self.axes, *((INVERTED,) if self.inverted_force else ())))
