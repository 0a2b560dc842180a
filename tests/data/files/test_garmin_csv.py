"""Garmin flight logs, read as Python's csv reads them: zones, units, and what leads to true north."""

from __future__ import annotations

import csv
import io
from datetime import datetime

import numpy as np
import pytest
from writers import garmin_csv as writer
from writers.resampled import resampled

from lab.data.formats import reader_of
from lab.missions import MissionError, Recording, mission, prepare_import
from lab.motion.frames import ecef
from lab.motion.frames.rotation import wrap

FOOT, KNOT = 0.3048, 1852 / 3600


@pytest.fixture
def file(tmp_path):
    """Return a function that writes bytes and reads them as a Garmin flight log."""

    def read(data: bytes, units=None):
        path = tmp_path / "log.dat"
        path.write_bytes(data)
        reader = reader_of(path)
        assert reader.name == "Garmin G1000 csv"
        return reader.read([path], units or {})

    return read


def recording() -> Recording:
    return mission("montreal").recording


def replaced(lines: list[str], column: str, value) -> list[str]:
    """Return rows with the cells of a column replaced, by a function of the row's number and the cell."""
    place = list(writer.UNITS).index(column)
    made = []
    for number, line in enumerate(lines):
        cells = line.split(", ")
        cells[place] = value(number, cells[place])
        made.append(", ".join(cells))
    return made


def test_an_independent_parser_reads_the_same(file):
    written = writer.write(recording())
    flight = file(written)
    lines = [line for line in written.decode().splitlines() if not line.startswith("#")]
    theirs = list(csv.DictReader(io.StringIO("\n".join(lines)), skipinitialspace=True))[1:]

    def column(name: str) -> np.ndarray:
        return np.array([float(one[name]) for one in theirs])

    np.testing.assert_allclose(np.degrees(flight.latitude), column("Latitude"), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(flight.longitude), column("Longitude"), rtol=0, atol=1e-12)
    np.testing.assert_allclose(flight.height, column("AltGPS") * FOOT, atol=1e-9)
    np.testing.assert_allclose(flight.airspeed, column("TAS") * KNOT, atol=1e-9)
    np.testing.assert_allclose(flight.velocity_n[:, 2], -column("VSpdG") * FOOT / 60, atol=1e-9)
    times = [datetime.fromisoformat(f"{one['Lcl Date']}T{one['Lcl Time']}{one['UTCOfst']}") for one in theirs]
    np.testing.assert_array_equal(
        flight.time - flight.time[0], [(one - times[0]).total_seconds() for one in times]
    )
    assert flight.rows_read == len(theirs) + 1
    assert [(one.count, one.first_row) for one in flight.dropped] == [(1, 4)]
    assert flight.dropped[0].reason.startswith("without a fix")


@pytest.mark.parametrize(
    ("variation", "sign"), [(-14.3, 1.0), (-14.3, -1.0), (9.5, 1.0), (9.5, -1.0), (0.3, 1.0)]
)
def test_the_flight_is_the_one_that_was_logged_whatever_the_sign_of_the_variation(file, variation, sign):
    flight = file(writer.log(writer.rows(recording(), variation, sign)))
    truth = resampled(recording(), writer.RATE)
    np.testing.assert_allclose(flight.time, 86_400 - 90 + truth.time, atol=1e-9)
    place = np.column_stack((flight.latitude, flight.longitude, flight.height))
    assert np.abs(ecef.displacement(truth.position, place)).max() < 0.07
    # Track to 0.05° at 45 m/s; below 1° of variation the positions may not tell.
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < (0.05 if abs(variation) > 1 else 0.3)
    off = np.degrees(np.abs(wrap(flight.euler - truth.euler)).max(axis=0))
    assert (off < (0.006, 0.006, 0.06 if abs(variation) > 1 else 0.4)).all()
    if abs(variation) > 1:
        assert f"{variation:+.1f}° (east positive)" in " ".join(flight.remarks)
    assert flight.vehicle == "aircraft"
    assert "above the ellipsoid" in flight.remarks[-1]


def test_a_track_from_true_north_leaves_the_heading_open(file):
    flight = file(writer.log(writer.rows(recording(), true=True)))
    truth = resampled(recording(), writer.RATE)
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 0.05
    assert flight.euler is None
    assert "The reference of the heading is unknown" in " ".join(flight.remarks)


def test_without_a_variation_the_positions_give_it(file):
    lines = replaced(writer.rows(recording()), "MagVar", lambda row, cell: "")
    flight = file(writer.log(lines))
    truth = resampled(recording(), writer.RATE)
    assert np.degrees(np.abs(wrap(flight.euler - truth.euler)).max()) < 0.5
    assert "from position to position, -14." in " ".join(flight.remarks)


