"""Aiding: datasets of the measurements besides GPS, and of the states that the filter has for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.datasets.labelled import labelled
from lab.navigation import blocks
from lab.navigation.aids import NAMES, SHOWN
from lab.run import Run

if TYPE_CHECKING:
    import xarray as xr


def further_states(run: Run) -> xr.Dataset:
    """Return estimates, σ and true values of the further states; see `Result.further_states`."""
    names: list[str] = []
    units: list[str] = []
    shown: list[float] = []
    for block in (blocks.BLOCKS[name] for name in run.blocks if name not in blocks.SCALES):
        names += block.names
        units += [block.shown_unit] * block.size
        shown += [block.shown_scale] * block.size
    solution, dims = run.solution_arrays, ("time", "state")
    first = solution.states - len(names)
    variables = {
        "estimate": (dims, solution.further * shown, "", "estimates of the further states"),
        "sigma": (dims, np.sqrt(solution.variance[:, first:]) * shown, "", "their σ"),
    }
    if run.truth_arrays is not None and run.recorded is None:
        variables["truth"] = (dims, run.true_further() * shown, "", "their true values")
    return labelled(run, **variables).assign_coords(state=names, unit=("state", units))


def aiding(run: Run) -> xr.Dataset:
    """Return the innovations of the measurements besides GPS; see `Result.aiding`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    solution, kinds = run.solution_arrays, run.aids.kind
    scale = np.array([factor for _, factor in SHOWN])[kinds]
    innovation = solution.aid_innovation * scale
    sigma = np.sqrt(solution.aid_variance) * scale
    dims = ("time_aid",)
    return xr.Dataset(
        {
            "innovation": (dims, innovation, {"units": "", "long_name": "innovation, in the unit given"}),
            "sigma": (dims, sigma, {"units": "", "long_name": "σ of the innovation"}),
            "used": (dims, solution.aid_sample >= 0, {"units": "", "long_name": "whether it was used"}),
            "kind": (dims, np.array(NAMES)[kinds], {"units": "", "long_name": "what is measured"}),
            "unit": (dims, np.array([unit for unit, _ in SHOWN])[kinds], {"units": "", "long_name": "unit"}),
        },
        coords={"time_aid": (dims, run.aids.time, {"units": "s", "long_name": "time"})},
    )
