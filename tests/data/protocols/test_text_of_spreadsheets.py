"""Text that a spreadsheet or a logger's script sends line by line: commas, units below, words for nothing."""

import numpy as np
import pytest
from live_streams import decoded

from lab.data.protocols.text_lines import TextLines

NAMES = ("time", "lat", "lon", "alt", "vn", "ve", "vd", "gx", "gy", "gz", "ax", "ay", "az")
UNITS = ("s", "deg", "deg", "m", "m/s", "m/s", "m/s", "deg/s", "deg/s", "deg/s", "g", "g", "g")
ROWS = 400


def rows():
    """Return a level walk, a fix in every tenth row."""
    rng = np.random.default_rng(3)
    made = np.full((ROWS, 13), np.nan)
    made[:, 0] = 20.0 + 0.01 * np.arange(ROWS)
    at = np.arange(0, ROWS, 10)
    made[at, 1:7] = (46.5, 7.25, 431.5, 1.5, -0.5, 0.125)
    made[at, 1] += 1e-6 * at
    made[:, 7:10] = 20 * rng.normal(size=(ROWS, 3))
    made[:, 10:] = (0.05, -0.03, -1.0) + 0.02 * rng.normal(size=(ROWS, 3))
    return made


def lines(made, between=",", none="", point=".", head=NAMES, below=()):
    """Return the bytes of a table."""
    cells = [[none if np.isnan(x) else f"{x:.8f}".replace(".", point) for x in row] for row in made]
    return "\n".join(
        between.join(row) for row in (head, *((below,) if below else ()), *cells, ("",))
    ).encode()


def check(data, factor=np.pi / 180, gravity=9.80665):
    """Compare all samples and fixes with the rows, and return the decoder."""
    made, decoder = rows(), TextLines()
    found = decoded(decoder, data)
    assert len(found.imu) == ROWS and decoder.statistics.refused == 0
    np.testing.assert_allclose(found.imu["rate"], made[:, 7:10] * factor, atol=1e-7)
    np.testing.assert_allclose(found.imu["force"], made[:, 10:] * gravity, atol=1e-6)
    assert len(found.fix) == ROWS // 10
    np.testing.assert_allclose(np.degrees(found.fix["latitude"]), made[::10, 1], atol=1e-7)
    np.testing.assert_allclose(found.fix["velocity_n"], made[::10, 4:7], atol=1e-7)
    return decoder


def test_decimal_commas_with_a_header_and_empty_cells():
    head = [f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True)]
    decoder = check(lines(rows(), ";", point=",", head=head))
    assert decoder.columns.decimal_comma and not decoder.columns.doubt


def test_columns_that_are_not_read_have_decimal_commas_too():
    head = (
        "time [s]",
        "abc",
        "def",
        "alt",
        "u",
        "v",
        "w",
        *(f"{n} [{u}]" for n, u in zip(NAMES[7:], UNITS[7:], strict=True)),
    )
    assert len(decoded(TextLines(), lines(rows(), ";", point=",", head=head)).imu) == ROWS


def test_units_stand_in_the_line_below_the_headings():
    assert not check(lines(rows(), below=UNITS)).columns.doubt


@pytest.mark.parametrize("none", ["n/a", "N/A", "null", "none", "NaN", "-", "--"])
def test_words_for_no_fix(none):
    check(lines(rows(), none=none, below=UNITS))


@pytest.mark.parametrize(("unit", "second"), [("ms", 1e3), ("us", 1e6)])
def test_times_since_1970_are_no_counter_that_wraps(unit, second):
    made = rows()
    made[:, 0] = np.round((1.7e9 + 0.01 * np.arange(ROWS)) * second)
    head = (f"time_{unit}", *(f"{name} [{said}]" for name, said in zip(NAMES[1:], UNITS[1:], strict=True)))
    decoder = TextLines()
    found = decoded(decoder, lines(made, head=head))
    np.testing.assert_allclose(found.imu["time"] - 1.7e9, 0.01 * np.arange(ROWS), atol=1e-6)
    assert decoder.wrap_period == np.inf


def test_whole_numbers_beside_ten_millionths_of_a_degree_are_millimetres():
    made = rows()
    counts = made.copy()
    counts[:, 1:3] *= 1e7
    counts[:, 3:7] *= 1e3
    head = (*NAMES[:7], *(f"{name} [{unit}]" for name, unit in zip(NAMES[7:], UNITS[7:], strict=True)))
    cells = [
        ["" if np.isnan(x) else f"{x:.0f}" if 1 <= at < 7 else f"{x:.8f}" for at, x in enumerate(row)]
        for row in counts
    ]
    found = decoded(TextLines(), "\n".join(",".join(row) for row in (head, *cells, ("",))).encode())
    np.testing.assert_allclose(found.fix["height"], 431.5)
    np.testing.assert_allclose(found.fix["velocity_n"], np.tile((1.5, -0.5, 0.125), (ROWS // 10, 1)))


def test_a_velocity_without_a_vertical_part_is_one():
    made, head = rows(), [f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True)]
    head[6] = "satellites"
    found = decoded(TextLines(), lines(made, head=head))
    np.testing.assert_allclose(found.fix["velocity_n"][:, :2], made[::10, 4:6])
    assert np.isnan(found.fix["velocity_n"][:, 2]).all()
