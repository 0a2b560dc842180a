"""Text lines: columns are found, shown and corrected, and damaged lines are left out."""

from __future__ import annotations

import csv
import time

import numpy as np
import pytest
from live_streams import capture, decoded, motion

from lab.data.protocols.column_guess import guess_columns
from lab.data.protocols.column_map import ColumnMap, ColumnMapError
from lab.data.protocols.number_guess import MIN_LINES
from lab.data.protocols.text_lines import TextEncoder, TextLines
from lab.data.streams.stream_detector import StreamDetector
from lab.data.streams.transport import Chunk

G = 9.80665
WALK = "csv_gnss_imu_walk_1730_head6000.csv"
RAZOR = (
    "1996551, 0.01, 0.12, -1.00, 0.73, 0.38, 0.31, 12.15, -66.92, -45.91, 0.0369, -0.7548, -0.6537, -0.0402, "
    "169.71"
)
"""SparkFun 9DoF Razor M0, issue 16 of its firmware: ms, g, °/s, µT, quaternion, heading."""
SEVEN = ColumnMap.of("time[ms],force_x[g],force_y[g],force_z[g],rate_x[°/s],rate_y[°/s],rate_z[°/s]")


def seven(time: float, force: float = -1.0, rate: float = 0.5) -> str:
    """Return a line of seven columns."""
    return f"{time},0.01,0.02,{force},{rate},0.1,0.2"


def stream(*lines: str) -> bytes:
    """Return lines after an end of a line."""
    return ("\n" + "".join(f"{line}\n" for line in lines)).encode()


def test_a_capture_that_begins_in_a_line_has_the_values_of_its_cells():
    data = capture(WALK)
    decoder = TextLines()
    imu = decoded(decoder, data).imu
    assert str(decoder.columns) == (
        "force_x[g],force_y[g],force_z[g],rate_x[°/s],rate_y[°/s],rate_z[°/s],time[ms]"
    )
    rows = np.array(
        [
            [float(cell) for cell in row]
            for row in list(csv.reader(data.decode().splitlines()))[1:]
            if len(row) == 7
        ]
    )
    assert len(imu) == len(rows) == 5999
    np.testing.assert_allclose(imu["force"], rows[:, :3] * G, rtol=1e-14)
    np.testing.assert_allclose(imu["rate"], np.radians(rows[:, 3:6]), rtol=1e-14)
    np.testing.assert_allclose(imu["time"], rows[:, 6] * 1e-3, rtol=1e-14)
    assert decoder.statistics.refused == 0


@pytest.mark.parametrize(
    ("name", "quantity", "other"), [("accelerometer", "force", "rate"), ("gyroscope", "rate", "force")]
)
def test_an_export_of_a_phone_names_its_columns(name, quantity, other):
    data = capture(f"phyphox_{name}_head3000.csv")
    decoder = TextLines()
    imu = decoded(decoder, data).imu
    rows = np.array(list(csv.reader(data.decode().splitlines()))[1:], dtype=float)
    assert len(imu) == len(rows) == 3000
    np.testing.assert_array_equal(imu["time"], rows[:, 0])
    np.testing.assert_array_equal(imu[quantity], rows[:, 1:])
    assert np.isnan(imu[other]).all()


def test_columns_of_a_known_logger_are_found_without_a_header():
    values = [float(cell) for cell in RAZOR.split(",")]
    rng = np.random.default_rng(2)
    lines = []
    for number in range(12):
        row = np.array(values) + 0.01 * rng.standard_normal(len(values))
        row[0] = values[0] + 10 * number
        lines.append(", ".join([f"{row[0]:.0f}", *(f"{value:.4f}" for value in row[1:])]))
    found = guess_columns(lines)
    assert found is not None
    assert str(found).startswith(
        "time[ms],force_x[g],force_y[g],force_z[g],rate_x[°/s],rate_y[°/s],rate_z[°/s],"
        "magnetic_x[µT],magnetic_y[µT],magnetic_z[µT],-,-,-,-"
    )
    assert any("a guess" in remark for remark in found.remarks)
    decoder = TextLines(found)
    (row,) = decoded(decoder, stream(RAZOR)).imu
    assert row["time"] == pytest.approx(1996.551)
    np.testing.assert_allclose(row["force"], np.array((0.01, 0.12, -1)) * G)
    np.testing.assert_allclose(row["rate"], np.radians((0.73, 0.38, 0.31)))
    np.testing.assert_allclose(row["magnetic"], np.array((12.15, -66.92, -45.91)) * 1e-6)


