"""Increments: faults of the data of an IMU, made by changes of the increments of a triad.

Each function takes and returns the increments (n, 3) of a triad over the sample intervals, [rad] or [m/s],
with the true flight at both ends of the intervals, and their length dt [s]. A wrong term of the navigation
equations is made from its data: what the navigator does wrong with right data, it does wrong in the same way,
to the first order of its attitude error, with right equations and data that contain the opposite.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, rotation
from lab.motion.truth.trajectory import Truth

X_AND_Y_SWAPPED = (1, 0, 2)
"""Axes of b in the order in which a wrong driver gives them."""


def degrees_for_radians(increments: FloatArray, _truth: Truth, _dt: float) -> FloatArray:
    """Return angles in degrees, which the navigator takes for radians."""
    return np.degrees(increments)


def swapped(increments: FloatArray, _truth: Truth, _dt: float) -> FloatArray:
    """Return the increments with x and y exchanged."""
    return increments[:, X_AND_Y_SWAPPED]


def gravity_upwards(increments: FloatArray, truth: Truth, dt: float) -> FloatArray:
    """Return f − 2 C_bn g_n, with which a navigator that adds g_n computes as one that subtracts it."""
    gravity = np.zeros((truth.time.size, 3))
    gravity[:, 2] = earth.gravity(np.sin(truth.latitude), truth.height)
    return increments - 2 * dt * _in_body(truth, gravity)


def without_earth_rate(increments: FloatArray, truth: Truth, dt: float) -> FloatArray:
    """Return ω + C_bn ω_ie,n, with which a navigator that subtracts ω_ie computes as one that does not."""
    return increments + dt * _in_body(truth, earth_rate(truth))


def without_coriolis(increments: FloatArray, truth: Truth, dt: float) -> FloatArray:
    """Return f + 2 C_bn (ω_ie,n × v_n), the part of the rate of the Earth in the equation of velocity."""
    return increments + 2 * dt * _in_body(truth, np.cross(earth_rate(truth), truth.velocity_n))


def earth_rate(truth: Truth) -> FloatArray:
    """Return the rate of the Earth resolved in n (n, 3) [rad/s]."""
    sine, cosine = np.sin(truth.latitude), np.cos(truth.latitude)
    return np.asarray(earth.RATE * np.stack((cosine, np.zeros_like(sine), -sine), axis=-1))


def _in_body(truth: Truth, vectors: FloatArray) -> FloatArray:
    """Return vectors resolved in n at the samples (n + 1, 3), as means in b over the intervals (n, 3)."""
    resolved = np.einsum("kji,kj->ki", rotation.C_nb_from_euler(truth.euler), vectors)
    return np.asarray((resolved[:-1] + resolved[1:]) / 2)
