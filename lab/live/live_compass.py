"""Live compass: the heading of a magnetometer at rest, for a stream without fixes."""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.data.log.auxiliary_data import Magnetometer
from lab.data.streams.live_log import magnetometer_of
from lab.live.live_stream import Stream
from lab.navigation.alignment.initial_heading import MAGNETIC_SIGMA, by_magnetometer
from lab.navigation.solution import Imu
from lab.navigation.standstill import SHORTEST

DECLINATION_SIGMA: Final = np.radians(20.0)
"""σ of the magnetic declination at an unknown place [rad]: larger only about the magnetic poles."""
WORSE: Final = np.sqrt(2)
"""σ of a heading, in that of a magnetometer, from which the magnetometer takes its place: it errs by iron,
which no mean removes."""


def look_at_compass(stream: Stream) -> None:
    """Give the attitude of a stream the heading of its magnetometer at rest, if it has none as good."""
    attitude = stream.attitude
    if attitude is None or not attitude.begun or not attitude.rest:
        return
    if attitude.P[8, 8] <= (WORSE * MAGNETIC_SIGMA) ** 2:
        return
    samples = stream.samples
    start = max(samples.number("time", stream.now - SHORTEST), samples.first)
    imu = Imu(*(samples.rows(name, start, samples.end) for name in ("time", "dtheta", "dvelocity")))
    field = magnetometer_of(imu.time, samples.rows("magnetic", start, samples.end))
    if field is None:
        return
    here = stream.sample(stream.end - 1)
    place, more = attitude.place, 0.0
    if place is None:
        field, place, more = Magnetometer(field.time, field.field, 0.0), np.zeros(3), DECLINATION_SIGMA
    tilt = float(here.euler_sigma[:2].max())
    level = float(here.euler[0]), float(here.euler[1])
    found = by_magnetometer(imu, field, level, tilt, float(SHORTEST), place)
    if found.source:
        source = f"{found.source}, from magnetic north" if more else found.source
        attitude.give_heading(found.heading, float(np.hypot(found.sigma, more)), source)
