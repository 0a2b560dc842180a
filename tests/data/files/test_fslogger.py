"""fsLogger's Data.csv: a real recording gives a flight whose parts agree with each other."""

from __future__ import annotations

import numpy as np
import pytest

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.formats import read_raw
from lab.missions import MissionError

HEADER = (
    "Time,Plane_Altitude,Airspeed_True,Plane_Pitch_Degrees,Plane_Bank_Degrees,Plane_Heading_Degrees_True,"
    "Plane_Latitude,Plane_Longitude,Rotation_Velocity_Body_X,Rotation_Velocity_Body_Y,Rotation_Velocity_Body_Z,"
    "Acceleration_Body_X,Acceleration_Body_Y,Acceleration_Body_Z,Velocity_World_X,Velocity_World_Y,"
    "Velocity_World_Z"
)
ROW = "{time},1000,100,2,-30,90,45,-73,1,2,3,0.1,0.2,0.3,10,20,30\n"


def small(folder, rows=ROW * 5):
    path = folder / "anything.dat"
    path.write_text(HEADER + "\n" + "".join(rows).format(time=0))
    return path


def test_units_and_signs_are_simconnects(tmp_path):
    flight = read_raw(small(tmp_path))
    assert flight.format == "MSFS/FSX fsLogger csv"
    assert flight.height is not None and flight.height[0] == pytest.approx(304.8)
    assert flight.airspeed is not None and flight.airspeed[0] == pytest.approx(185200 / 3600)
    assert flight.euler is not None and flight.body_rate is not None
    np.testing.assert_allclose(np.degrees(flight.euler[0]), [30, -2, 90])
    np.testing.assert_allclose(np.degrees(flight.body_rate[0]), [-3, -1, 2])
    assert flight.acceleration_b is not None and flight.velocity_n is not None
    np.testing.assert_allclose(flight.acceleration_b[0] / STANDARD_GRAVITY, [0.3, 0.1, -0.2])
    np.testing.assert_allclose(flight.velocity_n[0], np.array([30, 10, -20]) * 0.3048)
    assert any("above sea level" in remark for remark in flight.remarks)


@pytest.mark.parametrize("blank", [" ", "_"])
def test_the_wrapper_of_simconnect_for_python_writes_radians(tmp_path, blank):
    header = "timestamp,ABSOLUTE_TIME,GROUND_VELOCITY,PLANE_LATITUDE,PLANE_LONGITUDE," + HEADER[5:].upper()
    rows = "".join(
        f"2026-01-07T13:07:{t:02d}.5,{63794953311 + t},100,45,-73,1000,100,0.1,-0.5,1.5,45,-73,1,2,3,0,0,0,"
        "10,20,30\n" for t in range(5)
    )  # fmt: skip
    names = header.replace(",PLANE_LATITUDE,PLANE_LONGITUDE,ROT", ",A,B,ROT").replace("_", blank)
    path = tmp_path / "flight_data.csv"
    path.write_text(f"{names}\n{rows}")
    flight = read_raw(path)
    np.testing.assert_allclose(flight.euler[0], [0.5, -0.1, 1.5])
    np.testing.assert_allclose(flight.velocity_n[0], np.array([30, 10, -20]) * 0.3048)
    np.testing.assert_allclose(flight.time - flight.time[0], np.arange(5))


def test_units_can_be_overruled_by_column(tmp_path):
    flight = read_raw(small(tmp_path), {"Plane_Altitude": "metres", "plane_bank_degrees": "rad"})
    assert flight.height is not None and flight.height[0] == 1000.0
    assert flight.euler is not None and flight.euler[0, 0] == 30.0
    units = {unit.column: (unit.unit, unit.source) for unit in flight.units}
    assert units["Plane_Altitude"] == ("m", "given by you")
    assert units["Plane_Bank_Degrees"] == ("rad", "given by you")
    assert units["Airspeed_True"] == ("kt", "guessed")


@pytest.mark.parametrize(
    ("units", "message"),
    [
        (
            {"Plane_Altitude": "stone"},
            r"column Plane_Altitude: 'stone' is not a known unit of length; accepted are m, ft, km",
        ),
        ({"Plane_Height": "m"}, r"column Plane_Height, which is not read .*Plane_Altitude"),
    ],
)
def test_units_that_make_no_sense_are_refused(tmp_path, units, message):
    with pytest.raises(MissionError, match=message):
        read_raw(small(tmp_path), units)


def test_rows_no_flight_has_are_dropped(tmp_path):
    flight = read_raw(small(tmp_path, [ROW, ROW.replace("1000,100,", "1e300,100,"), *[ROW] * 5]))
    (dropped,) = flight.dropped
    assert (dropped.count, dropped.first_row) == (1, 3)
    assert "Plane_Altitude beyond -3280.84 to 328084 ft" in dropped.reason
    with pytest.raises(MissionError, match=r"0 of 5 rows .* If the unit of a column is another one, give it"):
        read_raw(small(tmp_path), {"Airspeed_True": "m/s", "Plane_Altitude": "km"})


def test_two_files_are_too_many(tmp_path):
    with pytest.raises(MissionError, match="is one file, and 2 are given"):
        read_raw([small(tmp_path), small(tmp_path)])


def test_a_real_flight_agrees_with_itself(recordings):
    flight = read_raw(recordings / "sim_msfs" / "Data.csv")
    assert len(flight.time) == flight.rows_read == 671
    assert flight.velocity_n is None
    assert flight.euler is not None and flight.body_rate is not None and flight.acceleration_b is not None
    # Groves (2.58): body rates from the change of roll, pitch and heading.
    rate = np.diff(np.unwrap(flight.euler, axis=0), axis=0) / np.diff(flight.time)[:, None]
    (sin_r, sin_p), (cos_r, cos_p) = np.sin(flight.euler[1:, :2].T), np.cos(flight.euler[1:, :2].T)
    derived = (
        rate[:, 0] - sin_p * rate[:, 2],
        cos_r * rate[:, 1] + sin_r * cos_p * rate[:, 2],
        cos_r * cos_p * rate[:, 2] - sin_r * rate[:, 1],
    )
    for one, other in zip(derived, flight.body_rate[1:].T, strict=True):
        assert np.corrcoef(one, other)[0, 1] > 0.9
    # The recorded acceleration is the change of velocity: it has no gravity in it.
    assert np.median(np.linalg.norm(flight.acceleration_b, axis=1)) < 5.0