@pytest.mark.parametrize(
    ("lines", "separator", "columns"),
    [
        (
            ["t;gx;gy;gz;ax;ay;az"],
            ";",
            "time[ms],rate_x[rad/s],rate_y[rad/s],rate_z[rad/s],force_x[m/s²],force_y[m/s²],force_z[m/s²]",
        ),
        (
            ["# millis gx(deg/s) gy(deg/s) gz(deg/s) ax(g) ay(g) az(g)"],
            " ",
            "time[ms],rate_x[°/s],rate_y[°/s],rate_z[°/s],force_x[g],force_y[g],force_z[g]",
        ),
        ([], "\t", "time[ms],-,-,-,force_x[m/s²],force_y[m/s²],force_z[m/s²]"),
    ],
)
def test_separators_and_headers(lines, separator, columns):
    rows = [
        separator.join(
            f"{value:g}"
            for value in (
                10 * number,
                0.01,
                -0.02 - 1e-3 * number,
                0.03,
                0.1,
                0.2,
                1.0 if "(g)" in str(lines) else 9.8,
            )
        )
        for number in range(10)
    ]
    found = guess_columns([*lines, *rows])
    assert found is not None
    assert found.separator == separator
    if lines:
        assert ",".join(map(str, found.columns)) == columns
    else:
        named = ",".join(map(str, found.columns))
        assert named.replace("rate_x[rad/s],rate_y[rad/s],rate_z[rad/s]", "-,-,-") == columns


def test_decimal_commas_are_read():
    rows = [f"{10 * number};0,01;0,02;-1,0{number % 10};1,5;-2,5;3,25" for number in range(10)]
    decoder = TextLines()
    imu = decoded(decoder, stream(*rows)).imu
    assert decoder.columns is not None
    assert decoder.columns.decimal_comma
    np.testing.assert_allclose(np.degrees(imu["rate"][0]), (1.5, -2.5, 3.25))


def test_lines_of_the_razor_firmware_are_known_by_their_prefix():
    rows = [f"#YPRAG=1.0,2.0,3.0,{number},10,-256,0.25,-0.5,0.75" for number in range(9)]
    imu = decoded(TextLines(), stream(*rows)).imu
    np.testing.assert_allclose(imu["force"][5], np.array((5, 10, -256)) * G / 256)
    np.testing.assert_allclose(imu["rate"][5], (0.25, -0.5, 0.75))


def test_a_person_corrects_the_map():
    lines = [seven(10 * number) for number in range(20)]
    decoder = TextLines()
    decoded(decoder, stream(*lines))
    assert decoder.columns is not None
    assert "separated by comma: time[ms],force_x[g]" in decoder.columns.described
    corrected = ColumnMap.of(str(decoder.columns).replace("rate_x[°/s]", "rate_x[rad/s]"))
    imu = decoded(TextLines(corrected), stream(*lines)).imu
    assert imu["rate"][0].tolist() == pytest.approx([0.5, np.radians(0.1), np.radians(0.2)])
    swapped = ColumnMap.of("time[ms],force_y[g],force_x[g],force_z[g],-,-,-")
    imu = decoded(TextLines(swapped), stream(*lines)).imu
    np.testing.assert_allclose(imu["force"][0], np.array((0.02, 0.01, -1)) * G)


