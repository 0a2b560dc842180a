"""App request: what the app Sensor Logger sends in one request, checked.

References
----------
K. T. H. Choi, *Awesome Sensor Logger* (PUSHING.md, UNITS.md, CROSSPLATFORM.md).
"""

from __future__ import annotations

import math
from itertools import islice
from typing import Any, Final, NamedTuple

from lab.data.protocols.json_rows import LARGEST, number, parse_json
from lab.data.protocols.phone_line import MOST_FIXES, MOST_SAMPLES, RADIANS, PhoneLine, Row
from lab.data.protocols.samples import NAN
from lab.live.phone.page_request import is_device, velocity

MOST_READINGS: Final = 4000
"""Most readings of one request: 2 s of four sensors at 500 Hz, or 10 s at 100 Hz."""
_RADIAL_68: Final = math.sqrt(-2 * math.log(1 - 0.683))
"""Radius that holds 68.3 % of the positions, in σ of each horizontal axis: the app states this radius."""
_MICRO: Final = 1e-6  # [T/µT]
_SAME: Final = 1e-3
"""Most by which the times of gravity and of the rest of the acceleration differ [s]: they are one event."""
_LARGEST_TIME: Final = 1e24
"""Largest time that is converted [ns]: `LARGEST` s. Whole numbers of JSON may be too large for a float."""


class AppRequest(NamedTuple):
    """A request of the app.

    Attributes
    ----------
    device, session : str
        Names that the app gave its phone and the recording.
    message : int
        Number of the request in its recording; -1 if it is unknown.
    lines : list of PhoneLine
        Its readings; their batches are not numbered yet.
    """

    device: str
    session: str
    message: int
    lines: list[PhoneLine]


def parse_app_request(body: bytes) -> AppRequest | None:
    """Return what a request says; None if it is anything else than a request of the app.

    Sensors that the lab does not use are left out. On Android ``accelerometer`` is without gravity, so
    ``totalacceleration`` is used; on Apple's phones the specific force is the sum of ``accelerometer`` and
    ``gravity``, with all signs turned unless the app is set to *Standardise Units & Frames*.
    """
    said = parse_json(body)
    if not isinstance(said, dict) or not is_device(said.get("deviceId")):
        return None
    payload, message = said.get("payload"), said.get("messageId")
    if not isinstance(payload, list) or len(payload) > MOST_READINGS:
        return None
    found: dict[str, list[Row]] = {}
    for reading in payload:
        if isinstance(reading, dict):
            _sort(reading, found)
    rows = {name: sorted(rows) for name, rows in found.items()}
    apple = "totalacceleration" not in rows and "gravity" in rows
    force = (
        _sums(rows.get("accelerometer", []), rows["gravity"]) if apple else rows.get("totalacceleration", [])
    )
    origin = min((some[0][0] for some in rows.values()), default=0.0)
    kinds = {
        "rate": rows.get("gyroscope", []),
        "force": force,
        "magnetic": [
            [time, *(_MICRO * one for one in value)] for time, *value in rows.get("magnetometer", [])
        ],
        "fix": rows.get("location", []),
    }
    lines = list(_lines(kinds, origin, apple))
    session = said.get("sessionId")
    return AppRequest(
        said["deviceId"],
        session[:100] if isinstance(session, str) else "",
        message if type(message) is int and abs(message) < LARGEST else -1,
        lines,
    )


def _sort(reading: dict[str, Any], found: dict[str, list[Row]]) -> None:
    """Add a reading to those of its sensor."""
    name, time, values = reading.get("name"), reading.get("time"), reading.get("values")
    if not isinstance(name, str) or type(time) not in {int, float} or not isinstance(values, dict):
        return
    assert isinstance(time, int | float)
    seconds = number(time / 1e9 if abs(time) < _LARGEST_TIME else None)
    if name in {"gyroscope", "accelerometer", "totalacceleration", "gravity", "magnetometer"}:
        row = [seconds, *(number(values.get(axis)) for axis in "xyz")]
        if not any(map(math.isnan, row)):
            found.setdefault(name, []).append(row)
    elif name == "location" and not math.isnan(seconds):
        found.setdefault(name, []).append(_fix(seconds, values))


def _fix(time: float, values: dict[str, Any]) -> Row:
    def positive(name: str) -> float:
        value = number(values.get(name))
        return value if value >= 0 else NAN  # the app writes -1 for what is not known

    level, vertical = positive("horizontalAccuracy"), positive("verticalAccuracy")
    place = [number(values.get(name)) for name in ("latitude", "longitude", "altitude")]
    speeds = velocity(positive("speed"), positive("bearing"))
    return [time, time, *place, level / _RADIAL_68, vertical, *speeds, positive("speedAccuracy"), 0.0]


def _sums(rest: list[Row], gravity: list[Row]) -> list[Row]:
    """Return gravity plus the rest of the acceleration, where both have the same time."""
    sums, at = [], 0
    for time, *value in rest:
        while at < len(gravity) and gravity[at][0] < time - _SAME:
            at += 1
        if at < len(gravity) and gravity[at][0] <= time + _SAME:
            sums.append([time, *(one + two for one, two in zip(value, gravity[at][1:], strict=True))])
    return sums


def _lines(kinds: dict[str, list[Row]], origin: float, apple: bool) -> Any:
    """Give lines with as many rows as a line may have, those of the same time in the same line."""
    sources = {name: iter(rows) for name, rows in kinds.items()}
    while True:
        line = PhoneLine(0, origin, source="Sensor Logger", apple=apple, unit=RADIANS)
        for name, rows in sources.items():
            some = islice(rows, MOST_FIXES if name == "fix" else MOST_SAMPLES)
            setattr(line, name, [[round(row[0] - origin, 9), *row[1:]] for row in some])
        if not any(getattr(line, name) for name in sources):
            return
        yield line
