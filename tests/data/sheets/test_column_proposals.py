"""What each column of a csv is taken for, with its evidence; an answer is taken as ``--column`` takes it."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.sheets.column_proposals import column_proposals
from lab.missions import MissionError


def table(path, header, force=9.80665, rows=400):
    """Write an IMU at rest with a unit of force, and a fix a second beside it, in another unit of time."""
    rng = np.random.default_rng(1)
    lines = [header]
    for i in range(rows):
        rate = rng.normal(0, 1e-3, 3)
        lines.append(",".join(f"{x:.6f}" for x in (20.0 * i, *rate, 0, 0, -force, 7.0)))
    path.write_text("\n".join(lines) + "\n")
    return path


def said(path, **units):
    return {one.heading: one for one in column_proposals([path], units)}


def test_units_that_the_numbers_show_are_proposed_as_guesses(tmp_path):
    found = said(table(tmp_path / "a.csv", "t,gx,gy,gz,ax,ay,az,foo", force=1.0))
    assert [one.said for one in found.values()] == [
        "time[ms]", *(f"rate_{axis}[°/s]" for axis in "xyz"), *(f"force_{axis}[g]" for axis in "xyz"), "-",
    ]  # fmt: skip
    assert found["ax"].unsure and "1 g long" in found["ax"].evidence
    assert not found["foo"].unsure and found["foo"].evidence == "Its heading names no quantity."


def test_what_headings_say_is_no_guess(tmp_path):
    found = said(table(tmp_path / "a.csv", "t_ms,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,foo", force=1.0))
    assert not any(one.unsure for one in found.values())
    assert found["gx_dps"].said == "rate_x[°/s]"


def test_what_the_data_do_not_decide_names_the_readings(tmp_path):
    found = said(table(tmp_path / "a.csv", "t_ms,gx,gy,gz,ax,ay,az,foo", force=980.665))
    assert found["ax"].said == "force_x"
    assert found["ax"].unsure and "cm/s² or mg: the data do not decide" in found["ax"].evidence
    said_so = said(table(tmp_path / "a.csv", "t_ms,gx,gy,gz,ax,ay,az,foo", force=980.665), ax="cm/s²")
    assert said_so["ax"].said == "force_x[cm/s²]" and not said_so["ax"].unsure
    assert said_so["ax"].evidence == "You said so."


@pytest.mark.parametrize("header", ["a,b,c,d,e,f,g,h", ""])
def test_columns_that_nothing_names_are_open(tmp_path, header):
    path = table(tmp_path / "a.csv", header)
    if not header:
        path.write_text(path.read_text().lstrip())
    found = said(path)
    assert list(found) == (list("abcdefgh") if header else [str(i) for i in range(1, 9)])
    assert all(one.said == "-" and one.unsure for one in found.values())


def test_a_quantity_that_is_none_is_refused(tmp_path):
    with pytest.raises(MissionError, match="'wing' is no quantity"):
        said(table(tmp_path / "a.csv", "t_ms,gx,gy,gz,ax,ay,az,foo"), foo="wing[m]")
