"""Live errors: the errors of the live navigator against the truth behind its stream, and their σ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.live.live_state import LiveHistory
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import wrap
from lab.motion.truth.growing_truth import TrueMotion


class LiveErrors(NamedTuple):
    """Errors, estimate minus truth, and their σ according to the filter; NaN where either is unknown.

    Attributes
    ----------
    time : (n,) array
        Times of the host's clock [s].
    position, position_sigma : (n, 3) arrays
        North, east, down [m].
    velocity, velocity_sigma : (n, 3) arrays
        North, east, down [m/s].
    attitude, attitude_sigma : (n, 3) arrays
        Roll, pitch, heading [rad]; NaN for a heading that nothing shows.
    """

    time: FloatArray
    position: FloatArray
    position_sigma: FloatArray
    velocity: FloatArray
    velocity_sigma: FloatArray
    attitude: FloatArray
    attitude_sigma: FloatArray


def errors_of(history: LiveHistory, truth: TrueMotion) -> LiveErrors:
    """Return the errors of some rows of the history of a live navigator.

    Parameters
    ----------
    history
        The rows.
    truth
        The true motion, by the clock of the history.
    """
    there = truth.at(history.time)
    heading_unknown = history.euler_sigma[:, 2] >= np.pi
    attitude = np.asarray(wrap(history.euler - there.euler))
    sigma = history.euler_sigma.copy()
    attitude[heading_unknown, 2] = sigma[heading_unknown, 2] = np.nan
    without = np.isnan(history.position[:, :1])
    return LiveErrors(
        history.time,
        displacement(there.position, history.position),
        np.where(without, np.nan, history.sigma[:, :3]),
        history.velocity_n - there.velocity_n,
        np.where(without, np.nan, history.sigma[:, 3:6]),
        attitude,
        sigma,
    )


def join_errors(parts: Sequence[LiveErrors]) -> LiveErrors:
    """Return the rows of all parts, of which there is one or more."""
    return LiveErrors(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def normalised_rms(errors: LiveErrors) -> dict[str, float]:
    """Return the rms of error over σ of position, velocity and attitude; NaN where none is known."""
    found = {}
    for name, error, sigma in (
        ("position", errors.position, errors.position_sigma),
        ("velocity", errors.velocity, errors.velocity_sigma),
        ("attitude", errors.attitude, errors.attitude_sigma),
    ):
        with np.errstate(invalid="ignore", divide="ignore"):
            normed = error / sigma
        known = normed[np.isfinite(normed)]
        found[name] = float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
    return found
