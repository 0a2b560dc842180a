"""Motion commands: what each of the five types asks is what becomes of attitude and velocity."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from lab.flying.flight_plan import read_plan
from lab.flying.motion_commands import MotionPlan, move
from lab.flying.motion_file import read_motion_file
from lab.missions import MissionError, Recording, fly, fly_mission, mission

START = {"latitude_deg": 32.0, "longitude_deg": 120.0, "forward_m_s": 10.0, "yaw_deg": 90.0}

# In the form of gnss-ins-sim's demonstrations, with other numbers.
FILE = """\
ini lat (deg),ini lon (deg),ini alt (m),ini vx_body (m/s),ini vy_body (m/s),ini vz_body (m/s),ini yaw (deg),\
ini pitch (deg),ini roll (deg)
32,120,5,10,0,0,90,0,0
command type,yaw (deg),pitch (deg),roll (deg),vx_body (m/s),vy_body (m/s),vz_body (m/s),\
command duration (s),GPS visibility
1,0,0,0,0,0,0,2,1
1,-15,0,0,0,0,0,6,0
1,0,0,0,0,0,0,2,1
5,30,0,0,4,0,0,30,0
1,0,0,0,0.5,0,0,4,1
"""


def moved(*commands: dict[str, Any], **values: Any) -> Recording:
    """Return what becomes of commands."""
    plan = read_plan({"start": START, "commands": list(commands), **values})
    assert isinstance(plan, MotionPlan)
    assert MotionPlan.from_dict(plan.to_dict()) == plan
    return fly(plan).recording


def forward(flight: Recording) -> np.ndarray:
    """Return the speed along the nose, where pitch and roll are zero [m/s]."""
    yaw = flight.euler[:, 2]
    return flight.velocity_n[:, 0] * np.cos(yaw) + flight.velocity_n[:, 1] * np.sin(yaw)


def test_rates_for_a_time_are_an_angle_and_a_speed():
    flight = moved(
        {"type": 1, "seconds": 2},
        {"type": 1, "yaw": -15, "forward": 0.5, "seconds": 6},
        {"type": 1, "seconds": 3},
    )
    assert flight.duration == pytest.approx(11)
    rate = np.degrees(CubicSpline(flight.time, flight.euler[:, 2])(flight.time, 1))
    middle = (flight.time > 4) & (flight.time < 7.9)
    assert rate[middle] == pytest.approx(-15, abs=1e-3)
    assert np.degrees(flight.euler[-1, 2]) == pytest.approx(90 - 6 * 15, abs=1e-3)
    assert forward(flight)[-1] == pytest.approx(10 + 6 * 0.5, abs=1e-3)
    # A steady turn at constant speed is a circle: |a| = V ω.
    steady = moved({"type": 1, "yaw": 12, "seconds": 20})
    force = np.linalg.norm(CubicSpline(steady.time, steady.velocity_n)(steady.time, 1), axis=1)
    assert force[(steady.time > 3) & (steady.time < 19)] == pytest.approx(10 * math.radians(12), rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "yaw", "speed"),
    [(2, 50.0, 4.0), (3, 90 + 50.0, 10 + 4.0), (4, 50.0, 10 + 4.0), (5, 90 + 50.0, 4.0)],
)
def test_types_two_to_five_reach_or_change_attitude_and_velocity(kind, yaw, speed):
    flight = moved(
        {"type": kind, "yaw": 50, "pitch": 0, "forward": 4, "seconds": 60}, {"type": 1, "seconds": 1}
    )
    assert np.degrees(flight.euler[-1, 2]) == pytest.approx(yaw, abs=0.01)
    assert forward(flight)[-1] == pytest.approx(speed, abs=1e-3)
    assert flight.duration < 30  # it ends when reached, not after its time
    along = np.gradient(forward(flight), flight.time)
    assert np.abs(along).max() < 1.01
    turning = CubicSpline(flight.time, flight.euler[:, 2])
    assert np.degrees(np.abs(turning(flight.time, 1))).max() < 115
    assert np.degrees(np.abs(turning(flight.time, 2))).max() < 31


def test_a_command_ends_after_its_time_and_the_motion_stays_smooth():
    flight = moved({"type": 2, "yaw": 90, "forward": 30, "seconds": 5}, {"type": 3, "yaw": 20, "seconds": 10})
    assert forward(flight)[-1] == pytest.approx(10 + 5, abs=0.5)
    force = CubicSpline(flight.time, flight.velocity_n)(flight.time, 1)
    assert np.abs(np.diff(force, axis=0)).max() < 0.6


def test_pitch_and_velocity_across_and_down_lead_where_they_point():
    flight = moved({"type": 3, "pitch": 30, "seconds": 20}, {"type": 1, "seconds": 2})
    assert -flight.velocity_n[-1, 2] == pytest.approx(10 * math.sin(math.radians(30)), abs=1e-3)
    climbed = -CubicSpline(flight.time, flight.velocity_n[:, 2]).antiderivative()(flight.time[-1])
    assert np.ptp(flight.height) == pytest.approx(climbed, abs=1e-6)
    side = moved({"type": 2, "yaw": 90, "right": 3, "down": -1, "seconds": 30}, {"type": 1, "seconds": 1})
    # Heading east, right is south; velocity forward was asked to become 0.
    np.testing.assert_allclose(side.velocity_n[-1], [-3, 0, -1], rtol=0, atol=2e-3)


commands = st.fixed_dictionaries(
    {
        "type": st.integers(1, 5),
        "yaw": st.floats(-60, 60),
        "pitch": st.floats(-3, 3),
        "roll": st.floats(-20, 20),
        "forward": st.floats(-5, 5),
        "seconds": st.floats(0.1, 8),
        "gps": st.integers(0, 1),
    }
)


@settings(max_examples=60, deadline=None)
@given(listed=st.lists(commands, min_size=1, max_size=6))
def test_whatever_is_commanded_is_finite_regular_and_as_long_as_allowed(listed):
    plan = read_plan({"start": START, "commands": [*listed, {"type": 1, "seconds": 1}]})
    assert isinstance(plan, MotionPlan)
    try:
        motion = move(plan)
    except MissionError as error:
        assert "pitch passes 85°" in str(error)
        return
    flight = motion.recording
    assert np.isfinite(np.column_stack([flight.velocity_n, flight.euler, flight.height])).all()
    np.testing.assert_allclose(np.diff(flight.time), 0.05, rtol=1e-9)
    assert flight.duration <= sum(one["seconds"] for one in listed) + 1.05
    for start, end in motion.without_gps:
        assert 0 <= start < end <= flight.duration + 1e-9
    assert (listed[0]["gps"] == 0) == (bool(motion.without_gps) and motion.without_gps[0][0] == 0)


def test_a_file_of_gnss_ins_sim_is_flown_as_it_is(tmp_path):
    path = tmp_path / "motion_def-demo.csv"
    path.write_text(FILE, encoding="utf-8")
    plan = read_motion_file(path)
    assert [command.type for command in plan.commands] == [1, 1, 1, 5, 1]
    assert plan.start.height_m == 5
    flown = fly_mission(path, folder=tmp_path / "mine")
    assert flown.path == tmp_path / "mine" / "motion_def-demo.toml"
    assert np.degrees(flown.recording.euler[-1, 2]) == pytest.approx(30, abs=0.02)
    # The response lags by a tenth of a second.
    assert forward(flown.recording)[-1] == pytest.approx(4 + (4 - 0.1) * 0.5, abs=0.02)
    assert "no GPS from 2 to 8 s, 10 to " in flown.description
    with pytest.raises(MissionError, match="motion_def-demo"):
        fly_mission(path, folder=tmp_path / "mine")
    again = fly_mission(flown.path, overwrite=True)
    np.testing.assert_array_equal(again.recording.velocity_n, flown.recording.velocity_n)
    assert mission(flown.path).plan == plan
    with pytest.raises(MissionError, match="seed = 1"):
        fly_mission(path, seed=1, folder=tmp_path)


def test_a_reserved_column_says_nothing_of_gps(tmp_path):
    path = tmp_path / "old.csv"
    path.write_text(FILE.replace("GPS visibility", "reserved"), encoding="utf-8")
    assert all(command.gps for command in read_motion_file(path).commands)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FILE.replace("2,1\n", "2\n", 1), "line 4: 8 numbers; accepted are 9"),
        (FILE.replace("5,30", "7,30"), r"number 4: type = 7; accepted is a whole number from 1 to 5"),
        (FILE.replace("32,120,5", "32,120,x"), "line 2: height_m = 'x'; accepted is a number"),
        ("\n".join(FILE.splitlines()[:3]), "not a motion definition"),
        (FILE.replace("1,-15,0,0,0,0,0,6,0", "1,-15,0,0,0,0,0,nan,0"), "seconds = nan"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path: Path, text: str, message: str):
    path = tmp_path / "wrong.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MissionError, match=message):
        read_motion_file(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_anything_in_a_file_is_a_plan_or_an_error(tmp_path: Path, data: st.DataObject):
    content = bytearray(FILE.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        piece = data.draw(
            st.binary(max_size=3) | st.sampled_from([b"9" * 400, b"inf", b"nan", b'"', b"\n", b","])
        )
        content[at : at + data.draw(st.integers(0, 30))] = piece
    path = tmp_path / "any.csv"
    path.write_bytes(content)
    try:
        read_motion_file(path)
    except MissionError as error:
        assert "any.csv" in str(error)


def test_commands_that_lead_nowhere_or_over_the_top_say_so():
    with pytest.raises(MissionError, match="less than four samples"):
        moved({"type": 2, "yaw": 90, "forward": 10, "seconds": 60})
    with pytest.raises(MissionError, match="pitch passes 85°"):
        moved({"type": 3, "pitch": 120, "seconds": 60})
