"""Headings and speeds in a recorded file: its replay, its mission, the batch and the live navigator on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from live_batch import assert_equal, follow, navigator, suite

import lab.live
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.raw_recording import RawWriter
from lab.data.streams.recorded_log import log_of_recording, recorded_samples
from lab.data.streams.transport import Chunk
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.missions.library import add_log
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

FITTED = ("sensors.heading.fitted=true", "sensors.odometer.fitted=true")
END = 60.0
"""End of the recording [s]."""


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    """Return a flight with two antennas and an odometer."""
    return SimulatedFlight.of("montreal", 100.0, seed=3, rest=15.0, assignments=FITTED)


def recording(path: Path, flight: SimulatedFlight, device: str) -> Path:
    """Record what a device sends of a flight, late and in uneven pieces."""
    encoder, writer = ENCODERS[device](), RawWriter(path, {"protocol": device})
    rng, imu = np.random.default_rng(5), flight.imu
    fixes = readings = 0
    for end in range(10, round(END * flight.rate), 10):
        now = float(imu["time"][end - 1])
        due, come = (int(np.searchsorted(rows["time"], now - 0.15)) for rows in (flight.fix, flight.reading))
        data = encoder.encode(imu[end - 10 : end], flight.fix[:0])
        data += encoder.encode(imu[:0], flight.fix[fixes:due]) if due > fixes else b""
        data += encoder.encode_readings(flight.reading[readings:come]) if come > readings else b""
        fixes, readings = due, come
        writer.accept(Chunk(5000.0 + now + float(rng.exponential(2e-3)), data))
    writer.close()
    return path


def sensors() -> SensorSuite:
    """Return sensors with two antennas and an odometer."""
    made = suite()
    made.heading.fitted = made.odometer.fitted = True
    return made


@pytest.mark.proof
@pytest.mark.parametrize("device", ["ublox", "mavlink"])
def test_a_recorded_file_replays_bit_for_bit_and_its_mission_has_all(
    device: str, flight: SimulatedFlight, tmp_path: Path
) -> None:
    if device == "mavlink":
        pytest.importorskip("pymavlink")
    path = recording(tmp_path / "flight.inslab", flight, device)
    found = recorded_samples(path)
    live = navigator(sensors=sensors(), vehicle="aeroplane")
    with lab.live.open(f"replay:{path}?speed=max") as source:
        follow(live, source)
        replayed = source.since(None)
    for name in ("imu", "fix", "reading"):
        assert getattr(found, name).tobytes() == getattr(replayed, name).tobytes(), name
    sent = flight.reading[flight.reading["time"] < END - 0.4]
    for name, least in (("heading", 0.99), ("speed", 0.99)):
        assert np.isfinite(found.reading[name]).sum() >= least * np.isfinite(sent[name]).sum() > 40

    log = log_of_recording(path)
    added = add_log(log, "drive", title="Drive", folder=tmp_path)
    mine = read_sensor_log(added.path).auxiliary
    for series, name in ((mine.headings, "heading"), (mine.odometer, "speed")):
        whole = np.isfinite(found.reading[name])
        assert series.time.size == whole.sum()
    own = np.degrees(mine.headings.sigma)
    if device in (
        "ublox",
        "mavlink",
    ):  # the unit of accHeading and hdg_acc is 1e-5°; the table has six digits
        assert own == pytest.approx(float(flight.result.experiment.sensors.heading.noise), abs=1e-4)
    else:
        assert np.isnan(own).all()

    assert live.state.phase == "navigating"
    settings = NavigatorSettings(vehicle="aeroplane")
    run = navigate_log(log, sensors(), settings, start=live.alignment)
    assert (run.solution.aid_sample >= 0).sum() > 80
    assert_equal(live, run)
