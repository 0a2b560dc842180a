"""Error axes: navigation errors in Earth-fixed axes e, and those that a filter outputs.

In e, the errors are vectors: no axis turns along the path, so that a pole is a place like any other. The
output of a filter is along north, east and down of the estimate, which turn from place to place by δθ = Θ δr:

    δv = δv_c + v × δθ,   φ = ψ + δθ

with δv_c and ψ the errors in e, resolved in n (as the error model `psi` has them).

References
----------
D. O. Benson, *A comparison of two approaches to pure-inertial and Doppler-inertial error analysis*, IEEE
Trans. AES 11 (1975).
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, ecef
from lab.navigation.filters.error_models import ATT, POS, VEL

SMALLEST = 1e-15
"""Smallest cos L, which stands for all below: 6 nm from a pole, where a filter bounds tan L, too."""


def output_map(position: FloatArray, velocity_n: FloatArray) -> FloatArray:
    """Return T (m, 9, 9), which takes errors in e to the output errors of a filter, to first order.

    Parameters
    ----------
    position : (m, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (m, 3) array
        Velocity north, east, down [m/s].
    """
    latitude, longitude, height = position.T
    C_ne = np.swapaxes(ecef.axes(latitude, longitude), 1, 2)
    sine = np.sin(latitude)
    meridian, transverse = earth.radii(sine)
    tangent = sine / np.maximum(np.cos(latitude), SMALLEST)
    turn = np.zeros((latitude.size, 3, 3))  # Θ
    turn[:, 0, 1] = 1 / (transverse + height)
    turn[:, 1, 0] = -1 / (meridian + height)
    turn[:, 2, 1] = -tangent / (transverse + height)
    turn = turn @ C_ne
    T = np.zeros((latitude.size, 9, 9))
    T[:, POS, POS] = T[:, VEL, VEL] = T[:, ATT, ATT] = C_ne
    T[:, VEL, POS] = np.cross(velocity_n[:, None, :], np.swapaxes(turn, 1, 2)).swapaxes(1, 2)
    T[:, ATT, POS] = turn
    return T
