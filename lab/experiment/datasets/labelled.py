"""Labelled: arrays of a run as an `xarray.Dataset`, with coordinates, units and long names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI
from lab.run.run import Run

if TYPE_CHECKING:
    import xarray as xr


DEGREE = 1 / TO_SI["°"]
"""Degrees in a radian."""
EAST_NORTH_UP = ["east", "north", "up"]
ANGLES = ["roll", "pitch", "heading"]
BODY_AXES = ["x", "y", "z"]

COORDINATES: dict[str, list[str]] = {
    "axis": EAST_NORTH_UP,
    "angle": ANGLES,
    "body_axis": BODY_AXES,
}
"""Names of the components along each dimension."""


Variables = dict[str, tuple[tuple[str, ...], FloatArray, str, str]]
"""Variables by name: dimensions, values, unit, long name."""


def labelled(run: Run, **variables: tuple[tuple[str, ...], FloatArray, str, str]) -> xr.Dataset:
    """Return a dataset of variables given as (dimensions, values, unit, long name).

    Parameters
    ----------
    run
        Whose they are; it gives the times of the dimensions `time`, `time_imu` and `time_gps`.
    variables
        The variables, by name.
    """
    return labelled_at(run, slice(None), variables)


def labelled_at(run: Run, samples: NDArray[np.intp] | slice, variables: Variables) -> xr.Dataset:
    """Return a dataset as `labelled` does, of some samples of the dimension `time`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    times = {"time": run.time[samples], "time_imu": run.time[1:], "time_gps": run.fixes.time}
    used = {dim for dims, *_ in variables.values() for dim in dims}
    coords: dict[str, Any] = {
        dim: (dim, values, {"units": "s", "long_name": "time"})
        for dim, values in times.items()
        if dim in used
    }
    coords |= {dim: names for dim, names in COORDINATES.items() if dim in used}
    return xr.Dataset(
        {
            name: (dims, values, {"units": unit, "long_name": label})
            for name, (dims, values, unit, label) in variables.items()
        },
        coords=coords,
    )
