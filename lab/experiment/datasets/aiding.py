"""Aiding: datasets of the measurements besides GPS, and of the states that the filter has for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.experiment.datasets.labelled import labelled
from lab.navigation.aids import NAMES, SHOWN
from lab.navigation.filters import blocks
from lab.run.run import Run

if TYPE_CHECKING:
    import xarray as xr

UNLIKELY = 5.0
"""Excess of a mean square, in its σ √(2 / n), that chance does not explain: one of three million."""


def further_states(run: Run) -> xr.Dataset:
    """Return estimates, σ and true values of the further states; see `Result.further_states`."""
    names, units, shown = blocks.shown_states(run.blocks)
    solution, dims = run.solution_arrays, ("time", "state")
    first = solution.states - len(names)
    variables = {
        "estimate": (dims, solution.further * shown, "", "estimates of the further states"),
        "sigma": (dims, np.sqrt(solution.variance[:, first:]) * shown, "", "their σ"),
    }
    if run.truth_arrays is not None and run.shows_sensor_errors:
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


def larger_than_assumed(run: Run) -> list[str]:
    """Return remarks on kinds of measurements besides GPS whose innovations are larger than their σ."""
    remarks = []
    solution = run.solution_arrays
    for kind in np.unique(run.aids.kind):
        squares = (solution.aid_innovation**2 / solution.aid_variance)[run.aids.kind == kind]
        squares = squares[np.isfinite(squares)]
        if squares.size and squares.mean() > 1 + UNLIKELY * np.sqrt(2 / squares.size):
            remarks.append(
                f"The innovations of {NAMES[kind]} are {np.sqrt(squares.mean()):.2g} × as large as the "
                "filter says: these measurements, or the axes of the IMU in the vehicle, have other errors "
                "than assumed, and σ is too small."
            )
    return remarks
