"""The simulated device brings its vehicle: heading and position come with the first course."""

from __future__ import annotations

import time

import numpy as np
import pytest

from lab.data.streams.axis_map import AxisMap
from lab.experiment.experiment import Experiment
from lab.live import open as open_source
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import NAVIGATING
from lab.live.simulated.simulated_flight import REST, SimulatedFlight, missing_rest
from lab.live.station import Station
from lab.motion.frames.rotation import euler_from_quaternion, wrap

SEEN = {False: 18.0, True: 12.0}
"""Time by which heading and position must be there without and with a magnetometer [s]: ten seconds level,
the next shows the field; the first seconds of the run-up give a course."""
STILL = 12.0
"""Rest of a simulated flight on the page [s]."""


@pytest.mark.parametrize("magnetometer", [False, True])
def test_heading_and_position_come_with_the_first_course(magnetometer: bool) -> None:
    experiment = Experiment(mission="montreal")
    experiment.sensors.heading.update({"fitted": magnetometer, "source": "magnetometer"})
    mounted = AxisMap.of("y,-x,z")
    flight = SimulatedFlight.of(
        "montreal",
        100.0,
        rest=missing_rest("montreal", STILL),
        settings={"sensors": experiment.sensors.to_dict()},
        axes=mounted,
    )
    assert np.isfinite(flight.imu["magnetic"]).any() == magnetometer
    experiment.navigator.vehicle = flight.vehicle
    live = LiveNavigator(experiment.sensors, experiment.navigator)
    imu, fix = flight.timed()
    for name in ("rate", "force", "magnetic"):
        imu[name] = mounted.mapped(imu[name], force=name == "force")
    for begin in range(0, round(100 * SEEN[magnetometer]), 10):
        rows = imu[begin : begin + 10]
        since = -np.inf if begin == 0 else imu["time"][begin - 1]
        live.feed(rows, fix[(fix["time"] > since) & (fix["time"] <= rows["time"][-1])], flight.reading[:0])
    state, truth = live.state, flight.result.truth_arrays
    assert state.phase == NAVIGATING
    at = int(np.searchsorted(truth.time, state.time))
    error = wrap(state.euler[2] - euler_from_quaternion(truth.q_nb[at : at + 1])[0, 2])
    assert abs(error) < 3 * state.euler_sigma[2] < np.radians(30)
    assert np.isfinite(state.position).all()
    assert state.euler_sigma[2] < np.radians(3) or not magnetometer


def test_a_device_says_its_vehicle_only_if_it_goes_as_its_nose_points() -> None:
    assert SimulatedFlight.of("pacific", 20.0).vehicle == "aeroplane"
    assert not SimulatedFlight.of(REST, 20.0, rest=3.0).vehicle
    assert missing_rest("pacific", STILL) == 0.0  # it begins in flight
    assert 0 < missing_rest("montreal", STILL) < STILL  # it stands for a while itself


@pytest.mark.parametrize(("set_by_hand", "assumed"), [("auto", "aeroplane"), ("boat", "boat")])
def test_a_station_takes_the_vehicle_of_its_source_unless_one_is_set(set_by_hand: str, assumed: str) -> None:
    experiment = Experiment()
    experiment.navigator.vehicle = set_by_hand
    source = open_source("simulated:montreal?hz=20")
    station = Station(source, experiment.sensors, experiment.navigator, "montreal")
    try:
        end = time.monotonic() + 60
        while not station.source.end.imu:
            assert time.monotonic() < end
            station.source.wait(station.source.end, 0.1)
        assert station._navigator is not None
        assert station._navigator._navigator.vehicle == assumed
        assert station.settings.vehicle == set_by_hand  # what others compare theirs with
    finally:
        station.close()
