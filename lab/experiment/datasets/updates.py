"""Updates: the update by a fix as a dataset, in the units of the states; see `Result.update_at`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.fix_update import directions, fix_at, fix_update
from lab.experiment.datasets.flight import shown_states
from lab.run.run import ResultError, Run

if TYPE_CHECKING:
    import xarray as xr

MEASURED = tuple(f"{kind} {axis}" for kind in ("position", "velocity") for axis in ("north", "east", "down"))
"""What a fix measures, in the order of H."""
UNITS = ("m",) * 3 + ("m/s",) * 3
"""Their units."""


def update_at(run: Run, time: float) -> xr.Dataset:
    """Return the update by the last fix at a time or before [s]; see `Result.update_at`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    fix = fix_at(run, time)
    if fix < 0 and run.fixes.time.size:
        raise ResultError(
            f"There is no fix up to {time:.6g} s: the first one is at {run.fixes.time[0]:.6g} s."
        )
    found = fix_update(run, fix)
    names, units, scale = shown_states(run)
    seen = np.isfinite(found.innovation)
    square, by_seen = np.outer(scale, scale), np.ix_(seen, seen)
    ratio, along = directions(found.after, found.start)
    states, measured = ("state", "other_state"), ("measurement", "other_measurement")
    variables = {
        "before": (states, found.before * square, {"long_name": "P before the fix"}),
        "after": (states, found.after * square, {"long_name": "P after the fix"}),
        "start": (("state",), np.sqrt(np.diagonal(found.start)) * scale, {"long_name": "σ at the start"}),
        "H": (("measurement", "state"), found.H[seen] / scale, {"long_name": "measurement matrix"}),
        "R": (measured, found.R[by_seen], {"long_name": "covariance of the fix as used"}),
        "S": (measured, found.S[by_seen], {"long_name": "covariance of the innovation"}),
        "gain": (("state", "measurement"), found.gain[:, seen] * scale[:, None], {"long_name": "gain K"}),
        "innovation": (("measurement",), found.innovation[seen], {"long_name": "navigator minus fix"}),
        "correction": (("state",), found.correction * scale, {"long_name": "estimated error K y"}),
        "ratio": (("direction",), ratio, {"long_name": "σ now over σ at the start"}),
        "along": (("direction", "state"), along, {"long_name": "directions, states in their σ at the start"}),
    }
    low, high = chi_square_interval(max(int(seen.sum()), 1))
    return xr.Dataset(
        variables,
        coords={
            "state": names,
            "other_state": names,
            "unit": ("state", units),
            "measurement": np.array(MEASURED)[seen],
            "other_measurement": np.array(MEASURED)[seen],
            "measured_unit": ("measurement", np.array(UNITS)[seen]),
        },
        attrs={
            "time": float(run.fixes.time[fix]),
            "fix": fix,
            "outcome": found.outcome,
            "heading_held": int(found.held),
            "nis": found.nis,
            "nis_from": low,
            "nis_to": high,
        },
    )
