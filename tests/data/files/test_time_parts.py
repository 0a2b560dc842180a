"""Time stamps of which each part has a column of its own."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from foreign_tables import table

from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_fixes import find_fixes
from lab.missions.flight_import import prepare_import

START = datetime(2024, 12, 31, 23, 59, 57, 250_000, tzinfo=UTC)
"""A flight into a new year."""
RATE = 5
DATE, CLOCK = ("year", "month", "day"), ("hour", "minute", "second")


def stamps(count: int, start: datetime) -> list[datetime]:
    return [start + timedelta(milliseconds=1000 * number / RATE) for number in range(count)]


def circle(count: int) -> np.ndarray:
    """Return latitude, longitude [°] and height [m] at 15 m/s around a circle of 300 m."""
    angle = 15.0 / 300.0 * np.arange(count) / RATE
    return np.column_stack(
        (
            45.0 + np.degrees(300.0 / 6.37e6) * np.sin(angle),
            7.0 + np.degrees(300.0 / 6.37e6 / np.cos(np.radians(45.0))) * np.cos(angle),
            np.full(count, 400.0),
        )
    )


def written(path, names, parts, extra=(), start=START):
    """Write a table of a flight of a minute with the parts of its time, and further columns with a value."""
    rows = [
        (*parts(when), *place, *(value for _, value in extra))
        for when, place in zip(stamps(60 * RATE, start), circle(60 * RATE).tolist(), strict=True)
    ]
    return table(path, ",".join((*names, "LAT", "LON", "ALT", *(name for name, _ in extra))), rows)


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (
            (*(name.upper() for name in (*DATE, *CLOCK)), "MS"),
            lambda t: (*(getattr(t, one) for one in (*DATE, *CLOCK)), t.microsecond // 1000),
        ),
        (
            ("Hours", "Minutes", "Seconds"),
            lambda t: (t.hour, t.minute, t.second + t.microsecond * 1e-6),
        ),
        (
            ("Day", "Month", "Year", "Hour", "Min", "Sec"),
            lambda t: (t.day, t.month, t.year, t.hour, t.minute, t.second + t.microsecond * 1e-6),
        ),
    ],
    ids=["with milliseconds", "without a date", "day first"],
)
def test_the_parts_of_a_time_are_one_stamp(tmp_path, names, parts):
    path = written(tmp_path / "log.csv", names, parts)
    clock = find_clock(read_sheet(path.name, path.read_bytes()), fast=False)
    dated = any(name.lower() == "year" for name in names)
    first = START.timestamp() if dated else START.timestamp() % 86400
    np.testing.assert_allclose(clock.time, first + np.arange(60 * RATE) / RATE, atol=1e-5, rtol=0)
    made = prepare_import(path)
    assert len(made.flight.raw.time) == 60 * RATE
    assert made.report.verdict != "implausible"


def test_a_counter_beside_whole_seconds_is_the_finer_clock(tmp_path):
    path = written(
        tmp_path / "log.csv",
        (*CLOCK, "millis"),
        lambda t: (t.hour, t.minute, t.second, 5000 + round(1000 * (t - START).total_seconds())),
    )
    clock = find_clock(read_sheet(path.name, path.read_bytes()), fast=False)
    np.testing.assert_allclose(clock.time, 5 + np.arange(60 * RATE) / RATE, atol=1e-9)


@pytest.mark.parametrize(("beside", "is_velocity"), [((("POS_U", 1.5),), False), ((), True)])
def test_an_uncertainty_is_no_velocity_up(tmp_path, beside, is_velocity):
    names = (*(name.upper() for name in CLOCK), "MS")
    path = written(
        tmp_path / "log.csv",
        names,
        lambda t: (*(getattr(t, one) for one in CLOCK), t.microsecond // 1000),
        (*beside, ("VEL_U", 0.4)),
    )
    sheet = read_sheet(path.name, path.read_bytes())
    down = find_fixes([sheet]).gnss.velocity_n[:, 2]
    assert bool((down == -0.4).all()) is is_velocity
    assert bool(np.isnan(down).all()) is not is_velocity


def test_an_hour_of_zero_is_an_hour(tmp_path):
    path = written(
        tmp_path / "log.csv",
        ("Hour", "Minute", "Second"),
        lambda t: (t.hour, t.minute, t.second + t.microsecond * 1e-6),
        start=START + timedelta(minutes=2),
    )
    clock = find_clock(read_sheet(path.name, path.read_bytes()), fast=False)
    np.testing.assert_allclose(clock.time, 117.25 + np.arange(60 * RATE) / RATE, atol=1e-5)
