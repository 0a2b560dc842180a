"""X-Plane Data.txt: the file X-Plane 9 to 12 writes of the groups ticked in Settings, Data Output.

Cells are separated by ``|`` and padded; the header is repeated at each start of recording. Headings are a
name and a unit, padded with underscores; they differ between versions, so columns are found by heading,
never by place. The velocity of group 21 is in X-Plane's local frame: east, up and south at a reference
point that may lie tens of kilometres away; X and Z of the same group give its place, and the velocity is
transformed from there to the aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import NAMED, SEA_LEVEL, one_file
from lab.data.files.profile import Profile, plain
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.sheets.flight_columns import (
    Columns,
    raw_flight,
    read_columns,
    recognises_header,
    refuse_no_motion,
)
from lab.motion.frames import ecef

NAME = "X-Plane Data.txt"

CLOCKS = ("time", "mission_time", "elapsed_time", "real_time")
"""The columns of group 1, the simulator's own clock first."""
_CLOCK_HEADINGS = ("totl,time", "missn,time", "elaps,time", "real,time")
_COLUMNS = {
    "vtrue,ktas": "airspeed[kt]",
    **{f"{name},{unit}": f"rate_{axis}[{si}]" for unit, si in (("rad/s", "rad/s"), ("deg/s", "°/s"))
       for name, axis in zip("pqr", "xyz", strict=True)},
    "pitch,deg": "pitch[°]", "roll,deg": "roll[°]", "hding,true": "yaw[°]", "alpha,deg": "alpha[°]",
    "beta,deg": "beta[°]", "lat,deg": "latitude[°]", "lon,deg": "longitude[°]",
    # X-Plane 12 distinguishes the centre of gravity from p-alt, which may depend on the air pressure.
    **dict.fromkeys(("cg,ftmsl", "alt,ftmsl", "p-alt,ftmsl"), "height[ft]"),
    "x,m": "local_x[m]", "z,m": "local_z[m]",
    **{f"v{axis},m/s": f"local_velocity_{axis}[m/s]" for axis in "xyz"},
}  # fmt: skip
_PROFILE = Profile(
    Path(__file__),
    NAME,
    {
        **{heading: f"{key}[s]" for heading, key in zip(_CLOCK_HEADINGS, CLOCKS, strict=True)},
        **_COLUMNS,
    },
    (tuple(_COLUMNS),),
    source=NAMED,
    simulator=True,
)

GROUPS = (
    (CLOCKS[:1], "1 times", "the simulator's own clock"),
    (("airspeed",), "3 speeds", "true airspeed"),
    (("rate_x", "rate_y", "rate_z"), "16 angular velocities", "rates to check with"),
    (("pitch", "roll", "yaw"), "17 pitch, roll, headings", "attitude"),
    (("alpha", "beta"), "18 angle of attack, side-slip, paths", "angles of the air"),
    (("latitude", "longitude", "height"), "20 latitude, longitude, altitude", "position"),
    (tuple(f"local_velocity_{axis}" for axis in "xyz"), "21 loc, vel, dist traveled", "velocity"),
)
"""What each group to tick gives."""


recognises = partial(recognises_header, profile=_PROFILE)
"""Return whether a file has one of X-Plane's headings."""


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a ``Data.txt`` of X-Plane.

    Raises
    ------
    MissionError
        For whatever is wrong with the file; if it has no time or no motion, naming the
        groups to tick.
    """
    path = one_file(paths, NAME)
    columns = read_columns(path, _PROFILE, units)
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
    if clock == CLOCKS[-1]:
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
        euler=columns.vector("roll", "pitch", "yaw"),
        body_rate=columns.vector("rate_x", "rate_y", "rate_z"),
        remarks=remarks,
    )
    refuse_no_motion(path, flight, advice)
    return flight


def _clock(columns: Columns) -> str:
    """Return the simulator's own clock, or the next that runs where that stands still."""
    ticks = {name: len(np.unique(columns.values[name])) for name in CLOCKS if name in columns.values}
    return next(name for name, count in ticks.items() if 2 * count >= max(ticks.values()))


def _velocity(columns: Columns) -> FloatArray | None:
    local = columns.vector("-local_velocity_z", "local_velocity_x", "-local_velocity_y")
    here = columns.vector("latitude", "longitude", "height")
    if local is None or here is None:
        return local
    return velocity_at_aircraft(local, here, columns.vector("-local_z", "local_x"))


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
    reference = ecef.displaced(here, -ecef.resolve_elsewhere(level, reference, here) * (1.0, 1.0, 0.0))
    return ecef.resolve_elsewhere(local, reference, here)
