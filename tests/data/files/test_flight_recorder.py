"""Flight Recorder's csv: SimConnect's axes through the attitude, and whose clock it is."""

from __future__ import annotations

import numpy as np
import pytest
from writers import flight_recorder as writer

from lab.data.formats import read_raw
from lab.missions import MissionError, mission

MONTREAL = mission("montreal").recording
HEADER = (
    "Milliseconds,Latitude,Longitude,Altitude,Pitch,Bank,TrueHeading,VelocityBodyX,VelocityBodyY,VelocityBodyZ,"
    "RotationVelocityBodyX,RotationVelocityBodyY,RotationVelocityBodyZ\n"
)


def write(folder, content: bytes | str):
    path = folder / "Export.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_axes_units_and_signs_are_simconnects(tmp_path):
    # Heading east, nose 30° up (-30 of SimConnect's), going forward at 100 ft/s.
    row = "{},45,-73,1000,-30,0,90,0,0,100,0.1,0.2,0.3\n"
    flight = read_raw(write(tmp_path, HEADER + "".join(row.format(i * 20) for i in range(5))))
    assert flight.velocity_n is not None and flight.euler is not None and flight.body_rate is not None
    np.testing.assert_allclose(
        flight.velocity_n[0], 30.48 * np.array([0, np.cos(np.pi / 6), -0.5]), atol=1e-12
    )
    np.testing.assert_allclose(np.degrees(flight.euler[0]), [0, 30, 90])
    np.testing.assert_allclose(flight.body_rate[0], [-0.3, -0.1, 0.2])
    np.testing.assert_allclose(flight.time, np.arange(5) * 0.02)
    assert any("computer" in remark for remark in flight.remarks)
    # To the right of east is south; a bank of 90° to the right turns SimConnect's up to south... of the wing.
    right = read_raw(
        write(tmp_path, HEADER + "".join(f"{i},45,-73,0,0,0,90,10,0,0,0,0,0\n" for i in range(5)))
    )
    assert right.velocity_n is not None
    np.testing.assert_allclose(right.velocity_n[0], [-3.048, 0, 0], atol=1e-12)


def test_the_simulators_clock_is_taken_where_there_is_one(tmp_path):
    own = read_raw(write(tmp_path, writer.write(MONTREAL)))
    assert np.abs(own.time - MONTREAL.time).max() < 1e-5
    older = read_raw(write(tmp_path, writer.write(MONTREAL, own_clock=False)))
    assert 1e-3 < np.abs(older.time - MONTREAL.time).max() < 6e-3
    assert older.airspeed is None


def test_a_clock_that_stands_still_is_not_taken(tmp_path):
    lines = writer.write(MONTREAL).decode().splitlines()
    cells = [line.split(",") for line in lines]
    place = cells[0].index("AbsoluteTime")
    for row in cells[1:]:
        row[place] = "63886122215.27931"
    flight = read_raw(write(tmp_path, "\n".join(",".join(row) for row in cells)))
    assert np.ptp(flight.time) == pytest.approx(MONTREAL.duration, abs=0.01)


def test_zeros_in_place_of_a_velocity_are_no_velocity(tmp_path):
    moving = "".join(f"{i * 20},{45 + i * 1e-5},-73,1000,0,0,0,0,0,0,0,0,0\n" for i in range(50))
    flight = read_raw(write(tmp_path, HEADER + moving))
    assert flight.velocity_n is None
    assert any("all zero although" in remark for remark in flight.remarks)
    standing = "".join(f"{i * 20},45,-73,1000,0,0,0,0,0,0,0,0,0\n" for i in range(50))
    assert read_raw(write(tmp_path, HEADER + standing)).velocity_n is not None


def test_a_file_cut_off_in_the_header_is_refused(tmp_path):
    with pytest.raises(MissionError, match=r"0 of 0 rows"):
        read_raw(write(tmp_path, HEADER))
