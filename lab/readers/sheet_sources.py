"""Sheet sources: files that are a table, but not a csv with a header: rewritten as one.

A VBO file of Racelogic names its columns in one section and their units in another; latitude and longitude
are minutes, and west is positive. KITTI has a file of thirty numbers without a header for each sample.
FlySight 2 begins each row with the sensor that it is of.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from lab.units import DAY

_VBO = b"[column names]"
_VBO_HEADINGS = {
    "lat": "latitude[arcmin]", "latitude": "latitude[arcmin]", "long": "longitude_west[arcmin]",
    "longitude": "longitude_west[arcmin]", "velocity": "speed[km/h]", "height": "height[m]",
    "vert-vel": "vertical_speed[km/h]", "vertical-velocity": "vertical_speed[km/h]", "heading": "course[deg]",
}  # fmt: skip
"""Headings with units of the columns of a VBO file (Racelogic, "VBO file format")."""
_VBO_SPEED = re.compile(rb"(?im)^(vertical )?velocity (kmh|km/h|knots|kts|mph|m/s)\s*$")

_GPS_EPOCH = 315_964_800.0
"""Start of GPS time, since 1970 [s]."""
_LEAP_SECONDS = 18.0
"""GPS time minus UTC since 2017 [s]."""

_NUMBER = r"[+-]?\d{1,10}(?:\.\d{0,20})?(?:[eE][+-]?\d{1,2})?"
_BEGIN = re.compile(rf"{_NUMBER}(?=,)")
"""The time with which a row begins [s]."""
_FLYSIGHT_TIME = re.compile(rf"\$TIME,({_NUMBER}),({_NUMBER}),(\d{{1,5}})\b")
"""Clock of the device, GPS time of week, and GPS week."""

KITTI_FRAME = re.compile(r"(?:^|/)oxts/data/\d+\.txt$")
"""Path of the file with one sample."""
KITTI_STAMPS = re.compile(r"(?:^|/)oxts/timestamps\.txt$")
_KITTI_HEADINGS = (
    "lat[deg],lon[deg],alt[m],roll,pitch,yaw,vn[m/s],ve[m/s],vf,vl,vu[m/s],acc_x[m/s2],acc_y[m/s2],"
    "acc_z[m/s2],af,al,au,gyro_x[rad/s],gyro_y[rad/s],gyro_z[rad/s],wf,wl,wu,pos_accuracy[m],"
    "vel_accuracy[m/s],navstat,numsats,posmode,velmode,orimode"
)
"""The columns of a sample (KITTI raw data, dataformat.txt); x forward, y left, z up."""


def as_table(data: bytes) -> bytes:
    """Return the text of a file as a csv with a header; any other text as it is."""
    if data.startswith(b"$FLYS"):
        return _of_flysight(data)
    place = data[: 2**16].lower().find(_VBO)
    return data if place < 0 else _of_vbo(data, place)


def _of_vbo(data: bytes, place: int) -> bytes:
    head, rest = data[:place], data[place:].split(b"\n", 2)
    if len(rest) < len(("section", "names", "rows")):
        return data
    units = {bool(found[1]): found[2].decode().lower() for found in _VBO_SPEED.finditer(head)}
    names = []
    for name in rest[1].decode("latin-1").split():
        known = _VBO_HEADINGS.get(name.lower(), name)
        is_vertical = known.startswith("vertical")
        if "[km/h]" in known and is_vertical in units:
            known = known.replace("km/h", units[is_vertical])
        names.append(known)
    rows = rest[2].partition(b"[data]")[2].lstrip()
    return " ".join(names).encode() + b"\n" + rows


def _of_flysight(data: bytes) -> bytes:
    """Return the fixes of a file of FlySight 2, or its IMU with UTC as time."""
    lines = data.decode("latin-1").splitlines()
    sensor = next((one for one in ("GNSS", "IMU") if any(line.startswith(f"${one},") for line in lines)), "")
    names, units = (
        next((line.split(",")[2:] for line in lines if line.startswith(f"${kind},{sensor},")), [])
        for kind in ("COL", "UNIT")
    )
    head = [f"{name}[{unit}]" if unit else name for name, unit in zip(names, units, strict=False)]
    rows = [line.split(",", 1)[1] for line in lines if line.startswith(f"${sensor},")]
    if sensor == "IMU" and head and (start := _utc_at_start(lines)) is not None:
        head[0] = "utc[s]"
        rows = [
            f"{float(found[0]) + start:.4f}{row[found.end() :]}"
            for row in rows
            if (found := _BEGIN.match(row))
        ]
    return "\n".join((",".join(head), *rows, "")).encode()


def _utc_at_start(lines: Sequence[str]) -> float | None:
    """Return UTC when the clock of a FlySight 2 was zero [s], by its first complete time stamp."""
    found = next(filter(None, map(_FLYSIGHT_TIME.match, lines)), None)
    if found is None:
        return None
    clock, of_week, week = map(float, found.groups())
    return week * 7 * DAY + of_week + _GPS_EPOCH - _LEAP_SECONDS - clock


def kitti_table(frames: Sequence[bytes], stamps: bytes) -> bytes:
    """Return the samples of a KITTI drive as a csv.

    Parameters
    ----------
    frames
        The files of the samples, in order.
    stamps
        The file with their times, a line for each.
    """
    lines = [f"timestamp,{_KITTI_HEADINGS}"]
    for time, frame in zip(stamps.decode("latin-1").split("\n"), frames, strict=False):
        lines.append(",".join((time.strip(), *frame.decode("latin-1").split())))
    return "\n".join(lines).encode()
