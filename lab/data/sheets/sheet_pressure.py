"""Sheet pressure: heights by a barometer out of the sheets of a log, if they follow those of the receiver.

The height is that of the standard atmosphere, shifted to begin at the height of the first fix, as the live
navigator has it: the weather moves it by a hundred metres. A cabin with a pressure of its own shows in the
changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.files.streams import Stream
from lab.data.files.unit_names import UNITS
from lab.data.log.auxiliary_data import Series
from lab.data.log.pressure_height import ACCEPTED, PERIOD, height_of, reading_at
from lab.data.log.sensor_log import SensorLog
from lab.data.sheets.column_names import Heading
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_imu import NAMED, is_of_another_device

_GUESSED = ("hPa", "kPa", "Pa")
"""Units of numbers without one; the pressures of the air are a factor apart in them."""
_MIN_READINGS = 10
"""Fewest readings that differ from the one before: a sensor that is stuck has one."""
_WEATHER = 600.0
"""Largest shift [m]: 50 hPa of weather, and the geoid."""
_WARM = 0.15
"""Largest error of a change of height, as a part of it: 40 K from the standard atmosphere."""
_GUSTS = 10.0
"""Largest error of a height besides [m]: 1 hPa of fans, windows and drift."""
_SIGMAS = 3.0
"""How many σ of the receiver's height are accepted besides."""
_UNKNOWN = 10.0
"""σ of the receiver's height where it gives none [m]."""
_FITTING = 0.8
"""Part of the fixes whose height has to agree."""


class Found(NamedTuple):
    """The barometer of a log, if it may be used.

    Attributes
    ----------
    barometer : Series or None
        Heights [m] with the times of the log.
    remarks : tuple of str
        The report: what was taken, or why nothing was.
    """

    barometer: Series | None
    remarks: tuple[str, ...]


def find_barometer(sheets: Sequence[Sheet], log: SensorLog) -> Found:
    """Return the heights by pressure of a log.

    Parameters
    ----------
    sheets
        The tables of the log.
    log
        Its IMU and receiver.
    """
    candidates = [
        (heading.rank, place, heading, sheet, values)
        for place, sheet in enumerate(sheets)
        if not is_of_another_device(sheet)
        for heading, values in sheet.all_of("pressure")
    ]
    refused: tuple[str, ...] = ()
    for _, _, heading, sheet, values in sorted(candidates, key=lambda one: one[:2]):
        found = _checked(heading, sheet, values, log)
        if found.barometer is not None:
            return found
        refused = refused or found.remarks
    return Found(None, refused)


def _checked(heading: Heading, sheet: Sheet, values: FloatArray, log: SensorLog) -> Found:
    """Return one barometer, if its heights follow those of the receiver."""
    place = f"{heading.text} of {sheet.name}"
    clock = find_clock(sheet, fast=False)
    if clock is None:
        return Found(None, ())
    size = float(np.nanmedian(values))
    unit = heading.unit or next((one for one in _GUESSED if _is_of_the_air(size, one)), "")
    if not unit:
        return Found(None, ())  # a short name such as p may be anything
    if not _is_of_the_air(size, unit):
        other = next((f"; the numbers look like {one}" for one in _GUESSED if _is_of_the_air(size, one)), "")
        remark = (
            f"The barometer {place} is not used: it measures {size:.4g} {unit}, which the air has not{other}."
        )
        return Found(None, (remark,))
    stream = _stream(clock.time - log.epoch, values * UNITS["pressure"][unit], log)
    if len(stream.time) < _MIN_READINGS:
        return Found(None, (f"The barometer {place} is not used: it does not change.",))
    height = height_of(stream.values[:, 0])
    shift, why = _shift(stream.time, height, log)
    if why:
        return Found(None, (f"The barometer {place} is not used: {why}.",))
    source = NAMED if heading.unit else f"guessed: it is {size:.4g}"
    remark = (
        f"Barometer: {place}, in {unit} ({source}), {stream.rate:.3g} Hz; heights of the standard "
        f"atmosphere, moved by {shift:+.0f} m to begin at the first fix."
    )
    number = np.floor(stream.time / PERIOD)
    used = np.append(True, np.diff(number) > 0)
    return Found(Series(stream.time[used], height[used] + shift), (remark,))


def _is_of_the_air(size: float, unit: str) -> bool:
    return ACCEPTED[0] < size * UNITS["pressure"][unit] < ACCEPTED[1]


def _stream(time: FloatArray, pressure: FloatArray, log: SensorLog) -> Stream:
    """Return pressures [Pa] within a log; those that a table repeats are left out."""
    valid = (pressure > ACCEPTED[0]) & (pressure < ACCEPTED[1]) & (time > -PERIOD) & (time < log.time[-1])
    stream = Stream.of("barometer", time, pressure, valid)
    new = np.append(True, np.diff(stream.values[:, 0]) != 0)[: len(stream.time)]
    return Stream.of("barometer", stream.time[new], stream.values[new])


def _shift(time: FloatArray, height: FloatArray, log: SensorLog) -> tuple[float, str]:
    """Return what is added to heights by pressure [m], and why they are not those of the receiver."""
    fixes, sigma = log.gnss.position[:, 2], log.gnss.position_sigma[:, 2]
    at = log.gnss.time - log.gnss.latency
    rows = np.isfinite(fixes) & (at >= time[0]) & (at <= time[-1])
    if not rows.any():
        return 0.0, "no fix has a height while it measures"
    apart = fixes[rows] - np.interp(at[rows], time, height)
    usual = float(np.median(apart))
    if abs(usual) > _WEATHER:
        return 0.0, f"its heights are {-usual:+.0f} m from those of the receiver"
    changing = _GUSTS + _WARM * float(np.ptp(fixes[rows]))
    allowed = changing + _SIGMAS * np.where(np.isfinite(sigma[rows]), sigma[rows], _UNKNOWN)
    share = float((np.abs(apart - usual) < allowed).mean())
    if share < _FITTING:
        return 0.0, f"its heights change as those of the receiver for {share:.0%} of the fixes"
    first = int(np.flatnonzero(rows)[0])
    return float(fixes[first] - height[reading_at(time, float(at[first]))]), ""
