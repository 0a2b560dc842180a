"""The aircraft the pilot flies, and every manoeuvre and every kind of weather by what it should look like."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from lab.flying.aircraft import AIRCRAFT
from lab.flying.simulated_aircraft import SimulatedAircraft
from lab.flying.weather import Gust
from lab.missions import FlightPlan, MissionError, Recording, fly

pytest.importorskip("jsbsim", reason="flying needs the extra 'fly'")

LIGHT = {"wind_from_deg": 40.0, "wind_m_s": 5.0, "turbulence_severity": 2, "turbulence_wind_m_s": 5.0}


def in_the_air(*manoeuvres: dict[str, Any], seconds: float, **others: Any) -> Recording:
    """Return a flight from 1000 m above the ground, which it must fly to its end."""
    start = {"latitude_deg": -33.0, "longitude_deg": 151.0, "height_m": 1000.0, "heading_deg": 80.0}
    start |= others.pop("start", {})
    plan = {"duration_s": seconds, "air_start": start, "manoeuvres": list(manoeuvres), **others}
    flight = fly(FlightPlan.from_dict(plan))
    assert flight.ending == ""
    return flight.recording


def turned(flight: Recording) -> np.ndarray:
    """Return the heading since the start [°], unwrapped."""
    heading = np.unwrap(flight.euler[:, 2])
    return np.degrees(heading - heading[0])


@pytest.mark.proof
@pytest.mark.parametrize("name", AIRCRAFT)
def test_every_aircraft_takes_off_climbs_turns_and_descends_in_light_turbulence(name):
    aircraft = AIRCRAFT[name]
    bank = min(aircraft.limits["bank_deg"][1], 30.0)
    plan = {
        "aircraft": name,
        "duration_s": 340.0 if name == "J3Cub" else 190.0,
        "runway": {"latitude_deg": 47.0, "longitude_deg": 11.0, "height_m": 580.0, "heading_deg": 80.0},
        "air": LIGHT,
        "manoeuvres": [
            {"do": "take_off"},
            {"do": "climb", "height_m": 220.0},
            {"do": "turn_by", "angle_deg": 120.0, "bank_deg": bank},
            {"do": "descend", "height_m": 150.0},
            {"do": "hold", "seconds": 5.0},
        ],
    }
    flight = fly(FlightPlan.from_dict(plan))
    assert flight.ending == ""
    end = flight.recording.time > flight.recording.time[-1] - 5
    height = flight.recording.height - flight.recording.height[0]
    assert height.max() == pytest.approx(220, abs=15)
    assert height[end].mean() == pytest.approx(150, abs=8)
    assert flight.recording.airspeed[end].mean() == pytest.approx(aircraft.airspeed, abs=3)
    assert turned(flight.recording)[end].mean() == pytest.approx(120, abs=4)
    assert np.degrees(flight.recording.euler[:, 0]).max() == pytest.approx(bank, abs=6)


@pytest.mark.parametrize("name", AIRCRAFT)
def test_every_aircraft_starts_in_the_air_in_trim_in_any_wind(name):
    slow, fast = AIRCRAFT[name].limits["airspeed_m_s"]
    for airspeed in (slow, 0.8 * fast):
        flight = in_the_air(
            {"do": "hold", "seconds": 5.0},
            seconds=6.0,
            aircraft=name,
            start={"airspeed_m_s": airspeed},
            air={"wind_from_deg": 10.0, "wind_m_s": 15.0},
        )
        assert flight.airspeed[0] == pytest.approx(airspeed, abs=0.01)
        assert flight.beta[0] == pytest.approx(0, abs=1e-6)
        assert flight.height[0] == pytest.approx(1000, abs=1e-3)
        wind = -15.0 * np.array([math.cos(math.radians(10)), math.sin(math.radians(10)), 0.0])
        course = airspeed * np.array([math.cos(math.radians(80)), math.sin(math.radians(80)), 0.0])
        np.testing.assert_allclose(flight.velocity_n[0], course + wind, rtol=0, atol=0.01)
        assert np.ptp(flight.airspeed) < 0.5
        assert np.ptp(flight.height) < 1
        # No jump at the start: a hundredth of g at most between the first samples, and little later.
        acceleration = np.linalg.norm(np.diff(flight.velocity_n, axis=0), axis=1) / np.diff(flight.time)
        assert acceleration[:3].max() < 0.1
        assert acceleration.max() < 0.5


def test_a_figure_of_eight_closes_in_still_air():
    flight = in_the_air({"do": "figure_eight", "bank_deg": 30.0}, seconds=110.0)
    heading = turned(flight)
    assert heading.max() == pytest.approx(360, abs=8)
    assert heading[-1] == pytest.approx(0, abs=3)
    assert np.degrees(flight.euler[:, 0]).min() == pytest.approx(-30, abs=4)
    east = np.radians(80)
    across = -flight.velocity_n[:, 0] * math.sin(east) + flight.velocity_n[:, 1] * math.cos(east)
    radius = 40.0**2 / (9.81 * math.tan(math.radians(30)))
    reach = CubicSpline(flight.time, across).antiderivative()(flight.time)
    # Two circles side by side; rolling in and out at 8°/s widens them.
    assert 4 * radius < np.ptp(reach[heading > 5]) < 4.6 * radius
    assert np.ptp(flight.height) < 12


def test_s_turns_go_there_and_back():
    flight = in_the_air(
        {"do": "s_turns", "turns": 3, "angle_deg": 90.0, "direction": "left", "bank_deg": 35.0}, seconds=75.0
    )
    heading = turned(flight)
    there = np.flatnonzero(heading < -85)
    back = np.flatnonzero(heading[there[0] :] > -5) + there[0]
    assert heading[there[0] : back[0]].min() == pytest.approx(-90, abs=4)
    assert heading[back[0] :].max() == pytest.approx(0, abs=4)
    assert heading[-1] == pytest.approx(-90, abs=3)


@pytest.mark.proof
def test_a_turn_by_more_than_once_around_and_a_skid():
    coordinated = in_the_air({"do": "turn_by", "angle_deg": 400.0, "bank_deg": 30.0}, seconds=60.0)
    assert turned(coordinated)[-1] == pytest.approx(400, abs=3)
    for direction, sign in (("right", 1), ("left", -1)):
        turn = {
            "do": "turn_by",
            "angle_deg": 150.0,
            "direction": direction,
            "skid_deg": 5.0,
            "bank_deg": 20.0,
        }
        skid = in_the_air(turn, seconds=60.0)
        assert turned(skid)[-1] == pytest.approx(sign * 150, abs=3)
        turning = (sign * turned(skid) > 40) & (sign * turned(skid) < 120)
        # The air comes from outside the nose's turn: from the left where it turns right.
        assert np.degrees(skid.beta[turning]).mean() == pytest.approx(-sign * 5, abs=1)
        assert abs(np.degrees(skid.beta[-1])) < 0.5


def test_level_and_speed_end_where_they_say():
    flight = in_the_air(
        {"do": "climb", "height_m": 1500.0, "rate_m_s": 3.0, "seconds": 20.0},
        {"do": "level"},
        {"do": "speed", "airspeed_m_s": 48.0},
        {"do": "hold", "seconds": 10.0},
        seconds=70.0,
    )
    climb = -flight.velocity_n[:, 2]
    assert climb[(flight.time > 12) & (flight.time < 20)].mean() == pytest.approx(3.0, abs=0.2)
    after = flight.time > 35
    assert np.ptp(flight.height[after]) < 8
    assert abs(climb[flight.time > 60]).max() < 0.3
    assert flight.height[-1] < 1090
    assert flight.airspeed[-1] == pytest.approx(48, abs=1)


def test_a_gust_is_felt_as_one_minus_cosine():
    gust = {
        "time_s": 5.0,
        "speed_m_s": 6.0,
        "from_deg": 80.0,
        "updraught_m_s": 1.0,
        "rise_s": 2.0,
        "hold_s": 1.0,
    }
    air = {"gusts": [gust, {"time_s": 6.0, "speed_m_s": 2.0, "from_deg": 80.0}]}
    flight = in_the_air({"do": "hold", "seconds": 5.0}, seconds=12.0, air=air)
    roll, pitch, yaw = flight.euler.T
    u = flight.airspeed * np.cos(flight.alpha) * np.cos(flight.beta)
    v = flight.airspeed * np.sin(flight.beta)
    w = flight.airspeed * np.sin(flight.alpha) * np.cos(flight.beta)
    # Stevens & Lewis, eq. 1.3-20, as in the tests of flights.
    up = v * np.sin(roll) + w * np.cos(roll)
    forward, side = u * np.cos(pitch) + up * np.sin(pitch), v * np.cos(roll) - w * np.sin(roll)
    down = -u * np.sin(pitch) + up * np.cos(pitch)
    north = forward * np.cos(yaw) - side * np.sin(yaw)
    east = forward * np.sin(yaw) + side * np.cos(yaw)
    felt = flight.velocity_n - np.column_stack([north, east, down])
    one = np.interp(flight.time, [5, 7, 8, 10], [0, np.pi, np.pi, 2 * np.pi])
    two = np.interp(flight.time, [6, 8, 10], [0, np.pi, 2 * np.pi])
    size = (1 - np.cos(one)) / 2 * 6 + (1 - np.cos(two)) / 2 * 2
    course = np.radians(80)
    np.testing.assert_allclose(felt[:, 0], -size * np.cos(course), rtol=0, atol=0.03)
    np.testing.assert_allclose(felt[:, 1], -size * np.sin(course), rtol=0, atol=0.03)
    np.testing.assert_allclose(felt[:, 2], -(1 - np.cos(one)) / 2, rtol=0, atol=0.03)


def test_a_gust_begins_and_ends_smoothly():
    gust = Gust(time_s=3.0, speed_m_s=4.0, rise_s=1.0, hold_s=2.0)
    speeds = [-gust.velocity_n(time)[0] for time in (2.9, 3.0, 3.5, 4.0, 5.9, 6.5, 7.0, 9.0)]
    assert speeds == pytest.approx([0, 0, 2, 4, 4, 2, 0, 0])


def test_hot_air_costs_climb():
    # Lift is as density; the ideal gas at 288 K and 318 K at one pressure differs by 10 % in density.
    cool, hot = (
        in_the_air(
            {"do": "hold", "seconds": 3.0}, seconds=3.0, aircraft="737", air={"temperature_deviation_k": dt}
        )
        for dt in (0.0, 30.0)
    )
    ratio = hot.alpha[0] / cool.alpha[0]
    assert 1.1 < ratio < 2.0


def test_what_cannot_be_reached_ends_the_flight_with_what_to_change():
    plan = {
        "duration_s": 600.0,
        "air_start": {"latitude_deg": 0, "longitude_deg": 0, "height_m": 2500, "heading_deg": 0},
        "manoeuvres": [
            {"do": "climb", "height_m": 3500, "airspeed_m_s": 58, "rate_m_s": 5},
            {"do": "hold", "seconds": 5},
        ],
    }
    flight = fly(FlightPlan.from_dict(plan))
    for words in ("cannot do manoeuvre 1 of 2 (climb)", "height", "of 3500 m", "ask for less height"):
        assert words in flight.ending
    assert 60 < flight.recording.duration < 500


def test_what_jsbsim_cannot_trim_is_refused_silently(capfd):
    plan = {
        "aircraft": "737",
        "duration_s": 60.0,
        "air_start": {"latitude_deg": 0, "longitude_deg": 0, "height_m": 9000, "heading_deg": 0},
        "manoeuvres": [{"do": "hold", "seconds": 5}],
    }
    with pytest.raises(MissionError, match=r"cannot trim the Boeing 737 at 140 m/s, 9000 m"):
        fly(FlightPlan.from_dict(plan))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", AIRCRAFT)
def test_no_aircraft_listens_to_the_network_or_prints(name, capfd):
    # JSBSim's 737 asks for ports to be steered through; a second one then says that they are taken.
    start = {"latitude_deg": 0, "longitude_deg": 0, "height_m": 1000, "heading_deg": 0}
    values = {"aircraft": name, "duration_s": 9, "air_start": start, "manoeuvres": [{"do": "level"}]}
    plan = FlightPlan.from_dict(values)
    both = SimulatedAircraft(plan), SimulatedAircraft(plan)
    assert both[0].sample() == both[1].sample()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", AIRCRAFT)
def test_an_engine_without_fuel_is_noticed(name):
    start = {"latitude_deg": 0, "longitude_deg": 0, "height_m": 1000, "heading_deg": 0}
    values = {"aircraft": name, "duration_s": 9, "air_start": start, "manoeuvres": [{"do": "level"}]}
    aircraft = SimulatedAircraft(FlightPlan.from_dict(values))
    aircraft.step()
    assert not aircraft.out_of_fuel()
    aircraft._fdm["propulsion/tank[0]/contents-lbs"] = 0.0
    for tank in (1, 2) if name != "t6texan2" else ():
        aircraft._fdm[f"propulsion/tank[{tank}]/contents-lbs"] = 0.0
    for _ in range(500):
        aircraft.step()
    assert aircraft.out_of_fuel()


def test_an_aircraft_blown_over_on_the_runway_says_so():
    plan = {
        "duration_s": 90.0,
        "runway": {"latitude_deg": 0, "longitude_deg": 0, "height_m": 0, "heading_deg": 0},
        "air": {"wind_from_deg": 90, "wind_m_s": 14},
        "manoeuvres": [{"do": "take_off"}],
    }
    with pytest.raises(MissionError, match="turned over on the runway"):
        fly(FlightPlan.from_dict(plan))
