"""The verdict on a stream: settings of flights and logs that do not hold for a stream have no effect."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import lab.live.station as station_module
from lab import Experiment
from lab.data.log.sensor_log import SensorLog
from lab.data.streams.live_log import make_log
from lab.live import open as open_source
from lab.live.live_navigator import LiveNavigator
from lab.live.live_verdict import judge_stream
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.live.stream_settings import stream_settings

LENGTH = 120.0
"""Length of the stream [s]: what a live navigator keeps."""


def rows(mission: str = "los_angeles", **gps: Any) -> tuple[Any, Any]:
    """Return samples and fixes of a flight, with settings of the receiver."""
    imu, fixes = SimulatedFlight.of(mission, 20.0, settings={"sensors": {"gps": gps}}).timed()
    return imu[imu["time"] <= LENGTH], fixes[fixes["time"] <= LENGTH]


def streamed(imu: Any, fixes: Any) -> SensorLog:
    """Return the log of a stream, as a live navigator keeps it."""
    navigator = LiveNavigator(Experiment().sensors, Experiment().navigator)
    navigator.feed(imu, fixes)
    return navigator.log()


def of_a_flight() -> Experiment:
    """Return settings with an outage, a part of a log, and sensors that a stream does not have."""
    experiment = Experiment()
    experiment.sensors.gps.outages = [(5.0, 55.0)]
    experiment.sensors.odometer.fitted = True
    experiment.navigator.update({"log_from": 1000.0, "smoother": True, "estimate_gps_drift": True})
    return experiment


def test_the_verdict_is_that_of_the_same_stream_without_settings_of_flights() -> None:
    plain, other, log = Experiment(), of_a_flight(), streamed(*rows())
    said = str(judge_stream(log, plain.sensors, plain.navigator))
    assert "Consistent" in said
    assert str(judge_stream(log, other.sensors, other.navigator)) == said


GOOD = {"position_variance": 0.01, "velocity_variance": 0.01}
"""A receiver of 10 cm and 10 cm/s."""


@pytest.mark.proof
@pytest.mark.parametrize(
    ("mission", "receiver", "words"),
    [
        ("los_angeles", {**GOOD, "latency": 0.2}, "late"),
        ("los_angeles", {**GOOD, "lever_arm": (0.0, 0.0, -2.0)}, "lever arm"),
        # With the default receiver, only a flight with many turns shows the arm: its σ is 0.2 m here.
        ("pacific", {"lever_arm": (0.0, 2.0, 0.0)}, "lever arm"),
    ],
)
def test_a_fault_of_the_receiver_is_named_as_by_the_batch(
    mission: str, receiver: dict[str, Any], words: str
) -> None:
    imu, fixes = rows(mission, **receiver)
    experiment = Experiment()
    live = judge_stream(streamed(imu, fixes), experiment.sensors, experiment.navigator)
    assert words in str(live)
    log = make_log("recorded", imu, fixes)
    assert str(judge_stream(log, experiment.sensors, experiment.navigator)) == str(live)


def test_the_settings_themselves_are_not_changed() -> None:
    experiment = of_a_flight()
    before = experiment.to_dict()
    sensors, navigator = stream_settings(experiment.sensors, experiment.navigator)
    assert experiment.to_dict() == before
    assert list(sensors.gps.outages) == []
    assert navigator.log_from is None
    experiment.set("sensors.airspeed.fitted", True)
    assert not stream_settings(experiment.sensors, experiment.navigator)[0].airspeed.fitted
    assert sensors.odometer.fitted == experiment.sensors.odometer.fitted  # a stream may have one
    assert not np.any([navigator.smoother, navigator.estimate_gps_drift])


def test_a_verdict_on_a_solution_that_is_no_more_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station_module, "JUDGED", 0.01)
    source = open_source("simulated:rest?hz=20&rest=60")
    station = station_module.Station(source, Experiment().sensors, Experiment().navigator, "rest")
    try:
        station.verdict = "Consistent: as of the flight before."
        end = time.monotonic() + 60
        while station.verdict:  # it aligns: it has no position of its own
            assert time.monotonic() < end
            station.source.wait(station.source.end, 0.05)
    finally:
        station.close()
