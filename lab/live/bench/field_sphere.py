"""Field sphere: what a magnetometer that is turned in all directions shows of the iron in the vehicle.

Without iron, the fields in the axes of the device lie on a sphere about zero: the Earth's field turned. Hard
iron, which is magnetic itself, moves its centre. Soft iron makes an ellipsoid of it, which the scatter shows.

References
----------
M. J. Caruso, *Applications of Magnetic Sensors for Low Cost Compass Systems*, IEEE PLANS 2000.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray

FEWEST: Final = 20
"""Fewest fields for a sphere: four numbers are sought."""
LEAST_DEPTH: Final = 0.25
"""Least spread of the fields along the direction in which it is smallest, as a part of the largest: it is 0.5
of half a sphere and 0.27 of a cap of 60°, from which a noise of 1 % gives the centre to some percent."""


class FieldSphere(NamedTuple):
    """A sphere through measured fields.

    Attributes
    ----------
    centre : (3,) array
        Hard iron, forward, right, down [T].
    radius : float
        Size of the field without it [T].
    scatter : float
        Root mean square of the distances of the fields from the sphere [T].
    """

    centre: FloatArray
    radius: float
    scatter: float

    def __str__(self) -> str:
        iron = ", ".join(f"{1e6 * one:+.1f}".replace("-", "\u2212") for one in self.centre)
        return (
            f"The field is {1e6 * self.radius:.1f} µT, hard iron forward, right, down {iron} µT; the points "
            f"scatter by {1e6 * self.scatter:.1f} µT about the sphere."
        )


def fit_sphere(fields: FloatArray) -> FieldSphere | None:
    """Return the sphere through fields; None if they do not show one.

    Parameters
    ----------
    fields : (n, 3) array
        Fields in the axes of the device [T], without NaN.
    """
    if len(fields) < FEWEST:
        return None
    middle = fields.mean(axis=0)
    spread = np.linalg.svd(fields - middle, compute_uv=False)
    if not spread[2] > LEAST_DEPTH * spread[0]:
        return None
    size = float(spread[0]) / np.sqrt(len(fields))  # numbers near one, so that no direction is lost
    seen = (fields - middle) / size
    A = np.column_stack((2 * seen, np.ones(len(seen))))
    *about, rest = np.linalg.lstsq(A, np.sum(seen**2, axis=1))[0]
    centre = middle + size * np.array(about)
    radius = size * float(np.sqrt(rest + np.sum(np.square(about))))
    scatter = np.sqrt(np.mean((np.linalg.norm(fields - centre, axis=1) - radius) ** 2))
    return FieldSphere(centre, radius, float(scatter))
