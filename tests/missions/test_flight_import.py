"""Imported flights: the report judges them rightly and names the likely cause; what is added is theirs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_flights import raw_of, weave, without
from scipy.interpolate import CubicSpline

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks import limits
from lab.data.rebuild import import_report
from lab.data.rebuild.import_report import ImportReport
from lab.data.rebuild.plausibility import motion
from lab.data.rebuild.raw_flight import RawFlight
from lab.flying import coordinated_turn
from lab.missions import ImportSettings, MissionError, mission, prepare_import
from lab.missions.flight_import import prepare_flight
from lab.motion.frames import earth
from lab.motion.frames.rotation import C_nb_from_euler, body_rate
from lab.sensors.imu_errors import SensorNoise

EVEN = np.arange(2000) * 0.05


@pytest.fixture
def msfs(recordings: Path) -> Path:
    path = recordings / "sim_msfs" / "Data.csv"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    return path


def test_a_real_flight_of_a_simulator_imports_without_hand_work(msfs):
    read = prepare_import(msfs)
    moves = motion(read.flight, read.rebuilt)
    by_air = prepare_import(msfs, ImportSettings(curve="air data"))
    off = float(np.linalg.norm(by_air.rebuilt.position_residual))
    print(f"\n{read.flight.method}: stamps moved by {1000 * read.flight.moved_rms:.1f} ms rms")
    for axis, like in zip("xyz", moves.agreements, strict=True):
        print(f"rate {axis}: slope {like.slope:.4f}, correlation {like.correlation:.5f}")
    print(
        f"median acceleration {moves.acceleration:.2f} m/s²; six variables with fitted wind {off:.2f} m rms"
    )
    assert read.report.verdict == "plausible"
    for like in moves.agreements:
        assert like.slope == pytest.approx(1, abs=0.02)
        assert like.correlation > 0.99
    assert moves.acceleration < 10
    assert off < 6


def test_its_acceleration_is_the_one_the_simulator_recorded(msfs):
    # The recorded acceleration is independent of all that the flight is rebuilt from.
    errors = {}
    for stamps in ("repaired", "as recorded"):
        read = prepare_import(msfs, ImportSettings(time_stamps=stamps))
        raw = read.flight.raw
        flying = raw.time < 25
        acceleration = CubicSpline(read.recording.time, read.recording.velocity_n)(raw.time[flying], 1)
        derived = np.einsum("nji,nj->ni", C_nb_from_euler(raw.euler[flying]), acceleration)
        errors[stamps] = np.sqrt(np.mean((derived - raw.acceleration_b[flying]) ** 2, axis=0))
    print("\nderived minus recorded acceleration [m/s² rms, forward, right, down]:", errors)
    assert (errors["repaired"] < (0.6, 0.5, 0.6)).all()
    assert (errors["repaired"] < 0.6 * errors["as recorded"]).all()


def test_a_good_flight_is_plausible():
    report = prepare_flight(weave(EVEN)).report
    assert report.verdict == "plausible"
    assert report.reasons == ()


KNOTS, FEET = 1852 / 3600, 0.3048


def broken(name: str) -> RawFlight:
    """Return a flight with one thing wrong, as a reader would give it that believed a wrong unit or sign."""
    raw = (
        raw_of(mission("montreal").recording)
        if name.startswith(("roll", "pitch", "vertical"))
        else weave(EVEN)
    )
    changed = {
        "velocity in knots": {"velocity_n": raw.velocity_n / KNOTS},
        "velocity in feet": {"velocity_n": raw.velocity_n / FEET},
        "down is up": {"velocity_n": raw.velocity_n * (1, 1, -1)},
        "south is north": {"velocity_n": raw.velocity_n * (-1, 1, 1)},
        "north and east exchanged": {"velocity_n": raw.velocity_n[:, [1, 0, 2]]},
        "attitude in radians": {"euler": np.radians(raw.euler)},
        "heading mirrored": {"euler": raw.euler * (1, 1, -1)},
        "height in feet": {"height": raw.height / FEET},
        "time in milliseconds": {"time": raw.time * 1000},
        "airspeed in knots": {"airspeed": raw.airspeed / KNOTS},
        "roll sign": {"euler": raw.euler * (-1, 1, 1)},
        "pitch sign": {"euler": raw.euler * (1, -1, 1)},
        "roll and pitch exchanged": {"euler": raw.euler[:, [1, 0, 2]]},
        "position in radians": {
            "latitude": np.radians(raw.latitude),
            "longitude": np.radians(raw.longitude),
        },
        "vertical in feet per minute": {"velocity_n": raw.velocity_n * (1, 1, 60 / FEET)},
    }
    return replace(raw, **changed[name])


@pytest.mark.parametrize(
    ("name", "verdict", "words"),
    [
        ("velocity in knots", "implausible", "velocities look like knots"),
        ("velocity in feet", "implausible", "velocities look like feet per second"),
        ("down is up", "implausible", "velocity down has the opposite sign"),
        (
            "south is north",
            "implausible",
            "the north component of velocity or position has the opposite sign",
        ),
        ("north and east exchanged", "implausible", "north and east look exchanged"),
        ("attitude in radians", "implausible", "radians read as degrees"),
        ("heading mirrored", "implausible", "it has the opposite sign"),
        ("height in feet", "implausible", "heights look like feet where m"),
        ("airspeed in knots", "questionable", "knots read as m/s"),
        ("roll sign", "implausible", "it has the opposite sign"),
        ("pitch sign", "implausible", "it has the opposite sign"),
        ("roll and pitch exchanged", "implausible", "Roll and pitch look exchanged"),
        ("position in radians", "implausible", "latitude and longitude look like radians where degrees"),
        ("vertical in feet per minute", "implausible", "velocities look like feet per minute where m/s"),
    ],
)
def test_what_is_wrong_is_named(name, verdict, words):
    report = prepare_flight(broken(name)).report
    assert report.verdict == verdict
    assert words in " ".join(report.reasons)


def test_noisy_positions_are_no_wrong_unit_of_the_velocity():
    """A logger on a walk: its positions have errors of 3 m on the 7 m of a step, its speed has none."""
    rng = np.random.default_rng(5)
    time = 5.0 * np.arange(400)
    course = np.cumsum(rng.normal(0, 0.3, 400))
    velocity = 1.4 * np.stack((np.cos(course), np.sin(course), np.zeros(400)), axis=-1)
    path = np.concatenate((np.zeros((1, 3)), np.cumsum(5.0 * (velocity[1:] + velocity[:-1]) / 2, axis=0)))
    path += rng.normal(0, 3.0, path.shape) * (1, 1, 0)
    walk = RawFlight(
        format="logger", time=time, latitude=0.8 + path[:, 0] / 6.37e6,
        longitude=0.2 + path[:, 1] / (6.38e6 * np.cos(0.8)), height=np.full(400, 80.0), velocity_n=velocity,
        rows_read=400,
    )  # fmt: skip
    assert prepare_flight(walk).report.verdict == "plausible"
    knots = prepare_flight(replace(walk, velocity_n=velocity * KNOTS)).report
    assert knots.verdict == "implausible"


def test_rates_in_degrees_are_noticed():
    raw = raw_of(mission("montreal").recording)
    rates = np.gradient(np.unwrap(raw.euler, axis=0), raw.time, axis=0)
    report = prepare_flight(replace(raw, body_rate=np.degrees(rates))).report
    assert report.verdict == "questionable"
    assert "degrees read as radians" in " ".join(report.reasons)
    assert prepare_flight(replace(raw, body_rate=rates)).report.verdict == "plausible"


def copter(yaw: float, seconds: float = 90.0, step: float = 0.1) -> RawFlight:
    """Return a copter whose speed swings along a line, and which leans where it accelerates."""
    time = np.arange(0.0, seconds, step)
    velocity = np.stack((7.0 + 3.0 * np.sin(0.5 * time), 2.0 * np.sin(0.31 * time), 0.0 * time), axis=-1)
    pulled = np.stack((1.5 * np.cos(0.5 * time), 0.62 * np.cos(0.31 * time)), axis=-1)
    heading = yaw + 0.1 * np.sin(0.2 * time)
    ahead = pulled[:, 0] * np.cos(heading) + pulled[:, 1] * np.sin(heading)
    right = pulled[:, 1] * np.cos(heading) - pulled[:, 0] * np.sin(heading)
    pitch = np.arctan2(-ahead, STANDARD_GRAVITY)
    roll = np.arctan2(right, np.hypot(ahead, STANDARD_GRAVITY))
    path = CubicSpline(time, velocity).antiderivative()(time)
    meridian, transverse = earth.radii(np.sin(0.8))
    return RawFlight(
        format="logger", time=time, latitude=0.8 + path[:, 0] / (meridian + 50),
        longitude=0.2 + path[:, 1] / ((transverse + 50) * np.cos(0.8)), height=np.full(time.size, 50.0),
        velocity_n=velocity, euler=np.stack((roll, pitch, heading), axis=-1), rows_read=time.size,
    )  # fmt: skip


@pytest.mark.parametrize("yaw", [0.3, np.pi, -1.6])
@pytest.mark.parametrize("vehicle", ["auto", "copter"])
def test_a_copter_may_fly_backwards_and_sideways(yaw, vehicle):
    report = prepare_flight(copter(yaw), ImportSettings(vehicle=vehicle)).report
    assert report.verdict == "plausible", report


@pytest.mark.parametrize("off", [np.pi, 1.6, -1.6])
@pytest.mark.parametrize("vehicle", ["auto", "copter", "car"])
def test_a_heading_that_accelerations_contradict_is_named(off, vehicle):
    raw = copter(0.1)
    wrong = replace(raw, euler=raw.euler + np.array((0.0, 0.0, off)))
    report = prepare_flight(wrong, ImportSettings(vehicle=vehicle)).report
    assert report.verdict != "plausible"
    about = {"copter": f"specific force points {abs(np.degrees(off)):.0f}°"}
    assert about.get(vehicle, "The heading is usually") in " ".join(report.reasons)


def test_the_files_own_gyro_bears_out_a_tumble():
    raw = copter(0.3, 40.0, 0.05)
    euler = raw.euler + np.stack((np.radians(400.0) * raw.time, 0 * raw.time, 0 * raw.time), axis=-1)
    body = body_rate(euler, np.gradient(euler, raw.time, axis=0))
    tumbling = replace(raw, euler=euler - 2 * np.pi * np.round(euler / (2 * np.pi)))
    said = " ".join(prepare_flight(tumbling).report.reasons)
    assert "body rate reaches" in said
    borne_out = " ".join(prepare_flight(replace(tumbling, body_rate=body)).report.reasons)
    assert "body rate reaches" not in borne_out


@pytest.mark.parametrize(
    ("text", "vehicle"),
    [("Quadcopter (PX4)", "copter"), ("rotary wing", "copter"), ("vtol", "copter"), ("balloon", "copter"),
     ("Rocket", "rocket"), ("trail running", "pedestrian"), ("Hiking", "pedestrian"), ("rover", "car"),
     ("Cessna 208 Caravan", "aircraft"), ("boating", "boat"), ("", "aircraft"), ("submarine", "boat")],
)  # fmt: skip
def test_the_vehicle_of_a_file_is_read_by_whole_words(text, vehicle):
    assert prepare_flight(replace(weave(EVEN), vehicle=text)).rebuilt.vehicle == vehicle


def test_every_vehicle_is_judged_and_rebuilt():
    raw = without(weave(EVEN), "euler", "airspeed", "alpha", "beta")
    assert set(limits.VEHICLES) == set(coordinated_turn.VEHICLES)
    for vehicle in coordinated_turn.VEHICLES:
        made = prepare_flight(raw, ImportSettings(vehicle=vehicle))
        assert np.isfinite(made.recording.euler).all()
        assert vehicle in text_of(made.report, "Curve", "Vehicle")


@pytest.mark.parametrize("step", [75.0, 36.0])
def test_a_recording_is_cut_where_its_solution_jumps(step):
    """What an estimator that is reset does, of which the file says nothing: 28 m/s, and one step further."""
    raw = without(copter(0.0, 120.0), "euler")
    late = raw.time >= 80.0
    made = prepare_flight(replace(raw, latitude=raw.latitude + late * step / 6.37e6))
    assert "the position by" in text_of(made.report, "Time", "Resets")
    assert made.flight.raw.time[-1] == pytest.approx(79.9)
    held = np.arange(raw.time.size) // 10 * 10  # fixes of 1 Hz in rows of 10 Hz are no jumps
    still = replace(raw, latitude=raw.latitude[held], longitude=raw.longitude[held])
    assert not prepare_flight(still).flight.cuts


def test_noise_that_is_no_motion_is_implausible():
    raw = without(weave(EVEN), "velocity_n")
    shaken = replace(raw, height=raw.height + np.random.default_rng(1).normal(size=EVEN.size))
    report = prepare_flight(shaken, ImportSettings(smoothing="none", curve="position")).report
    assert report.verdict == "implausible"
    assert report.specific_force_noise > 500
    calmed = prepare_flight(shaken, ImportSettings(curve="position")).report
    assert calmed.specific_force_noise < 2


def text_of(report: ImportReport, group: str, name: str = "") -> str:
    return " | ".join(row.value for row in report.rows if row.group == group and name in row.name)


def test_the_report_tells_what_was_found():
    rounded = replace(weave(EVEN), velocity_n=np.round(weave(EVEN).velocity_n, 2))
    kept = np.arange(EVEN.size) % 10 != 5
    latitude = rounded.latitude.copy()
    latitude[7] = 3.0
    read = prepare_flight(
        replace(rounded, latitude=latitude).rows(kept), sensor=SensorNoise("an IMU", 1e-3, 2e-3)
    )
    report = read.report
    assert "2000 rows read, 1799 used" in text_of(report, "File", "Samples")
    assert "1 × a latitude beyond ±90°, first at 0.35 s" in text_of(report, "File", "Left out")
    assert "grid of 50 ms" in text_of(report, "Time", "Resolution")
    assert "0.01 m/s" in text_of(report, "Resolution", "Velocity")
    own = 2e-3 * np.sqrt(3 * 10)
    assert f"an IMU itself up to 10 Hz: {own:.3g} m/s²" in text_of(report, "Noise", "Specific force")
    for text in (str(report), report._repr_html_()):
        assert "Verdict" in text
        assert "plausible" in text
        assert "a latitude beyond" in text
    assert max(len(line) for line in str(report).splitlines()) <= 110


def test_an_even_clock_is_told_with_its_spacing():
    stamps = np.round(EVEN[:1000] / 3, 3)
    report = prepare_flight(replace(weave(EVEN[:1000] / 3), time=stamps)).report
    assert "even spacing of 16.6667 ms" in text_of(report, "Time", "Stamps")


def test_units_and_how_they_are_known_are_told(msfs):
    report = prepare_import(msfs).report
    assert "ft (guessed)" in text_of(report, "Units", "Plane_Altitude")
    changed = prepare_import(msfs, units={"Plane_Altitude": "m"}).report
    assert "m (given by you)" in text_of(changed, "Units", "Plane_Altitude")


def test_what_is_added_is_the_flight(tmp_path):
    read = prepare_flight(without(weave(EVEN), "euler", "airspeed", "alpha", "beta"))
    added = read.add("woven", folder=tmp_path, tags=("mine",))
    assert added.tags == ("mine", "imported", "attitude reconstructed")
    assert "attitude reconstructed" in added.origin
    np.testing.assert_allclose(added.recording.velocity_n, read.recording.velocity_n, atol=1e-7)
    with pytest.raises(MissionError, match="name 'woven'"):
        read.add("woven", folder=tmp_path)
    read.add("woven", "Again", folder=tmp_path, overwrite=True)
    assert prepare_flight(weave(EVEN)).add("plain", folder=tmp_path).tags == ("imported",)


def test_a_flight_that_came_over_a_network_is_no_log():
    assert prepare_flight(weave(EVEN)).log is None


def test_settings_are_not_kept_by_reference():
    settings = ImportSettings()
    read = prepare_flight(weave(EVEN), settings)
    settings.curve = "position"
    assert read.settings.curve == "auto"


def test_a_long_flight_is_judged_by_fewer_samples_and_not_otherwise(monkeypatch):
    whole = prepare_import(mission("montreal").recording_path).report
    monkeypatch.setattr(import_report, "_MAX_REPORTED_SAMPLES", 1000)
    fewer = prepare_import(mission("montreal").recording_path).report
    assert fewer.verdict == whole.verdict
    assert fewer.specific_force_noise == pytest.approx(whole.specific_force_noise, rel=0.3)
    assert fewer.body_rate_noise == pytest.approx(whole.body_rate_noise, rel=0.3)
    assert [row.name for row in fewer.rows] == [row.name for row in whole.rows]
    for one, other in zip(fewer.rows, whole.rows, strict=True):
        if one.group not in {"Motion", "Noise"}:
            assert one == other


def test_long_flights_take_time_in_proportion():
    def seconds(samples: int) -> float:
        raw = without(weave(np.arange(samples) * 0.01), "airspeed", "alpha", "beta")
        raw = replace(raw, latitude=np.radians(np.round(np.degrees(raw.latitude), 5)))
        begin = time.thread_time()
        assert prepare_flight(raw).report.verdict == "plausible"
        return time.thread_time() - begin

    seconds(1000)
    short, long = min(seconds(20_000), seconds(20_000)), seconds(100_000)
    print(f"\n100,000 samples rebuilt and reported in {long:.2f} s of one core, 20,000 in {short:.2f} s")
    assert long < 15 * short


NUMBERS = st.floats(-1e4, 1e4) | st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.proof
@given(st.data())
def test_whatever_the_numbers_there_is_a_report_or_a_message(data):
    count = data.draw(st.integers(4, 30))
    column = st.lists(NUMBERS, min_size=count, max_size=count).map(np.array)
    small = st.lists(st.floats(-1.5, 1.5), min_size=count, max_size=count).map(np.array)
    three = st.tuples(small | column, small, small).map(lambda parts: np.stack(parts, axis=-1))
    place = small if data.draw(st.booleans()) else column
    raw = RawFlight(
        format="hostile",
        time=np.sort(data.draw(small)) * data.draw(st.sampled_from([1e-6, 1.0, 100.0])),
        latitude=data.draw(st.none() | place),
        longitude=data.draw(st.none() | place),
        height=data.draw(st.none() | column | small),
        velocity_n=data.draw(st.none() | three),
        euler=data.draw(st.none() | three),
        body_rate=data.draw(st.none() | three),
        acceleration_b=data.draw(st.none() | three),
        airspeed=data.draw(st.none() | small),
    )
    settings = ImportSettings(
        curve=data.draw(st.sampled_from(["auto", "velocity", "position", "air data"])),
        longest_gap=1000.0,
        wind=data.draw(st.sampled_from(["fitted", "none", "constant"])),
    )
    try:
        read = prepare_flight(raw, settings)
    except MissionError:
        return
    assert str(read.report)
    assert (np.diff(read.recording.time) > 0).all()
    for name in ("latitude", "longitude", "height", "velocity_n", "euler"):
        assert np.isfinite(getattr(read.recording, name)).all()
