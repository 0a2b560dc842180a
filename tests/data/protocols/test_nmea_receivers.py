"""Two receivers on one line, with the same letters before their sentences, are parted and said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.framing import xor8
from lab.motion.frames.earth import SEMI_MAJOR_AXIS

NORTH, EAST = math.radians(47.3), math.radians(8.5)


def path(t: float, aside: float) -> tuple[float, float]:
    """Return latitude and longitude [rad] of a car on a winding road, some metres to the east."""
    north, east = 15.0 * t, 100 * math.sin(t / 20) + aside
    return NORTH + north / SEMI_MAJOR_AXIS, EAST + east / SEMI_MAJOR_AXIS / math.cos(NORTH)


def sentences(t: float, aside: float, quality: int = 4) -> list[str]:
    """Return GGA, VTG and RMC of a receiver at a time of day."""
    cells = []
    for angle, width in zip(path(t, aside), (2, 3), strict=True):
        degrees, part = divmod(math.degrees(angle), 1)
        cells.append(f"{int(degrees):0{width}d}{60 * part:09.6f}")
    clock = f"10{int(t) // 60:02d}{t % 60:05.2f}"
    speed = 10.0 + aside  # says whose velocity it is
    bodies = (
        f"GNGGA,{clock},{cells[0]},N,{cells[1]},E,{quality},12,0.8,430.1,M,47.0,M,,",
        f"GNVTG,45.0,T,,M,{speed:.3f},N,,K,A",
        f"GNRMC,{clock},A,{cells[0]},N,{cells[1]},E,{speed:.3f},45.0,020124,,,A",
    )
    return [f"${body}*{xor8(body.encode()):02X}\r\n" for body in bodies]


def read(lines: list[str]) -> tuple[np.ndarray, str]:
    """Return for each fix how far east of the first receiver's path it is [m], and what is said."""
    decoder = make_decoder("nmea")
    parts = [decoder.feed(line.encode()).fix for line in lines]
    fix = np.concatenate([*parts, decoder.finish().fix])
    since = fix["utc"] % 86400 - 36_000
    there = np.array([path(t, 0.0)[1] for t in since])
    aside = (fix["longitude"] - there) * SEMI_MAJOR_AXIS * math.cos(NORTH)
    speed = np.linalg.norm(fix["velocity_n"][:, :2], axis=1) / 0.514444
    of_one = np.abs(speed - 10.0 - aside) < 0.05  # position and velocity of one
    return np.where(of_one, aside, np.inf), getattr(decoder, "evidence", "")


def drive(order, rate: float = 5.0, seconds: float = 60.0, apart: float = 2.0) -> list[str]:
    """Return what comes of two receivers, in the order that a function makes of their sentences."""
    times = np.round(np.arange(seconds * rate) / rate, 2)
    return [line for t in times for line in order(float(t), sentences(t, 0.0), sentences(t, apart))]


def one_after_the_other(t, one, other):
    return [*one, *other]


def mixed(t, one, other):
    return [line for both in zip(one, other, strict=True) for line in both if "VTG" not in line]


def slower(t, one, other):
    return [*one, *(other if t == int(t) else [])]


def exchanged(t, one, other):
    """Often the second receiver is faster."""
    is_first = t > 3 and np.random.default_rng(int(100 * t)).random() < 0.3
    return [*other, *one] if is_first else [*one, *other]


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("order", [one_after_the_other, mixed, slower, exchanged])
def test_the_path_is_that_of_one_receiver_and_the_other_is_said(order, rate):
    if order is slower and rate == 1.0:
        rate = 10.0
    aside, said = read(drive(order, rate))
    assert len(aside) >= 60 * rate - 3
    # The first time that the order changes shows when the second position comes.
    assert (np.abs(aside[5:]) > 0.1).sum() <= (order is exchanged)
    assert "two receivers with the same name come, 2.0 m apart" in said


def test_receivers_of_a_vehicle_that_turns_in_circles_are_parted(monkeypatch):
    """Its path leaves a straight line by 1.5 m in the second between positions; they are 2 m apart."""

    def circle(t: float, aside: float) -> tuple[float, float]:
        radius, angle = 24.0 - aside, 0.35 * t
        north, east = radius * math.sin(angle), radius * (1 - math.cos(angle)) + aside
        return NORTH + north / SEMI_MAJOR_AXIS, EAST + east / SEMI_MAJOR_AXIS / math.cos(NORTH)

    monkeypatch.setitem(globals(), "path", circle)
    decoder = make_decoder("nmea")
    parts = [decoder.feed(line.encode()).fix for line in drive(exchanged, 1.0)]
    fix = np.concatenate([*parts, decoder.finish().fix])
    there = np.array([circle(t, 0.0) for t in fix["utc"] % 86400 - 36_000])
    away = np.hypot(fix["latitude"] - there[:, 0], (fix["longitude"] - there[:, 1]) * math.cos(NORTH))
    assert len(fix) == 60
    assert (away * SEMI_MAJOR_AXIS > 0.1).sum() <= 3  # before its bend is known


def test_the_other_is_read_when_the_first_falls_silent():
    aside, _ = read(drive(lambda t, one, other: [*(one if t < 30 else []), *other]))
    assert np.abs(aside[5:150]).max() < 0.1
    assert np.abs(aside[-130:] - 2.0).max() < 0.1


def test_one_receiver_is_never_parted():
    lines = drive(lambda t, one, other: one)
    # A logger writes some lines twice, and a position is corrected once.
    lines[30:30] = lines[27:30]
    lines[60:60] = sentences(4.0, 50.0)
    aside, said = read(lines[:60] + lines[63:])
    assert not said
    assert np.abs(aside).max() < 0.1
