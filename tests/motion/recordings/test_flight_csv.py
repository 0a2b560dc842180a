"""The flight csv: what is written is read, what is wrong is named, nothing but MissionError comes out."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flights import COLUMNS, circle, csv_text, table
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lab.base.files.named_columns import MAX_BYTES
from lab.missions import MissionError, Recording, read_flight_csv, write_flight_csv

FIELDS = ("time", "latitude", "longitude", "height", "velocity_n", "euler", "airspeed", "alpha", "beta")


def written(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refused(path: Path) -> str:
    with pytest.raises(MissionError) as caught:
        read_flight_csv(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def same(one: Recording, other: Recording, tolerance: float = 0.0) -> None:
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance, err_msg=name)


def test_numbers_are_read_with_their_units(tmp_path):
    values = table(circle(samples=8))
    read = read_flight_csv(written(tmp_path / "flight.csv", csv_text(values)))
    np.testing.assert_array_equal(read.time, values[:, 0])
    np.testing.assert_allclose(read.latitude, values[:, 1] * np.pi / 180, rtol=1e-15)
    np.testing.assert_allclose(read.longitude, values[:, 2] * np.pi / 180, rtol=1e-15)
    np.testing.assert_array_equal(read.height, values[:, 3])
    np.testing.assert_array_equal(read.velocity_n, values[:, 4:7])
    np.testing.assert_allclose(read.euler, values[:, 7:10] * np.pi / 180, rtol=1e-15)
    assert read.airspeed is None
    assert read.alpha is None
    assert read.beta is None


def test_order_of_columns_and_unknown_columns_do_not_matter(tmp_path):
    values = table(circle(samples=8))
    expected = read_flight_csv(written(tmp_path / "a.csv", csv_text(values)))
    lines = csv_text(values[:, ::-1], COLUMNS[::-1]).splitlines()
    noted = [f"remark,{lines[0]},beta_deg", *(f"süß; {i},{line},1.5" for i, line in enumerate(lines[1:]))]
    read = read_flight_csv(written(tmp_path / "b.csv", "\n".join(noted)))
    same(read, Recording(*(getattr(expected, name) for name in FIELDS[:6]), beta=np.radians(np.full(8, 1.5))))


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("before", ["", "\ufeff", "# a remark\n\n# another\n", "\ufeff# a remark\r\n"])
@pytest.mark.parametrize("after", ["", "\n\n", "  \n \n"])
def test_editors_habits_are_accepted(tmp_path, compressed, end, before, after):
    values = table(circle(samples=6))
    content = (before + csv_text(values, end=end) + after).encode()
    path = tmp_path / ("flight.csv.gz" if compressed else "flight.csv")
    read = read_flight_csv(written(path, gzip.compress(content) if compressed else content))
    same(read, read_flight_csv(written(tmp_path / "plain.csv", csv_text(values))))


@pytest.mark.parametrize("name", ["flight.csv", "flight.csv.gz"])
def test_what_is_written_is_read(tmp_path, name):
    flight = circle()
    full = Recording(
        *(getattr(flight, name) for name in FIELDS[:6]),
        airspeed=np.linspace(0, 50, 400), alpha=np.linspace(-0.1, 0.2, 400), beta=np.linspace(0.1, -0.1, 400),
    )  # fmt: skip
    for recording, path in ((flight, tmp_path / name), (full, tmp_path / f"full_{name}")):
        write_flight_csv(path, recording)
        same(read_flight_csv(path), recording, tolerance=1e-6)
        # Where the documented digits matter most: 0.1 µm of position, 10 nm/s, 1e-9°.
        read = read_flight_csv(path)
        np.testing.assert_allclose(read.latitude, recording.latitude, rtol=0, atol=1e-14)
        np.testing.assert_allclose(read.velocity_n, recording.velocity_n, rtol=0, atol=0.6e-8)
        np.testing.assert_allclose(read.euler, recording.euler, rtol=0, atol=1e-11)


def test_same_flight_same_bytes_whatever_the_name_and_the_time_of_day(tmp_path):
    first, second = tmp_path / "first.csv.gz", tmp_path / "second.csv.gz"
    write_flight_csv(first, circle())
    write_flight_csv(second, circle())
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes()[4:8] == bytes(4)  # RFC 1952: MTIME 0, no time stamp
    assert first.read_bytes()[3] == 0  # RFC 1952: no flags, so no file name


def test_a_flight_that_cannot_be_written_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "flight.csv"
    write_flight_csv(path, circle(samples=5))
    before = path.read_bytes()
    height = np.full(5, 300.0)
    height[3] = np.nan
    flight = circle(samples=5)
    bad = Recording(flight.time, flight.latitude, flight.longitude, height, flight.velocity_n, flight.euler)
    with pytest.raises(MissionError, match="height_m of sample 3 is nan"):
        write_flight_csv(path, bad)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(MissionError, match="cannot be written"):
        write_flight_csv(tmp_path / "no" / "such" / "folder.csv", flight)


def spoiled(row: int, column: str, text: str, samples: int = 20, **how: str) -> str:
    """Return csv text with one cell replaced; row as an editor counts, the header being row 1."""
    lines = csv_text(table(circle(samples=samples)), **how).splitlines()
    cells = lines[row - 1].split(",")
    cells[COLUMNS.index(column)] = text
    lines[row - 1] = ",".join(cells)
    return "\n".join(lines)


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize(
    "text", ["abc", "1.5x", "", "  ", "nan", "NaN", "inf", "-Infinity", "1e999", "0x10", "1_0", "١"]
)
@pytest.mark.parametrize("row", [2, 9, 21])
def test_a_cell_that_is_no_finite_number_is_named(tmp_path, column, text, row):
    message = refused(written(tmp_path / "flight.csv", spoiled(row, column, text)))
    assert f"row {row}, column {column}: " in message
    assert "accepted is a number from" in message


@pytest.mark.parametrize(
    ("column", "text"),
    [
        ("latitude_deg", "90.001"), ("latitude_deg", "-91"), ("longitude_deg", "361"), ("height_m", "-1001"),
        ("height_m", "100001"), ("velocity_north_m_s", "1001"), ("velocity_east_m_s", "-1e6"),
        ("velocity_down_m_s", "5000"), ("pitch_deg", "95"), ("roll_deg", "400"), ("yaw_deg", "-361"),
        ("time_s", "1e11"),
    ],
)  # fmt: skip
def test_a_number_beyond_its_limits_is_named(tmp_path, column, text):
    message = refused(written(tmp_path / "flight.csv", spoiled(7, column, text)))
    assert f"row 7, column {column}: " in message
    assert "accepted is a number from" in message


def test_remarks_before_the_header_count_as_rows(tmp_path):
    message = refused(written(tmp_path / "flight.csv", "# one\n\n# three\n" + spoiled(9, "roll_deg", "abc")))
    assert "row 12, column roll_deg: 'abc'" in message


def test_the_first_of_several_faults_is_named_even_far_into_a_large_file(tmp_path):
    lines = csv_text(table(circle(samples=400))).splitlines()
    rows = [*lines[1:]] * 300  # 20 MB, several blocks
    rows[100_000] = rows[100_000].replace(rows[100_000].split(",")[3], "high", 1)
    rows[110_000] = "x"
    message = refused(written(tmp_path / "flight.csv", "\n".join([lines[0], *rows])))
    assert "row 100002, column height_m: 'high'" in message


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column_is_named_with_those_accepted(tmp_path, column):
    path = written(tmp_path / "flight.csv", csv_text(table(circle(samples=5))).replace(column, "other", 1))
    message = refused(path)
    assert f"row 1: column {column} missing" in message
    assert all(name in message for name in (*COLUMNS, "airspeed_m_s", "alpha_deg", "beta_deg"))


def test_a_repeated_column_and_semicolons_are_explained(tmp_path):
    text = csv_text(table(circle(samples=5)))
    twice = "\n".join(f"{line},{line.split(',')[1]}" for line in text.splitlines())
    assert "column latitude_deg occurs twice" in refused(written(tmp_path / "twice.csv", twice))
    assert "commas, not semicolons" in refused(written(tmp_path / "semi.csv", text.replace(",", ";")))


@pytest.mark.parametrize(("time", "word"), [("0.25", "runs backwards"), ("0.75", "repeats")])
def test_time_that_does_not_increase_is_named(tmp_path, time, word):
    # Rows 2, 3, 4, 5 are 0, 0.25, 0.5, 0.75 s; row 6 is spoiled.
    message = refused(written(tmp_path / "flight.csv", spoiled(6, "time_s", time)))
    assert "row 6, column time_s" in message
    assert word in message
    assert f"from 0.75 to {time}" in message


def test_a_flight_of_days_is_refused(tmp_path):
    message = refused(written(tmp_path / "flight.csv", spoiled(21, "time_s", "90000")))
    assert "row 21, column time_s: 90000 s after the first sample" in message


@pytest.mark.parametrize(("samples", "rows"), [(0, 0), (1, 1), (2, 2), (3, 3)])
def test_too_few_samples_are_refused(tmp_path, samples, rows):
    lines = csv_text(table(circle(samples=5))).splitlines()[: samples + 1]
    message = refused(written(tmp_path / "flight.csv", "\n".join(lines)))
    assert f"after {rows} rows" in message
    assert "at least 4" in message


@pytest.mark.parametrize(
    "change", [lambda row: row + ",1", lambda row: row.rsplit(",", 1)[0], lambda row: row + ","]
)
def test_rows_of_another_length_are_named(tmp_path, change):
    lines = csv_text(table(circle(samples=9))).splitlines()
    lines[4] = change(lines[4])
    message = refused(written(tmp_path / "flight.csv", "\n".join(lines)))
    assert re.search(r"row 5: (9|11) cells; accepted are 10", message)


def test_an_empty_row_inside_is_named(tmp_path):
    lines = csv_text(table(circle(samples=9))).splitlines()
    for blank in ("", "   "):
        path = written(tmp_path / "flight.csv", "\n".join([*lines[:4], blank, *lines[4:]]))
        assert "row 5: the row is empty" in refused(path)


@pytest.mark.parametrize("content", [b"", b"\n\n", b"# only a remark\n", b"\xef\xbb\xbf", b"   "])
def test_an_empty_file_is_said_to_be_empty(tmp_path, content):
    assert "the file is empty" in refused(written(tmp_path / "flight.csv", content))


def test_files_that_are_not_text(tmp_path):
    text = csv_text(table(circle(samples=9)))
    assert "row 1: this is not text" in refused(written(tmp_path / "a.csv", text.encode("utf-16")))
    lines = text.encode().splitlines()
    for junk in (b"\xff", b"\0"):
        path = written(tmp_path / "c.csv", b"\n".join([*lines[:5], lines[5] + junk, *lines[6:]]))
        assert "row 6: this is not text" in refused(path)


def test_a_compressed_file_is_known_by_its_content(tmp_path):
    path = written(tmp_path / "flight.csv", gzip.compress(csv_text(table(circle(samples=9))).encode()))
    same(read_flight_csv(path), circle(samples=9), tolerance=1e-12)


def test_files_that_are_no_whole_gzip(tmp_path):
    whole = gzip.compress(csv_text(table(circle(samples=200))).encode())
    assert "gzip" in refused(written(tmp_path / "a.csv.gz", b"time_s,latitude_deg\n1,2\n"))
    assert "gzip" in refused(written(tmp_path / "b.csv.gz", whole[: len(whole) // 2]))
    spoilt = bytearray(whole)
    spoilt[len(whole) // 2] ^= 0xFF
    refused(written(tmp_path / "c.csv.gz", bytes(spoilt)))


def test_a_file_of_two_gigabytes_is_refused_without_being_read(tmp_path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as file:
        file.truncate(2 * 2**30)
    assert path.stat().st_size == 2 * 2**30
    message = refused(path)
    assert "2048 MB; accepted are files up to 256 MB" in message


def test_lines_without_end_and_remarks_without_end_are_stopped(tmp_path):
    header = ",".join(COLUMNS) + "\n"
    assert "longer than 1 MB" in refused(written(tmp_path / "commas.csv", "," * 20_000_000))
    assert "longer than 1 MB" in refused(written(tmp_path / "zeros.csv", header + "0" * 20_000_000))
    assert "within the first 1000 lines" in refused(
        written(tmp_path / "remarks.csv", "#\n" * 5_000_000 + header)
    )


@pytest.mark.proof
def test_line_ends_may_fall_anywhere_in_a_large_file(tmp_path):
    values = table(circle(samples=1000, step=0.01))
    rows = np.tile(values, (150, 1))
    rows[:, 0] = np.arange(len(rows)) * 0.01
    rows[:, 4:6] = 0.0  # the same circle again and again jumps, which standing still does not contradict
    for end in ("\n", "\r\n", "\r"):
        path = written(tmp_path / "large.csv", csv_text(rows, end=end))
        assert path.stat().st_size > 2**24
        np.testing.assert_array_equal(read_flight_csv(path).time, rows[:, 0])


def test_a_file_that_swells_when_decompressed_is_stopped(tmp_path):
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb", 1) as file:
        file.write((",".join(COLUMNS) + "\n").encode())
        block = b"\n" * 2**20
        for _ in range(MAX_BYTES // len(block) + 1):
            file.write(block)
    assert path.stat().st_size < 3e6
    assert "grows more than 100 times when decompressed" in refused(path)


def test_what_is_no_ordinary_file(tmp_path):
    assert "no such file" in refused(tmp_path / "missing.csv")
    assert "is a folder" in refused(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.csv")
        assert "not an ordinary file" in refused(tmp_path / "pipe.csv")
    with pytest.raises(MissionError, match=r"no such file|cannot be read"):
        read_flight_csv("nul\0byte.csv")


@given(content=st.binary(max_size=300))
def test_arbitrary_bytes_are_refused_and_nothing_else(tmp_path_factory, content):
    folder = tmp_path_factory.getbasetemp()
    for path in (folder / "bytes.csv", folder / "bytes.csv.gz"):
        refused(written(path, content))


@given(place=st.floats(0, 1), value=st.integers(1, 255), end=st.floats(0, 1))
def test_a_damaged_gzip_file_gives_a_whole_flight_or_a_reason(tmp_path_factory, place, value, end):
    content = bytearray(gzip.compress(csv_text(table(circle(samples=30))).encode(), mtime=0))
    content[int(place * (len(content) - 1))] ^= value
    damaged = written(
        tmp_path_factory.getbasetemp() / "damaged.csv.gz", bytes(content[: round(end * len(content))])
    )
    try:
        recording = read_flight_csv(damaged)
    except MissionError as error:
        assert str(damaged) in str(error)
        return
    np.testing.assert_array_equal(recording.time, circle(samples=30).time)


CELLS = st.one_of(
    st.floats(-90, 90).map(repr),
    st.text(max_size=5),
    st.sampled_from(["", "1", "-0", "1e5", "nan", "1,2", "\r", '"3"']),
)


@given(rows=st.lists(st.lists(CELLS, min_size=9, max_size=11), max_size=8), time=st.booleans())
def test_rows_of_anything_give_a_whole_flight_or_a_reason(tmp_path_factory, rows, time):
    path = tmp_path_factory.getbasetemp() / "rows.csv"
    lines = [",".join(([str(i), *row[1:]]) if time else row) for i, row in enumerate(rows)]
    path.write_bytes("\n".join([",".join(COLUMNS), *lines]).encode("utf-8", "replace"))
    try:
        recording = read_flight_csv(path)
    except MissionError:
        return
    assert len(recording.time) >= 4
    assert all(np.isfinite(getattr(recording, name)).all() for name in FIELDS[:6])


@given(
    steps=arrays(float, 12, elements=st.floats(1e-3, 100)),
    values=arrays(float, (12, 9), elements=st.floats(-1, 1)),
    air=arrays(float, (12, 3), elements=st.floats(-1, 1)),
    compressed=st.booleans(),
)
def test_any_flight_survives_the_round_trip(tmp_path_factory, steps, values, air, compressed):
    recording = Recording(
        time=np.cumsum(steps),
        latitude=values[:, 0] * np.pi / 2,
        longitude=values[:, 1] * 2 * np.pi,
        height=values[:, 2] * 1000,
        # Slow enough that positions which jump about at random contradict no velocity.
        velocity_n=values[:, 3:6] * 0.01,
        euler=values[:, 6:9] * [2 * np.pi, np.pi / 2, 2 * np.pi],
        airspeed=air[:, 0] * 1000,
        alpha=air[:, 1] * np.pi,
        beta=air[:, 2] * np.pi,
    )
    path = tmp_path_factory.getbasetemp() / ("trip.csv.gz" if compressed else "trip.csv")
    write_flight_csv(path, recording)
    same(read_flight_csv(path), recording, tolerance=1e-6)


def test_few_rows_and_many_give_the_same_bits(tmp_path, monkeypatch):
    """NumPy reads few rows, because pandas takes longer to import than they to read."""
    path = tmp_path / "flight.csv"
    write_flight_csv(path, circle())
    few = read_flight_csv(path)
    monkeypatch.setattr("lab.base.files.named_columns._FEW", 0)
    same(few, read_flight_csv(path))


def test_reading_does_not_import_what_it_does_not_need():
    code = "import sys, lab.missions; print([m for m in ('pandas', 'jsbsim', 'scipy') if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
