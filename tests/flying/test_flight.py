"""Flights by the pilot: they obey physics, do what the plan says, and the same seed flies the same bits."""

from __future__ import annotations

import dataclasses
import gzip
import itertools
import json
import math
import re
import subprocess
import sys
import tomllib

import numpy as np
import pymap3d
import pytest
from scipy.interpolate import CubicSpline

from lab.base.files.locks import LOCK_FILE
from lab.base.parameters.toml_file import toml_text
from lab.flying.simulated_aircraft import Instruments, SimulatedAircraft
from lab.missions import (
    FlightPlan,
    MissionError,
    Recording,
    fly,
    fly_mission,
    mission,
    missions,
    shipped_folder,
    write_flight_csv,
)

pytest.importorskip("jsbsim", reason="flying needs the extra 'fly'")

SHORT = {
    "duration_s": 60.0,
    "runway": {"latitude_deg": -33.9, "longitude_deg": 18.6, "height_m": 75.0, "heading_deg": 10.0},
    "air": {"wind_from_deg": 40.0, "wind_m_s": 4.0},
    "manoeuvres": [
        {"do": "take_off", "wait_s": 2.0},
        {"do": "climb", "height_m": 300.0, "rate_m_s": 3.0, "seconds": 10.0},
        {"do": "turn", "heading_deg": 300.0, "bank_deg": 25.0},
    ],
}


@pytest.fixture(scope="module")
def calm() -> Recording:
    """Return a short flight in steady wind without turbulence, in the south."""
    return fly(FlightPlan.from_dict(SHORT)).recording


@pytest.fixture(scope="module", params=["montreal", "los_angeles"])
def shipped(request) -> Recording:
    """Return the recordings that ship."""
    return missions()[request.param].recording


def ecef_path_by_velocity(flight: Recording) -> np.ndarray:
    """Return the path in ECEF [m] that the recorded velocity gives when integrated."""
    velocity = np.array(
        pymap3d.enu2ecefv(
            flight.velocity_n[:, 1], flight.velocity_n[:, 0], -flight.velocity_n[:, 2],
            flight.latitude, flight.longitude, deg=False,
        )
    ).T  # fmt: skip
    curve = CubicSpline(flight.time, velocity).antiderivative()
    return np.array(curve(flight.time) - curve(flight.time[0]))


def test_velocity_is_that_of_the_recorded_position(shipped, calm):
    for flight in (shipped, calm):
        position = np.array(
            pymap3d.geodetic2ecef(flight.latitude, flight.longitude, flight.height, deg=False)
        ).T
        error = np.linalg.norm(position - position[0] - ecef_path_by_velocity(flight), axis=1)
        assert error.max() < 0.01


def test_air_data_and_attitude_and_wind_give_the_velocity(calm):
    airborne = calm.height > calm.height[0] + 10
    roll, pitch, yaw = calm.euler[airborne].T
    alpha, beta, airspeed = calm.alpha[airborne], calm.beta[airborne], calm.airspeed[airborne]
    u = airspeed * np.cos(alpha) * np.cos(beta)
    v = airspeed * np.sin(beta)
    w = airspeed * np.sin(alpha) * np.cos(beta)
    # Body to north, east, down, written out: Stevens & Lewis, Aircraft Control and Simulation, eq. 1.3-20.
    up = v * np.sin(roll) + w * np.cos(roll)
    forward = u * np.cos(pitch) + up * np.sin(pitch)
    side = v * np.cos(roll) - w * np.sin(roll)
    air_n = np.column_stack(
        [
            forward * np.cos(yaw) - side * np.sin(yaw),
            forward * np.sin(yaw) + side * np.cos(yaw),
            -u * np.sin(pitch) + up * np.cos(pitch),
        ]
    )
    wind_n = 4.0 * np.array([-np.cos(np.radians(40)), -np.sin(np.radians(40)), 0.0])
    # Air data are one step of 1 ms older than the rest.
    np.testing.assert_allclose(calm.velocity_n[airborne], air_n + wind_n, rtol=0, atol=0.02)


def test_turns_are_coordinated(calm, shipped):
    for flight in (calm, shipped):
        in_turn = np.abs(flight.euler[:, 0]) > np.radians(17)
        assert in_turn.sum() > 100
        yaw_rate = CubicSpline(flight.time, np.unwrap(flight.euler[:, 2]))(flight.time, 1)
        # tan(bank) = V · yaw rate / g in a level coordinated turn.
        expected = 9.81 * np.tan(flight.euler[in_turn, 0]) / flight.airspeed[in_turn]
        assert np.median(yaw_rate[in_turn] / expected) == pytest.approx(1.0, abs=0.1)
        assert np.degrees(np.abs(flight.beta[in_turn]).mean()) < 2


