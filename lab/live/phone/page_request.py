"""Page request: what the page on a phone sends in one request, checked."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any, Final, NamedTuple, TypeGuard

from lab.data.protocols.json_rows import number, parse_json, read_rows
from lab.data.protocols.phone_line import (
    MOST_FIXES,
    MOST_SAMPLES,
    PhoneLine,
    Row,
    direction,
    parse_whole_number,
)
from lab.data.protocols.samples import NAN

MOST_BATCHES: Final = 100
"""Most batches of one request: 10 s of them. A page sends at most 60 at once."""
_DEVICE: Final = re.compile(r"[\w-]{8,64}", re.ASCII)
_RADIAL_95: Final = math.sqrt(-2 * math.log(0.05))
"""Radius that holds 95 % of the positions, in σ of each horizontal axis (Rayleigh distribution): 2.45."""
_TWO_SIDED_95: Final = 1.96
"""Half of the interval that holds 95 % of the heights, in σ (normal distribution)."""


class PageRequest(NamedTuple):
    """A request of the page.

    Attributes
    ----------
    device : str
        Random name that the page gave its phone.
    run : int
        When the page was loaded [ms since 1970]; the batches of each run are numbered from 0.
    name : str
        What the owner typed, of any length and kind.
    oldest : int
        Number of the oldest batch that the page still has or will make.
    waiting : int
        Batches that wait on the phone, those of the request included.
    batches : list of PhoneLine
        In order.
    """

    device: str
    run: int
    name: str
    oldest: int
    waiting: int
    batches: list[PhoneLine]


def parse_page_request(body: bytes) -> PageRequest | None:
    """Return what a request says; None if it is anything else than a request of the page."""
    said = parse_json(body)
    if not isinstance(said, dict):
        return None
    device, name, batches = said.get("device"), said.get("name"), said.get("batches")
    run, oldest, origin = (
        parse_whole_number(said.get("run")),
        parse_whole_number(said.get("oldest")),
        number(said.get("origin")),
    )
    if not is_device(device) or not isinstance(name, str) or min(run, oldest) < 0 or math.isnan(origin):
        return None
    if not isinstance(batches, list) or len(batches) > MOST_BATCHES:
        return None
    apple = said.get("apple") is True
    lines = []
    for batch in batches:
        line = _make_line(batch, origin / 1000, apple)
        if line is None:
            return None
        lines.append(line)
    if any(one.number >= two.number for one, two in pairwise(lines)):
        return None
    waiting = max(parse_whole_number(said.get("waiting")), 0)
    return PageRequest(device, run, name, oldest, waiting, lines)


def is_device(value: Any) -> TypeGuard[str]:
    """Return whether something out of JSON is the name of a device."""
    return isinstance(value, str) and _DEVICE.fullmatch(value) is not None


def _make_line(batch: Any, origin: float, apple: bool) -> PhoneLine | None:
    if not isinstance(batch, dict):
        return None
    imu = read_rows(batch.get("imu"), 7, MOST_SAMPLES)
    fixes = read_rows(batch.get("fix"), 9, MOST_FIXES)
    turned = read_rows(batch.get("turned"), 4, MOST_SAMPLES)
    count = parse_whole_number(batch.get("number"))
    if imu is None or fixes is None or turned is None or count < 0:
        return None
    for row in imu:
        row[0] = round(row[0] / 1000, 6)
    return PhoneLine(
        count,
        origin,
        parse_whole_number(batch.get("first")),
        apple=apple,
        up=direction(batch.get("up")),
        imu=imu,
        attitude=[_attitude(row) for row in turned if not any(map(math.isnan, row))],
        fix=[_fix(row, apple) for row in fixes],
    )


def _attitude(row: Row) -> Row:
    """Return a row of alpha, beta, gamma [°] as of `PhoneLine`: turns about z, then x, then y of the device.

    The quaternion is the product of those of the three turns (W3C, *Device Orientation and Motion*).
    """
    time, *angles = row
    (cz, sz), (cx, sx), (cy, sy) = (
        (math.cos(half), math.sin(half)) for half in (math.radians(angle) / 2 for angle in angles)
    )
    w, x = cz * cx * cy - sz * sx * sy, cz * sx * cy - sz * cx * sy
    y, z = cz * cx * sy + sz * sx * cy, sz * cx * cy + cz * sx * sy
    return [round(time / 1000, 6), *(round(one, 6) for one in (w, x, y, z))]


def _fix(row: Row, apple: bool) -> Row:
    """Return a fix of a browser as of `PhoneLine`; its accuracies hold 95 % of all cases."""
    time, utc, latitude, longitude, height, level, vertical, speed, course = row
    # Apple's system gives heights above the sea, whatever the specification says.
    return [
        round(time / 1000, 6), utc / 1000, latitude, longitude, height, level / _RADIAL_95,
        vertical / _TWO_SIDED_95, *velocity(speed, course), NAN, float(apple),
    ]  # fmt: skip


def velocity(speed: float, course: float) -> tuple[float, float, float]:
    """Return the velocity north, east and down [m/s] of a speed and a course [°]; down is unknown.

    At rest a phone leaves out the course, and any course will do.
    """
    turn = math.radians(0.0 if math.isnan(course) and speed == 0 else course)
    return speed * math.cos(turn), speed * math.sin(turn), NAN
