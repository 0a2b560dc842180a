"""Our own csv among the foreign formats: as strict as ever, with the same words."""

from __future__ import annotations

import numpy as np
import pytest
from flights import circle, csv_text, table

from lab.data.formats import read_raw
from lab.missions import MissionError, read_flight_csv


def test_it_is_read_as_everywhere(tmp_path):
    path = tmp_path / "flight.txt"
    path.write_text("# a remark\n" * 500 + csv_text(table(circle(samples=20))))
    flight, recording = read_raw(path), read_flight_csv(path)
    for name in ("time", "latitude", "longitude", "height", "velocity_n", "euler"):
        np.testing.assert_array_equal(getattr(flight, name), getattr(recording, name))
    assert flight.airspeed is None
    assert {unit.column: unit.unit for unit in flight.units}["velocity_north_m_s"] == "m/s"
    assert {unit.column: unit.unit for unit in flight.units}["yaw_deg"] == "°"
    assert len(flight.units) == 10


def test_a_file_with_some_of_the_headings_is_a_csv_with_named_columns(tmp_path):
    path = tmp_path / "flight.txt"
    path.write_text(csv_text(table(circle(samples=60))))
    own = read_raw(path)
    path.write_text(csv_text(table(circle(samples=60))).replace("roll_deg", "bank_deg"))
    other = read_raw(path)
    assert (own.format, other.format) == ("INS Lab flight csv", "csv with named columns")
    for name in ("latitude", "longitude", "height", "velocity_n"):
        np.testing.assert_allclose(getattr(other, name), getattr(own, name), atol=1e-9)
    np.testing.assert_allclose(np.sin((other.euler - own.euler) / 2), 0.0, atol=1e-9)


def test_what_is_wrong_is_named_as_everywhere(tmp_path):
    path = tmp_path / "flight.txt"
    path.write_text(csv_text(table(circle(samples=20))).replace(",", ";"))
    with pytest.raises(MissionError, match="commas, not semicolons"):
        read_raw(path)
    path.write_text(csv_text(table(circle(samples=20))))
    with pytest.raises(MissionError, match="a unit is given for roll_deg"):
        read_raw(path, {"roll_deg": "rad"})
