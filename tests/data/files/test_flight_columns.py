"""The columns of a profile: what loggers leave is read, what cannot be used is counted, no more comes out."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.files.profile import Profile, plain
from lab.data.rebuild.raw_flight import Dropped
from lab.data.sheets.flight_columns import OTHER_RECORDING, Columns, read_columns
from lab.data.sheets.sheet_cells import MISSING, NO_NUMBER
from lab.missions import MissionError

PROFILE = Profile(
    Path("own.toml"),
    "Own",
    {"time": "time[s]", "speed,m/s": "north[m/s]", "velocity": "north[m/s]", "rate": "up[m/s]"},
    (("time",), ("speed,m/s", "velocity")),
    simulator=True,
)


def read(folder: Path, text: str | bytes, name: str = "table.txt") -> Columns:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_columns(path, PROFILE, {})


def text_of(rows: np.ndarray, header: str = "time,other,speed m/s,rate", end: str = "\n") -> str:
    # The heading of the speed holds a comma where that does not separate.
    return end.join([header, *(",".join(repr(float(x)) for x in row) for row in rows)]) + end


def rows(count: int = 6) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 4)) * [1, 100, 1e-9, 1]


@pytest.mark.parametrize("delimiter", ["|", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("pad", ["", "   "])
def test_delimiters_line_ends_and_padding_do_not_matter(tmp_path, delimiter, end, pad):
    values = rows()
    lines = [
        "\ufefflogged by something",
        "",
        delimiter.join(f"{pad}{name}{pad}" for name in ("_Time", "other", '"Speed,_m/s"', "rate")),
        *(delimiter.join(f"{pad}{x!r}{pad}" for x in row) for row in values.tolist()),
    ]
    table = read(tmp_path, end.join(lines))
    np.testing.assert_array_equal(table.values["time"], values[:, 0])
    np.testing.assert_array_equal(table.values["north"], values[:, 2])
    assert table.lines.tolist() == [4, 5, 6, 7, 8, 9]
    assert table.rows_read == 6
    assert table.dropped == ()
    assert list(table.values) == ["time", "north", "up"]


@pytest.mark.parametrize("both", [False, True])
def test_a_delimiter_at_the_end_of_rows_is_no_cell(tmp_path, both):
    values = rows()
    lines = ["time|speed,m/s|rate" + ("|" if both else "")]
    lines += ["|".join(map(repr, row[:3])) + "|" for row in values.tolist()]
    lines[3] = lines[3][:-1]
    table = read(tmp_path, "\n".join(lines))
    np.testing.assert_array_equal(np.column_stack(list(table.values.values())), values[:, :3])
    assert table.dropped == ()


def test_quoted_headings_may_hold_the_delimiter(tmp_path):
    values = rows()
    header = 'time,"speed,m/s","rate"'
    cells = "\n".join(",".join(f'"{x!r}"' for x in row[:3]) for row in values.tolist())
    table = read(tmp_path, f"{header}\n{cells}")
    np.testing.assert_array_equal(np.column_stack(list(table.values.values())), values[:, :3])


def test_rows_that_cannot_be_used_are_counted_with_their_first_line(tmp_path):
    lines = text_of(rows(40), "time,other,velocity,rate").splitlines()
    lines[3] = "1,2"
    lines[5] = "1,2,3,4,5,6"
    lines[7] = "one,2,3,4"
    lines[8] = ",2,3,4"
    lines[9] = "nan,2,3,inf"
    lines[10] = "1\0,2,3,4"
    lines[11] = "1e999,2,3,4"
    lines[12] = ""
    lines[13] = "# a remark"
    lines[14] = "0x10,2,3,4"
    lines[20] = lines[20][:4]
    table = read(tmp_path, "\n".join(lines))
    assert table.rows_read == 38
    assert table.dropped == (Dropped(MISSING, 3, 4), Dropped(NO_NUMBER, 6, 8))
    assert len(table.lines) == 38 - 9


def test_cells_of_no_interest_may_hold_anything(tmp_path):
    lines = text_of(rows(), "time,other,velocity,rate").splitlines()
    lines[2:5] = [line.replace(line.split(",")[1], "N172SP") for line in lines[2:5]]
    table = read(tmp_path, "\n".join(lines))
    assert len(table.lines) == 6
    assert table.dropped == ()


def test_a_column_that_is_mostly_empty_counts_as_absent(tmp_path):
    lines = ["time,velocity,rate", *(f"{i},{i},{i if i < 4 else ''}" for i in range(10))]
    table = read(tmp_path, "\n".join(lines))
    assert list(table.values) == ["time", "north"]
    assert len(table.lines) == 10
    assert "Column rate is left out" in table.remarks[0]
    lines = ["time,velocity,rate", *(f"{i},{i},{i if i < 8 else ''}" for i in range(10))]
    table = read(tmp_path, "\n".join(lines))
    assert table.dropped == (Dropped(NO_NUMBER, 2, 10),)


def test_a_heading_that_is_there_twice_is_said(tmp_path):
    table = read(tmp_path, "time,velocity,rate,rate\n" + "1,2,3,4\n" * 5)
    assert table.values["up"].tolist() == [3.0] * 5
    assert "rate is there more than once" in table.remarks[0]


def test_the_longest_of_several_recordings_is_taken(tmp_path):
    first, second, third = rows(5), rows(9), rows(7)
    # The second recording has its columns in another order.
    text = (
        text_of(first, "time,other,velocity,rate")
        + text_of(second, "velocity,rate,time,other")
        + text_of(third, "time,other,velocity,rate")
    )
    table = read(tmp_path, text)
    np.testing.assert_array_equal(table.values["time"], second[:, 2])
    np.testing.assert_array_equal(table.values["up"], second[:, 1])
    assert table.rows_read == 21
    assert table.dropped == (Dropped(OTHER_RECORDING, 12, 2),)
    assert table.lines[0] == 8


def test_line_numbers_hold_over_several_blocks(tmp_path):
    lines = ["time,velocity,rate"] + ["0.123456789,0.123456789,0.123456789"] * 400_000  # 14 MB
    lines[350_000] = "x,1,1"
    for header in (300_000, 390_000):
        lines[header] = lines[0]
    table = read(tmp_path, "\n".join(lines))
    assert table.lines[[0, -1]].tolist() == [2, 300_000]
    assert table.dropped == (Dropped(OTHER_RECORDING, 99_999, 300_002),)


def test_a_compressed_file_is_known_by_its_content(tmp_path):
    values = rows()
    text = text_of(values, "time,other,velocity,rate").encode()
    np.testing.assert_array_equal(
        read(tmp_path, gzip.compress(text), "table.csv").values["time"], values[:, 0]
    )


def test_what_gives_no_flight_is_explained(tmp_path):
    with pytest.raises(MissionError, match=r"no header within the first 300 lines.*time, speed,m/s or veloc"):
        read(tmp_path, "time,place\n1,2\n")
    with pytest.raises(MissionError, match=r"3 of 5 rows .* \(2 left out from row 2 on: cells missing"):
        read(tmp_path, "time,velocity\n1\n2\n" + "1,2\n" * 3)
    with pytest.raises(MissionError, match="at most 10000 columns"):
        read(tmp_path, "time,velocity" + ",a" * 100_000 + "\n" + ("1,2" + ",3" * 100_000 + "\n") * 6)
    with pytest.raises(MissionError, match="more than 1000 headers"):
        read(tmp_path, "time,velocity\n1,2\n" * 1100)
    with pytest.raises(MissionError, match="0 of 1 rows"):
        read(tmp_path, "time,velocity\n" + "1" * 20_000_000)


def test_the_limit_holds_for_what_is_decompressed(tmp_path, monkeypatch):
    monkeypatch.setattr("lab.data.sheets.flight_columns.MAX_BYTES", 2**20)
    numbers = np.random.default_rng(2).random((40_000, 2)).tolist()
    text = "time,velocity\n" + "".join(f"{x!r},{y!r}\n" for x, y in numbers)
    (tmp_path / "large.gz").write_bytes(gzip.compress(text.encode()))
    assert (tmp_path / "large.gz").stat().st_size < 2**20 < len(text)
    with pytest.raises(MissionError, match="up to 1 MB when decompressed"):
        read_columns(tmp_path / "large.gz", PROFILE, {})


@pytest.mark.proof
@pytest.mark.parametrize(
    "text",
    [
        "time,velocity,rate\n" + "1.5,2.5,x\n" * 55_000,
        "time,velocity,rate\n" + "1.25,2.5,3.125,\n1.25,2.5\n" * 60_000,
        "time,velocity" + ",a" * 9_000 + "\n" + ("1,2" + ",3" * 9_000 + "\n") * 60,
        "time,velocity,rate\n" + "\n" * 2_000_000,
        "time,velocity,rate\n" + ",,\n" * 500_000,
    ],
    ids=["no numbers", "ragged", "wide", "blank", "empty cells"],
)
def test_a_file_takes_at_most_ten_times_its_size(tmp_path, text):
    path = tmp_path / "table.txt"
    path.write_text(text)
    read(tmp_path, "time,velocity\n" + "1,2\n" * 5, "imports_pandas.txt")
    tracemalloc.start()
    try:
        read_columns(path, PROFILE, {})
    except MissionError:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak <= 10 * len(text)


def test_names_are_compared_without_decoration():
    assert plain("  ____Q,rad/s ") == "q,rad/s"
    assert plain("Plane_Altitude") == plain("PLANE ALTITUDE") == plain('"PlaneAltitude"')


CELLS = st.one_of(
    st.floats().map(repr),
    st.text(max_size=4),
    st.sampled_from(["", "1", " 2 ", '"3"', "1e400", "time", "\0"]),
)


@given(
    lines=st.lists(st.lists(CELLS, max_size=5).map(",".join), max_size=12),
    noise=st.binary(max_size=40),
    place=st.integers(0, 200),
)
def test_anything_gives_finite_numbers_or_a_reason(tmp_path_factory, lines, noise, place):
    folder = tmp_path_factory.getbasetemp()
    content = "\n".join(["time,velocity,rate", *lines, *["1,2,3"] * 3]).encode("utf-8", "replace")
    content = content[:place] + noise + content[place:]
    for data in (content, gzip.compress(content), noise):
        try:
            table = read(folder, data)
        except MissionError as error:
            assert "table.txt" in str(error)
            continue
        for column in table.values.values():
            assert np.isfinite(column).all()
            assert len(column) == len(table.lines)
        assert len(table.lines) + sum(drop.count for drop in table.dropped) == table.rows_read
