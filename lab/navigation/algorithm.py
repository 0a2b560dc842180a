"""Algorithm: a navigator of the user's own, run in an experiment and compared like the built-in ones.

It is an object, or is loaded from a Python file that the user names.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.python_file import PythonFileError, describe_error, load_object
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import SLACK
from lab.navigation.kernels.propagation import NAV
from lab.navigation.solution import Fixes, Imu, Solution, Start

FORM = "FILE.py:Name, such as my_filter.py:MyFilter"
Arrays = TypeVar("Arrays", Imu, Fixes, Start)

ASYMMETRIC = 1e-6
"""Largest asymmetry of a covariance, in its σ: single precision stays below."""
OFF_UNIT = 1e-3
"""Largest deviation of the length of a quaternion from one, before it is made one: single precision and
integration stay far below, other parametrisations of an attitude do not. A convention."""


class AlgorithmError(ValueError):
    """A user's algorithm failed or did not return a solution; the message says which one, and why."""


class Estimate(NamedTuple):
    """The result of an algorithm: n + 1 samples at the IMU times, and optional arrays at the m fixes.

    The first four arrays are required. NEES needs the covariance; NIS and whiteness need the innovations.
    Without these arrays, they are unknown. A fix that the algorithm did not use has NaN in its whole rows.

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
    covariance : (m, 9, 9) array, optional
        Covariance of the same nine errors at the first sample that includes the fix: the sample at its time,
        or the next one.
    innovation : (m, 6) array, optional
        Navigator minus GPS before the fix is used: position [m], then velocity [m/s], north, east, down.
    innovation_covariance : (m, 6, 6) array, optional
        Covariance of the innovation; required for each innovation.
    """

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    sigma: FloatArray
    covariance: FloatArray | None = None
    innovation: FloatArray | None = None
    innovation_covariance: FloatArray | None = None


@runtime_checkable
class Algorithm(Protocol):
    """Any object that navigates: it takes IMU and GPS data, and returns a solution with σ."""

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
    """Run an algorithm on a flight and return its solution, in the form of the built-in ones.

    The biases are NaN, and so are the arrays that the algorithm did not return.

    Raises
    ------
    AlgorithmError
        If the algorithm raises an exception, which is the error's cause, or if its arrays are not of the
        shapes of an `Estimate`, not finite, or no covariances.
    """
    name = type(algorithm).__name__
    try:
        estimate = algorithm.navigate(_read_only(imu), _read_only(fixes), _read_only(start))
    except AlgorithmError:
        raise
    except (Exception, SystemExit) as error:
        raise AlgorithmError(f"{name}: raised an exception: {describe_error(error)}") from error
    samples, m = imu.time.size, fixes.time.size
    position = _array(name, estimate, "position", (samples, 3))
    velocity_n = _array(name, estimate, "velocity_n", (samples, 3))
    q_nb = _array(name, estimate, "q_nb", (samples, 4))
    sigma = _array(name, estimate, "sigma", (samples, NAV))
    if (sigma < 0).any():
        raise AlgorithmError(f"{name}: a σ is negative")
    length = np.linalg.norm(q_nb, axis=1, keepdims=True)
    if not np.allclose(length, 1, atol=OFF_UNIT):
        raise AlgorithmError(f"{name}: q_nb are not unit quaternions")
    covariance = _covariance(name, estimate, "covariance", (m, NAV, NAV))
    S = _covariance(name, estimate, "innovation_covariance", (m, MEASUREMENTS, MEASUREMENTS))
    innovation = _at_fixes(name, estimate, "innovation", (m, MEASUREMENTS))
    if (innovation is None) != (S is None):
        raise AlgorithmError(f"{name}: innovation and innovation_covariance belong together: give both")

    solution = Solution.empty(samples, m)
    solution.position[:], solution.velocity_n[:], solution.q_nb[:] = position, velocity_n, q_nb / length
    solution.bias[:], solution.covariance[:], solution.variance[:, NAV:] = np.nan, 0.0, np.nan
    solution.variance[:, :NAV] = sigma**2
    solution.fix_sample[:] = _samples(imu.time, fixes.time)
    for given in (covariance, innovation, S):
        if given is not None:
            solution.fix_sample[_left_out(given)] = -1
    if covariance is not None:
        solution.fix_covariance[:] = 0.0
        solution.fix_covariance[:, :NAV, :NAV] = covariance
    if innovation is not None and S is not None:
        solution.innovation[:], solution.innovation_covariance[:] = innovation, S
    return solution


def _read_only(arrays: Arrays) -> Arrays:
    """Return read-only views, because the cache shares the arrays."""
    views = {name: np.asarray(array).view() for name, array in arrays._asdict().items()}
    for view in views.values():
        view.setflags(write=False)
    return type(arrays)(**views)


