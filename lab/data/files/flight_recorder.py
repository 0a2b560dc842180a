"""Flight Recorder: the csv which Flight Recorder for Microsoft Flight Simulator exports, and Sky Dolly too.

SimConnect's body axes and signs as in `fslogger`: X right, Y up, Z forward, pitch and bank the negatives of
ours. Its velocities are over the Earth, in feet per second, its rates in radians per second. Newer versions
also have accelerations, which are not used: they are requested in radians per second.
``Milliseconds`` is the clock of the computer, in whole milliseconds; newer versions have the simulator's own
``AbsoluteTime`` besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.files.fields import (
    SEA_LEVEL,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
    recognised,
)
from lab.data.rebuild.raw_flight import RawFlight
from lab.motion.frames.rotation import C_nb_from_euler

NAME = "MSFS Flight Recorder csv"

FIELDS = (
    Field("time", ("milliseconds",), "time", "ms"),
    Field("absolute time", ("absolutetime",), "time", "s"),
    Field("latitude", ("latitude",), "angle", "°"),
    Field("longitude", ("longitude",), "angle", "°"),
    Field("height", ("altitude",), "length", "ft"),
    Field("pitch", ("pitch",), "angle", "°"),
    Field("bank", ("bank",), "angle", "°"),
    Field("heading", ("trueheading",), "angle", "°"),
    Field("right", ("velocitybodyx",), "speed", "ft/s"),
    Field("up", ("velocitybodyy",), "speed", "ft/s"),
    Field("forward", ("velocitybodyz",), "speed", "ft/s"),
    Field("rate right", ("rotationvelocitybodyx",), "angular rate", "rad/s"),
    Field("rate up", ("rotationvelocitybodyy",), "angular rate", "rad/s"),
    Field("rate forward", ("rotationvelocitybodyz",), "angular rate", "rad/s"),
    Field("airspeed", ("trueairspeed",), "speed", "kt"),
)
"""Columns of the recorder, with the units it asks SimConnect for."""

REQUIRED = (("milliseconds",), ("latitude",), ("longitude",), ("altitude",), ("trueheading",))


_MIN_MOVED = 1e-6
"""Change of latitude or longitude from which the aircraft moves [rad]: 6 m."""
_MIN_TICKING = 0.9
"""Part of the computer's time stamps with which the simulator's clock has to step, to be used."""
_RATE_OF_CLOCKS = (0.5, 2.0)
"""Rates of the simulator's clock, relative to the computer's, at which it is used: faster or slower, it
counts in another unit or the simulation was accelerated."""


def recognises(head: bytes) -> bool:
    """Return whether a file begins with the header of Flight Recorder."""
    return recognised(head, REQUIRED)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a csv of Flight Recorder.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    columns = read_columns(one_file(paths, NAME), FIELDS, units, REQUIRED)
    remarks = [SEA_LEVEL]
    euler = columns.vector("-bank", "-pitch", "heading")
    velocity_b = columns.vector("forward", "right", "-up")
    body_rate = columns.vector("-rate forward", "-rate right", "rate up")
    # Tools that write this format for others to replay fill what they do not have with zeros.
    if velocity_b is not None and not velocity_b.any() and _moves(columns):
        velocity_b = None
        remarks.append("The velocities are all zero although the aircraft moves: they are not used.")
    if body_rate is not None and not body_rate.any():
        body_rate = None
    velocity_n = None
    if velocity_b is not None and euler is not None:
        velocity_n = np.einsum("nij,nj->ni", C_nb_from_euler(euler), velocity_b)
    own_clock = columns.get("absolute time")
    if own_clock is not None and not _runs(own_clock, columns.values["time"]):
        own_clock = None
    columns.units.pop("absolute time" if own_clock is None else "time", None)
    if own_clock is None:
        remarks.append("Time is that of the computer in whole milliseconds, not that of the simulator.")
    return raw_flight(
        NAME,
        columns,
        # Seconds since the year 0 have no use here.
        time=None if own_clock is None else own_clock - own_clock[0],
        velocity_n=velocity_n,
        euler=euler,
        body_rate=body_rate,
        remarks=remarks,
    )


def _moves(columns: Columns) -> bool:
    place = columns.vector("latitude", "longitude")
    return place is not None and bool((np.ptp(place, axis=0) > _MIN_MOVED).any())


def _runs(own: FloatArray, computer: FloatArray) -> bool:
    """Return whether the simulator's clock steps with nearly each row, and by seconds."""
    elapsed, on_computer = own[-1] - own[0], computer[-1] - computer[0]
    steps = len(np.unique(own)) > _MIN_TICKING * len(np.unique(computer))
    return bool(steps and _RATE_OF_CLOCKS[0] * on_computer < elapsed < _RATE_OF_CLOCKS[1] * on_computer)
