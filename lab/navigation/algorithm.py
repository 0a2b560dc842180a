"""Algorithm: a navigator of the user's own, run in an experiment and compared like the built-in ones."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.navigation.solution import Fixes, Imu, Solution, Start

FloatArray = NDArray[np.float64]
Arrays = TypeVar("Arrays", Imu, Fixes, Start)


class AlgorithmError(ValueError):
    """A user's algorithm failed, or returned what is no solution; the message says which and why."""


class Estimate(NamedTuple):
    """What an algorithm returns: n + 1 samples at the IMU times.

    Attributes
    ----------
    position : (n + 1, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (n + 1, 3) array
        Velocity north, east, down [m/s].
    q_nb : (n + 1, 4) array
        Attitude, unit quaternions, scalar first.
    sigma : (n + 1, 9) array
        σ of the errors the algorithm expects: position north, east, down [m], velocity [m/s], and the small
        rotation φ of the computed navigation frame about north, east, down [rad].
    """

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    sigma: FloatArray


@runtime_checkable
class Algorithm(Protocol):
    """Any object that navigates: IMU and GPS in, solution and σ out."""

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        """Return the solution of a flight.

        Parameters
        ----------
        imu
            Increments of gyros and accelerometers; read only.
        fixes
            GPS fixes; read only.
        start
            Position, velocity and attitude to start from, with their errors.
        """


def run_algorithm(algorithm: Algorithm, imu: Imu, fixes: Fixes, start: Start) -> Solution:
    """Return what an algorithm makes of a flight, as a solution like the built-in ones.

    It has no biases and no innovations: these stay zero and NaN, and NEES and NIS are not known.

    Raises
    ------
    AlgorithmError
        If the algorithm raises an exception, which is the error's cause, or if its arrays are not of the
        shapes of an `Estimate`, not finite, or its σ negative.
    """
    name = type(algorithm).__name__
    try:
        estimate = algorithm.navigate(_read_only(imu), _read_only(fixes), _read_only(start))
    except Exception as error:
        raise AlgorithmError(f"{name}: failed by itself: {type(error).__name__}: {error}") from error
    position, velocity_n, q_nb, sigma = _checked(name, estimate, imu.time.size)
    solution = Solution.empty(imu.time.size, fixes.time.size)
    solution.position[:], solution.velocity_n[:] = position, velocity_n
    solution.q_nb[:] = q_nb / np.linalg.norm(q_nb, axis=1, keepdims=True)
    solution.bias[:], solution.covariance[:], solution.variance[:, 9:] = 0.0, 0.0, 0.0
    solution.variance[:, :9] = sigma**2
    return solution


def _read_only(arrays: Arrays) -> Arrays:
    """Return views that cannot be written through: the cache holds what is behind them."""
    views = [np.asarray(array).view() for array in arrays]
    for view in views:
        view.setflags(write=False)
    return type(arrays)(*views)


def _checked(name: str, estimate: Estimate, samples: int) -> tuple[FloatArray, ...]:
    """Return the arrays of an estimate, if that is what they are."""
    widths = {"position": 3, "velocity_n": 3, "q_nb": 4, "sigma": 9}
    arrays = []
    for part, width in widths.items():
        try:
            array = np.asarray(getattr(estimate, part), dtype=np.float64)
        except (AttributeError, TypeError, ValueError) as error:
            raise AlgorithmError(
                f"{name}: what it returned has no array {part!r} of numbers; accepted is an Estimate with "
                f"{', '.join(widths)}"
            ) from error
        if array.shape != (samples, width):
            raise AlgorithmError(f"{name}: {part} has shape {array.shape}, expected ({samples}, {width})")
        bad = ~np.isfinite(array).all(axis=1)
        if bad.any():
            raise AlgorithmError(f"{name}: {part} is not finite from sample {int(np.argmax(bad))} on")
        arrays.append(array)
    if (arrays[3] < 0).any():
        raise AlgorithmError(f"{name}: a σ is negative")
    if not np.allclose(np.linalg.norm(arrays[2], axis=1), 1, atol=1e-3):
        raise AlgorithmError(f"{name}: q_nb are not unit quaternions")
    return tuple(arrays)
