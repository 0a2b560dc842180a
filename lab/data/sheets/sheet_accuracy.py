"""Sheet accuracy: the σ of fixes out of the accuracies in a sheet, in the unit that is borne out.

The columns of one message share their unit: where heights are in mm, accuracies are. A σ of hundreds of
metres beside fixes that agree to a metre is in another unit in any case.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.files.unit_names import UNITS
from lab.data.log.sensor_log import believed_sigma
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_heights import Column, column_of, rescaled
from lab.motion.frames.displacement import metres_per_radian

_SIGMA_OF_RADIUS = 1.515
"""Radius of the circle with 68 % of the fixes, which phones give as accuracy, over σ of an axis:
sqrt(-2 ln 0.32)."""
_FINE = {"length": ("mm", "cm"), "speed": ("mm/s", "cm/s")}
"""Units of integers in messages of receivers, which all columns of a message share."""
_LEAST_HUGE = 50.0
"""σ of a position that is compared with the scatter of the fixes [m]: satellites give less."""
_AGREES = 0.02
"""Scatter of the fixes over σ below which σ is in another unit: receivers smooth, by a factor of 10."""
_CLEARLY_MORE = 10.0
"""How much less than their scatter the σ of fixes may be: turns add to the scatter."""
_SIGMA_OF_THIRD = 1.4826 / np.sqrt(20.0)
"""σ of white noise over the median size of its third difference."""
_MIN_FIXES = 10
"""Fewest fixes whose scatter is judged."""


def _shared(height: Column, speeds: Sequence[Column]) -> dict[str, str]:
    """Return the units of heights and speeds, by kind, that the accuracies beside them share."""
    shared = {}
    for kind, columns in (("length", (height,)), ("speed", speeds)):
        found = next((one for one in columns if one.unit in _FINE[kind]), None)
        if found is not None:
            shared[kind] = found.unit
            shared["of"] = f"{shared['of']} and {found.name}" if shared.get("of") else found.name
    return shared


def sigmas_of(
    sheet: Sheet, rows: NDArray[np.intp], height: Column, speeds: Sequence[Column], position: FloatArray
) -> tuple[FloatArray, list[Column], list[str]]:
    """Return σ of position and velocity (m, 6), their columns, and a report.

    Parameters
    ----------
    sheet
        The sheet.
    rows
        Its rows with a fix.
    height, speeds
        Columns beside, whose units the accuracies share where they are those of integers.
    position : (m, 3) array
        Latitude, longitude [rad], height [m] of the fixes.
    """
    beside = _shared(height, speeds)
    sigmas = np.full((len(rows), 6), np.nan)
    remarks, used = [], []
    for name, kind, places, words in (
        ("horizontal_sigma", "length", slice(0, 2), "the horizontal position"),
        ("vertical_sigma", "length", slice(2, 3), "the height"),
        ("speed_sigma", "speed", slice(3, 5), "the horizontal velocity"),
    ):
        column = column_of(sheet, name)
        if column is None:
            continue
        radius = _SIGMA_OF_RADIUS if name == "horizontal_sigma" else 1.0
        if column.source == "assumed" and (shared := beside.get(kind)):
            column = rescaled(column, kind, shared, f"as {beside['of']}")
        elif column.source == "assumed" and kind == "length":
            column = _in_believable_unit(column, rows, position)
        used.append(column)
        sigmas[:, places] = column.values[rows, None] / radius
        over = f" over {radius}, as the radius with 68 % of the fixes" if radius != 1 else ""
        remarks.append(f"σ of {words}: {column.name}, in {column.unit} ({column.source}){over}.")
    return believed_sigma(sigmas), used, remarks


def _in_believable_unit(column: Column, rows: NDArray[np.intp], position: FloatArray) -> Column:
    """Return a σ of positions in mm or cm if fixes on a longer way agree far better than it says."""
    size = float(np.nanmedian(column.values[rows])) if np.isfinite(column.values[rows]).any() else 0.0
    if size < _LEAST_HUGE or len(position) < _MIN_FIXES:
        return column
    metres = np.column_stack((*metres_per_radian(position[:, 0], 0.0), np.ones(len(position))))
    place = (np.unwrap(position, axis=0) - position[0]) * metres
    place = place[np.isfinite(place[:, :2]).all(axis=1), :2]
    way = float(np.linalg.norm(np.ptp(place, axis=0))) if len(place) >= _MIN_FIXES else 0.0
    scatter = np.median(np.abs(np.diff(place, n=3, axis=0))) * _SIGMA_OF_THIRD if way > size else np.inf
    for unit in ("mm", "cm"):
        if scatter < size * _AGREES and size * UNITS["length"][unit] > scatter / _CLEARLY_MORE:
            return rescaled(
                column, "length", unit, f"guessed: the fixes agree to {scatter:.2g} m, not to {size:.3g} m"
            )
    return column
