"""Sheet coordinates: latitudes and longitudes of a sheet in radians, whatever they are written in."""

from __future__ import annotations

import re

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError, QuestionError
from lab.base.parameters.units import DEGREE
from lab.data.files.unit_names import UNITS
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_heights import BY_SIZE, Column
from lab.motion.frames.rotation import wrap

_MAX_DEGREES = 360.0
"""Largest coordinate in degrees: larger whole numbers are 1e-7°."""
_MAX_NMEA = 18_000.0
"""Largest coordinate as degrees times 100 plus minutes, as NMEA writes it."""
_HUNDRED, _MINUTES = 100.0, 60.0
"""Between the digits of degrees and minutes in ddmm.mmmm; how many minutes there are."""
_ROUNDING = 1e-9
"""By how much a coordinate may be beyond a pole, relative to 90°."""
_OF_FIT = re.compile(r"(?i)(?:start_|end_)?position_?(?:lat|long)")
"""Headings of FIT, whose whole numbers are semicircles."""


class LatitudeError(MissionError):
    """Latitudes are beyond the poles: the columns are swapped, or their unit is another one."""


def in_degrees(latitude: Column, longitude: Column) -> tuple[Column, Column]:
    """Return coordinates [rad] without a unit by their size: degrees, ddmm.mmmm of NMEA, or 1e-7°.

    Parameters
    ----------
    latitude, longitude
        The columns as their headings say [rad]; numbers without a unit as degrees.
    """
    numbers = [np.abs(one.values[np.isfinite(one.values)]) / DEGREE for one in (latitude, longitude)]
    stated = {latitude.source, longitude.source} != {"assumed"} or not all(one.size for one in numbers)
    largest = max(float(np.median(one)) for one in numbers) if not stated else 0.0
    if _MAX_DEGREES < largest < _MAX_NMEA and all((one % _HUNDRED < _MINUTES).all() for one in numbers):
        return _of_nmea(latitude), _of_nmea(longitude)
    return _degrees(latitude), _degrees(longitude)


def on_the_earth(sheet: Sheet, latitude: Column, longitude: Column) -> tuple[Column, Column]:
    """Return coordinates with longitudes from -180° to 180°, and NaN for those that are none.

    Parameters
    ----------
    sheet
        The sheet, for the message.
    latitude, longitude
        Its columns [rad].

    Raises
    ------
    LatitudeError
        If most latitudes are none.
    """
    pole, turn = (1 + _ROUNDING) * np.pi / 2, (1 + _ROUNDING) * 2 * np.pi
    beyond = np.abs(latitude.values) > pole
    if np.median(np.abs(latitude.values[np.isfinite(latitude.values)])) > pole:
        is_other = np.median(np.abs(longitude.values[np.isfinite(longitude.values)])) <= pole
        swapped = ", and the longitudes are not: the two columns look swapped" if is_other else ""
        raise LatitudeError(
            f"{sheet.name}: the latitudes ({latitude.name}) are beyond ±90°{swapped}; accepted are latitudes "
            "and longitudes in °, rad, 1e-7° or 1e-6°: --unit COLUMN=UNIT, or --column HEADING=latitude[°]"
        )
    beyond |= np.abs(longitude.values) > turn
    values = longitude.values if np.nanmax(np.abs(longitude.values)) <= turn / 2 else wrap(longitude.values)
    return (
        latitude._replace(values=np.where(beyond, np.nan, latitude.values)),
        longitude._replace(values=np.where(beyond, np.nan, values)),
    )


def _of_nmea(column: Column) -> Column:
    """Return a coordinate that is written as the number ddmm.mmmm."""
    degrees, minutes = np.divmod(np.abs(column.values) / DEGREE, _HUNDRED)
    values = np.copysign((degrees + minutes / _MINUTES) * DEGREE, column.values)
    return column._replace(values=values, unit="ddmm.mmmm", source=BY_SIZE)


def _degrees(column: Column) -> Column:
    if column.source == "assumed" and np.nanmedian(np.abs(column.values)) > _MAX_DEGREES * DEGREE:
        if _OF_FIT.fullmatch(column.name):
            factor = UNITS["angle"]["semicircles"] / DEGREE
            return column._replace(values=column.values * factor, unit="semicircles", source="as FIT has it")
        return column._replace(values=column.values * 1e-7, unit="1e-7°", source=BY_SIZE)
    return column


def refuse_radians(sheet: Sheet, latitude: str, longitude: str, position: FloatArray) -> None:
    """Raise a `QuestionError` if two columns of a sheet, read in degrees, could be radians.

    In degrees, such positions (m, 3) lie on the sea where the equator meets the meridian of Greenwich.
    """
    if not (np.abs(position[:, :2]) <= (np.pi / 2 * DEGREE, np.pi * DEGREE)).all():
        return
    raise QuestionError(
        f"{sheet.name}: {latitude} and {longitude} are radians, or degrees on the sea where the equator "
        "meets the meridian of Greenwich: no heading names the unit, and no velocity shows it; accepted are "
        f'both with their unit: --unit "{latitude}=rad"',
        {unit: {latitude: unit, longitude: unit} for unit in ("rad", "°")},
    )