def test_the_flight_begins_at_rest_on_the_runway(shipped, calm):
    for flight in (shipped, calm):
        assert flight.time[0] == 0
        waiting = flight.time < 2.0
        assert np.linalg.norm(flight.velocity_n[waiting], axis=1).max() < 0.02
        assert np.ptp(flight.height[waiting]) < 0.01
    # The centre of gravity of a Cessna 172 standing on its wheels is some 1.3 m above the ground.
    assert calm.height[0] - SHORT["runway"]["height_m"] == pytest.approx(1.3, abs=0.2)


def test_position_is_geodetic_on_wgs84():
    aircraft = SimulatedAircraft(FlightPlan.from_dict(SHORT))
    latitude, longitude, height = aircraft.sample()[:3]
    expected = [aircraft._fdm[f"position/ecef-{axis}-ft"] * 0.3048 for axis in "xyz"]
    np.testing.assert_allclose(
        pymap3d.geodetic2ecef(latitude, longitude, height, deg=False), expected, rtol=0, atol=1e-3
    )


def test_samples_are_55_ms_apart_and_span_the_plan():
    for name, duration in (("montreal", 205.0), ("los_angeles", 105.0)):
        time = missions()[name].recording.time
        np.testing.assert_allclose(np.diff(time), 0.055, rtol=0, atol=1e-12)
        assert duration <= time[-1] < duration + 0.055


def turns(flight: Recording) -> list[float]:
    """Return the largest bank [°] of every stretch banked more than 12°."""
    bank = np.degrees(np.abs(flight.euler[:, 0]))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (bank > 12).astype(int), [0]])))
    return [float(bank[a:b].max()) for a, b in edges.reshape(-1, 2)]


@pytest.mark.parametrize(("name", "count"), [("montreal", 3), ("los_angeles", 2)])
def test_the_shipped_flights_are_sane(name, count):
    flight = missions()[name].recording
    banks = turns(flight)
    assert len(banks) == count
    assert all(18 <= bank <= 31 for bank in banks)
    height = flight.height - flight.height[0]
    airborne = height > 20
    assert np.all((flight.airspeed[airborne] > 33) & (flight.airspeed[airborne] < 48))
    assert np.degrees(np.abs(flight.euler[:, 1])).max() < 12
    assert np.degrees(np.abs(flight.beta[airborne])).max() < 5
    lift_off = flight.airspeed[np.flatnonzero(height > 0.5)[0]]
    assert 28 < lift_off < 37
    climbing = (height > 30) & (height < 200) & (flight.time < 80)
    rate = -flight.velocity_n[climbing, 2].mean() / 0.3048 * 60
    assert 500 < rate < 800  # ft/min
    if name == "montreal":
        assert height.max() > 240
        assert height[-1] < 130


def test_the_pilot_reaches_heading_and_bank(calm):
    assert np.degrees(calm.euler[-1, 2]) == pytest.approx(300, abs=3)
    assert turns(calm) == [pytest.approx(25, abs=2.5)]
    on_the_ground = calm.height < calm.height[0] + 0.2
    course = np.degrees(calm.euler[on_the_ground, 2])
    assert np.abs(course - 10).max() < 3


@pytest.mark.proof
def test_left_and_right_are_obeyed():
    for direction, sign in (("left", -1), ("right", 1)):
        manoeuvres = [*SHORT["manoeuvres"][:2], {"do": "turn", "heading_deg": 50.0, "direction": direction}]
        plan = FlightPlan.from_dict({**SHORT, "duration_s": 50.0, "manoeuvres": manoeuvres})
        assert np.sign(fly(plan).recording.euler[-1, 0]) == sign


def test_without_wind_airspeed_is_speed_over_the_earth():
    still = fly(
        FlightPlan.from_dict({**SHORT, "air": {}, "duration_s": 40.0, "manoeuvres": SHORT["manoeuvres"][:1]})
    ).recording
    speed = np.linalg.norm(still.velocity_n, axis=1)
    np.testing.assert_allclose(still.airspeed, speed, rtol=0, atol=0.02)


