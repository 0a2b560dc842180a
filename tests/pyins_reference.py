"""The independent strapdown: python-ins, with the lab's gravity in place of its own."""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from typing import NamedTuple
from unittest import mock

import numba
import numpy as np
import pandas as pd
import pyins._numba_integrate
import pyins.strapdown
import pyins.util

from lab.base.arrays import FloatArray
from lab.motion.frames import earth


class Path(NamedTuple):
    """Latitude, longitude [rad], height [m]; v_n [m/s]; roll, pitch, yaw [rad]; (n + 1, 3) each."""

    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray


def integrate(
    time: FloatArray,
    dtheta: FloatArray,
    dvelocity: FloatArray,
    start: tuple[FloatArray, FloatArray, FloatArray],
) -> Path:
    """Navigate with python-ins.

    Parameters
    ----------
    time : (n + 1,) array
        Ends of the sample intervals, the first one their common start [s].
    dtheta, dvelocity : (n, 3) arrays
        Increments [rad], [m/s].
    start
        Position [rad], [rad], [m], velocity_n [m/s] and Euler angles [rad] at the start, (3,) each.
    """
    position, velocity_n, euler = start
    initial = np.concatenate((np.degrees(position[:2]), position[2:], velocity_n, np.degrees(euler)))
    integrator = pyins.strapdown.Integrator(pd.Series(initial, pyins.util.TRAJECTORY_COLS))
    with mock.patch.object(pyins.strapdown, "integrate", _integrate_with_lab_gravity()):
        found = np.array(integrator.integrate(increments(time, dtheta, dvelocity)))
    degrees = [0, 1, 6, 7, 8]
    found[:, degrees] = np.radians(found[:, degrees])
    return Path(found[:, :3], found[:, 3:6], found[:, 6:])


def increments(time: FloatArray, dtheta: FloatArray, dvelocity: FloatArray) -> pd.DataFrame:
    """Return the increments as python-ins takes them, compensated for coning and sculling."""
    samples = np.hstack((dtheta, dvelocity))
    # Coning and sculling want the sample before the first one: continued in a straight line.
    samples = np.vstack((2 * samples[0] - samples[1], samples))
    columns = [*pyins.util.GYRO_COLS, *pyins.util.ACCEL_COLS]
    return pyins.strapdown.compute_increments_from_imu(pd.DataFrame(samples, time, columns), "increment")


@functools.cache
def _integrate_with_lab_gravity() -> Callable[..., None]:
    """Return the compiled loop of python-ins with the lab's gravity."""
    gravity = numba.njit(earth.gravity)
    original = pyins._numba_integrate.integrate.py_func

    @numba.njit
    def gravity_by_degrees(latitude: float, height: float) -> float:
        return gravity(np.sin(np.radians(latitude)), height)

    names = {**original.__globals__, "gravity": gravity_by_degrees}
    return numba.njit(types.FunctionType(original.__code__, names, "integrate_with_the_lab_gravity"))
