"""Ways along waypoints: closed forms of circle, straight and geodesic, and limits kept whatever is asked."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pymap3d
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pymap3d.vincenty import vdist, vreckon
from scipy.interpolate import CubicSpline

from lab.base.arrays import FloatArray
from lab.flying.flight_plan import read_plan
from lab.flying.geodesy import geodesic
from lab.flying.path_profile import Turn, step, step_integral, step_slope
from lab.flying.waypoints import WaypointPlan
from lab.missions import MissionError, Recording, fly
from lab.motion.frames.rotation import wrap


def way(*points: tuple[float, ...], **values: Any) -> WaypointPlan:
    """Return a plan through points of latitude, longitude, height, speed and wait."""
    names = ("latitude_deg", "longitude_deg", "height_m", "speed_m_s", "wait_s")
    listed = [dict(zip(names, point, strict=False)) for point in points]
    plan = read_plan({"waypoints": listed, **values})
    assert isinstance(plan, WaypointPlan)
    assert WaypointPlan.from_dict(plan.to_dict()) == plan
    return plan


def local(flight: Recording) -> FloatArray:
    """Return the way in metres east, north, up of its start (n, 3)."""
    origin = np.degrees(flight.latitude[0]), np.degrees(flight.longitude[0]), flight.height[0]
    enu = pymap3d.geodetic2enu(
        np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height, *origin
    )
    return np.stack(enu, axis=-1)


def acceleration(flight: Recording) -> FloatArray:
    """Return the derivative of the velocity (n, 3) [m/s²]."""
    return CubicSpline(flight.time, flight.velocity_n)(flight.time, 1)


def away(flight: Recording, latitude: float, longitude: float) -> FloatArray:
    """Return the distance of every sample to a point [m]."""
    east, north, _ = pymap3d.geodetic2enu(
        np.degrees(flight.latitude), np.degrees(flight.longitude), 0, latitude, longitude, 0
    )
    return np.hypot(east, north)


def test_the_smooth_step_is_one():
    x = np.linspace(0, 1, 2001)
    curve = CubicSpline(x, step(x))
    np.testing.assert_allclose(curve(x, 1), step_slope(x), rtol=0, atol=1e-6)
    np.testing.assert_allclose(curve.antiderivative()(x), step_integral(x), rtol=0, atol=1e-9)
    assert (step(np.array([-1.0, 0, 1, 2])) == [0, 0, 1, 1]).all()
    assert step_integral(np.array([1.0, 3.0])) == pytest.approx([0.5, 2.5])


def test_the_middle_of_a_turn_is_a_circle_of_the_asked_radius():
    # North, then east: 25° of bank at 50 m/s is a radius of V² / (g tan 25°).
    flight = fly(
        way((45, 7, 300, 50), (45.1, 7, 300, 50), (45.1, 7.2, 300, 50), vehicle="aircraft")
    ).recording
    rate = CubicSpline(flight.time, np.unwrap(flight.euler[:, 2]))(flight.time, 1)
    steady = rate > 0.999 * rate.max()
    assert flight.time[steady][-1] - flight.time[steady][0] > 10
    radius = 50**2 / (9.80665 * math.tan(math.radians(25)))
    assert rate.max() * radius / 50 == pytest.approx(1, abs=1e-3)
    place = local(flight)[steady]
    # The circle through three of its points is the circle through all.
    a, b, c = place[0, :2], place[len(place) // 2, :2], place[-1, :2]
    centre = np.linalg.solve(2 * np.array([b - a, c - a]), [b @ b - a @ a, c @ c - a @ a])
    np.testing.assert_allclose(np.linalg.norm(place[:, :2] - centre, axis=1), radius, rtol=1e-3)
    assert np.degrees(flight.euler[steady, 0]) == pytest.approx(25, abs=0.1)
    assert abs(np.degrees(flight.euler[flight.time < 60, 0])).max() < 0.1


def test_a_corner_is_flown_by_as_near_as_its_reach():
    turn = Turn.at_speed(math.radians(70), 30.0, math.radians(6), 3.0)
    time = np.linspace(0, turn.lasts, 20_001)
    course = turn.turned(time)
    assert course[-1] == pytest.approx(math.radians(70))
    way_n, way_e = (CubicSpline(time, 30 * part(course)).antiderivative()(time) for part in (np.cos, np.sin))
    end = turn.reach * np.array([1 + math.cos(math.radians(70)), math.sin(math.radians(70))])
    assert (way_n[-1], way_e[-1]) == pytest.approx(tuple(end), abs=1e-6)


def test_a_straight_from_rest_to_rest_takes_the_time_its_acceleration_needs():
    end = vreckon(45, 7, 1000, 90)
    flight = fly(way((45, 7, 0, 20, 10), (end[0], end[1], 0, 0, 5), acceleration_m_s2=2)).recording
    # From rest to 20 m/s by the smooth step of largest slope 15/8: 15/8 · 20 / 2 s, at 10 m/s on average.
    change = 15 / 8 * 20 / 2
    cruise = (1000 - 2 * change * 10) / 20
    assert flight.duration == pytest.approx(10 + 2 * change + cruise + 5, abs=1e-3)
    assert np.linalg.norm(acceleration(flight), axis=1).max() == pytest.approx(2, abs=0.01)
    speed = np.linalg.norm(flight.velocity_n, axis=1)
    assert speed[flight.time < 10].max() < 1e-9
    assert speed[flight.time > flight.time[-1] - 4.9].max() < 1e-6
    assert away(flight, *end)[-1] < 1e-3
    assert np.degrees(flight.euler[flight.time < 25, 2]) == pytest.approx(90, abs=0.01)


def test_lengths_and_courses_are_those_of_pymap3d_and_of_the_equator():
    rng = np.random.default_rng(3)
    here = np.stack((rng.uniform(-80, 80, 50), rng.uniform(-180, 180, 50)))
    there = np.stack((rng.uniform(-80, 80, 50), here[1] + rng.uniform(-100, 100, 50)))
    length, course, arriving = geodesic(*np.radians(here), *np.radians(there))
    expected = [vdist(*a, *b) for a, b in zip(here.T, there.T, strict=True)]
    back = [vdist(*b, *a)[1] - 180 for a, b in zip(here.T, there.T, strict=True)]
    np.testing.assert_allclose(length, [one[0] for one in expected], rtol=0, atol=1e-3)
    for angles, degrees in ((course, [one[1] for one in expected]), (arriving, back)):
        np.testing.assert_allclose(wrap(angles - np.radians(degrees)), 0, rtol=0, atol=1e-9)
    # Along the equator and along a meridian; nowhere; to the other side of the Earth.
    zero = np.zeros(4)
    length, course, _ = geodesic(
        zero, zero, np.array([0.0, 1e-6, 0.0, 0.0]), np.array([1e-3, 0.0, 0.0, math.pi - 1e-4])
    )
    assert length[:3] == pytest.approx([6378137e-3, 6335439.327e-6, 0])
    assert course[:2] == pytest.approx([math.pi / 2, 0])
    assert np.isnan(length[3])


def test_a_long_leg_is_a_geodesic():
    # Vincenty's own way, point by point, along 1500 km.
    distance, course = (float(value) for value in vdist(50, 8, 58, 28))
    flight = fly(way((50, 8, 0, 250), (58, 28, 0, 250), vehicle="aircraft")).recording
    there = vreckon(50, 8, distance * np.linspace(0, 1, 41), np.full(41, course))
    at = np.interp(np.linspace(0, 1, 41), flight.time / flight.time[-1], np.arange(len(flight.time)))
    index = np.round(at).astype(int)
    speed = distance / flight.time[-1]
    assert speed == pytest.approx(250, rel=1e-6)
    latitude = np.degrees(flight.latitude[index])
    longitude = np.degrees(flight.longitude[index])
    along = np.abs(at - index) * speed * flight.time[1]
    gap = vdist(latitude[1:], longitude[1:], there[0][1:], there[1][1:])[0]
    assert (gap <= along[1:] + 0.05).all()
    assert np.degrees(flight.euler[0, 2]) == pytest.approx(course, abs=1e-4)


def test_a_stop_on_the_way_is_a_stop_and_the_corner_is_turned_there():
    flight = fly(way((45, 7, 0, 10, 2), (45.002, 7, 0, 8, 20), (45.002, 7.003, 0, 0, 0))).recording
    still = np.linalg.norm(flight.velocity_n, axis=1) < 1e-6
    stop = still & (flight.time > 10) & (flight.time < flight.time[-1] - 5)
    assert np.ptp(flight.time[stop]) == pytest.approx(20, abs=0.2)
    assert away(flight, 45.002, 7)[stop].max() < 0.01
    assert np.degrees(flight.euler[stop, 2][0]) == pytest.approx(0, abs=0.01)
    assert np.degrees(flight.euler[flight.time > flight.time[stop][-1] + 3, 2]) == pytest.approx(90, abs=0.01)


def test_heights_are_climbed_smoothly_and_kept_in_turns():
    flight = fly(
        way((45, 7, 100, 40), (45.05, 7, 300, 40), (45.05, 7.1, 300, 40), vehicle="aircraft")
    ).recording
    slope = CubicSpline(flight.time, flight.height)(flight.time, 1)
    np.testing.assert_allclose(-flight.velocity_n[:, 2], slope, rtol=0, atol=1e-4)
    turning = np.abs(flight.euler[:, 0]) > np.radians(1)
    assert np.ptp(flight.height[turning]) < 1e-6
    assert flight.height[-1] == pytest.approx(300)


points = st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(0, 150), st.floats(5, 60))


@settings(max_examples=40, deadline=None)
@given(
    corners=st.lists(points, min_size=2, max_size=6),
    vehicle=st.sampled_from(["car", "boat", "aircraft"]),
    latitude=st.sampled_from([-60.0, 0.0, 45.0, 80.0]),
)
def test_whatever_is_asked_limits_are_kept_and_the_end_is_reached(corners, vehicle, latitude):
    listed = []
    for north, east, height, speed in corners:
        there = pymap3d.enu2geodetic(east, north, 0, latitude, 179.99, 0)
        listed.append((float(there[0]), float(there[1]), height, speed))
    try:
        flight = fly(way(*listed, vehicle=vehicle)).recording
    except MissionError as error:
        assert any(
            word in str(error)
            for word in ("too near", "turns back", "at one place", "climbs", "the path takes")
        )
        assume(False)
    assert all(np.isfinite(getattr(flight, name)).all() for name in ("time", "velocity_n", "euler"))
    assert (np.diff(flight.time) > 0).all()
    level = np.linalg.norm(flight.velocity_n[:, :2], axis=1)
    assert level.max() < max(point[3] for point in listed) * 1.001
    push = acceleration(flight)[:, :2]
    lateral, along = {"aircraft": (4.573, 1.5), "car": (2.5, 2.0), "boat": (0.7, 0.5)}[vehicle]
    assert np.linalg.norm(push, axis=1).max() < 1.01 * max(lateral, along) + 0.01
    if vehicle == "aircraft" and len(listed) > 2:
        assert np.abs(np.degrees(flight.euler[level > 15, 0])).max(initial=0) < 31
    assert away(flight, *listed[-1][:2])[-1] < 0.1
    assert flight.height[-1] == pytest.approx(listed[-1][2])


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (((45, 7, 0, 20), (45, 7, 0, 20)), "waypoints 1 and 2 are at one place"),
        (((45, 7, 0, 20), (45.01, 7, 0, 20), (45, 7.001, 0, 20)), "waypoint 2 turns back by 176°"),
        (((45, 7, 0, 0), (45.01, 7, 0, 20)), "waypoint 1: speed_m_s = 0 leads nowhere"),
        (((45, 7, 0, 50), (45.0003, 7, 0, 50), (45.0003, 7.01, 0, 50)), "too near for the turns"),
        (((45, 7, 0, 50), (45.01, 7, 900, 50)), "climbs or descends by"),
        (((45, 7, 0, 1), (46, 7, 0, 1)), "the path takes"),
    ],
)
def test_a_way_that_cannot_be_gone_says_why(plan, message):
    with pytest.raises(MissionError, match=message):
        fly(way(*plan))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"waypoints": 3}, "flight.waypoints: expected a list of 2"),
        ({"waypoints": [{}, {}]}, "number 1: latitude_deg is missing"),
        ({"waypoints": [], "manoeuvres": []}, "has manoeuvres and waypoints; accepted is one of"),
        ({"waypoints": [], "vehicle": "sled"}, "expected a list"),
    ],
)
def test_a_plan_that_is_wrong_says_where(values, message):
    with pytest.raises(MissionError, match=message):
        read_plan(values)


def test_no_simulator_is_needed_and_no_seed_taken(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    plan = way((45, 7, 0, 20), (45.01, 7, 0, 20))
    assert fly(plan).ending == ""
    with pytest.raises(MissionError, match="seed = 3: waypoints and commands have no turbulence"):
        fly(plan, seed=3)
