"""A station that has closed keeps no samples, whoever still refers to it."""

from __future__ import annotations

import gc
from types import BuiltinFunctionType, FunctionType, ModuleType

import numpy as np
import pytest

from lab.experiment.experiment import Experiment
from lab.live import open as open_source
from lab.live.live_state import HistoryCursor
from lab.live.simulated.simulated_device import SimulatedDevice
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.live.simulated.simulated_link import local_link
from lab.live.simulated.simulated_transport import SimulatedTransport
from lab.live.station import Station
from lab.missions import MissionError

SMALL = 2**15
"""Size of an array that is a state, and no stream [bytes]: a covariance, or the samples that the reception
compares with the next ones."""


def arrays_of(root: object) -> list[np.ndarray]:
    """Return the arrays of more than `SMALL` that an object keeps in memory, but for those of programs."""
    found: dict[int, object] = {}
    waiting = [root]
    while waiting:
        one = waiting.pop()
        # Of its type, because `isinstance` asks a proxy whose object has gone for that of the object.
        shared = issubclass(type(one), type | ModuleType | FunctionType | BuiltinFunctionType)
        if id(one) not in found and not shared:
            found[id(one)] = one
            waiting.extend(gc.get_referents(one))
    return [one for one in found.values() if issubclass(type(one), np.ndarray) and one.nbytes > SMALL]


def test_a_closed_station_has_no_arrays() -> None:
    experiment = Experiment()
    flight = SimulatedFlight.of("rest", 100.0, rest=20.0)
    device = SimulatedDevice(flight, "vectornav", local_link())
    source = open_source(SimulatedTransport("simulated:rest", device))
    station = Station(source, experiment.sensors, experiment.navigator, "rest")
    del flight, device
    try:
        with station.growing():
            source.wait(source.end, 30.0)
        assert arrays_of(station)
        samples = source.status.samples
    finally:
        station.close()
    assert arrays_of(station) == []
    assert station.history(HistoryCursor()) is None
    assert len(source.since().imu) == len(source.last(1.0).imu) == 0
    assert source.status.samples >= samples > 0
    with pytest.raises(MissionError, match="has ended"):
        station.log()
    station.close()
