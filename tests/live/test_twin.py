"""Twin: sensors that are those of the settings are not accused; louder ones and a vibration are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import lab.live.twin as twin_module
from lab.live.live_log import log_of
from lab.live.simulated_flight import SimulatedFlight
from lab.live.twin import twin_of
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

HZ = 100.0
Rows = tuple[NDArray[np.void], NDArray[np.void]]


@pytest.fixture(scope="module")
def flown() -> tuple[Rows, SensorSuite]:
    flight = SimulatedFlight.of("montreal", HZ, seed=1001, rest=15.0)
    imu, fix = flight.timed()
    return (imu[imu["time"] < 60], fix[fix["time"] < 60]), flight.result.experiment.sensors


def sentences(flown: tuple[Rows, SensorSuite], monkeypatch: pytest.MonkeyPatch, change: str) -> list[str]:
    monkeypatch.setattr(twin_module, "TWINS", 5)
    (imu, fix), sensors = flown
    imu = imu.copy()
    if change == "loud":  # three times the noise in all, of 0.05 °/s/√Hz
        noise = np.random.default_rng(3).normal(size=(len(imu), 3))
        imu["rate"] += np.sqrt(8 * HZ) * np.radians(0.05) * noise
    if change == "line":
        imu["force"][:, 2] += 0.5 * np.sin(2 * np.pi * 30 * imu["time"])
    return twin_of(log_of("real", imu, fix), sensors, NavigatorSettings(), seed=7).sentences


def test_the_sensors_of_the_settings_are_not_accused(
    flown: tuple[Rows, SensorSuite], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sentences(flown, monkeypatch, "") == []


def test_three_times_the_noise_is_told(
    flown: tuple[Rows, SensorSuite], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = " ".join(sentences(flown, monkeypatch, "loud"))
    assert "The noise of the real gyro above 20 Hz is 3." in said or "is 2.9" in said
    assert "noise of the real accelerometer" not in said


def test_a_vibration_is_told(flown: tuple[Rows, SensorSuite], monkeypatch: pytest.MonkeyPatch) -> None:
    said = sentences(flown, monkeypatch, "line")
    assert [one for one in said if one.startswith("The spectrum of the real accelerometer has a line")]
    assert not [one for one in said if "gyro has a line" in one]