def _samples(time: FloatArray, fix_time: FloatArray) -> NDArray[np.int64]:
    """Return the first sample (m,) that includes each fix, or −1 for fixes outside the IMU data."""
    slack = SLACK * float(np.mean(np.diff(time)))
    sample = np.searchsorted(time, fix_time - slack).astype(np.int64)
    sample[(fix_time < time[0] - slack) | (sample == time.size)] = -1
    return sample


def _numbers(name: str, estimate: Estimate, part: str, shape: tuple[int, ...]) -> FloatArray:
    """Return an array of an estimate, if it is one of numbers and has this shape."""
    try:
        array = np.asarray(getattr(estimate, part), dtype=np.float64)
    except (AttributeError, TypeError, ValueError) as error:
        needed = ", ".join(field for field in Estimate._fields if field not in Estimate._field_defaults)
        raise AlgorithmError(
            f"{name}: the returned object has no numeric array {part!r}; accepted is an Estimate with "
            f"{needed}"
        ) from error
    if array.shape != shape:
        raise AlgorithmError(f"{name}: {part} has shape {array.shape}, expected {shape}")
    return array


def _array(name: str, estimate: Estimate, part: str, shape: tuple[int, ...]) -> FloatArray:
    """Return an array of an estimate that must be finite."""
    array = _numbers(name, estimate, part, shape)
    bad = ~np.isfinite(array).all(axis=1)
    if bad.any():
        raise AlgorithmError(f"{name}: {part} is not finite from sample {int(np.argmax(bad))} on")
    return array


def _at_fixes(name: str, estimate: Estimate, part: str, shape: tuple[int, ...]) -> FloatArray | None:
    """Return an optional array of an estimate, which may be NaN in the whole row of a fix."""
    if getattr(estimate, part, None) is None:
        return None
    array = _numbers(name, estimate, part, shape)
    bad = ~(np.isfinite(array).all(axis=tuple(range(1, array.ndim))) | _left_out(array))
    if bad.any():
        raise AlgorithmError(
            f"{name}: {part} is not finite at fix {int(np.argmax(bad))}; accepted is NaN in the whole row of "
            "a fix that was not used"
        )
    return array


def _left_out(array: FloatArray) -> NDArray[np.bool_]:
    """Return a mask (m,) of the fixes without any value."""
    return np.asarray(np.isnan(array).all(axis=tuple(range(1, array.ndim))))


def _covariance(name: str, estimate: Estimate, part: str, shape: tuple[int, ...]) -> FloatArray | None:
    """Return covariances of an estimate, if they are symmetric and positive definite."""
    array = _at_fixes(name, estimate, part, shape)
    if array is None:
        return None
    fixes = np.flatnonzero(np.isfinite(array[:, 0, 0]))
    known = array[fixes]
    variance = np.diagonal(known, axis1=1, axis2=2)
    bad = (variance <= 0).any(axis=1)
    # Scaled to unit diagonal: next to metres, small variances in radians would be lost.
    sigma = np.sqrt(np.where(variance > 0, variance, 1))
    scaled = known / (sigma[:, :, None] * sigma[:, None, :])
    bad |= np.abs(scaled - scaled.transpose(0, 2, 1)).max(axis=(1, 2), initial=0) > ASYMMETRIC
    bad |= np.linalg.eigvalsh(scaled)[:, 0] <= 0
    if bad.any():
        raise AlgorithmError(
            f"{name}: {part} at fix {fixes[int(np.argmax(bad))]} is not a covariance; accepted is a "
            "symmetric, positive definite matrix"
        )
    return array


def load_algorithm(place: str) -> Algorithm:
    """Execute a Python file and return its algorithm.

    Parameters
    ----------
    place
        ``FILE.py:Name``. The name is that of a class, which is called without arguments, or of an object.

    Raises
    ------
    AlgorithmError
        If the file or the name does not exist, if the file or the class fails, or if the object has no method
        `navigate`.
    """
    try:
        found: Algorithm = load_object(place, FORM, "navigate(imu, fixes, start)", "algorithms in the file")
    except PythonFileError as error:
        raise AlgorithmError(str(error)) from (error.__cause__ or error)
    return found


def load_algorithms(places: Sequence[str]) -> dict[str, Algorithm]:
    """Return algorithms of Python files by name; by place if two have the same name.

    Parameters
    ----------
    places
        Place of each, as for `load_algorithm`.

    Raises
    ------
    AlgorithmError
        If one cannot be loaded.
    """
    names = [place.rpartition(":")[2] for place in places]
    return {
        name if names.count(name) == 1 else place: load_algorithm(place)
        for name, place in zip(names, places, strict=True)
    }
