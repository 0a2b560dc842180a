"""Flight: datasets of the flight, true and navigated, of its errors and their σ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.analysis.errors import euler_sigma, position_error
from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI
from lab.experiment.datasets.labelled import DEGREE, Variables, labelled, labelled_at
from lab.motion.frames.east_north_up import east_north_up, east_north_up_sizes
from lab.motion.frames.projection import Projection
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ATT, POS, STATES, VEL
from lab.navigation.solution import Solution
from lab.run.run import Run

if TYPE_CHECKING:
    import xarray as xr


STATE_UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3 + ("°/s",) * 3 + ("mg",) * 3 + ("%",) * 6
"""Units in which the σ of the error states are shown."""
ERRORS = {"position": ("axis", "m"), "velocity": ("axis", "m/s"), "attitude": ("angle", "°")}
"""Kinds of errors: the dimension of their components, and their unit."""
AT_ONCE = 2**16
"""Samples of a long flight whose errors are computed at once, with some 400 bytes each."""
_MOTION = ("position", "velocity_n", "q_nb")


def truth(run: Run) -> xr.Dataset:
    """Return the true flight; see `Result.truth`."""
    true = run.known_truth("truth")
    return _flight(run, true.position, true.velocity_n, true.euler, run.truth_word)


def solution(run: Run) -> xr.Dataset:
    """Return the flight as navigated; see `Result.solution`."""
    navigated = run.solution_arrays
    return _flight(run, navigated.position, navigated.velocity_n, run.euler, "estimate")


def _flight(
    run: Run, position: FloatArray, velocity_n: FloatArray, euler: FloatArray, word: str
) -> xr.Dataset:
    return labelled(
        run,
        latitude=(("time",), position[:, 0] * DEGREE, "°", f"latitude ({word})"),
        longitude=(("time",), position[:, 1] * DEGREE, "°", f"longitude ({word})"),
        height=(("time",), position[:, 2], "m", f"height above the ellipsoid ({word})"),
        velocity=(("time", "axis"), east_north_up(velocity_n), "m/s", f"velocity ({word})"),
        attitude=(("time", "angle"), euler * DEGREE, "°", f"attitude ({word})"),
    )


def errors(run: Run) -> xr.Dataset:
    """Return the errors of the solution; see `Result.errors`."""
    run.known_truth("errors")
    kinds = {
        name: (("time", dim), error_of(run, name), unit, f"{name} error")
        for name, (dim, unit) in ERRORS.items()
    }
    return labelled(run, **kinds)


def error_of(run: Run, name: str) -> FloatArray:
    """Return one of the errors (n + 1, 3) of the solution: one of `ERRORS`, in its unit."""
    if not run.is_long:
        return _error(run.solution_arrays, run.known_truth("errors"), run.euler, name)
    columns = [error_component(run, name, number) for number in range(3)]
    return np.stack(columns, axis=-1)


def error_component(run: Run, name: str, number: int) -> FloatArray:
    """Return a component (n + 1,) of one of the errors, computed without the memory that the others take."""
    truth, solution = run.known_truth("errors"), run.solution_arrays
    component = np.empty(truth.time.size)
    for first in range(0, component.size, AT_ONCE):
        part = slice(first, first + AT_ONCE)
        here = solution._replace(**{kind: getattr(solution, kind)[part] for kind in _MOTION})
        euler = euler_from_quaternion(here.q_nb)
        component[part] = _error(here, truth.taken(part), euler, name)[:, number]
    return component


def _error(navigated: Solution, true: Truth, euler: FloatArray, name: str) -> FloatArray:
    if name == "position":
        return east_north_up(position_error(navigated.position, true))
    if name == "velocity":
        return east_north_up(navigated.velocity_n - true.velocity_n)
    return wrap(euler - true.euler) * DEGREE


def sigma(run: Run) -> xr.Dataset:
    """Return σ of the errors, according to the filter; see `Result.sigma`."""
    variance, covariance = run.solution_arrays.variance, run.solution_arrays.covariance
    attitude = euler_sigma(run.euler, variance[:, ATT], covariance[:, 1]) * DEGREE
    position, velocity = (east_north_up_sizes(np.sqrt(variance[:, block])) for block in (POS, VEL))
    return labelled(
        run,
        position=(("time", "axis"), position, "m", "σ of the position error"),
        velocity=(("time", "axis"), velocity, "m/s", "σ of the velocity error"),
        attitude=(("time", "angle"), attitude, "°", "σ of the attitude error"),
    )


def state_sigma(run: Run) -> xr.Dataset:
    """Return σ of all error states; see `Result.state_sigma`."""
    names, units, scale = shown_states(run)
    values = np.sqrt(run.solution_arrays.variance) * scale
    dataset = labelled(run, sigma=(("time", "state"), values, "", "σ of the error states"))
    return dataset.assign_coords(state=names, unit=("state", units))


def shown_states(run: Run) -> tuple[list[str], list[str], FloatArray]:
    """Return names, units and scales from SI units of all error states of a run, as they are shown."""
    solution = run.solution_arrays
    known = solution.states - solution.further.shape[1]
    further, their_units, their_scales = blocks.shown_states(run.blocks)
    units = list(STATE_UNITS[:known])
    scale = [*(1 / TO_SI[unit] for unit in units), *their_scales]
    return [*STATES[:known], *further], [*units, *their_units], np.array(scale)


def track(run: Run, projection: Projection, samples: NDArray[np.intp] | slice = slice(None)) -> xr.Dataset:
    """Return the paths in metres on a map, of all samples or of some; see `Result.track`."""
    paths = {"estimated": run.solution_arrays.position[samples]}
    if run.truth_arrays is not None:
        paths = {"true": run.truth_arrays.taken(samples).position} | paths
    projected = [projection.project(path) for path in paths.values()]
    height = np.stack([path[:, 2] for path in paths.values()])
    dims, label = ("path", "time"), projection.label
    variables: Variables = {
        "easting": (dims, np.stack([east for east, _ in projected]), "m", f"easting, {label}"),
        "northing": (dims, np.stack([north for _, north in projected]), "m", f"northing, {label}"),
        "height": (dims, height, "m", "height above the ellipsoid"),
    }
    dataset = labelled_at(run, samples, variables)
    return dataset.assign_coords(path=list(paths))
