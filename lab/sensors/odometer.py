"""Odometer: the forward speed of a place of the vehicle, such as the middle of the rear axle.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6.3
and 16.2.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_kinds import AxisQuantity
from lab.base.parameters.units import si
from lab.motion.frames import rotation
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import readings
from lab.sensors.draws import Seed
from lab.sensors.readings import AidSensor, measure

__all__ = ["OdometerErrors", "measure", "speeds"]


class OdometerErrors(AidSensor):
    """Errors and timing of an odometer. Defaults: the wheel sensors of a car."""

    NAME = "odometer"
    fitted = readings.fitted(
        "an odometer, which measures the speed forward. A filter that uses it has a state for its scale "
        "factor."
    )
    period = readings.period(0.2)
    noise = readings.noise(0.1, unit="m/s", bounds=(1e-5, 100), softbounds=(0.01, 2), step=0.01)
    scale_factor_sigma = readings.scale_factor_sigma("speed")
    lever_arm = AxisQuantity(
        0.0,
        unit="m",
        bounds=(-100, 100),
        softbounds=(-5, 5),
        step=0.1,
        label="Place",
        doc="From the IMU to the place whose speed is measured: forward, right, down. The constraint that "
        "the vehicle does not slip holds there.",
    )
    outages = readings.outages()

    def truth(self, trajectory: Trajectory, seed: Seed, times: FloatArray) -> FloatArray:
        """Return the true speeds forward (a,) of its place at times (a,) [m/s]."""
        return speeds(trajectory, si(self, "lever_arm"), times)[:, 0]


def speeds(trajectory: Trajectory, place: FloatArray, times: FloatArray) -> FloatArray:
    """Return the true speeds (a, 3) of a place forward, to the right and down [m/s].

    Parameters
    ----------
    trajectory
        The flight of the IMU.
    place : (3,) array
        From the IMU forward, right, down [m].
    times : (a,) array
        Times [s].
    """
    truth = trajectory.at(times)
    C_nb = rotation.C_nb_from_euler(truth.euler)
    of_imu = np.einsum("aij,ai->aj", C_nb, truth.velocity_n)
    return np.asarray(of_imu + np.cross(trajectory.rates(times)[0], place))
