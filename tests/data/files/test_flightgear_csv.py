"""FlightGear's own logs: whatever the titles, the flight that was flown; and no other program's csv."""

from __future__ import annotations

import numpy as np
import pytest
from writers import flightgear_csv as writer

from lab.data.formats import read_raw, reader_of
from lab.missions import MissionError, Recording, mission, prepare_import


@pytest.fixture(scope="module")
def flown() -> Recording:
    return mission("montreal").recording


@pytest.fixture
def file(tmp_path):
    """Return a function that writes columns and reads them as FlightGear's."""

    def read(logged: dict[str, np.ndarray], delimiter: str = ",", units=None):
        path = tmp_path / "fg_log.csv"
        path.write_bytes(writer.text(logged, delimiter))
        by_path = any("/position" in title for title in logged)
        assert reader_of(path).name == ("FlightGear csv" if by_path else "csv with named columns")
        return read_raw(path, units)

    return read


def check(flight, flown: Recording, height: float = 1.0) -> None:
    np.testing.assert_allclose(flight.time - flight.time[0], flown.time - flown.time[0], atol=2e-7)
    np.testing.assert_allclose(flight.latitude, flown.latitude, atol=2e-9)
    np.testing.assert_allclose(flight.longitude, flown.longitude, atol=2e-9)
    np.testing.assert_allclose(flight.height, flown.height * height, rtol=1e-6)
    if flight.velocity_n is not None:
        np.testing.assert_allclose(flight.velocity_n, flown.velocity_n, atol=1e-6)
        np.testing.assert_allclose(np.sin(flight.euler - flown.euler), 0.0, atol=1e-8)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("titles", [writer.TITLES, writer.PATHS])
def test_titles_and_paths_give_the_flight(file, flown, titles, delimiter):
    logged = dict(zip(titles, writer.columns(flown).values(), strict=True))
    check(file(logged, delimiter), flown)


def test_units_in_the_titles_count(file, flown):
    logged = writer.columns(flown)
    metres = {
        "Time (s)": logged["Time"],
        " Latitude [deg]": logged["Latitude (deg)"],
        "longitude-deg": logged["Longitude (deg)"],
        "Altitude (m MSL)": flown.height,
        "Roll (rad)": flown.euler[:, 0],
        "Pitch_deg": logged["Pitch (deg)"],
        "True Heading (degrees)": logged["Heading (deg)"],
        "vn (m/s)": flown.velocity_n[:, 0],
        "ve (kt)": flown.velocity_n[:, 1] * 3600 / 1852,
        "vd (ft/min)": flown.velocity_n[:, 2] * 60 / 0.3048,
    }
    check(file(metres), flown)
    check(file(metres, units={"Altitude (m MSL)": "ft"}), flown, height=0.3048)


def test_milliseconds_are_told_by_the_speed(file, flown):
    rows = np.arange(0, len(flown.time), 10)
    logged = {title: value[rows] for title, value in writer.columns(flown).items()}
    seconds = logged["Time"]
    logged["Time"] = np.round(1000 * seconds)
    flight = file(logged)
    np.testing.assert_allclose(flight.time, seconds, atol=6e-4)
    assert any("in ms (guessed" in remark for remark in flight.remarks)
    # Every ten seconds, which are seconds.
    rows = np.arange(0, len(flown.time), int(10 / (flown.time[1] - flown.time[0])))
    logged = {title: value[rows] for title, value in writer.columns(flown).items()}
    logged["Time"] = np.round(logged["Time"])
    np.testing.assert_array_equal(file(logged).time, logged["Time"])


def test_the_report_finds_nothing_wrong(tmp_path, flown):
    path = tmp_path / "fg_log.csv"
    path.write_bytes(writer.write(flown))
    assert prepare_import(path).report.verdict == "plausible"


def test_milliseconds_of_paths_are_told_by_the_speed(file, flown):
    rows = np.arange(0, len(flown.time), 10)
    logged = {
        title: value[rows] for title, value in zip(writer.PATHS, writer.columns(flown).values(), strict=True)
    }
    seconds = logged["Time"]
    logged["Time"] = np.round(1000 * seconds)
    flight = file(logged)
    np.testing.assert_allclose(flight.time, seconds, atol=6e-4)
    assert any("milliseconds" in remark for remark in flight.remarks)


@pytest.mark.parametrize(
    "text",
    [
        b"Latitude (deg),Longitude (deg),Altitude (ft)\n45,7,100\n45,7,100\n",
        b"/position/latitude-deg,/position/longitude-deg\n45,7\n45,7\n",
    ],
)
def test_a_table_without_a_time_is_refused(text, tmp_path):
    path = tmp_path / "x.csv"
    path.write_bytes(text)
    with pytest.raises(MissionError, match="its format is unknown"):
        reader_of(path)
