"""Temperature: profiles against closed forms, the thermometer, and the compensation over a whole flight."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions import Recording, write_flight_csv
from lab.sensors.temperature import TemperatureSettings, temperature, thermometer

TIME = np.linspace(0, 1000, 11)
HEIGHT = np.linspace(0, 2500, 11)
COEFFICIENTS = {
    "sensors.gyro.bias_temperature": 0.02,
    "sensors.gyro.scale_temperature": 0.05,
    "sensors.accelerometer.bias_temperature": 1.0,
    "sensors.accelerometer.scale_temperature": 0.05,
}


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ("none", np.full(11, 25.0)),
        ("constant", np.full(11, -10.0)),
        ("warm_up", -10 + 30 * (1 - np.exp(-TIME / 200))),
        ("climb", -10 - 6.5 * np.linspace(0, 2.5, 11)),
    ],
)
def test_profiles(profile, expected):
    settings = TemperatureSettings(profile=profile, start=-10, warm_up_rise=30, warm_up_time=200)
    assert np.allclose(temperature(settings, TIME, HEIGHT), expected, rtol=1e-12)


def test_warm_up_has_done_63_percent_after_its_time():
    settings = TemperatureSettings(profile="warm_up", start=20, warm_up_rise=10, warm_up_time=100)
    after = temperature(settings, np.array((0.0, 100.0, 1e5)), np.zeros(3))
    assert np.allclose(after, (20, 26.3212, 30), atol=1e-4)


def test_the_thermometer_is_white_about_the_truth():
    true = np.linspace(0, 50, 20_000)
    noise = thermometer(TemperatureSettings(thermometer_sigma=0.5), 1, true) - true
    assert noise.std() == pytest.approx(0.5, rel=5 / np.sqrt(40_000))
    assert abs(np.mean(noise[1:] * noise[:-1])) < 5 * 0.25 / np.sqrt(20_000)
    assert np.array_equal(thermometer(TemperatureSettings(), 1, true), true)
    other = thermometer(TemperatureSettings(thermometer_sigma=0.5), 2, true) - true
    assert abs(np.corrcoef(noise, other)[0, 1]) < 5 / np.sqrt(20_000)


def climbing() -> Recording:
    """Return a climb of 60 s at 60 m/s, weaving."""
    time = np.arange(0, 60.05, 0.1)
    course = 0.5 + 0.3 * np.sin(0.2 * time)
    velocity = np.stack((60 * np.cos(course), 60 * np.sin(course), np.full(time.size, -10.0)), axis=-1)
    steps = np.vstack((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * 0.1, axis=0)))
    lat, lon, height = pymap3d.ned2geodetic(*steps.T, 45.0, 9.0, 500.0)
    return Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=height,
        velocity_n=velocity,
        euler=np.stack((0.35 * np.cos(0.2 * time), 0.1 + 0 * time, course), axis=-1),
    )


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the path of the climb."""
    path = tmp_path_factory.mktemp("flights") / "climb.csv"
    write_flight_csv(path, climbing())
    return str(path)


def run(flight: str, seed: int = 1, **temperature: object) -> Result:
    """Run the climb with sensors that feel the temperature."""
    one = Experiment(mission=flight, seed=seed)
    one.update({"sensors": {"temperature": temperature}})
    for path, value in COEFFICIENTS.items():
        one.set(path, value)
    return one.run()


def attitude_error(result: Result) -> float:
    """Return the rms attitude error of the second half of a flight [°]."""
    return float(np.sqrt((result.errors.attitude.values[result.time.size // 2 :] ** 2).mean()))


@pytest.mark.parametrize("profile", ["constant", "warm_up", "climb"])
def test_with_compensation_the_errors_are_near_those_without_temperature(flight, profile):
    """And without it they are worse, over six seeds."""
    heat = {"profile": profile, "start": 60.0, "warm_up_rise": 20.0, "warm_up_time": 20.0, "lapse_rate": 20.0}
    free, warm, compensated = (
        np.array([attitude_error(run(flight, seed, **settings)) for seed in range(6)])
        for settings in ({}, heat, {**heat, "compensation": True, "thermometer_sigma": 0.2})
    )
    print(
        f"\n{profile}: {free.mean():.3f}° none, {warm.mean():.3f}° felt, {compensated.mean():.3f}° corrected"
    )
    assert warm.mean() > 1.5 * free.mean()
    assert compensated.mean() == pytest.approx(free.mean(), rel=0.05)
    assert np.allclose(compensated, free, rtol=0.3)


def test_the_climb_cools_by_the_height_flown(flight):
    """600 m at 20 K/km are 12 K, which the bias shows."""
    result = run(flight, profile="climb", start=25.0, lapse_rate=20.0)
    inside = result.gyro.bias / (1 + result.gyro.scale)  # the bias shown is that of the output
    change = np.degrees(inside[-1] - inside[0])
    climbed = result.truth.height.values[-1] - result.truth.height.values[0]
    assert climbed == pytest.approx(600, abs=10)
    assert np.allclose(change, -0.02 * 20e-3 * climbed, rtol=1e-3)


def test_without_a_profile_compensation_with_a_perfect_thermometer_changes_nothing(flight):
    plain, compensated = run(flight), run(flight, compensation=True)
    for one, other in zip(plain.gyro[:2], compensated.gyro[:2], strict=True):
        assert np.array_equal(one, other)


def test_a_temperature_nobody_feels_and_a_coefficient_without_temperature_are_remarked(flight):
    assert "sensors.gyro.bias_temperature has no effect" in run(flight).remarks[0]
    assert run(flight, profile="warm_up").remarks == ()
    one = Experiment(mission=flight)
    assert one.run().remarks == ()
    one.sensors.temperature.profile = "climb"
    assert (
        "No sensor depends on the temperature (sensors.temperature.profile is climb)" in one.run().remarks[0]
    )
