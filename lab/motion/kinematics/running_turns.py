"""Running turns: attitudes from small turns one after the other, all at once.

A running product of n quaternions takes log2 n passes over them, each vectorised.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray

Quaternions = NDArray[np.complex128]
"""Unit quaternions (2, k) as pairs of complex numbers, w + x i and y + z i: of these, a product has four."""


def running_attitudes(dtheta: FloatArray) -> Rotation:
    """Return the attitudes (k + 1,) relative to the first, from angular increments (k, 3) [rad]."""
    a, b = running_products(quaternions(dtheta))
    return Rotation.from_quat(np.stack((a.imag, b.real, b.imag, a.real), axis=-1))


def quaternions(rotation: FloatArray) -> Quaternions:
    """Return the quaternions (2, k) of rotation vectors (k, 3) [rad]."""
    half = 0.5 * np.sqrt((rotation * rotation).sum(axis=1))
    # NumPy's sinc(x) is sin(π x) / (π x): here sin(|φ|/2) / (|φ|/2), also at zero.
    x, y, z = rotation.T * (0.5 * np.sinc(half / np.pi))
    made = np.empty((2, half.size), complex)
    made.real = np.cos(half), y
    made.imag = x, z
    return made


def running_products(increments: Quaternions) -> Quaternions:
    """Return the products (2, k + 1) of all increments (2, k) until each, from that of none on."""
    total = np.concatenate(([[1.0], [0.0]], increments), axis=1)
    reach = 1
    while reach < total.shape[1]:  # each pass doubles how many increments are in each product
        # The right side is computed as a whole before it is written.
        total[:, reach:] = product(total[:, :-reach], total[:, reach:])
        reach *= 2
    return total


def product(one: Quaternions, other: Quaternions) -> Quaternions:
    """Return the products of quaternions (2, k): those of `Rotation` take thirty times as long."""
    (a, b), (c, d) = one, other
    made = np.empty_like(other)
    # (a + b j)(c + d j) with j c = c̄ j for complex numbers of i.
    made[0] = a * c - b * d.conj()
    made[1] = a * d + b * c.conj()
    return made
