"""Aiding: the measurements besides GPS that a filter uses, with the noise that it assumes.

Readings of sensors, and two conditions that hold without any sensor: a vehicle at rest does not move, and one
on wheels moves where its wheels point.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.units import si
from lab.navigation import aids
from lab.navigation.aids import KINDS, Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Imu
from lab.sensors.readings import Readings
from lab.sensors.suite import SensorSuite

CONDITION_PERIOD = 1.0
"""Time between two measurements of a condition [s]: slip is assumed white from one to the next."""
ROUNDING = 1e-6
"""Largest rounding of a time stamp [s]: a second ends with the sample at its end."""


def needs_rest(navigator: NavigatorSettings) -> bool:
    """Return whether a filter needs to know when the vehicle stands still."""
    return bool(navigator.rest_updates or navigator.zero_velocity)


def most_aids(sensors: SensorSuite, navigator: NavigatorSettings, duration: float) -> int:
    """Return how many measurements besides GPS fixes a simulated flight has at most; its duration is in s."""
    fitted = (one for one in sensors.aids().values() if one.get("fitted"))
    per_second = sum(1.0 / float(one.get("period")) for one in fitted)
    conditions = 2 * bool(navigator.no_slip) + 3 * bool(navigator.zero_velocity)
    return round(duration * (per_second + conditions / CONDITION_PERIOD))


def collect_aids(
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    readings: Mapping[str, Readings],
    imu: Imu,
    rest: NDArray[np.bool_],
) -> Aids:
    """Return all measurements besides GPS fixes.

    Parameters
    ----------
    sensors, navigator
        Noise of the sensors, and the filter.
    readings
        Readings by the sensor's group in the settings.
    imu
        The increments.
    rest : (n,) array
        Samples at rest.
    """
    scale = navigator.aiding_scale
    parts = []
    for name, found in readings.items():
        errors = sensors.aids()[name]
        variance: float | FloatArray = scale * float(si(errors, "noise")) ** 2
        if found.sigma.size:
            variance = known_variance(found.sigma, scale, float(variance))
        part = of_one_kind(found.time, KINDS[name], found.value, variance)
        if found.field.size:
            part = of_fields(sensors, part, found.field)
        parts.append(part.only(errors.usable(found.value)))
    length = (imu.time[-1] - imu.time[0]) / CONDITION_PERIOD
    seconds = imu.time[0] + CONDITION_PERIOD * np.arange(1, int(length + ROUNDING) + 1)
    if navigator.no_slip:
        for kind, sigma in zip((aids.RIGHTWARD, aids.DOWNWARD), si(navigator, "slip_sigma"), strict=True):
            parts.append(of_one_kind(seconds, kind, np.zeros(seconds.size), scale * sigma**2))
    if navigator.zero_velocity and rest.any():
        still = seconds[rest[np.searchsorted(imu.time, seconds - ROUNDING) - 1]]
        parts += zero_velocity(still, navigator)
    return Aids.together(parts, si(sensors.odometer, "lever_arm"))


def zero_velocity(time: FloatArray, navigator: NavigatorSettings) -> list[Aids]:
    """Return the measurements that a vehicle stands still at times (a,) [s], north, east and down."""
    variance = float(navigator.aiding_scale) * float(navigator.zero_velocity_sigma) ** 2
    three = (aids.NORTHWARD, aids.EASTWARD, aids.VERTICAL)
    return [of_one_kind(time, kind, np.zeros(time.size), variance) for kind in three]


def known_variance(sigma: FloatArray, scale: float, variance: float) -> FloatArray:
    """Return the variances (a,) of readings: by the device's own σ (a,), a variance where it is unknown.

    Parameters
    ----------
    sigma : (a,) array
        σ that the device gave; NaN or 0 where it gave none.
    scale
        Factor on their squares.
    variance
        Variance of the others.
    """
    return np.where(sigma > 0, scale * sigma**2, variance)


def of_one_kind(time: FloatArray, kind: int, value: FloatArray, variance: float | FloatArray) -> Aids:
    """Return measurements of one kind, such as `aids.HEIGHT`, at times (a,), with one variance or (a,)."""
    size = time.size
    kinds, variances = np.full(size, kind, np.int64), np.full(size, variance)
    return Aids(time, kinds, value, variances, np.zeros((size, 3)), np.zeros(3))


def of_fields(sensors: SensorSuite, headings: Aids, field: FloatArray) -> Aids:
    """Return measurements of the magnetic field (a, 3) in b, with the declination that the filter assumes."""
    own = sensors.heading.declination
    value = headings.value if own is None else np.full(headings.time.size, np.radians(own))
    return headings._replace(
        kind=np.full(headings.time.size, aids.MAGNETIC, np.int64), value=value, field=field
    )
