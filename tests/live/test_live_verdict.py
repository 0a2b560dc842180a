"""The verdict on a stream: settings of flights and logs that do not hold for a stream have no effect."""

from __future__ import annotations

import numpy as np
import pytest

from lab import Experiment
from lab.live.live_navigator import LiveNavigator
from lab.live.live_verdict import verdict_of
from lab.live.simulated_flight import SimulatedFlight
from lab.live.stream_settings import stream_settings
from lab.logs.sensor_log import SensorLog

LENGTH = 60.0
"""Length of the stream [s]: enough fixes for a verdict."""


@pytest.fixture(scope="module")
def streamed() -> SensorLog:
    """Return the log of a stream, as a live navigator keeps it."""
    imu, fixes = SimulatedFlight.of("los_angeles", 20.0).timed()
    navigator = LiveNavigator(Experiment().sensors, Experiment().navigator)
    navigator.feed(imu[imu["time"] <= LENGTH], fixes[fixes["time"] <= LENGTH])
    return navigator.log()


def of_a_flight() -> Experiment:
    """Return settings with an outage, a part of a log, and sensors that a stream does not have."""
    experiment = Experiment()
    experiment.sensors.gps.outages = [(5.0, 55.0)]
    experiment.sensors.barometer.fitted = True
    experiment.navigator.update({"log_from": 1000.0, "smoother": True, "estimate_gps_drift": True})
    return experiment


def test_the_verdict_is_that_of_the_same_stream_without_settings_of_flights(streamed: SensorLog) -> None:
    plain, other = Experiment(), of_a_flight()
    said = str(verdict_of(streamed, plain.sensors, plain.navigator))
    assert said
    assert str(verdict_of(streamed, other.sensors, other.navigator)) == said


def test_the_settings_themselves_are_not_changed() -> None:
    experiment = of_a_flight()
    before = experiment.to_dict()
    sensors, navigator = stream_settings(experiment.sensors, experiment.navigator)
    assert experiment.to_dict() == before
    assert list(sensors.gps.outages) == []
    assert navigator.log_from is None
    assert not np.any([sensors.barometer.fitted, navigator.smoother, navigator.estimate_gps_drift])