@pytest.mark.proof
def test_flying_again_gives_the_shipped_recordings(tmp_path):
    for name in ("montreal", "los_angeles", "pacific"):
        flown = fly_mission(name, folder=tmp_path)
        assert flown.ending == ""
        was, now = missions()[name].recording_path.read_bytes(), flown.recording_path.read_bytes()
        assert flown.path.read_bytes() == missions()[name].path.read_bytes()
        if gzip.decompress(was) != gzip.decompress(now):
            # Another processor or C library may round the last bits differently, and the wheels on the ground
            # magnify that: moving the start by 1e-12° moves a flight by 2e-6 rad, 7e-5 m/s and 4e-5 m.
            old, new = missions()[name].recording, flown.recording
            np.testing.assert_allclose(new.euler, old.euler, rtol=0, atol=1e-4)
            np.testing.assert_allclose(new.velocity_n, old.velocity_n, rtol=0, atol=5e-3)
            np.testing.assert_allclose(new.height, old.height, rtol=0, atol=1e-2)


def test_same_seed_same_bits_other_seed_other_flight():
    plan = FlightPlan.from_dict(
        {
            **SHORT,
            "duration_s": 20.0,
            "manoeuvres": SHORT["manoeuvres"][:1],
            "air": {"turbulence_severity": 2, "turbulence_wind_m_s": 5.0},
        }
    )
    one, again, other = (fly(plan, seed=seed).recording for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.velocity_n, again.velocity_n)
    np.testing.assert_array_equal(one.airspeed, again.airspeed)
    assert np.abs(one.airspeed - other.airspeed).max() > 0.01
    with pytest.raises(MissionError, match="seed = -1"):
        fly(plan, seed=-1)


def test_a_fresh_process_flies_the_same_bits_silently_and_leaves_no_files(tmp_path, calm):
    code = (
        "import json, sys, lab.missions as m; "
        "m.write_flight_csv(sys.argv[2], m.fly(m.FlightPlan.from_dict(json.loads(sys.argv[1]))).recording)"
    )
    work = tmp_path / "work"
    work.mkdir()
    there, here = tmp_path / "there.csv", tmp_path / "here.csv"
    answer = subprocess.run(
        [sys.executable, "-c", code, json.dumps(SHORT), str(there)],
        cwd=work,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (answer.stdout, answer.stderr) == ("", "")
    assert list(work.iterdir()) == []
    write_flight_csv(here, calm)
    assert there.read_bytes() == here.read_bytes()


def test_progress_rises_to_one():
    told: list[float] = []
    plan = FlightPlan.from_dict({**SHORT, "duration_s": 20.0, "manoeuvres": SHORT["manoeuvres"][:1]})
    fly(plan, progress=told.append)
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert len(told) > 10


@pytest.mark.proof
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"airspeed": math.nan}, "the simulation broke down"),
        (
            {"airspeed": 15.0},
            r"stalled .* \(airspeed 15.0 m/s\) during manoeuvre 2 of 3 \(climb\)",
        ),
        ({"alpha": 0.4}, "stalled"),
        ({"on_ground": True}, "touched the ground"),
        ({"height": -0.1}, "touched the ground"),
        ({"roll": 1.5}, "out of control"),
        ({"pitch": -1.0}, "out of control"),
    ],
)
def test_a_flight_that_goes_wrong_ends_with_a_reason_and_is_kept(calm, monkeypatch, wrong, message):
    honest = SimulatedAircraft.instruments
    looks = itertools.count()

    def instruments(aircraft: SimulatedAircraft) -> Instruments:
        seen = honest(aircraft)
        return dataclasses.replace(seen, **wrong) if next(looks) > 7000 else seen

    monkeypatch.setattr(SimulatedAircraft, "instruments", instruments)
    flight = fly(FlightPlan.from_dict(SHORT))
    assert re.search(message, flight.ending)
    # Look 7001 at 5 ms ended it, and every sample before that is kept.
    assert flight.recording.duration == pytest.approx(35.0, abs=0.055)
    np.testing.assert_array_equal(flight.recording.velocity_n, calm.velocity_n[: len(flight.recording.time)])


def test_a_plan_that_needs_more_time_says_so_and_keeps_what_was_flown():
    flight = fly(FlightPlan.from_dict({**SHORT, "duration_s": 10.0}))
    assert re.search(r"flight of 10 s ended during manoeuvre 1 of 3 \(take_off\)", flight.ending)
    assert flight.recording.duration == pytest.approx(10, abs=0.055)


def test_a_flight_is_cancelled_at_once_and_kept_from_two_seconds_on(calm):
    asked = itertools.count()
    flight = fly(FlightPlan.from_dict(SHORT), cancelled=lambda: next(asked) >= 100)
    assert flight.ending == "cancelled 5.50 s into the flight"
    assert len(flight.recording.time) == 100
    np.testing.assert_array_equal(flight.recording.euler, calm.euler[:100])
    with pytest.raises(MissionError, match=r"cancelled 0\.00 s into the flight"):
        fly(FlightPlan.from_dict(SHORT), cancelled=lambda: True)


