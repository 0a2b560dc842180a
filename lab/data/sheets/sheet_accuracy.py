"""Sheet accuracy: the σ of fixes out of the accuracies in a sheet, in the unit that is borne out.

The columns of one message share their unit: where heights are in mm, accuracies are. A σ of hundreds of
metres beside fixes that agree to a metre is in another unit in any case.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.files.unit_names import UNITS
from lab.data.log.sensor_log import believed_sigma
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_heights import Column, find_column, rescale_column
from lab.motion.frames.displacement import metres_per_radian

_SIGMA_OF_RADIUS = 1.515
"""Radius of the circle with 68 % of the fixes, which phones give as accuracy, over σ of an axis:
sqrt(-2 ln 0.32)."""
_SIGMAS = {
    "horizontal_sigma": ("length", slice(0, 2), "the horizontal position", _SIGMA_OF_RADIUS),
    "north_sigma": ("length", slice(0, 1), "the position north", 1.0),
    "east_sigma": ("length", slice(1, 2), "the position east", 1.0),
    "vertical_sigma": ("length", slice(2, 3), "the height", 1.0),
    "speed_sigma": ("speed", slice(3, 6), "the velocity", 1.0),
    "north_speed_sigma": ("speed", slice(3, 4), "the velocity north", 1.0),
    "east_speed_sigma": ("speed", slice(4, 5), "the velocity east", 1.0),
    "down_speed_sigma": ("speed", slice(5, 6), "the vertical velocity", 1.0),
}
"""Of each accuracy: the kind of its unit, what it is σ of, that in words, and what it is divided by."""
_KINDS = ("length", "speed")
_FINE = ("mm", "cm")
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


class _Beside(NamedTuple):
    """What shows the unit of accuracies: the units of columns beside, and how well the fixes agree [m]."""

    units: dict[str, str]
    names: str
    scatter: float
    way: float


def _accuracies_beside(sheet: Sheet, columns: Sequence[Column], position: FloatArray) -> _Beside:
    """Return what shows the unit of accuracies: where heights or other accuracies are in mm, they are."""
    others = [found for name in _SIGMAS if (found := find_column(sheet, name)) and found.source != "assumed"]
    fine = [one for one in (*columns, *others) if one.unit.removesuffix("/s") in _FINE]
    units = {kind: one.unit for one in fine[::-1] for kind in _KINDS if one.unit in UNITS[kind]}
    scatter, way = np.inf, 0.0
    place = position[np.isfinite(position[:, :2]).all(axis=1), :2]
    if len(place) >= _MIN_FIXES:
        place = (np.unwrap(place, axis=0) - place[0]) * np.column_stack(metres_per_radian(place[:, 0], 0.0))
        scatter = float(np.median(np.abs(np.diff(place, n=3, axis=0)))) * _SIGMA_OF_THIRD
        way = float(np.linalg.norm(np.ptp(place, axis=0)))
    return _Beside(units, " and ".join(dict.fromkeys(one.name for one in fine)), scatter, way)


def read_sigmas(
    sheet: Sheet,
    rows: NDArray[np.intp],
    columns: Sequence[Column],
    position: FloatArray,
    velocity: FloatArray,
) -> tuple[FloatArray, list[Column], list[str]]:
    """Return σ of position and velocity (m, 6), their columns, and a report.

    Parameters
    ----------
    sheet
        The sheet.
    rows
        Its rows with a fix.
    columns
        Heights and velocities beside, whose units the accuracies share where they are those of integers.
    position : (m, 3) array
        Latitude, longitude [rad], height [m] of the fixes.
    velocity : (m, 3) array
        Velocities north, east, down [m/s]; the accuracy of a speed is also that of a vertical one.
    """
    beside = _accuracies_beside(sheet, columns, position)
    sigmas = np.full((len(rows), 6), np.nan)
    remarks, used = [], []
    for name, (kind, places, words, radius) in _SIGMAS.items():
        column = find_column(sheet, name)
        if column is None:
            continue
        if column.source == "assumed":
            column = _in_its_unit(column, kind, rows, beside)
            if column.unit in _FINE:
                beside.units.setdefault("length", column.unit)
                beside.units.setdefault("speed", f"{column.unit}/s")
        used.append(column)
        sigmas[:, places] = column.values[rows, None] / radius
        over = f" over {radius}, as the radius with 68 % of the fixes" if radius != 1 else ""
        remarks.append(f"σ of {words}: {column.name}, in {column.unit} ({column.source}){over}.")
    sigmas[np.isnan(velocity[:, 2]), 5] = np.nan
    return believed_sigma(sigmas), used, remarks


def _in_its_unit(column: Column, kind: str, rows: NDArray[np.intp], beside: _Beside) -> Column:
    """Return an accuracy in the unit of the columns beside, or that the scatter of the fixes shows."""
    values = column.values[rows][np.isfinite(column.values[rows])]
    size = float(np.median(values)) if values.size else 0.0

    def is_believable(unit: str) -> bool:
        return kind == "speed" or size * UNITS[kind][unit] * _CLEARLY_MORE > beside.scatter

    shared = beside.units.get(kind, "")
    if shared and not (values % 1).any() and (is_believable(shared) or beside.scatter == np.inf):
        return rescale_column(column, kind, shared, f"as {beside.names or 'the other accuracies'}")
    huge = kind == "length" and size > _LEAST_HUGE and beside.way > size and beside.scatter < size * _AGREES
    unit = next((one for one in _FINE if huge and is_believable(one)), "")
    why = f"guessed: the fixes agree to {beside.scatter:.2g} m, not to {size:.3g} m"
    return rescale_column(column, kind, unit, why) if unit else column