@pytest.mark.parametrize(
    "line",
    [
        "{0};0,01;0,02;-1,0;1,5;-2,5;3,25",
        "{0}\t0.01\t0.02\t-1.0\t1.5\t-2.5\t3.25",
        "{0} 0.01 0.02 -1.0 1.5 -2.5 3.25",
        "IMU: {0},0.01,0.02,-1.0,1.5,-2.5,3.25",
        "#YPRAG=1.0,2.0,3.0,{0},10,-256,0.25,-0.5,0.75",
    ],
)
def test_a_map_that_is_written_down_reads_the_same_lines(line: str) -> None:
    """A recording keeps the map as text; its replay once read lines with semicolons as lines with commas."""
    data = stream(*(line.format(10 * number) for number in range(20)))
    decoder = TextLines()
    imu = decoded(decoder, data).imu
    assert len(imu) == 20
    assert decoder.columns is not None
    again = TextLines(ColumnMap.of(str(decoder.columns)))
    assert decoded(again, data).imu.tobytes() == imu.tobytes()
    assert str(decoder.columns) in decoder.evidence


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "force_x[g],force_y[g],force_z[g];colon",
            "'colon' says nothing about the lines; accepted are comma",
        ),
        ("time[ms],speed_x[m/s]", "'speed_x' is no quantity; accepted are time"),
        ("force_x[lb],force_y[g],force_z[g]", "force_x: 'lb' is no unit of it; accepted are m/s²"),
        ("force_x[g],force_x[g]", "force_x is there more than once"),
        ("force_x[g],force_y[g]", "force has only x, y"),
        ("time[ms]", "no column is a rate, a force or a latitude"),
        ("force_x(g)", "is no column; accepted is quantity"),
    ],
)
def test_what_is_no_map_is_refused(text, words):
    with pytest.raises(ColumnMapError, match=words):
        ColumnMap.of(text)


def test_the_line_in_which_a_stream_begins_is_left_out():
    lines = "".join(f"{seven(10 * number)}\n" for number in range(20)).encode()
    decoder = TextLines(SEVEN)
    # "10,0.01,…" cut after its first digit would be a sample at the wrong time.
    assert len(decoded(decoder, lines[30:]).imu) == 18
    assert decoder.statistics.skipped == len(seven(10)) - 1


def test_lines_that_are_not_whole_are_left_out():
    good = [seven(10 * number) for number in range(20)]
    bad = [
        "1000",
        seven(55) + ",7",
        seven(55)[:-3] + "x",
        seven(55).replace(".", "..", 1),
        "nan,1,2,3,4,5,6",
        "x" * 3000,
    ]
    mixed = [line for pair in zip(good, bad * 4, strict=False) for line in pair]
    decoder = TextLines(SEVEN)
    assert decoded(decoder, stream(*mixed)).imu["time"] == pytest.approx(np.arange(20) * 0.01)
    assert decoder.statistics.failed + decoder.statistics.unknown + 3 == 20  # three overlong lines


def test_jumps_of_a_line_are_refused_and_those_that_stay_are_motion():
    lines = [seven(10 * number, force=-1.0 if number != 5 else -1001.0) for number in range(20)]
    lines[8] = seven(10 * 8, force=-30.0)  # a lost decimal point
    lines[11] = seven(10 * 1100)  # a damaged time
    lines[15:] = [seven(10 * number, force=-20.0) for number in range(15, 20)]  # hit, and held
    decoder = TextLines(SEVEN)
    imu = decoded(decoder, stream(*lines)).imu
    assert decoder.statistics.refused == 4
    assert np.round(imu["time"] * 100).tolist() == [
        number for number in range(20) if number not in (5, 8, 11, 15)
    ]


@pytest.mark.parametrize("broken", [False, True])
def test_lines_with_many_empty_cells_take_as_long_as_others(broken: bool):
    """Blanks beside a tab are no other tabs: the empty cells of a line are parted in one way."""
    columns = ColumnMap.of("time[ms]," + "-," * 12 + "force_x[g],force_y[g],force_z[g];tab")
    row = "\t" * 13 + "0.01\t0.02\t-1" + "\tx" * broken
    begin = time.process_time()
    imu = decoded(TextLines(columns), stream(*(f"{number}0{row}" for number in range(300)))).imu
    assert time.process_time() - begin < 1.0
    assert len(imu) == (0 if broken else 300)


def test_one_damaged_time_that_passes_costs_no_other_line():
    times = [0, 10, 20, 30, 64, 50, 60, 70]
    imu = decoded(TextLines(SEVEN), stream(*map(seven, times))).imu
    assert np.round(imu["time"] * 1e3).tolist() == times


def test_a_counter_of_microseconds_goes_on_when_it_starts_again():
    micro = ColumnMap.of(str(SEVEN).replace("[ms]", "[µs]"))
    times = [(2**32 - 50_000 + 10_000 * number) % 2**32 for number in range(12)]
    decoder = TextLines(micro)
    imu = decoded(decoder, stream(*map(seven, times))).imu
    np.testing.assert_allclose(np.diff(imu["time"]), 0.01, atol=1e-9)
    assert decoder.wrap_period == pytest.approx(4294.967296)


