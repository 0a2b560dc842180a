"""GPS: what a receiver reports of the true position and velocity (the truth side)."""

from __future__ import annotations

from lab.settings import AxisQuantity, Intervals, Quantity, Settings

EAST_NORTH_UP = ("east", "north", "up")


class GpsErrors(Settings):
    """Errors and timing of the GPS receiver. Defaults: the classic experiment."""

    position_variance = AxisQuantity(
        0.5, unit="m²", axes=EAST_NORTH_UP, bounds=(1e-6, 1e6), softbounds=(0.01, 25), step=0.01,
        label="Position variance", doc="Variance of the white position error.",
    )
    velocity_variance = AxisQuantity(
        0.2, unit="(m/s)²", axes=EAST_NORTH_UP, bounds=(1e-8, 1e4), softbounds=(0.001, 4), step=0.001,
        label="Velocity variance", doc="Variance of the white velocity error.",
    )
    period = Quantity(
        1.0, unit="s", bounds=(0.05, 60), softbounds=(0.1, 10), step=0.1, label="Period",
        doc="Time from fix to fix; the first comes one period after the start.",
    )
    outages = Intervals(
        default=[], label="Outages", doc="Times without fixes, as [start, end] pairs in seconds since the start."
    )
