"""Rebuilt flights are the flights flown: closed forms, and the precisions of files by every path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from raw_flights import position, raw_of, rounded_positions, weave, without
from scipy.interpolate import CubicSpline

from lab.data.rebuild.air_data import fit_wind, integrate_velocity
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.rebuild.reconstruction import Reconstruction, reconstruct
from lab.data.rebuild.time_repair import repair
from lab.missions import ImportSettings, MissionError, Recording, mission
from lab.missions.flight_import import prepare_flight
from lab.motion.frames import ecef
from lab.motion.frames.rotation import quaternion_from_euler
from lab.motion.truth.trajectory import Trajectory

EVEN = np.arange(2000) * 0.05
UNEVEN = np.cumsum(np.random.default_rng(3).uniform(0.02, 0.08, 2000)) - 0.02


def rebuilt(raw: RawFlight, **settings: object) -> Reconstruction:
    chosen = ImportSettings(**settings)
    return reconstruct(repair(raw, chosen.time_stamps, chosen.longest_gap), chosen)


def misses(recording: Recording, true: RawFlight) -> tuple[float, float, float]:
    """Return the largest errors of position [m], velocity [m/s] and attitude [rad], ends left out."""
    off = np.linalg.norm(ecef.displacement(position(true), position(recording)), axis=1)[20:-20]
    speed = np.linalg.norm(recording.velocity_n - true.velocity_n, axis=1)[20:-20]
    alike = np.sum(quaternion_from_euler(recording.euler) * quaternion_from_euler(true.euler), axis=1)
    turn = 2 * np.arccos(np.minimum(np.abs(alike), 1))[20:-20]
    return off.max(), speed.max(), turn.max()


def truth_at(recording: Recording, first: float, **place: float) -> RawFlight:
    return weave(recording.time + first, **place)


@pytest.mark.parametrize("curve", ["velocity", "position", "air data"])
@pytest.mark.parametrize("latitude", [-60.0, 0.0, 45.0])
@pytest.mark.parametrize("longitude", [-73.0, 179.99])
def test_every_curve_gives_the_flight_of_exact_samples(curve, latitude, longitude):
    place = {"latitude": latitude, "longitude": longitude}
    raw = weave(UNEVEN, **place)
    if curve != "velocity":
        raw = without(raw, "velocity_n")
    found = rebuilt(raw, curve=curve, wind="none")
    assert found.curve == curve
    off, speed, turn = misses(found.recording, truth_at(found.recording, UNEVEN[0], **place))
    assert off < 2e-3
    assert speed < 2e-3
    assert turn < 1e-5


@pytest.mark.parametrize("curve", ["velocity", "position"])
def test_a_flight_over_the_pole(curve):
    time = np.arange(1200) * 0.1
    # Up a meridian and down the opposite one, the latitude changing evenly.
    latitude = np.radians(89.96) + 80 / 6.4e6 * time
    over = latitude > np.pi / 2
    raw = RawFlight(
        format="over the pole",
        time=time,
        latitude=np.where(over, np.pi - latitude, latitude),
        longitude=np.where(over, 2.0 - np.pi, 2.0),
        height=np.full(time.size, 1000.0),
        velocity_n=np.stack(
            (np.where(over, -1, 1) * speed_along_meridian(latitude), 0 * time, 0 * time), axis=-1
        ),
        euler=np.stack((0 * time, 0 * time, np.where(over, np.pi, 0.0)), axis=-1),
    )
    found = rebuilt(raw, curve=curve, rate=10)
    assert np.linalg.norm(ecef.displacement(position(raw), position(found.recording)), axis=1).max() < 0.01
    away = np.abs(np.degrees(raw.latitude)) < 89.999
    assert np.abs(found.recording.velocity_n - raw.velocity_n)[away].max() < 0.02


def speed_along_meridian(latitude: np.ndarray) -> np.ndarray:
    from lab.motion.frames.earth import radii

    return 80 / 6.4e6 * (radii(np.sin(latitude))[0] + 1000)


def test_samples_that_need_nothing_are_the_recording():
    recording = mission("montreal").recording
    found = rebuilt(raw_of(recording))
    assert found.unchanged
    for name in (
        "time",
        "latitude",
        "longitude",
        "height",
        "velocity_n",
        "euler",
        "airspeed",
        "alpha",
        "beta",
    ):
        np.testing.assert_array_equal(getattr(found.recording, name), getattr(recording, name))


def test_missing_samples_are_bridged():
    raw = weave(EVEN)
    kept = np.ones(EVEN.size, dtype=bool)
    kept[np.random.default_rng(1).integers(10, 1990, 150)] = False
    found = rebuilt(raw.rows(kept))
    assert len(found.recording.time) == EVEN.size
    off, speed, _ = misses(found.recording, truth_at(found.recording, 0.0))
    assert off < 1e-3
    assert speed < 1e-3


def test_velocity_alone_starts_where_it_is_told():
    raw = without(weave(EVEN), "latitude", "longitude", "height")
    true = weave(EVEN)
    start = {
        "start_latitude": float(np.degrees(true.latitude[0])),
        "start_longitude": float(np.degrees(true.longitude[0])),
        "start_height": float(true.height[0]),
    }
    found = rebuilt(raw, **start)
    assert np.linalg.norm(ecef.displacement(position(true), position(found.recording)), axis=1).max() < 0.01
    assert "No position is recorded" in " ".join(found.remarks)


def test_heights_that_are_missing_follow_the_vertical_velocity():
    true = weave(EVEN)
    found = rebuilt(without(true, "height"), start_height=float(true.height[0]))
    np.testing.assert_allclose(found.recording.height, true.height, atol=0.01)


WIND = (7.0, -11.0)


def test_the_wind_is_fitted():
    raw = weave(EVEN, wind=WIND)
    found = rebuilt(without(raw, "velocity_n"), curve="air data", wind="fitted")
    np.testing.assert_allclose(found.wind, (*WIND, 0), atol=1e-3)
    assert np.linalg.norm(found.position_residual) < 0.05


def test_the_wind_is_given_and_blows_from_where_it_is_said_to():
    # Air that moves south and east comes from the north-west.
    raw = without(weave(EVEN, wind=(-5.0, 5.0)), "velocity_n")
    given = {"curve": "air data", "wind": "constant", "wind_speed": 50**0.5}
    right, wrong = (rebuilt(raw, wind_from=direction, **given) for direction in (315.0, 135.0))
    assert np.linalg.norm(right.position_residual) < 0.05
    assert np.linalg.norm(wrong.position_residual) > 100


def test_an_integral_over_the_ellipsoid_follows_a_parallel_round_the_earth():
    time = np.linspace(0, 7200, 7201)
    latitude, height = np.radians(60.0), 9000.0
    rate = np.radians(90.0) / 7200
    from lab.motion.frames.earth import radii

    speed = rate * (radii(np.sin(latitude))[1] + height) * np.cos(latitude)
    east = np.stack((0 * time, np.full(time.size, speed), 0 * time), axis=-1)
    way = integrate_velocity(time, east, np.array([latitude, -2.5, height]))
    true = np.stack((np.full(time.size, latitude), -2.5 + rate * time, np.full(time.size, height)), axis=-1)
    assert np.linalg.norm(ecef.position(way) - ecef.position(true), axis=1).max() < 0.05


def test_a_constant_wind_over_a_long_way():
    time = np.linspace(0, 3600, 3601)
    air = np.stack((np.full(3601, 40.0), 200 + 5 * np.sin(time / 100), 0 * time), axis=-1)
    start = np.array([0.9, 0.3, 8000.0])
    recorded = integrate_velocity(time, air + np.array([-20.0, 35.0, 0.0]), start)
    wind, found = fit_wind(time, air, recorded)
    np.testing.assert_allclose(wind, (-20, 35, 0), atol=0.01)
    assert np.linalg.norm(ecef.displacement(found[None], start[None])) < 20


def test_without_attitude_it_is_that_of_coordinated_turns_and_said_so():
    found = rebuilt(without(weave(EVEN), "euler", "airspeed", "alpha", "beta"))
    assert found.attitude_reconstructed
    course = np.arctan2(found.recording.velocity_n[:, 1], found.recording.velocity_n[:, 0])
    np.testing.assert_allclose(found.recording.euler[:, 2], course, atol=1e-9)
    boat = rebuilt(without(weave(EVEN), "euler", "airspeed", "alpha", "beta"), vehicle="boat")
    assert np.abs(boat.recording.euler[:, :2]).max() == 0


def test_the_heading_does_not_follow_the_noise_of_a_standstill():
    time = np.arange(160.0)
    east = np.where(time > 80, 10.0 * (time - 80), 0.0)
    noise = np.random.default_rng(4).normal(size=(2, time.size))
    raw = RawFlight(
        format="track",
        time=time,
        latitude=0.7 + noise[0] / 6.4e6,
        longitude=(east + noise[1]) / (6.4e6 * np.cos(0.7)),
        height=np.zeros(time.size),
    )
    found = rebuilt(raw, vehicle="car").recording
    standing = found.time < 78
    assert np.ptp(np.unwrap(found.euler[standing, 2])) < np.radians(20)
    driving = (found.time > 90) & (found.time < 150)
    assert np.abs(found.euler[driving, 2] - np.pi / 2).max() < np.radians(10)


def test_a_rate_that_is_given_is_that_of_the_recording():
    found = rebuilt(weave(EVEN), rate=37)
    np.testing.assert_allclose(np.diff(found.recording.time), 1 / 37, rtol=1e-9)


@pytest.mark.parametrize(
    ("lacking", "settings", "message"),
    [
        (("velocity_n",), {"curve": "velocity"}, "accepted here: auto, position, air data"),
        (("latitude", "longitude", "velocity_n", "airspeed"), {}, "no flight can be made of"),
    ],
)
def test_what_a_curve_needs_is_said(lacking, settings, message):
    with pytest.raises(MissionError, match=message):
        rebuilt(without(weave(EVEN), *lacking), **settings)


@pytest.mark.parametrize("clock", ["ticks", "packets"])
def test_single_precision_under_stamps_of_packets_is_smoothed_without_being_told(clock):
    """Frames of a simulator at 60 Hz, stamped by a coarse timer or as they arrive in bursts."""
    rng = np.random.default_rng(4)
    frames = np.cumsum(rng.uniform(0.5, 1.5, 6000) / 60)
    stamps = np.floor(frames / 0.0156) * 0.0156
    if clock == "packets":
        stamps = np.maximum.accumulate(frames + rng.exponential(0.02, frames.size))
    raw = weave(frames)

    def single(values):
        return np.float32(values).astype(float)

    raw = replace(
        without(raw, "velocity_n", "airspeed", "alpha", "beta"),
        time=stamps,
        latitude=np.radians(single(np.degrees(raw.latitude))),
        longitude=np.radians(single(np.degrees(raw.longitude))),
        height=single(raw.height / 0.3048) * 0.3048,
    )
    made = prepare_flight(raw)
    assert made.report.verdict == "plausible", made.report
    assert made.report.specific_force_noise < 1.0
    # The way is still the one flown: the smoothing takes out no more than the stamps put in.
    truth = weave(made.recording.time + frames[0])
    down = made.recording.velocity_n[:, 2] - truth.velocity_n[:, 2]
    assert np.sqrt(np.mean(down[30:-30] ** 2)) < 0.5


def test_noise_of_a_velocity_is_smoothed_and_shown():
    raw = weave(EVEN)
    rng = np.random.default_rng(8)
    noisy = replace(raw, velocity_n=raw.velocity_n + 0.1 * rng.normal(size=(EVEN.size, 3)))
    found = rebuilt(noisy, curve="velocity")
    assert "velocity" in found.smoothing
    np.testing.assert_allclose(found.velocity_residual, 0.1, rtol=0.2)
    by_samples = rebuilt(noisy, curve="velocity", smoothing="none")
    assert not by_samples.smoothing
    assert acceleration_error(found.recording, raw) < 0.2 * acceleration_error(by_samples.recording, raw)


def acceleration_error(recording: Recording, true: RawFlight) -> float:
    """Return the rms error of the acceleration [m/s²] away from the ends."""
    found = CubicSpline(recording.time, recording.velocity_n)(recording.time, 1)
    exact = CubicSpline(true.time, true.velocity_n)(recording.time, 1)
    return float(np.sqrt(np.mean(np.sum((found - exact)[20:-20] ** 2, axis=1))))


PRECISIONS = ("exact", "5 decimals", "float32", "7 decimals", "±1 ms")


def false_force(step: float) -> dict[str, dict[str, tuple[str, float]]]:
    """Return, by precision and path, which curve was made and the rms of its false specific force [m/s²].

    The flight is montreal's, known at any time by its trajectory; files hold up to 5000 samples of it.
    """
    trajectory = Trajectory.from_recording(mission("montreal").recording, 200)
    time = np.arange(int(min(trajectory.duration, 5000 * step) / step)) * step
    truth = trajectory.at(time)
    exact = RawFlight(
        format="exact",
        time=time,
        latitude=truth.latitude,
        longitude=truth.longitude,
        height=truth.height,
        velocity_n=truth.velocity_n,
        euler=truth.euler,
    )
    stamps = time + np.random.default_rng(0).uniform(-1e-3, 1e-3, time.size)
    files = {
        "exact": exact,
        "5 decimals": rounded_positions(exact, 5),
        "float32": replace(
            exact,
            latitude=np.radians(np.degrees(exact.latitude).astype(np.float32).astype(float)),
            longitude=np.radians(np.degrees(exact.longitude).astype(np.float32).astype(float)),
        ),
        "7 decimals": replace(
            rounded_positions(exact, 7),
            height=np.round(exact.height, 3),
            velocity_n=np.round(exact.velocity_n, 3),
        ),
        "±1 ms": replace(exact, time=np.sort(stamps)),
    }
    paths = {
        "splined position": {"curve": "position", "smoothing": "none", "time_stamps": "as recorded"},
        "splined velocity": {"curve": "velocity", "smoothing": "none", "time_stamps": "as recorded"},
        "position": {"curve": "position"},
        "automatic": {},
    }
    return {
        precision: {
            path: (
                (found := rebuilt(raw, **settings)).curve,
                force_error(found.recording, trajectory, raw.time[0] if precision == "±1 ms" else 0.0),
            )
            for path, settings in paths.items()
        }
        for precision, raw in files.items()
    }


def force_error(recording: Recording, trajectory: Trajectory, first: float) -> float:
    """Return the rms of the false specific force between the samples [m/s²], its turning left out."""
    middle = recording.time[100:-100] + 0.37 * np.diff(recording.time[100:-99])
    around = np.stack([trajectory.at(middle + first + shift).velocity_n for shift in (-1e-3, 1e-3)])
    exact = (around[1] - around[0]) / 2e-3
    found = CubicSpline(recording.time, recording.velocity_n)(middle, 1)
    return float(np.sqrt(np.mean(np.sum((found - exact) ** 2, axis=1))))


@pytest.mark.proof
@pytest.mark.parametrize("step", [0.055, 0.01])
def test_false_specific_force_by_precision_and_path(step):
    table = false_force(step)
    print(f"\nFalse specific force of montreal, recorded every {1000 * step:g} ms [m/s² rms]")
    for precision, paths in table.items():
        print(f"  {precision:12}", *(f"{path} {error:.3g}" for path, (_, error) in paths.items()), sep="  ")
    rough = {precision: paths["splined position"][1] for precision, paths in table.items()}
    assert rough["5 decimals"] > 100
    assert rough["float32"] > 100
    for precision in PRECISIONS:
        paths = table[precision]
        curve, automatic = paths["automatic"]
        assert curve == "velocity"
        assert automatic < 1.05 * min(error for _, error in paths.values())
        assert automatic < (0.2 if step == 0.055 else 0.12)
        # Positions alone, smoothed as much as they ask for, are usable too.
        assert paths["position"][1] < 3.0