def test_a_track_that_is_none_is_not_used(file):
    rng = np.random.default_rng(3)
    turned = replaced(writer.rows(recording()), "TRK", lambda row, cell: f"{(float(cell) + 90) % 360:.1f}")
    flight = file(writer.log(turned))
    assert flight.velocity_n is None and flight.euler is None
    assert "Track and heading are not used" in " ".join(flight.remarks)
    still = replaced(writer.rows(recording()), "GndSpd", lambda row, cell: f"{rng.uniform(0, 2):.2f}")
    assert "hardly moves" in " ".join(file(writer.log(still)).remarks)
    without = [
        line.replace("TRK", "XXX") for line in writer.log(writer.rows(recording())).decode().split("\n")
    ]
    assert "no track over ground" in " ".join(file("\n".join(without).encode()).remarks)


def test_rows_without_a_fix_or_a_time_are_left_out_and_counted(file):
    lines = writer.rows(recording())
    lines = replaced(lines, "GPSfix", lambda row, cell: "NoSoln" if 10 <= row < 14 else cell)
    lines = replaced(lines, "Lcl Time", lambda row, cell: "99:99:99" if row == 20 else cell)
    for name in ("Latitude", "Longitude"):
        lines = replaced(lines, name, lambda row, cell: "0.0" if row == 30 else cell)
    flight = file(writer.log(lines))
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [
        ("without a fix", 5, 14),
        ("without a date and time that can be read", 1, 24),
    ]
    assert len(flight.time) == flight.rows_read - 6


def test_the_offset_from_utc_may_change_in_flight(file):
    def offset(row: int, cell: str) -> str:
        return "-05:00" if row < 100 else "02:30"

    def clock(row: int, cell: str) -> str:
        second = 18 * 3600 + 58 * 60 + 30 + row + (0 if row < 100 else 7 * 3600 + 1800)
        return f"{second // 3600 % 24:02d}:{second // 60 % 60:02d}:{second % 60:02d}"

    def date(row: int, cell: str) -> str:
        return "2024-05-18" if row >= 100 else cell

    lines = writer.rows(recording())
    for name, value in (("UTCOfst", offset), ("Lcl Time", clock), ("Lcl Date", date)):
        lines = replaced(lines, name, value)
    flight = file(writer.log(lines))
    np.testing.assert_array_equal(np.diff(flight.time), 1.0)


def test_units_are_those_of_the_file_or_given(file):
    lines = writer.rows(recording())
    metric = writer.log(lines).decode().replace("ft wgs", "m").replace("ft msl", "m")
    usual, flight = file(writer.log(lines)), file(metric.encode())
    np.testing.assert_allclose(flight.height * FOOT, usual.height)
    named = {one.column: (one.unit, one.source) for one in flight.units}
    assert named["AltGPS"] == ("m", "named in the file")
    assert named["GndSpd"] == ("kt", "named in the file")
    assert "above sea level" in flight.remarks[-1]  # nothing says that these are above the ellipsoid
    broken = writer.log(lines).decode().replace("ft wgs, kt", "kt, ft wgs")
    np.testing.assert_array_equal(file(broken.encode()).height, usual.height)
    given = file(writer.log(lines), {"TAS": "m/s"})
    np.testing.assert_allclose(given.airspeed * KNOT, usual.airspeed)
    with pytest.raises(MissionError, match=r"TAX.*do you mean TAS"):
        file(writer.log(lines), {"TAX": "m/s"})


def test_the_head_of_a_g3x_names_units_in_brackets(file):
    names = list(writer.UNITS)
    long = [f"{name} ({unit})" for name, unit in writer.UNITS.items()]
    long[names.index("AltGPS")] = "GPS Altitude (ft)"
    text = "#airframe_info,log_version=1\n" + ",".join(long) + "\n" + ",".join(names) + "\n"
    flight = file((text + "\n".join(writer.rows(recording()))).encode())
    np.testing.assert_allclose(flight.velocity_n, file(writer.write(recording())).velocity_n, atol=1e-9)
    assert {one.source for one in flight.units} == {"named in the file"}


def test_the_whole_way_is_plausible(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(writer.write(recording()))
    made = prepare_import(path)
    assert made.report.verdict == "plausible"
    assert made.rebuilt.curve == "velocity"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "0 of 0 rows"),
        ([writer.NO_ROW.format(date="2024-05-17", clock="18:58:29", offset="00:00")] * 9, "0 of 9 rows"),
        (
            ["2024-05-17, 18:58:29, -05:00, , 1.0, 2.0" + "," * 20 + "NoSoln"] * 9,
            "0 of 9 rows can be used .9 from row 4 on: without a fix",
        ),
    ],
)
def test_what_is_no_flight_is_refused(file, lines, words):
    with pytest.raises(MissionError, match=words):
        file(writer.log(lines))
