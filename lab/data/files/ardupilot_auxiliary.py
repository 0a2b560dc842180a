"""ArduPilot auxiliary data: the magnetometer and the headings of two antennas in a DataFlash log.

References
----------
ArduPilot, *Onboard Message Log Messages* (MAG, GPS), https://ardupilot.org/plane/docs/logmessages.html
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.data.files.dataflash_time import TIME, Messages
from lab.data.files.streams import Stream
from lab.data.log.auxiliary_data import Headings, Magnetometer

_MICROTESLA = 0.1
"""Microteslas in a milligauss."""
_NORTH = 360.0
"""Largest yaw of a receiver with two antennas [°]: it writes north as 360 and not as 0, which is no yaw."""


def magnetometer_of(messages: Messages | None) -> Magnetometer | None:
    """Return the field in b, which the autopilot logs in milligauss with its offsets applied.

    Parameters
    ----------
    messages
        The messages MAG of one compass, with their times.
    """
    names = ("MagX", "MagY", "MagZ")
    if messages is None or not set(names) <= set(messages):
        return None
    field = np.column_stack([messages[name] for name in names]) * _MICROTESLA
    healthy = messages.get("Health", np.ones(len(field))) != 0
    stream = Stream.of("magnetometer", messages[TIME], field, healthy & (field != 0).any(axis=1))
    return Magnetometer(stream.time, stream.values) if stream.usable else None


def headings_of(gps: Messages, fixed: NDArray[np.bool_]) -> Headings | None:
    """Return the headings of a receiver with two antennas; one without them logs a yaw of zero.

    Parameters
    ----------
    gps
        The messages GPS of one receiver, with their times.
    fixed
        Which of them have a fix.
    """
    yaw = gps.get("Yaw")
    if yaw is None:
        return None
    fine = fixed & np.isfinite(yaw) & np.isfinite(gps[TIME]) & (yaw > 0) & (yaw <= _NORTH)
    stream = Stream.of("heading", gps[TIME], yaw, fine)
    if not stream.usable:
        return None
    return Headings(stream.time, np.radians(stream.values[:, 0]), np.full(len(stream.time), np.nan))