def test_a_device_that_starts_again_is_followed():
    times = [*range(5000, 5200, 10), *range(0, 200, 10)]
    decoder = TextLines(SEVEN)
    assert len(decoded(decoder, stream(*map(seven, times))).imu) == 40
    assert decoder.statistics.refused == 0


def test_no_columns_are_found_in_other_text():
    for lines in (
        ["Lorem ipsum, dolor, sit"] * 30,
        [f"{number},{number * 2}" for number in range(30)],
        ["1,2,3"] * 30,
    ):
        assert guess_columns(lines) is None


def test_lines_are_called_unrecognised_only_after_columns_were_looked_for_in_them():
    detector = StreamDetector(TextLines.name, None, {}, {})
    lines = [f"D {number % 3} {number % 5} 7" for number in range(MIN_LINES)]
    detector.accept(Chunk(0.0, stream(*lines[:-1])))
    assert detector.last_lines == ()
    detector.accept(Chunk(0.1, stream(lines[-1])))
    assert detector.last_lines == tuple(lines[-3:])


def test_what_is_encoded_is_read_again_to_the_last_bit():
    imu = motion(100)
    encoder, decoder = TextEncoder(), TextLines()
    data = encoder.encode(imu[:40], imu[:0]) + encoder.encode(imu[40:], imu[:0])
    found = decoded(decoder, data).imu
    for name in ("time", "rate", "force"):
        np.testing.assert_array_equal(found[name], imu[name])


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        (
            "timestamp_us,w_x,w_y,w_z,f_x,f_y,f_z,mx,my,mz",
            "time[µs],rate_x[°/s],rate_y[°/s],rate_z[°/s],force_x[g],force_y[g],force_z[g],"
            "magnetic_x[µT],magnetic_y[µT],magnetic_z[µT]",
        ),
        (
            "linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,angular_velocity.x,"
            "angular_velocity.y,angular_velocity.z",
            "force_x[g],force_y[g],force_z[g],rate_x[°/s],rate_y[°/s],rate_z[°/s]",
        ),
    ],
)
def test_headings_are_read_as_those_of_csv_files(header, columns):
    count = header.count(",") + 1
    rows = np.full((20, count), 0.1) + 0.01 * np.random.default_rng(1).standard_normal((20, count))
    if header.startswith("time"):
        rows[:, 0] = 10_000.0 * np.arange(20)
        rows[:, 7:] += 25.0  # the field of the Earth [µT]
    upright = header.split(",").index("f_z" if "f_z" in header else "linear_acceleration.z")
    rows[:, upright] = -1.0
    found = guess_columns([header, *(",".join(f"{value:g}" for value in row) for row in rows)])
    assert str(found) == columns


@pytest.mark.parametrize(
    ("headings", "found"),
    [("heading,speed", False), ("heading_deg,ground speed", False), ("true heading,wheel speed", True)],
)
def test_a_heading_or_a_speed_of_unknown_kind_is_not_guessed(headings, found):
    """A magnetometer's heading is off by the declination, and a receiver's speed is no odometer's."""
    rows = np.full((20, 8), 0.1) + 0.01 * np.random.default_rng(1).standard_normal((20, 8))
    rows[:, 5] = -1.0
    lines = [f"wx,wy,wz,fx,fy,fz,{headings}", *(",".join(f"{value:g}" for value in row) for row in rows)]
    guessed = str(guess_columns(lines))
    assert ("heading[°]" in guessed) == ("speed[m/s]" in guessed) == found


def test_a_line_of_colours_alone_and_numbers_beyond_all_are_no_trouble():
    """Both were found by mutated streams."""
    colours = b"\n\x1b[0m\r\n\x1b[0;32m\n"
    huge = b"".join(b"a: 1e200 b: 2e200 c: %de200 ax: 0 ay: 0 az: 9.8\n" % k for k in range(20))
    with np.errstate(all="raise"):
        assert len(decoded(TextLines(), colours).imu) == 0
        decoder = TextLines()
        assert len(decoded(decoder, huge).imu) == 20
