"""Sheet heights: the heights beside the positions in a sheet, in the unit that they or the motion show.

A height without a unit is judged by the accelerometers. Over a few seconds the specific force integrated
twice shows how the height changes, but for a parabola: an unknown height and velocity at the start, and a
bias. The heights follow it with the factor of their unit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.log_check import find_windows
from lab.data.checks.velocity_matching import Window, match
from lab.data.files.fields import SEA_LEVEL
from lab.data.files.unit_names import UNITS
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import SensorLog
from lab.data.sheets.column_names import SCALARS
from lab.data.sheets.sheet import Sheet
from lab.motion.kinematics.running_turns import running_attitudes

_UNITS = ("m", "ft", "cm", "mm")
"""Units that loggers write heights in."""
_MIN_FIXES = 6
"""Fewest fixes in a window, of which three fit the parabola."""
_CLEARLY = 8.0
"""Least factor of the heights in its σ: those of windows are not quite independent."""
_LIKE = 0.3
"""Largest distance of the factor from that of a unit, as a logarithm: a quarter of that between m and ft.
Measured: 0.90 to 1.08 in five minutes of a flight."""
_MAX_METRES = 10_000.0
"""Height from which whole numbers beside coordinates in 1e-7° are mm [m]."""
_TRANSPONDER_STEP = 25.0
"""Step of the heights of a transponder [ft] (ICAO Annex 10, mode S)."""
_MIN_LEVELS = 4
"""Fewest different heights that show it: four multiples of 25 by chance have a probability of 25⁻⁴."""
_HIGHEST = 18_000.0
"""Height at which civil receivers stop [m] (Wassenaar Arrangement, 7.A.5): larger numbers are mm."""

_SIMCONNECT = re.compile(r"(?i)\bplane[ _]?alt(?:itude)?\b")
"""A variable of Microsoft's simulators, in feet."""
_ABOVE_START = re.compile(r"(?i)take-?_? ?off|relative|(?<![a-z])rel(?![a-z])")
"""In a heading of heights above the place of take-off."""
_FROM_START = (
    " They are above the place of take-off or start, and not above sea level: the flight is too low or too "
    "high by the height of that place."
)
ABOVE_ELLIPSOID = "Heights are above the ellipsoid, as their heading says."
_ELLIPSOID = re.compile(r"(?i)ellipsoid|(?<![a-z])(?:hae|ell)(?![a-z])|(?<=[a-z])HAE")
"""In a heading of heights above the ellipsoid."""
BY_SIZE = "guessed by its size"


class Column(NamedTuple):
    """A column in SI units.

    Attributes
    ----------
    name : str
        Its heading; empty if there is none.
    values : (n,) array
        Its numbers in SI units; NaN where unknown.
    unit, source : str
        The unit in which they were read, and how it is known.
    """

    name: str
    values: FloatArray
    unit: str
    source: str


def find_column(sheet: Sheet, quantity: str) -> Column | None:
    """Return the best column of a quantity in SI units; without a unit its numbers are in the first one."""
    found = sheet.all_of(quantity)
    if not found:
        return None
    # Positions that never change are those of a home or of a remote control.
    equal = [pair for pair in found if pair[0].rank == found[0][0].rank]
    changing = (pair for pair in equal if np.unique(pair[1][np.isfinite(pair[1])]).size > 1)
    heading, values = next(changing, found[0]) if len(equal) > 1 else found[0]
    kind = SCALARS[quantity]
    unit = heading.unit or next(iter(UNITS[kind]))
    source = heading.source if heading.unit else "assumed"
    return Column(heading.text, heading.sign * values * UNITS[kind][unit], unit, source)


def rescale_column(column: Column, kind: str, unit: str, source: str) -> Column:
    """Return a column whose numbers are in another unit than the first of its kind."""
    return column._replace(values=column.values * UNITS[kind][unit], unit=unit, source=source)


def about_heights(name: str, ellipsoid: bool | None) -> tuple[str, ...]:
    """Return above what the heights of a column are; empty without one, or if it is told.

    Parameters
    ----------
    name
        Its heading.
    ellipsoid
        What the file says above its header, if it says anything.
    """
    if not name or _ABOVE_START.search(name):
        return ()
    if ellipsoid:
        return ("Heights are above the ellipsoid, as the lines above the header say.",)
    return (ABOVE_ELLIPSOID,) if _ELLIPSOID.search(name) else (SEA_LEVEL,)


