"""Zones in time stamps: used where an abbreviation stands for one offset, and refused otherwise."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from foreign_tables import UNIX, same, table

from lab.data.clock.stamps import offset_of, seconds_of_texts
from lab.missions import MissionError
from lab.missions.flight_import import read_log

PLACES = {
    "CET": ("Europe/Berlin", 1), "CEST": ("Europe/Berlin", 7), "EET": ("Europe/Athens", 1),
    "WEST": ("Europe/Lisbon", 7), "EST": ("America/New_York", 1), "EDT": ("America/New_York", 7),
    "CST": ("America/Chicago", 1), "MST": ("America/Denver", 1), "PDT": ("America/Los_Angeles", 7),
    "AKST": ("America/Anchorage", 1), "HST": ("Pacific/Honolulu", 1), "JST": ("Asia/Tokyo", 1),
    "AEDT": ("Australia/Sydney", 1), "ACST": ("Australia/Adelaide", 7), "NZDT": ("Pacific/Auckland", 1),
    "SAST": ("Africa/Johannesburg", 1), "MSK": ("Europe/Moscow", 1), "GMT": ("Europe/London", 1),
}  # fmt: skip
"""A place and a month in which its clocks show a zone."""


@pytest.mark.parametrize("zone", PLACES)
def test_an_abbreviation_is_the_offset_of_its_place(zone):
    place, month = PLACES[zone]
    there = datetime(2023, month, 15, 12, tzinfo=ZoneInfo(place))
    assert there.tzname() == zone
    assert offset_of(zone) == there.utcoffset() / timedelta(seconds=1)


@pytest.mark.parametrize(
    "text",
    [
        "2023-11-14 23:13:20.5 CET", "2023-11-14T17:13:20.5 EST", "14.11.2023 23:13:20.5 CET",
        "11/14/2023 05:13:20.5 PM EST", "2023-11-14 23:13:20.5 UTC+01:00", "2023-11-14 22:13:20.5 GMT",
    ],
)  # fmt: skip
def test_a_date_with_a_zone_is_in_utc(text):
    np.testing.assert_allclose(seconds_of_texts([text]), UNIX + 0.5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Tue Nov 14 23:13:20 CET 2023", UNIX), ("Tue Nov 14 14:13:20 PST 2023", UNIX),
        ("Tue Nov 14 23:13:20 GMT+01:00 2023", UNIX), ("23:13:20 CET", 80_000.0), ("17:13:20 EST", 80_000.0),
    ],
)  # fmt: skip
def test_a_zone_before_the_year_and_one_of_a_time_of_day(text, expected):
    np.testing.assert_allclose(seconds_of_texts([text]), expected)


@pytest.mark.proof
@pytest.mark.parametrize("zone", ["BST", "IST", "AST", "XYZ"])
def test_an_abbreviation_that_says_nothing_or_several_things_is_refused(tmp_path, made, zone):
    imu, gnss = made
    log(tmp_path, imu, gnss, lambda t: written(t, 0, zone))
    with pytest.raises(MissionError, match=rf"not understood: '[^']+ {zone}' .*a zone such as \+01:00"):
        read_log([tmp_path])


@pytest.mark.proof
@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S.%f", "%H:%M:%S.%f"])
@pytest.mark.parametrize(("zone", "hours"), [("CET", 1), ("PST", -8), ("NZDT", 13)])
def test_the_imu_in_one_zone_and_the_receiver_in_utc_are_of_one_clock(
    tmp_path, made, expected, form, zone, hours
):
    imu, gnss = made
    log(tmp_path, imu, gnss, lambda t: written(t, hours, zone, form), lambda t: written(t, 0, "UTC", form))
    same(read_log([tmp_path]), expected, 2e-3)


def written(time, hours, zone, form="%Y-%m-%d %H:%M:%S.%f"):
    return datetime.fromtimestamp(round(UNIX + time, 6) + 3600 * hours, UTC).strftime(form) + f" {zone}"


def log(folder, imu, gnss, stamp, stamp_of_fix=None):
    header = "time,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
    table(folder / "imu.csv", header, [[stamp(row[0]), *row[1:]] for row in imu])
    rows = [[(stamp_of_fix or stamp)(row[0]), *row[1:6]] for row in gnss]
    table(folder / "gps.csv", "time,lat_deg,lon_deg,alt_m,vel_n,vel_e", rows)
