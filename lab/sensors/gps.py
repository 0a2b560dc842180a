"""GPS: what a receiver reports of the true position and velocity (the truth side)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.sensors.draws import unit_draws
from lab.settings import AxisQuantity, Intervals, Quantity, Settings
from lab.trajectory import Truth
from lab.units import si

FloatArray = NDArray[np.float64]

EAST_NORTH_UP = ("east", "north", "up")


class GpsErrors(Settings):
    """Errors and timing of the GPS receiver. Defaults: the classic experiment."""

    position_variance = AxisQuantity(
        0.5,
        unit="m²",
        axes=EAST_NORTH_UP,
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 25),
        step=0.01,
        label="Position variance",
        doc="Variance of the white position error.",
    )
    velocity_variance = AxisQuantity(
        0.2,
        unit="(m/s)²",
        axes=EAST_NORTH_UP,
        bounds=(1e-8, 1e4),
        softbounds=(0.001, 4),
        step=0.001,
        label="Velocity variance",
        doc="Variance of the white velocity error.",
    )
    period = Quantity(
        1.0,
        unit="s",
        bounds=(0.05, 60),
        softbounds=(0.1, 10),
        step=0.1,
        label="Period",
        doc="Time from fix to fix; the first comes one period after the start.",
    )
    outages = Intervals(
        default=[],
        label="Outages",
        doc="Times without fixes, as [start, end] pairs in seconds since the start.",
    )


class GpsDraws(NamedTuple):
    """Unit draws of a receiver for m fixes: position (m, 3) and velocity (m, 3), east, north, up."""

    position: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, seed: int, fixes: int) -> GpsDraws:
        """Draw for a number of fixes."""
        return cls(unit_draws(seed, "gps.position", (fixes, 3)), unit_draws(seed, "gps.velocity", (fixes, 3)))


class GpsFixes(NamedTuple):
    """What a receiver reports; the position [rad], [rad], [m] and velocity_n [m/s] as in `navigation.Fixes`.

    Attributes
    ----------
    time : (m,) array
        Time of validity [s].
    position : (m, 3) array
        Latitude, longitude, height.
    velocity_n : (m, 3) array
        Velocity north, east, down.
    position_error, velocity_error : (m, 3) arrays
        Fix minus truth, east, north, up [m], [m/s].
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    position_error: FloatArray
    velocity_error: FloatArray


def fix_times(errors: GpsErrors, duration: float) -> FloatArray:
    """Return the times of all fixes of a flight, those in outages included [s]."""
    period = errors.period
    return period * np.arange(1.0, int(duration / period + 1e-9) + 1)


def outside_outages(errors: GpsErrors, times: FloatArray) -> NDArray[np.bool_]:
    """Return which times are outside all outages; an outage includes its start and its end."""
    free = np.ones(times.shape, dtype=np.bool_)
    for start, end in errors.outages:
        free &= (times < start) | (times > end)
    return free


def measure(truth: Truth, errors: GpsErrors, draws: GpsDraws) -> GpsFixes:
    """Return the fixes of a receiver.

    Parameters
    ----------
    truth
        Truth at the `fix_times`.
    errors
        The receiver's errors.
    draws
        Unit draws for as many fixes.
    """
    position_error = np.sqrt(si(errors, "position_variance")) * draws.position
    velocity_error = np.sqrt(si(errors, "velocity_variance")) * draws.velocity
    east, north, up = position_error.T
    meridian, transverse = earth.radii(np.sin(truth.latitude))
    latitude = truth.latitude + north / (meridian + truth.height)
    longitude = truth.longitude + east / ((transverse + truth.height) * np.cos(truth.latitude))
    keep = outside_outages(errors, truth.time)
    return GpsFixes(
        truth.time[keep],
        np.stack((latitude, longitude, truth.height + up), axis=-1)[keep],
        (truth.velocity_n + velocity_error[:, [1, 0, 2]] * (1, 1, -1))[keep],
        position_error[keep],
        velocity_error[keep],
    )
