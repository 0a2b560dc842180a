"""Twin: sensors that are those of the settings are not accused; louder ones and a vibration are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import lab.live.twin as twin_module
from lab.analysis.rest import Record, card_of, with_noise
from lab.data.streams.live_log import make_log
from lab.experiment.experiment import Experiment
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.live.twin import TwinComparison, twin_at_rest, twin_of
from lab.navigation.settings import NavigatorSettings
from lab.sensors.cards import card
from lab.sensors.suite import SensorSuite
from lab.views.twin_comparison import TwinFigures, twin_html

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
    return twin_of(make_log("real", imu, fix), sensors, NavigatorSettings(), seed=7).sentences


def test_the_sensors_of_the_settings_are_not_accused(
    flown: tuple[Rows, SensorSuite], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sentences(flown, monkeypatch, "") == []


@pytest.mark.proof
def test_a_card_that_was_just_measured_is_not_accused_in_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """A record at rest shows no turn-on bias: those of the settings are simulated with its noise."""
    monkeypatch.setattr(twin_module, "TWINS", 5)
    settings = Experiment()
    card("ADIS16465-1").load(settings)
    sensors = {"sensors": settings.sensors.to_dict()}
    still = SimulatedFlight.of("rest", HZ, seed=1234, rest=60.0, settings=sensors).imu
    records = {
        "gyro": Record(still["rate"].copy(), 1 / HZ),
        "accelerometer": Record(still["force"].copy(), 1 / HZ),
    }
    measured = with_noise(settings.sensors, card_of("mine", records, "a test"))
    imu, fix = SimulatedFlight.of("montreal", HZ, seed=1001, rest=15.0, settings=sensors).timed()
    log = make_log("real", imu[imu["time"] < 60], fix[fix["time"] < 60])
    assert twin_of(log, measured, settings.navigator, seed=7).sentences == []


def test_small_factors_have_two_digits() -> None:
    said = twin_module._difference("gyro noise", np.log(0.0512), np.log([0.999, 1.0, 1.001])).sentence
    assert "is 0.051 times (0.051 to 0.051," in said


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


def at_rest(monkeypatch: pytest.MonkeyPatch, drift: float = 0.0, noise: float = 1.0) -> TwinComparison:
    """Return the comparison of 100 s of a device at rest, with a random walk added to its gyros.

    Parameters
    ----------
    drift
        Random walk of the angular rate [°/s/√s].
    noise
        Factor on the noise of the accelerometers.
    """
    monkeypatch.setattr(twin_module, "TWINS", 5)
    flight = SimulatedFlight.of("rest", HZ, seed=1001, rest=100.0)
    rate, force = flight.imu["rate"].copy(), flight.imu["force"].copy()
    rng = np.random.default_rng(5)
    rate += np.radians(drift) * np.cumsum(rng.normal(size=rate.shape), axis=0) / np.sqrt(HZ)
    force += (noise - 1) * (force - force.mean(axis=0))
    records = {"gyro": Record(rate, 1 / HZ), "accelerometer": Record(force, 1 / HZ)}
    return twin_at_rest(records, flight.result.experiment.sensors, seed=7)


def test_at_rest_the_sensors_of_the_settings_are_not_accused(monkeypatch: pytest.MonkeyPatch) -> None:
    found = at_rest(monkeypatch)
    assert found.sentences == []
    names = {one.name for one in found.differences}
    assert {"gyro noise", "gyro deviation over 1 s", "accelerometer line"} <= names
    assert not [name for name in names if "100 s" in name]  # a record of 100 s shows nothing of it
    assert "agree within chance" in twin_html(found)


def test_at_rest_a_wandering_bias_is_told_by_the_slow_deviation_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.2 °/s/√s over 1 s is 0.2/√3 = 0.12 °/s beside 0.05 °/s of the noise, and nothing above 20 Hz."""
    said = " ".join(at_rest(monkeypatch, drift=0.2).sentences)
    assert "The Allan deviation over 1 s of the real gyro" in said
    assert "noise" not in said
    assert "accelerometer" not in said


def test_at_rest_noise_of_three_times_is_three_in_all_that_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {one.name: one for one in at_rest(monkeypatch, noise=3.0).differences}
    for name in ("accelerometer noise", "accelerometer deviation over 1 s"):
        assert np.exp(found[name].real - found[name].simulated) == pytest.approx(3.0, rel=0.15)
        assert found[name].sentence
    assert not found["gyro noise"].sentence


def test_what_is_drawn_and_written_is_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    found = at_rest(monkeypatch, noise=3.0)
    html = twin_html(found)
    assert html.count('class="number differs"') == len(found.sentences)
    level = next(one for one in found.differences if one.name == "accelerometer noise")
    assert f">{np.exp(level.real) / 9.80665e-6:.3g}<" in html
    figures = TwinFigures()
    figures.show(found)
    data = figures.figures[1].renderers[1].data_source.data
    high = np.asarray(data["at"]) > 20
    assert np.median(np.asarray(data["x"])[high] / np.asarray(data["x_dashed"])[high]) == pytest.approx(
        3, rel=0.15
    )
    figures.clear()
    assert all(len(fig.renderers[0].data_source.data["at"]) == 0 for fig in figures.figures)