def test_an_aircraft_without_fuel_says_so(monkeypatch):
    looks = itertools.count()
    monkeypatch.setattr(SimulatedAircraft, "out_of_fuel", lambda _: next(looks) >= 100)
    flight = fly(FlightPlan.from_dict(SHORT))
    assert re.search(r"ran out of fuel 5\.50 s into the flight, during manoeuvre 1 of 3", flight.ending)
    assert len(flight.recording.time) == 100


def test_a_flight_that_ends_early_is_written_and_says_so_until_flown_to_its_end(tmp_path):
    plan = tmp_path / "plan.toml"
    values = {**SHORT, "duration_s": 20.0, "manoeuvres": SHORT["manoeuvres"][:1]}
    text = "# mine\n" + toml_text({"title": "Plan", "recording": "plan.csv.gz", "flight": values})
    plan.write_bytes(text.encode())
    asked = itertools.count()
    flown = fly_mission(plan, cancelled=lambda: next(asked) >= 100)
    assert flown.ending == "cancelled 5.50 s into the flight"
    assert flown.duration == pytest.approx(99 * 0.055)
    assert "cancelled 5.50 s" in flown._repr_html_()
    assert plan.read_text(encoding="utf-8") == f'ending = "{flown.ending}"\n' + text
    again = fly_mission(plan, overwrite=True)
    # The words changed, so the recording has another name: neither stands beside the other's.
    renamed = text.replace("plan.csv.gz", "plan.2.csv.gz")
    assert (again.ending, plan.read_text(encoding="utf-8")) == ("", renamed)
    with pytest.raises(MissionError, match="cancelled"):
        fly_mission(plan, overwrite=True, cancelled=lambda: True)
    assert mission(plan).duration == again.duration


def test_without_jsbsim_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    with pytest.raises(MissionError, match=r"pip install 'ins-lab\[fly\]'"):
        fly(FlightPlan.from_dict(SHORT))


@pytest.mark.proof
def test_existing_files_are_replaced_only_when_allowed(tmp_path):
    plan = tmp_path / "plan.toml"
    values = {**SHORT, "duration_s": 20.0, "manoeuvres": SHORT["manoeuvres"][:1]}
    plan.write_bytes(toml_text({"title": "Plan", "recording": "plan.csv.gz", "flight": values}).encode())
    flown = fly_mission(plan)
    assert flown.recording_path == tmp_path / "plan.csv.gz"
    first = flown.recording_path.read_bytes()
    with pytest.raises(MissionError, match=r"plan\.csv\.gz would be replaced"):
        fly_mission(plan)
    with pytest.raises(MissionError, match=r"plan\.csv\.gz and .*plan\.toml would be replaced"):
        fly_mission(plan, seed=8)
    assert flown.recording_path.read_bytes() == first
    assert fly_mission(plan, overwrite=True).recording_path.read_bytes() == first
    assert fly_mission(plan, seed=8, overwrite=True).plan.seed == 8
    assert tomllib.loads(plan.read_text(encoding="utf-8"))["flight"]["runway"] == SHORT["runway"]
    assert {path.name for path in tmp_path.iterdir()} == {"plan.toml", "plan.2.csv.gz", LOCK_FILE}
    assert fly_mission(plan, seed=9, overwrite=True).recording_path.name == "plan.csv.gz"
    assert {path.name for path in tmp_path.iterdir()} == {"plan.toml", "plan.csv.gz", LOCK_FILE}


@pytest.mark.proof
def test_a_shipped_mission_is_flown_into_the_users_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path / "mine"))
    before = {path: path.read_bytes() for path in shipped_folder().iterdir()}
    flown = fly_mission("los_angeles", seed=77)
    assert flown.name == "user:los_angeles"
    assert flown.plan.seed == 77
    assert mission("user:los_angeles").duration == pytest.approx(105.05)
    assert flown.recording.velocity_n.shape == missions()["los_angeles"].recording.velocity_n.shape
    assert np.abs(flown.recording.velocity_n - missions()["los_angeles"].recording.velocity_n).max() > 0.01
    assert {path: path.read_bytes() for path in shipped_folder().iterdir()} == before


def test_a_mission_without_a_plan_cannot_be_flown(tmp_path):
    write_flight_csv(tmp_path / "only.csv", missions()["los_angeles"].recording)
    with pytest.raises(MissionError, match=r"no \[flight\] table"):
        fly_mission(tmp_path / "only.csv")
