"""Flight: datasets of the flight, true and navigated, of its errors and their σ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.analysis.errors import euler_sigma, position_error, to_enu
from lab.datasets.labelled import DEGREE, labelled
from lab.navigation.error_models import ATT, STATES
from lab.navigation.solution import Solution
from lab.rotation import euler_from_quaternion, wrap
from lab.trajectory import Truth
from lab.units import TO_SI

if TYPE_CHECKING:
    import xarray as xr

    from lab.result import Result

FloatArray = NDArray[np.float64]

STATE_UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3 + ("°/s",) * 3 + ("mg",) * 3 + ("%",) * 6
"""Units in which the σ of the error states are shown."""
ERRORS = {"position": ("axis", "m"), "velocity": ("axis", "m/s"), "attitude": ("angle", "°")}
"""Kinds of errors: the dimension of their components, and their unit."""
AT_ONCE = 2**16
"""Samples of a long flight whose errors are computed at once, with some 400 bytes each."""
_MOTION = ("position", "velocity_n", "q_nb")


def truth(result: Result) -> xr.Dataset:
    """Return the true flight; see `Result.truth`."""
    true = result.known_truth("truth")
    word = "reference" if result.recorded else "true"
    return _flight(result, true.position, true.velocity_n, true.euler, word)


def solution(result: Result) -> xr.Dataset:
    """Return the flight as navigated; see `Result.solution`."""
    navigated = result.solution_arrays
    return _flight(result, navigated.position, navigated.velocity_n, result.euler, "estimated")


def _flight(
    result: Result, position: FloatArray, velocity_n: FloatArray, euler: FloatArray, word: str
) -> xr.Dataset:
    return labelled(
        result,
        latitude=(("time",), position[:, 0] * DEGREE, "°", f"{word} latitude"),
        longitude=(("time",), position[:, 1] * DEGREE, "°", f"{word} longitude"),
        height=(("time",), position[:, 2], "m", f"{word} height above the ellipsoid"),
        velocity=(("time", "axis"), to_enu(velocity_n), "m/s", f"{word} velocity"),
        attitude=(("time", "angle"), euler * DEGREE, "°", f"{word} attitude"),
    )


def errors(result: Result) -> xr.Dataset:
    """Return the errors of the solution; see `Result.errors`."""
    result.known_truth("errors")
    kinds = {
        name: (("time", dim), error_of(result, name), unit, f"{name} error")
        for name, (dim, unit) in ERRORS.items()
    }
    return labelled(result, **kinds)


def error_of(result: Result, name: str) -> FloatArray:
    """Return one of the errors (n + 1, 3) of the solution: one of `ERRORS`, in its unit."""
    if not result.is_long:
        return _error(result.solution_arrays, result.known_truth("errors"), result.euler, name)
    columns = [error_component(result, name, number) for number in range(3)]
    return np.stack(columns, axis=-1)


def error_component(result: Result, name: str, number: int) -> FloatArray:
    """Return a component (n + 1,) of one of the errors, computed without the memory that the others take."""
    truth, solution = result.known_truth("errors"), result.solution_arrays
    component = np.empty(truth.time.size)
    for first in range(0, component.size, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        here = solution._replace(**{kind: getattr(solution, kind)[part] for kind in _MOTION})
        euler = euler_from_quaternion(here.q_nb)
        component[part] = _error(here, truth.taken(part), euler, name)[:, number]
    return component


def _error(navigated: Solution, true: Truth, euler: FloatArray, name: str) -> FloatArray:
    if name == "position":
        return to_enu(position_error(navigated.position, true))
    if name == "velocity":
        return to_enu(navigated.velocity_n - true.velocity_n)
    return wrap(euler - true.euler) * DEGREE


def sigma(result: Result) -> xr.Dataset:
    """Return σ of the errors, according to the filter; see `Result.sigma`."""
    variance, covariance = result.solution_arrays.variance, result.solution_arrays.covariance
    attitude = euler_sigma(result.euler, variance[:, ATT], covariance[:, 1]) * DEGREE
    return labelled(
        result,
        position=(("time", "axis"), np.sqrt(variance[:, [1, 0, 2]]), "m", "σ of the position error"),
        velocity=(("time", "axis"), np.sqrt(variance[:, [4, 3, 5]]), "m/s", "σ of the velocity error"),
        attitude=(("time", "angle"), attitude, "°", "σ of the attitude error"),
    )


def state_sigma(result: Result) -> xr.Dataset:
    """Return σ of all error states; see `Result.state_sigma`."""
    n = result.solution_arrays.states
    scale = np.array([1 / TO_SI[unit] for unit in STATE_UNITS[:n]])
    values = np.sqrt(result.solution_arrays.variance) * scale
    dataset = labelled(result, sigma=(("time", "state"), values, "", "σ of the error states"))
    return dataset.assign_coords(state=list(STATES[:n]), unit=("state", list(STATE_UNITS[:n])))


def track(result: Result) -> xr.Dataset:
    """Return the paths on the map; see `Result.track`."""
    paths = {"estimated": result.solution_arrays.position}
    if result.truth_arrays is not None:
        paths = {"true": result.truth_arrays.position} | paths
    projected = [result.projection.project(path) for path in paths.values()]
    height = np.stack([path[:, 2] for path in paths.values()])
    dims, label = ("path", "time"), result.projection.label
    dataset = labelled(
        result,
        easting=(dims, np.stack([east for east, _ in projected]), "m", f"easting, {label}"),
        northing=(dims, np.stack([north for _, north in projected]), "m", f"northing, {label}"),
        height=(dims, height, "m", "height above the ellipsoid"),
    )
    return dataset.assign_coords(path=list(paths))
