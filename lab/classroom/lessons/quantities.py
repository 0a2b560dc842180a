"""Quantities: the numbers of a result that a check may name, each with unit and meaning.

A check also may name a numeric setting by its path, such as ``navigator.r_scale``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.experiment.datasets.innovations import normalised
from lab.experiment.result import Result

HEADING = 2
"""Column of the heading in the errors of the attitude: roll, pitch, heading."""
UP = 2
"""Column of the height in the errors of the position: east, north, up."""


class Quantity(NamedTuple):
    """A number of a result.

    Attributes
    ----------
    unit : str
        Its unit; empty for a pure number.
    meaning : str
        What it is.
    of : callable
        Returns it for a result; NaN if it is unknown.
    """

    unit: str
    meaning: str
    of: Callable[[Result], float]


def _rms(values: FloatArray) -> float:
    """Return the root mean square of the lengths of rows (n, k), or of values (n,)."""
    return float(np.sqrt(np.mean(np.sum(values.reshape(values.shape[0], -1) ** 2, axis=1))))


def _largest_length(values: FloatArray) -> float:
    """Return the largest length of rows (n, k), or of values (n,)."""
    return float(np.sqrt(np.max(np.sum(values.reshape(values.shape[0], -1) ** 2, axis=1))))


def _last_value(values: FloatArray) -> float:
    return _largest_length(values[-1:])


def _error(kind: str, columns: slice | int, how: Callable[[FloatArray], float]) -> Callable[[Result], float]:
    """Return a function of a result: a figure of some columns of one of its errors."""

    def of(result: Result) -> float:
        if result.missing_reason("errors"):
            return float("nan")
        return how(result.errors[kind].values[:, columns])

    return of


def _sigma_end(kind: str, columns: slice | int) -> Callable[[Result], float]:
    return lambda result: _last_value(result.sigma[kind].values[:, columns])


def _mean_square(columns: slice) -> Callable[[Result], float]:
    """Return a function of a result: the mean square of some innovations of the used fixes, in their σ."""

    def of(result: Result) -> float:
        values = normalised(result.innovations)[:, columns]
        return float(np.nanmean(values**2)) if np.isfinite(values).any() else float("nan")

    return of


def _nees(result: Result) -> float:
    if result.missing_reason("consistency"):
        return float("nan")
    values, degrees = result.consistency.nees.values, result.consistency.nees.attrs["degrees"]
    return float(np.nanmean(values)) / degrees if degrees and np.isfinite(values).any() else float("nan")


def _correlation(result: Result) -> float:
    lags = [result.autocorrelation[kind].values[1:2] for kind in ("position", "velocity")]
    found = np.concatenate(lags, axis=None)
    return float(np.nanmax(np.abs(found))) if np.isfinite(found).any() else float("nan")


def _in_outages(result: Result) -> float:
    """Return the largest error of the position in the outages [m]; NaN without any."""
    if result.missing_reason("errors"):
        return float("nan")
    time = result.time + result.epoch
    inside = np.zeros(time.size, dtype=np.bool_)
    for start, end in result.experiment.sensors.gps.outages:
        inside |= (time >= start) & (time <= end)
    return _largest_length(result.errors.position.values[inside]) if inside.any() else float("nan")


def _fixes_used(result: Result) -> float:
    return float(np.count_nonzero(result.solution_arrays.fix_sample >= 0))


def _fixes_rejected(result: Result) -> float:
    return float(np.count_nonzero(result.solution_arrays.fix_rejected))


def _findings(result: Result) -> float:
    return float(len(result.verdict.findings))


_EVERY, _LEVEL = slice(None), slice(0, 2)  # columns: all, and the first two

QUANTITIES: dict[str, Quantity] = {
    "position_rms": Quantity("m", "rms of the position error", _error("position", _EVERY, _rms)),
    "position_max": Quantity("m", "largest position error", _error("position", _EVERY, _largest_length)),
    "position_end": Quantity("m", "position error at the end", _error("position", _EVERY, _last_value)),
    "horizontal_rms": Quantity("m", "rms of the horizontal position error", _error("position", _LEVEL, _rms)),
    "height_rms": Quantity("m", "rms of the height error", _error("position", UP, _rms)),
    "outage_max": Quantity("m", "largest position error during the GPS outages", _in_outages),
    "velocity_rms": Quantity("m/s", "rms of the velocity error", _error("velocity", _EVERY, _rms)),
    "tilt_rms": Quantity("°", "rms of the errors of roll and pitch", _error("attitude", _LEVEL, _rms)),
    "heading_rms": Quantity("°", "rms of the heading error", _error("attitude", HEADING, _rms)),
    "heading_end": Quantity(
        "°", "size of the heading error at the end", _error("attitude", HEADING, _last_value)
    ),
    "heading_sigma_end": Quantity(
        "°", "σ of the heading at the end, as the filter states it", _sigma_end("attitude", HEADING)
    ),
    "nis": Quantity("", "mean NIS by its degrees of freedom; 1 if consistent", _mean_square(_EVERY)),
    "nis_position": Quantity("", "the part of the positions in it", _mean_square(slice(0, 3))),
    "nis_velocity": Quantity("", "the part of the velocities in it", _mean_square(slice(3, 6))),
    "nees": Quantity("", "mean NEES by its degrees of freedom; 1 if consistent", _nees),
    "correlation": Quantity(
        "", "largest correlation of an innovation with the next, 0 to 1; small if white", _correlation
    ),
    "fixes_used": Quantity("", "number of fixes that the filter used", _fixes_used),
    "fixes_rejected": Quantity("", "number of fixes that the gate rejected", _fixes_rejected),
    "findings": Quantity("", "number of findings of the verdict", _findings),
}
"""The quantities by name."""


def setting_value(result: Result, path: str) -> float:
    """Return a numeric setting of a result: the component of largest size of one for each axis.

    Raises
    ------
    SettingError
        If there is no such setting.
    """
    value = result.experiment.get(path)
    if isinstance(value, bool | str) or value is None:
        return float(value) if isinstance(value, bool) else float("nan")
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float64)).ravel()
    return float(numbers[np.argmax(np.abs(numbers))]) if numbers.size else float("nan")
