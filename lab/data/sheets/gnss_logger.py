"""GnssLogger: the text file of Google's app of that name, whose rows begin with their kind, as tables.

Comment lines name the columns: ``# Fix,Provider,LatitudeDegrees,…``, ``# UncalGyro,utcTimeMillis,…``. Of the
inertial sensors the uncalibrated rows are read, whose biases stay in them as the filter expects; of the
magnetometer the calibrated ones, or the uncalibrated less the bias beside them; and of the fixes
those of the receiver before those that Android fuses. Raw measurements of satellites are not read.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from itertools import chain

_HEAD = 2**16
"""First bytes in which a comment shows the format."""
_COMMENT = re.compile(
    rb"(?m)^#\s*(?:Fix,Provider|Uncal(?:Accel|Gyro),|Raw,(?:utcTimeMillis|ElapsedRealtimeMillis))"
)
_WITH_KINDS = b"MessageType,utcTimeMillis,elapsedRealtimeNanos,MeasurementX,"
"""Header of the same rows of sensors in a file of their own, as in the Smartphone Decimeter Challenge."""
_SENSORS = {
    "gyro_{}[rad/s]": ("UncalGyro", "Gyro"),
    "accel_{}[m/s^2]": ("UncalAccel", "Accel"),
}
"""Heading of the axes of each sensor, and the kinds of its rows, the better first."""
_FIELD = ("Mag", "UncalMag")
"""Kinds of the rows of a magnetometer, the better first."""
_AXES, _BIASES = slice(2, 5), slice(5, 8)
"""Cells of the axes in a row of a sensor, after its two clocks, and of their biases."""
_BOOT = "elapsedRealtimeNanos"
"""The clock since the phone started, which sensors and fixes share."""
_SINCE_1970 = ("UnixTimeMillis", "utcTimeMillis", "(UTC)TimeInMs", "TimeInMs")
"""Headings of the other clock."""
_RECEIVERS = ("gps", "flp", "fused", "nlp", "network")
"""Providers of fixes, in lower case."""


def is_gnss_logger(data: bytes) -> bool:
    """Return whether a text is of this app."""
    return data.startswith(_WITH_KINDS) or (
        data.startswith(b"#") and _COMMENT.search(data[:_HEAD]) is not None
    )


def split_tables(data: bytes) -> bytes:
    """Return the sensors and fixes in a text of this app as csv tables, one below the other."""
    names = _names(data[:_HEAD].decode("utf-8", "replace"))
    rows: dict[str, list[str]] = {kind: [] for kind in ("Fix", *chain(*_SENSORS.values()), *_FIELD)}
    # A list of all lines, most of them raw measurements, would take several times the file.
    for line in io.TextIOWrapper(io.BytesIO(data), "utf-8", "replace"):
        kind, _, rest = line.partition(",")
        if kind in rows:
            rows[kind].append(rest.rstrip("\n"))
    since_boot = _has_boot_clock(rows["Fix"], names)
    time = "time[ns]" if since_boot else "time[ms]"
    made = []
    for heading, pair in _SENSORS.items():
        kind = next((one for one in pair if rows[one]), pair[0])
        made.append(",".join((time, *(heading.format(axis) for axis in "xyz"))))
        made += filter(None, (_of_sensor(row, since_boot) for row in rows[kind]))
    made += _fixes(rows["Fix"], names, since_boot)
    kind = next((one for one in _FIELD if rows[one]), "")
    if kind:
        made.append(",".join((time, *(f"magnetometer_{axis}[µT]" for axis in "xyz"))))
        less = _without_bias if kind == "UncalMag" else _of_sensor
        made += filter(None, (less(row, since_boot) for row in rows[kind]))
    return "\n".join((*made, "")).encode()


def _names(head: str) -> list[str]:
    """Return the headings of the cells of a fix; nothing if no comment says them."""
    for line in head.splitlines():
        kind, *cells = line.lstrip("# ").split(",")
        if line.startswith("#") and kind == "Fix" and cells:
            return [cell.strip() for cell in cells]
    return []


def _of_sensor(row: str, since_boot: bool) -> str:
    """Return time and axes of a sensor's row; nothing if cells are missing."""
    cells = row.split(",", _AXES.stop)
    return ",".join((cells[int(since_boot)], *cells[_AXES])) if len(cells) >= _AXES.stop else ""


def _without_bias(row: str, since_boot: bool) -> str:
    """Return time and axes of a row with the biases of the axes beside them, less these."""
    cells = row.split(",", _BIASES.stop)
    try:
        pairs = zip(map(float, cells[_AXES]), map(float, cells[_BIASES]), strict=True)
        return ",".join((cells[int(since_boot)], *(f"{value - bias:.6g}" for value, bias in pairs)))
    except (ValueError, IndexError):
        return ""


def _has_boot_clock(fixes: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether fixes have the clock since the start of the phone; older versions leave it out."""
    if _BOOT not in names:
        return False
    place = names.index(_BOOT)
    return bool(fixes) and all(len(row) > place and row[place].strip() for row in _cells(fixes))


def _cells(rows: Sequence[str]) -> Iterator[list[str]]:
    """Iterate over rows as cells; those of all rows at once would take many times the file."""
    return (row.split(",") for row in rows)


def _fixes(fixes: Sequence[str], names: Sequence[str], since_boot: bool) -> list[str]:
    """Return a table for each provider of fixes, under its own headings."""
    clocks = (_BOOT,) if since_boot else _SINCE_1970
    time = next((names.index(one) for one in clocks if one in names), -1)
    if time < 0:
        return []
    by_provider: dict[str, list[str]] = {"gps": []}
    for row in fixes:
        provider = row.partition(",")[0].strip().lower()
        if provider in _RECEIVERS:
            by_provider.setdefault(provider, []).append(row)
    made = []
    for provider, table in by_provider.items():
        word = {"gps": "GPS", "nlp": "network"}.get(provider, provider)
        head = ["" if name in (_BOOT, *_SINCE_1970) else f"{word} {name}" for name in names]
        head[time] = f"time[{'ns' if since_boot else 'ms'}]"
        made += [",".join(head), *table]
    return made