def doubt_of_feet(height: Column, columns: Sequence[Column]) -> tuple[str, ...]:
    """Return a sentence if heights without a unit stand beside a speed in knots, miles or feet."""
    unit = next((column.unit for column in columns if column.unit in ("kt", "mph", "ft/s")), "")
    if height.source != "assumed" or not unit:
        return ()
    return (
        f"The speed is in {'knots' if unit == 'kt' else unit}: if the heights are in feet, "
        f'--unit "{height.name}=ft" says so.',
    )


def find_heights(sheet: Sheet, latitude: Column, *, needed: bool) -> tuple[Column, str]:
    """Return the heights [m] beside latitudes, and a sentence on them.

    Parameters
    ----------
    sheet
        The sheet.
    latitude
        The latitudes: heights beside coordinates in 1e-7° are often in mm.
    needed
        Whether there must be heights; if not, those of a sheet without them are NaN.

    Raises
    ------
    MissionError
        If there are none, and they are needed.
    """
    found = find_column(sheet, "height")
    if found is None and needed:
        raise MissionError(
            f"{sheet.name}: no column with the height of the fixes found; accepted are headings such as "
            "altitude, alt_m or height, or --column HEADING=height[m]"
        )
    if found is None:
        return Column("", np.full(len(sheet), np.nan), "m", ""), "No column with heights is found."
    height = _in_metres(found, latitude)
    if found.source == "assumed" and _SIMCONNECT.search(found.name):
        height = rescale_column(found, "length", "ft", "as SimConnect has it")
    above = _FROM_START if _ABOVE_START.search(height.name) else ""
    # The heights of a level drive do not show their unit.
    other = f'; --unit "{height.name}=ft" states another one' if height.source == "assumed" else ""
    return height, f"Heights: {height.name}, in {height.unit} ({height.source}{other}).{above}"


def _in_metres(height: Column, latitude: Column) -> Column:
    if height.source != "assumed":
        return height
    levels = np.unique(height.values[np.isfinite(height.values)])
    if levels.size >= _MIN_LEVELS and (levels % _TRANSPONDER_STEP == 0).all():
        source = "guessed: all are multiples of 25, as transponders send"
        return rescale_column(height, "length", "ft", source)
    whole = np.nanmax(np.abs(np.nan_to_num(height.values) % 1)) == 0
    by_coordinates = latitude.unit == "1e-7°" and whole and np.nanmax(height.values) > _MAX_METRES
    if by_coordinates or np.nanmedian(np.abs(height.values)) > _HIGHEST:
        return rescale_column(height, "length", "mm", BY_SIZE)
    return height


def unit_that_agrees(log: SensorLog, taken: str) -> tuple[str, float]:
    """Return the unit that the motion shows of heights, and how much their numbers change per metre.

    Parameters
    ----------
    log
        The log, in forward, right, down.
    taken
        The unit in which its heights were read.

    Returns
    -------
    str, float
        The unit; that in which they were read if the motion shows no other one.
    """
    log = cut_section(log)
    pairs = [pair for window in find_windows(log) if (pair := _changes(log, window)) is not None]
    if not pairs:
        return taken, 1.0
    moved, written = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    power = float(moved @ moved)
    factor = float(moved @ written) / power if power else 0.0
    spread = float(np.sqrt(np.mean((written - factor * moved) ** 2)))
    if factor <= 0 or factor * np.sqrt(power) < _CLEARLY * spread:
        return taken, 1.0
    factor /= UNITS["length"][taken]
    near = min(_UNITS, key=lambda unit: abs(np.log(factor * UNITS["length"][unit])))
    return (near if abs(np.log(factor * UNITS["length"][near])) < _LIKE else taken), factor


def _changes(log: SensorLog, window: Window) -> tuple[FloatArray, FloatArray] | None:
    """Return the heights by the accelerometers and by the fixes, each without its parabola."""
    time, height = log.gnss.time - log.gnss.latency, log.gnss.position[:, 2]
    inside = (time >= window.time[0]) & (time <= window.time[-1])
    if inside.sum() < _MIN_FIXES:
        return None
    found, dt = match(window), np.diff(window.time)
    attitude = found.C_nb * running_attitudes(window.dtheta - found.gyro_bias * dt[:, None])[:-1]
    # Upwards: minus down, less what only carries the weight.
    velocity = np.cumsum(-attitude.apply(window.dvelocity)[:, 2] - STANDARD_GRAVITY * dt)
    risen = running_sums(velocity * dt)
    since = time[inside] - window.time[0]
    both = np.column_stack((np.interp(time[inside], window.time, risen), height[inside]))
    # A wrong start, a wrong vertical speed and a bias of the accelerometer make a parabola.
    parabola = np.vander(since, 3)
    left = both - parabola @ np.linalg.lstsq(parabola, both, rcond=None)[0]
    return left[:, 0], left[:, 1]
