"""Faults: the ten faults of the gallery, each made without another navigator.

A fault changes what the sensors measure, without the filter being told, or what the filter assumes, without
the page showing it. `lab.classroom.gallery.faulty_experiment` is the one place that uses them.

Each function for an IMU takes and returns the increments (n, 3) of a triad over the sample intervals, [rad]
or [m/s], with the true flight at both ends of the intervals, and their length dt [s]. A wrong term of the
navigation equations is made from its data: what the navigator does wrong with right data, it does wrong in
the same way, to the first order of its attitude error, with right equations and data that contain the
opposite.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, rotation
from lab.motion.truth.trajectory import Truth
from lab.sensors.draws import unit_draws
from lab.sensors.gps import GpsFixes

X_AND_Y_SWAPPED = (1, 0, 2)
"""Axes of b in the order in which a wrong driver gives them."""


def degrees_for_radians(increments: FloatArray, _truth: Truth, _dt: float) -> FloatArray:
    """Return angles in degrees, which the navigator takes for radians."""
    return np.degrees(increments)


def swap_axes(increments: FloatArray, _truth: Truth, _dt: float) -> FloatArray:
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


Spoil = Callable[[FloatArray, Truth, float], FloatArray]
Restamp = Callable[[FloatArray, int], FloatArray]

LATE = 0.12
"""Age of the fixes that come late [s]."""
LEVER_ARM = (2.0, 0.5, -1.0)
"""Antenna of the forgotten lever arm, forward, right, down of the IMU [m]."""
R_FACTOR = 0.1
"""Factor on R that is ten times too small."""
COLOURED = 3.0
"""σ of the correlated position error [m]; the white one has 0.7 m."""
JITTER = 0.1
"""σ of the time stamps of the fixes [s]: a message that waits for a busy computer."""
SCALE = 1.0
"""Scale factor error of the gyros [%]."""


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes
    ----------
    title : str
        What is wrong, as the answer that a student chooses.
    sensors : mapping of str to object
        Settings of the sensors as they really are, by their path in `lab.sensors.suite.SensorSuite`.
    gyro, accelerometer : callable
        Change of the increments (n, 3) of a triad, with the true flight and the length of the intervals [s].
    stamps : callable
        Change of the time stamps of the fixes, from the stamps (m,) [s] and the seed.
    r_factor : float
        Factor on the R that the filter assumes.
    """

    title: str
    sensors: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    gyro: Spoil | None = None
    accelerometer: Spoil | None = None
    stamps: Restamp | None = None
    r_factor: float = 1.0

    def restamped(self, fixes: GpsFixes, seed: int) -> GpsFixes:
        """Return fixes with changed time stamps, in the order of these."""
        if self.stamps is None or not fixes.time.size:
            return fixes
        stamps = self.stamps(fixes.time, seed)
        order = np.argsort(stamps, kind="stable")
        return GpsFixes(stamps[order], *(array[order] for array in fixes[1:]))


def jitter_stamps(stamps: FloatArray, seed: int) -> FloatArray:
    """Return time stamps (m,) with independent errors of σ `JITTER`, none outside the span of the fixes."""
    errors = JITTER * unit_draws(seed, "gallery.stamps", stamps.shape)
    return np.clip(stamps + errors, stamps[0], stamps[-1])


FAULTS: dict[str, Fault] = {
    "gravity": Fault("the sign of gravity", accelerometer=gravity_upwards),
    "degrees": Fault("degrees for radians", gyro=degrees_for_radians),
    "axes": Fault("two axes swapped", gyro=swap_axes, accelerometer=swap_axes),
    "lever_arm": Fault("a lever arm forgotten", sensors={"gps.lever_arm": LEVER_ARM}),
    "latency": Fault("fixes that come late", sensors={"gps.latency": LATE}),
    "r": Fault("R ten times too small", r_factor=R_FACTOR),
    "coloured": Fault("coloured GPS noise", sensors={"gps.correlated_sigma": COLOURED}),
    "jitter": Fault("jitter of the time stamps", stamps=jitter_stamps),
    "earth_rate": Fault(
        "the Earth's rate left out",
        gyro=without_earth_rate,
        accelerometer=without_coriolis,
    ),
    "scale": Fault("a scale factor of the gyros", sensors={"gyro.scale_factor": SCALE}),
}
"""The faults by name."""
