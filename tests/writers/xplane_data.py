"""X-Plane Data.txt: five decimals in every cell, velocity in the local frame of a reference point far off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pymap3d

from lab.missions import Recording
from lab.motion.frames.rotation import body_rate

FOOT = 0.3048
KNOT = 1852 / 3600
REFERENCE = (0.2, -0.25)
"""How far the reference point of the local frame is from the start, in latitude and longitude [°]."""


def euler_rate(recording: Recording) -> np.ndarray:
    """Return how fast roll, pitch and heading change [rad/s]."""
    return np.asarray(np.gradient(np.unwrap(recording.euler, axis=0), recording.time, axis=0))


def columns(recording: Recording, version: int = 11) -> dict[str, np.ndarray]:
    """Return the columns of groups 1, 3, 16, 17, 18, 20 and 21 by the headings of a version."""
    latitude, longitude = np.degrees(recording.latitude), np.degrees(recording.longitude)
    lat0, lon0 = latitude[0] + REFERENCE[0], longitude[0] + REFERENCE[1]
    east, north, up = pymap3d.geodetic2enu(latitude, longitude, recording.height, lat0, lon0, 0.0)
    vn, ve, vd = recording.velocity_n.T
    in_e = pymap3d.enu2uvw(ve, vn, -vd, latitude, longitude)
    v_east, v_north, v_up = pymap3d.uvw2enu(*in_e, lat0, lon0)
    roll, pitch, yaw = np.degrees(recording.euler).T
    p, q, r = body_rate(recording.euler, euler_rate(recording)).T
    zero = np.zeros(len(latitude))
    newer = version >= 12
    speed = {} if recording.airspeed is None else {"Vtrue,_ktas": recording.airspeed / KNOT}
    air = {}
    if recording.alpha is not None and recording.beta is not None:
        air = {"alpha,__deg": np.degrees(recording.alpha), "_beta,__deg": np.degrees(recording.beta)}
    unit = "deg/s" if newer else "rad/s"
    scale = np.degrees(1.0) if newer else 1.0
    return {
        "_real,_time": recording.time + 100.0,
        "_totl,_time": recording.time + 12.0,
        "missn,_time": recording.time,
        "timer,_time": zero,
        "_zulu,_time": zero + 17.5,
        "local,_time": zero + 13.5,
        "hobbs,_time": zero + 3.1,
        "_Vind,_kias": zero + 100.0,
        **speed,
        "Vtrue,_ktgs": np.hypot(vn, ve) / KNOT,
        f"____Q,{unit}": q * scale,
        f"____P,{unit}": p * scale,
        f"____R,{unit}": r * scale,
        "pitch,__deg": pitch,
        "_roll,__deg": roll,
        "hding,_true": yaw % 360.0,
        "hding,__mag": (yaw + 14.0) % 360.0,
        **air,
        ("hpath,_true" if newer else "hpath,__deg"): np.degrees(np.arctan2(ve, vn)) % 360.0,
        "vpath,__deg": zero,
        "__lat,__deg": latitude,
        "__lon,__deg": longitude,
        ("p-alt,ftMSL" if newer else "__alt,ftmsl"): recording.height / FOOT,
        "__alt,ftagl": recording.height / FOOT - 100.0,
        "____X,____m": east,
        "____Y,____m": up,
        "____Z,____m": -north,
        "___vX,__m/s": v_east,
        "___vY,__m/s": v_up,
        "___vZ,__m/s": -v_north,
        "_dist,___ft": zero,
    }


def text(values: Mapping[str, np.ndarray]) -> str:
    """Return one recording: a blank line, the header, and the rows, with a delimiter after every cell."""
    header = "".join(f"{f'{name} ':>14}| " for name in values)
    rows = ["".join(f"{x:13.5f} | " for x in row) for row in np.column_stack(list(values.values())).tolist()]
    return "\n" + "\n".join([header, *rows]) + "\n"


def write(recording: Recording) -> bytes:
    """Return the bytes of a Data.txt of X-Plane 11."""
    return text(columns(recording)).encode()
