"""Innovations: datasets of what the filter used: fixes and other measurements, and states for these."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.analysis import consistency as statistics
from lab.analysis.errors import error_state
from lab.analysis.fix_causes import of_fixes
from lab.base.arrays import FloatArray
from lab.experiment.datasets.flight import shown_states
from lab.experiment.datasets.labelled import EAST_NORTH_UP, labelled
from lab.motion.frames.east_north_up import NED_TO_ENU, east_north_up, east_north_up_sizes
from lab.navigation.aids import NAMES, SHOWN
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import POS
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.run.run import ResultError, Run

if TYPE_CHECKING:
    import xarray as xr

MEASURED = tuple(f"{kind} {axis}" for kind in ("position", "velocity") for axis in ("north", "east", "down"))
"""What a fix measures, in the order of H."""
UNITS = ("m",) * 3 + ("m/s",) * 3
"""Their units."""
UNLIKELY = 5.0
"""Excess of a mean square, in its σ √(2 / n), that chance does not explain: one of three million."""


def innovations(run: Run) -> xr.Dataset:
    """Return innovations, their σ, and NIS; see `Result.innovations`."""
    nu, S = run.solution_arrays.innovation, run.solution_arrays.innovation_covariance
    sigma = np.where(np.isnan(nu), np.nan, np.sqrt(np.diagonal(S, axis1=1, axis2=2)))
    measured = np.isfinite(nu).sum(axis=1)
    degrees = int(measured.max()) if measured.any() else MEASUREMENTS
    nis = _of_used_fixes(run, np.nan_to_num(nu), S)
    rejected = run.solution_arrays.fix_rejected.astype(np.float64)
    dims = ("time_gps", "axis")
    dataset = labelled(
        run,
        position=(dims, east_north_up(nu[:, :3]), "m", "position innovation"),
        velocity=(dims, east_north_up(nu[:, 3:]), "m/s", "velocity innovation"),
        position_sigma=(dims, east_north_up_sizes(sigma[:, :3]), "m", "σ of the position innovation"),
        velocity_sigma=(dims, east_north_up_sizes(sigma[:, 3:]), "m/s", "σ of the velocity innovation"),
        nis=(("time_gps",), nis, "", f"NIS, {degrees} degrees of freedom"),
        rejected=(("time_gps",), rejected, "", "1 for a fix rejected by the gate"),
    )
    dataset.nis.attrs["degrees"] = degrees
    return dataset


def normalised(found: xr.Dataset) -> FloatArray:
    """Return the innovations of the fixes used (m, 6) in their σ: position, then velocity, east, north, up.

    What the receiver of a log does not measure is NaN.

    Parameters
    ----------
    found
        What `innovations` returned.
    """
    used = np.isfinite(found["nis"].values)
    parts = [(found[name] / found[f"{name}_sigma"]).values[used] for name in ("position", "velocity")]
    return np.concatenate(parts, axis=1)


def autocorrelation(run: Run, found: xr.Dataset) -> xr.Dataset:
    """Return the autocorrelation of the innovations; see `Result.autocorrelation`."""
    values = normalised(found)
    r = statistics.autocorrelation(np.nan_to_num(values))
    r[:, np.isnan(values).all(axis=0)] = np.nan
    dims = ("lag", "axis")
    dataset = labelled(
        run,
        position=(dims, r[:, :3], "", "autocorrelation of the position innovations"),
        velocity=(dims, r[:, 3:], "", "autocorrelation of the velocity innovations"),
    ).assign_coords(lag=np.arange(r.shape[0]))
    return dataset.assign_attrs(band=statistics.whiteness_band(values.shape[0]))


def consistency(run: Run) -> xr.Dataset:
    """Return NEES after each fix; see `Result.consistency`."""
    solution, truth = run.solution_arrays, run.known_truth("consistency")
    samples = np.maximum(solution.fix_sample, 0)
    scale = run.true_scale if solution.scale.size else None
    further = run.true_further() if solution.further.size else None
    x = error_state(solution, samples, truth, run.true_bias, scale, further)
    nees = _of_used_fixes(run, x, solution.fix_covariance)
    used = of_fixes(solution.fix_covariance, np.flatnonzero(solution.fix_sample >= 0))
    degrees = int(statistics.find_uncertain_states(used).size) if used.size else 0
    label = f"NEES, {degrees} degrees of freedom" if degrees else "NEES, not known"
    dataset = labelled(run, nees=(("time_gps",), nees, "", label))
    dataset.nees.attrs["degrees"] = degrees
    return dataset


def position_covariance(run: Run) -> xr.DataArray:
    """Return the covariance of the position error; see `Result.position_covariance`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    P = NED_TO_ENU @ run.solution_arrays.fix_covariance[:, POS, POS] @ NED_TO_ENU.T
    return xr.DataArray(
        P,
        dims=("time_gps", "axis", "axis_2"),
        coords={"time_gps": run.fixes.time, "axis": EAST_NORTH_UP, "axis_2": EAST_NORTH_UP},
        attrs={"units": "m²", "long_name": "covariance of the position error"},
    )


def _of_used_fixes(run: Run, vectors: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return the normalised squares (m,) of vectors at the fixes; NaN where the filter used none."""
    used = np.flatnonzero(run.solution_arrays.fix_sample >= 0)
    squares = np.full(run.fixes.time.shape, np.nan)
    squares[used] = statistics.normalised_squares(vectors[used], of_fixes(covariances, used))
    return squares


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
                f"The innovations of {NAMES[kind]} are {np.sqrt(squares.mean()):.2g} times as large as the "
                "filter says: these measurements, or the axes of the IMU in the vehicle, have other errors "
                "than assumed, and σ is too small."
            )
    return remarks


def update_at(run: Run, time: float) -> xr.Dataset:
    """Return the update by the last fix at a time or before [s]; see `Result.update_at`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    from lab.analysis.fix_update import directions, find_last_fix, fix_update  # noqa: PLC0415 - likewise

    fix = find_last_fix(run, time)
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
    low, high = statistics.chi_square_interval(max(int(seen.sum()), 1))
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
