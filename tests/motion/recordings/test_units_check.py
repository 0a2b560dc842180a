"""Numbers in another unit than their column's are noticed, and honest flights are not suspected."""

from __future__ import annotations

import numpy as np
import pytest
from flights import circle, csv_text, table
from polar_flights import FLIGHTS, over_the_pole

from lab.missions import MissionError, mission, missions, read_flight_csv
from lab.motion.recordings.units_check import check_units

POSITION, VELOCITY, ATTITUDE = slice(1, 3), slice(4, 7), slice(7, 10)


def scaled(columns: slice, factor: float, **flight: float) -> np.ndarray:
    values = table(circle(**flight))
    values[:, columns] *= factor
    return values


@pytest.mark.parametrize("latitude", [0.0, 45.0, -33.0, 70.0])
@pytest.mark.parametrize("heading", [0.0, 90.0, 200.0])
@pytest.mark.parametrize("turn", [0.0, 270.0, -60.0])
def test_positions_in_radians(latitude, heading, turn):
    values = scaled(POSITION, np.pi / 180, latitude=latitude, heading=heading, turn=turn)
    with pytest.raises(MissionError, match=r"flight.csv.*latitude_deg and longitude_deg.*radians"):
        check_units("flight.csv", values)


@pytest.mark.parametrize("heading", [0.0, 90.0, 200.0])
@pytest.mark.parametrize("turn", [270.0, -90.0, 80.0])
def test_attitude_in_radians(heading, turn):
    values = scaled(ATTITUDE, np.pi / 180, heading=heading, turn=turn)
    values[:, 9] = np.remainder(values[:, 9], 2 * np.pi)
    with pytest.raises(MissionError, match=r"flight.csv.*roll_deg, pitch_deg and yaw_deg.*radians"):
        check_units("flight.csv", values)


@pytest.mark.parametrize(
    ("factor", "unit"),
    [(1 / 0.514444, "knots"), (1 / 0.3048, "feet"), (3.6, "km/h"), (1 / 0.44704, "miles")],
)
def test_velocity_in_another_unit(factor, unit):
    with pytest.raises(MissionError, match=f"velocity_north_m_s.*{unit}"):
        check_units("flight.csv", scaled(VELOCITY, factor))


def test_time_in_milliseconds():
    with pytest.raises(MissionError, match=r"time_s.*milliseconds"):
        check_units("flight.csv", scaled(slice(0, 1), 1000))


@pytest.mark.parametrize("latitude", [0.0, 45.0, -33.0, 70.0])
@pytest.mark.parametrize("heading", [0.0, 3.0, 90.0, 200.0])
@pytest.mark.parametrize("turn", [0.0, 5.0, 270.0, -700.0])
def test_honest_flights_pass(latitude, heading, turn):
    check_units("flight.csv", scaled(POSITION, 1.0, latitude=latitude, heading=heading, turn=turn))


@pytest.mark.parametrize("name", FLIGHTS)
def test_flights_over_a_pole_pass_and_their_units_are_checked(name):
    """Where longitude jumps by 180° and the course turns over."""
    values = table(over_the_pole(**FLIGHTS[name]))
    check_units("flight.csv", values)
    for columns, factor, what in (
        (VELOCITY, 1 / 0.514444, "velocity_north_m_s.*knots"),
        (POSITION, np.pi / 180, "latitude_deg and longitude_deg.*radians"),
        (slice(0, 1), 1000, "time_s.*milliseconds"),
    ):
        wrong = values.copy()
        wrong[:, columns] *= factor
        with pytest.raises(MissionError, match=what):
            check_units("flight.csv", wrong)


def test_honest_oddities_pass():
    crabbing = scaled(POSITION, 1.0, turn=0.0, heading=6.0)
    crabbing[:, 9] = 0.2  # nose 6° off the course, in strong wind
    sideways = scaled(POSITION, 1.0, turn=0.0, heading=90.0)
    sideways[:, 9] = 0.0  # a drone
    standing = scaled(POSITION, 1.0)
    standing[:, 1:3], standing[:, VELOCITY] = standing[0, 1:3], 0.0
    across_the_date_line = scaled(POSITION, 1.0)
    across_the_date_line[:, 2] = (across_the_date_line[:, 2] + 73.5 + 360.0) % 360.0 - 180.0
    rounded = scaled(POSITION, 1.0)
    rounded[:, 1:3] = np.round(rounded[:, 1:3], 5)
    for values in (crabbing, sideways, standing, across_the_date_line, rounded):
        check_units("flight.csv", values)


def test_shipped_flights_in_radians_are_noticed(tmp_path):
    for name in ("montreal", "los_angeles"):
        values = table(missions()[name].recording)
        path = tmp_path / f"{name}.csv"
        for columns, column in (
            (POSITION, "latitude_deg"),
            (ATTITUDE, "yaw_deg"),
            (slice(1, 10), "latitude_deg"),
        ):
            spoilt = values.copy()
            spoilt[:, columns] = np.radians(spoilt[:, columns])
            if columns == slice(1, 10):
                spoilt[:, 3:7] = values[:, 3:7]
            path.write_text(csv_text(spoilt), encoding="utf-8")
            with pytest.raises(MissionError, match=f"{column}.*radians"):
                read_flight_csv(path)
        path.write_text(csv_text(values), encoding="utf-8")
        assert mission(path).duration > 100
