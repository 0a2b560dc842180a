"""X-Plane Data.txt: the file X-Plane 9 to 12 writes of the groups ticked in Settings, Data Output.

Cells are separated by ``|`` and padded; the header is repeated at each start of recording. Headings are a
name and a unit, padded with underscores; they differ between versions, so columns are found by heading,
never by place. The velocity of group 21 is in X-Plane's local frame: east, up and south at a reference
point that may lie tens of kilometres away; X and Z of the same group give its place, and the velocity is
transformed from there to the aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import (
    NAMED,
    SEA_LEVEL,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
    recognised,
    refuse_no_motion,
)
from lab.data.files.table import plain
from lab.data.rebuild.raw_flight import RawFlight
from lab.motion.frames import ecef

NAME = "X-Plane Data.txt"

CLOCKS = ("totl,time", "missn,time", "elaps,time", "real,time")
"""The columns of group 1, the simulator's own clock first."""

FIELDS = (
    *(Field(name, (name,), "time", "s") for name in CLOCKS),
    Field("airspeed", ("vtrue,ktas",), "speed", "kt", NAMED),
    Field("p", ("p,rad/s",), "angular rate", "rad/s", NAMED),
    Field("q", ("q,rad/s",), "angular rate", "rad/s", NAMED),
    Field("r", ("r,rad/s",), "angular rate", "rad/s", NAMED),
    Field("p", ("p,deg/s",), "angular rate", "°/s", NAMED),
    Field("q", ("q,deg/s",), "angular rate", "°/s", NAMED),
    Field("r", ("r,deg/s",), "angular rate", "°/s", NAMED),
    Field("pitch", ("pitch,deg",), "angle", "°", NAMED),
    Field("roll", ("roll,deg",), "angle", "°", NAMED),
    Field("heading", ("hding,true",), "angle", "°"),
    Field("alpha", ("alpha,deg",), "angle", "°", NAMED),
    Field("beta", ("beta,deg",), "angle", "°", NAMED),
    Field("latitude", ("lat,deg",), "angle", "°", NAMED),
    Field("longitude", ("lon,deg",), "angle", "°", NAMED),
    # X-Plane 12 distinguishes the centre of gravity from p-alt, which may depend on the air pressure.
    Field("height", ("cg,ftmsl", "alt,ftmsl", "p-alt,ftmsl"), "length", "ft", NAMED),
    Field("X", ("x,m",), "length", "m", NAMED),
    Field("Z", ("z,m",), "length", "m", NAMED),
    Field("vX", ("vx,m/s",), "speed", "m/s", NAMED),
    Field("vY", ("vy,m/s",), "speed", "m/s", NAMED),
    Field("vZ", ("vz,m/s",), "speed", "m/s", NAMED),
)

GROUPS = (
    (CLOCKS[:1], "1 times", "the simulator's own clock"),
    (("airspeed",), "3 speeds", "true airspeed"),
    (("p", "q", "r"), "16 angular velocities", "rates to check with"),
    (("pitch", "roll", "heading"), "17 pitch, roll, headings", "attitude"),
    (("alpha", "beta"), "18 angle of attack, side-slip, paths", "angles of the air"),
    (("latitude", "longitude", "height"), "20 latitude, longitude, altitude", "position"),
    (("vX", "vY", "vZ"), "21 loc, vel, dist traveled", "velocity"),
)
"""What each group to tick gives."""

REQUIRED = (tuple(name for field in FIELDS[len(CLOCKS) :] for name in field.names),)


def recognises(head: bytes) -> bool:
    """Return whether a file has one of X-Plane's headings."""
    return recognised(head, REQUIRED)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a ``Data.txt`` of X-Plane.

    Raises
    ------
    MissionError
        For whatever is wrong with the file; if it has no time or no motion, naming the
        groups to tick.
    """
    path = one_file(paths, NAME)
    columns = read_columns(path, FIELDS, units, REQUIRED)
    lacking = [
        f"{group} ({gives})"
        for keys, group, gives in GROUPS
        if not all(key in columns.values for key in keys)
    ]
    advice = (
        f"Not in the file: {'; '.join(lacking)}. To record them, tick these groups under Disk File in "
        "X-Plane's Settings, Data Output."
    )
    if not any(name in columns.values for name in CLOCKS):
        raise MissionError(f"{path}: there is no time in it. {advice}")
    clock = _clock(columns)
    for key in CLOCKS:
        if key != clock:
            columns.units.pop(key, None)
    remarks = [SEA_LEVEL] if "height" in columns.values else []
    if lacking:
        remarks.append(advice)
    if clock == "real,time":
        remarks.append(
            "Time is that of the computer, not of the simulator: it jitters, and goes on when X-Plane pauses."
        )
    if "height" in columns.values and plain(columns.units["height"].column).startswith("p-alt"):
        remarks.append(
            "The height is p-alt: where that is X-Plane's pressure altitude it differs from the height as "
            "the air of the day differs from the standard atmosphere."
        )
    flight = raw_flight(
        NAME,
        columns,
        time=columns.values[clock],
        velocity_n=_velocity(columns),
        euler=columns.vector("roll", "pitch", "heading"),
        body_rate=columns.vector("p", "q", "r"),
        remarks=remarks,
    )
    refuse_no_motion(path, flight, advice)
    return flight


def _clock(columns: Columns) -> str:
    """Return the simulator's own clock, or the next that runs where that stands still."""
    ticks = {name: len(np.unique(columns.values[name])) for name in CLOCKS if name in columns.values}
    return next(name for name, count in ticks.items() if 2 * count >= max(ticks.values()))


def _velocity(columns: Columns) -> FloatArray | None:
    local = columns.vector("-vZ", "vX", "-vY")
    here = columns.vector("latitude", "longitude", "height")
    if local is None or here is None:
        return local
    return velocity_at_aircraft(local, here, columns.vector("-Z", "X"))


def velocity_at_aircraft(local: FloatArray, here: FloatArray, offset: FloatArray | None) -> FloatArray:
    """Return the velocity north, east, down at the aircraft, of that in X-Plane's local frame.

    Parameters
    ----------
    local : (n, 3) array
        Velocity north, east, down at the reference point of the frame [m/s].
    here : (n, 3) array
        Latitude, longitude [rad] and height [m] of the aircraft.
    offset : (n, 2) array or None
        Place of the aircraft in the frame, north and east of the reference point [m]; without it the
        reference point is taken to be where the aircraft is.
    """
    if offset is None:
        return local
    level = np.column_stack((offset, np.zeros(len(here))))
    reference = ecef.displaced(here, -level)
    # North there is not quite north here.
    reference = ecef.displaced(here, -ecef.resolved(level, reference, here) * (1.0, 1.0, 0.0))
    return ecef.resolved(local, reference, here)
