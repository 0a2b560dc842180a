"""X-Plane's Data.txt of several versions and selections; what is not ticked is asked for."""

from __future__ import annotations

import numpy as np
import pytest
from writers import xplane_data as writer

from lab.data.formats import read_raw
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.sheets.flight_columns import OTHER_RECORDING
from lab.missions import MissionError, mission
from lab.motion.truth.trajectory import Trajectory

MONTREAL = mission("montreal").recording


@pytest.fixture
def file(tmp_path):
    """Return a function that writes columns as Data.txt and reads it."""

    def read(*recordings: dict[str, np.ndarray], units: dict[str, str] | None = None) -> RawFlight:
        path = tmp_path / "Data.txt"
        path.write_text("".join(writer.text(columns) for columns in recordings), newline="\r\n")
        return read_raw(path, units)

    return read


def without(columns: dict[str, np.ndarray], *parts: str) -> dict[str, np.ndarray]:
    return {name: value for name, value in columns.items() if not any(part in name for part in parts)}


def test_versions_differ_in_names_and_units_and_say_the_same(file):
    old, new = (file(writer.columns(MONTREAL, version)) for version in (9, 12))
    assert old.quantities == new.quantities
    assert old.body_rate is not None and new.body_rate is not None
    np.testing.assert_allclose(new.body_rate, old.body_rate, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(new.height, old.height)
    assert any("p-alt" in remark for remark in new.remarks)
    assert not any("p-alt" in remark for remark in old.remarks)
    units = {unit.column: unit.unit for unit in new.units}
    assert units["____P,deg/s"] == "°/s"
    assert units["__lat,__deg"] == "°"
    assert "_real,_time" not in units


def test_rates_are_those_of_the_attitude(file):
    flight = file(writer.columns(MONTREAL))
    rates, _ = Trajectory.from_recording(MONTREAL, 100.0).rates(MONTREAL.time[2:-2])
    assert flight.body_rate is not None
    for recorded, flown in zip(flight.body_rate[2:-2].T, rates.T, strict=True):
        assert np.corrcoef(recorded, flown)[0, 1] > 0.95
        assert 0.9 < recorded @ flown / (flown @ flown) < 1.1


def test_order_does_not_matter(file):
    columns = writer.columns(MONTREAL)
    backwards = dict(reversed(columns.items()))
    np.testing.assert_array_equal(file(backwards).velocity_n, file(columns).velocity_n)


def test_the_simulators_clock_is_taken_where_it_runs(file):
    columns = writer.columns(MONTREAL)
    assert file(columns).time[0] == 12.0
    assert file(without(columns, "totl")).time[0] == 0.0
    stopped = {**columns, "_totl,_time": 0 * MONTREAL.time, "missn,_time": 0 * MONTREAL.time}
    flight = file(stopped)
    assert flight.time[0] == 100.0
    assert any("Time is that of the computer" in remark for remark in flight.remarks)


def test_velocity_is_turned_from_the_reference_point_to_the_aircraft(file):
    columns = writer.columns(MONTREAL)
    turned, plain = file(columns).velocity_n, file(without(columns, "____X", "____Z")).velocity_n
    assert turned is not None and plain is not None
    # At 25 km the local axes are off by d/R = 0.2°, which is 0.2 m/s of 55 m/s.
    assert np.abs(turned - MONTREAL.velocity_n).max() < 2e-4
    assert 0.05 < np.abs(plain - MONTREAL.velocity_n).max() < 0.5


def test_the_longest_recording_is_taken_though_the_groups_changed(file):
    columns = writer.columns(MONTREAL)
    short = {name: value[:100] for name, value in without(columns, "alpha", "beta").items()}
    flight = file(short, columns, short)
    assert len(flight.time) == len(MONTREAL.time)
    assert flight.alpha is not None
    (dropped,) = flight.dropped
    assert (dropped.reason, dropped.count, dropped.first_row) == (OTHER_RECORDING, 200, 3)


def test_without_group_21_there_is_the_rest_and_advice(file):
    flight = file(without(writer.columns(MONTREAL), "X,", "Y,", "Z,", "alpha", "beta"))
    assert flight.velocity_n is None
    assert flight.airspeed is not None and flight.euler is not None and flight.latitude is not None
    advice = next(remark for remark in flight.remarks if "tick" in remark)
    assert "21 loc, vel, dist traveled (velocity)" in advice
    assert "18 angle of attack" in advice
    assert "17 pitch" not in advice


def test_without_position_there_is_the_rest_and_advice(file):
    flight = file(without(writer.columns(MONTREAL), "lat", "lon", "alt"))
    assert flight.latitude is None
    assert flight.velocity_n is not None
    assert any("20 latitude, longitude, altitude (position)" in remark for remark in flight.remarks)
    assert not any("above sea level" in remark for remark in flight.remarks)


def test_without_any_motion_the_groups_to_tick_are_named(file):
    assert file(without(writer.columns(MONTREAL), "lat", "alt", "m/s")).airspeed is not None
    with pytest.raises(MissionError, match=r"neither velocity nor position .*20 latitude.*; 21 loc, vel"):
        file(without(writer.columns(MONTREAL), "lat", "alt", "m/s", "ktas"))


def test_without_time_too(file):
    with pytest.raises(MissionError, match=r"no time in it\. .*1 times \(the simulator's own clock\)"):
        file(without(writer.columns(MONTREAL), "_time"))


def test_units_can_be_overruled(file):
    columns = writer.columns(MONTREAL)
    metres = {**columns, "__alt,ftmsl": MONTREAL.height}
    flight = file(metres, units={"__alt,ftmsl": "m"})
    assert flight.height is not None
    np.testing.assert_allclose(flight.height, MONTREAL.height, rtol=0, atol=1e-5)
