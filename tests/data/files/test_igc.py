"""IGC files, read as an independent parser reads them; midnight, decimals, heights and broken records."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from aerofiles.igc import Reader
from writers import igc as writer
from writers.resampled import resampled

from lab.data.files import igc
from lab.missions import MissionError, mission
from lab.motion.frames import ecef

READER = igc

HEAD = "AXXX123\r\nHFDTE{date}\r\n"
FIX = "B{clock}{lat}N{lon}W{valid}{pressure:05d}{height:05d}{more}\r\n"


def fixes(count: int, first: int = 12 * 3600, **cells) -> str:
    """Return B records, one a second, going north at 45° N by 0.01' each."""
    lines = []
    for i in range(count):
        second = (first + i) % 86_400
        clock = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}"
        cells = {"valid": "A", "pressure": 400 + i, "height": 500 + i, "more": ""} | cells
        if cells.get("level"):
            cells |= {"pressure": 0, "height": 0} | cells["level"]
        lines.append(FIX.format(**{"clock": clock, "lat": f"45{10 * i:05d}", "lon": "07344050"} | cells))
    return "".join(lines)


def test_an_independent_parser_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = Reader().read(io.TextIOWrapper(io.BytesIO(written), "latin-1"))["fix_records"][1]
    assert len(flight.time) == len(theirs) == flight.rows_read == 206
    assert not flight.dropped
    # aerofiles gives positions to 0.001' and the decimals apart.
    for ours, name, more, sign in (
        (flight.latitude, "lat", "LAD", 1),
        (flight.longitude, "lon", "LOD", -1),
    ):
        full = [one[name] + sign * int(one[more]) / 60e5 for one in theirs]
        np.testing.assert_allclose(np.degrees(ours), full, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(flight.height, [one["gps_alt"] for one in theirs])
    clock = [one["datetime"] for one in theirs]
    seconds = [(one - clock[0].replace(hour=0, minute=0, second=0)).total_seconds() for one in clock]
    ours = flight.time - np.array([int(one["TDS"]) / 100 for one in theirs])
    after_midnight = np.array(seconds) < seconds[0]
    np.testing.assert_allclose(ours - 86_400 * after_midnight % 86_400, seconds, atol=1e-9)


def test_the_flight_is_the_one_that_was_written_and_goes_on_after_midnight(file):
    recording = mission("montreal").recording
    for fine, most in ((True, 0.02), (False, 1.9)):
        flight = file(writer.write(recording, fine=fine))
        truth = resampled(recording, writer.RATE)
        began = 86_400 - 90 + (0.25 if fine else 0.0)
        np.testing.assert_allclose(flight.time, began + truth.time, atol=1e-9)
        place = np.column_stack((flight.latitude, flight.longitude, flight.height))
        way = ecef.displacement(truth.position, place)
        assert np.abs(way[:, :2]).max() < most
        assert np.abs(way[:, 2]).max() <= 0.5 + 1e-6
    assert flight.remarks[0] == "Time counts from 2024-05-17 00:00 UTC."
    assert flight.vehicle == "aircraft"  # a Carat is a glider, though the word has a car in it
    assert flight.velocity_n is None and flight.euler is None


def test_a_pause_over_half_a_day_and_points_out_of_order_at_midnight(file):
    text = HEAD.format(date="311299") + fixes(3, 6 * 3600) + fixes(3, 20 * 3600)
    text += fixes(1, 86_399) + fixes(1, 1) + fixes(1, 86_398) + fixes(4, 2)
    day = 86_400.0
    np.testing.assert_array_equal(
        file(text).time,
        [21_600, 21_601, 21_602, 72_000, 72_001, 72_002, 86_399, day + 1, 86_398, *(day + np.arange(2, 6))],
    )
    on_the_second_day = HEAD.format(date="311299") + fixes(3, 82_800) + fixes(2, 3600) + fixes(2, 54_000)
    np.testing.assert_array_equal(
        file(on_the_second_day).time[2:], [82_802, day + 3600, day + 3601, day + 54_000, day + 54_001]
    )
    later = HEAD.format(date="311299") + fixes(4) + "HFDTEDATE:030100,02\r\n" + fixes(4)
    np.testing.assert_array_equal(np.diff(file(later).time), [1, 1, 1, 3 * day - 3, 1, 1, 1])
    assert "1999-12-31" in file(later).remarks[0]


def test_sides_of_the_equator_and_of_greenwich(file):
    text = HEAD.format(date="170524") + fixes(5)
    flight = file(text)
    np.testing.assert_allclose(np.degrees(flight.latitude), 45 + np.arange(5) * 0.01 / 60, atol=1e-12)
    np.testing.assert_allclose(np.degrees(flight.longitude), -(73 + 44.05 / 60), atol=1e-12)
    turned = file(text.replace("N0", "S0").replace("WA", "EA"))
    np.testing.assert_allclose(turned.latitude, -flight.latitude)
    np.testing.assert_allclose(turned.longitude, -flight.longitude)


@pytest.mark.parametrize(
    ("head", "cells", "first", "words"),
    [
        ("", {}, 500.0, "above the ellipsoid.*-100 m from the heights of the GPS"),
        ("HFALGALTGPS:GEO\r\n", {}, 500.0, "above sea level"),
        ("", {"level": {"pressure": 321}}, 321.0, "pressure altitudes"),
        ("", {"level": {"height": -12}}, -12.0, "above the ellipsoid"),
        ("", {"level": {"height": 0}}, None, "no heights"),
    ],
)
def test_which_height_is_taken_and_what_is_said_of_it(file, head, cells, first, words):
    flight = file(HEAD.format(date="170524") + head + fixes(6, **cells))
    assert (None if flight.height is None else flight.height[0]) == first
    assert re.search(words, " ".join(flight.remarks))
    named = [one.column for one in flight.units]
    assert named[2:] == ([] if first is None else ["pressure altitude" if first == 321 else "GNSS altitude"])


def test_what_has_no_fix_or_is_broken_is_left_out_and_counted(file):
    lines = [HEAD.format(date="170524"), fixes(3), fixes(2, 43_203, valid="V")]
    lines += [fixes(1, 43_205, lat="0000000", lon="00000000"), "B1200069960000N07344050WA0040000500\r\n"]
    lines += ["B12000\r\n", "LXXXB nothing\r\n", fixes(4, 43_208), fixes(1, 43_212, lat="4560000")]
    flight = file("".join(lines))
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [
        ("B records that cannot be read", 3, 9),
        ("without a fix", 3, 6),
    ]
    assert flight.rows_read == len(flight.time) + 6 == 13
    assert len(flight.time) == 7


def test_extensions_that_make_no_sense_are_not_read(file):
    for record in ("I013638FXA", "I019900LAD", "I010104TDS", "I02", "I013699LAD", "I01xx38LAD"):
        assert len(file(HEAD.format(date="170524") + f"{record}\r\n" + fixes(5, more="123")).time) == 5
    short = HEAD.format(date="170524") + "I013637TDS\r\n" + fixes(4, more="50") + fixes(3, 43_300)
    flight = file(short)
    assert flight.time[0] == 43_200.5
    assert [one.count for one in flight.dropped] == [3]


def test_another_datum_is_said(file):
    flight = file(HEAD.format(date="170524") + "HFDTM062GPSDATUM:OHIO-NAD27\r\n" + fixes(5))
    assert "OHIO-NAD27" in flight.remarks[-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD.format(date="170524"), "no B record"),
        (HEAD.format(date="170524") + fixes(3), "3 of 3 points.*at least 4"),
        (HEAD.format(date="170524") + fixes(9, valid="V"), "0 of 9 points.*9 from row 3 on: without a fix"),
    ],
)
def test_what_is_no_track_is_refused(file, text, words):
    with pytest.raises(MissionError, match=words):
        file(text)


def test_units_cannot_be_given(file):
    with pytest.raises(MissionError, match="fixes its units"):
        file(HEAD.format(date="170524") + fixes(9), {"GNSS altitude": "ft"})
