"""X-Plane as truth: samples, fixes and truth of a flight that comes frame by frame, at full speed."""

from __future__ import annotations

import struct
from functools import cache

import numpy as np
import pytest
from turning_flight import Turning
from xplane_sender import frames_of
from xplane_simulator import STEP, montreal, packets

from lab import Experiment
from lab.data.clock.limits import LIMITS
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.samples import Samples, join_samples
from lab.data.protocols.xplane import REFERENCES
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.reception import Reception
from lab.data.streams.transport import Chunk
from lab.live.live_errors import errors_of, normalised_rms
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import HistoryCursor
from lab.live.simulated.simulated_flight import fix_rows, imu_rows
from lab.live.xplane.flight import AWAY, XPlaneFlight
from lab.live.xplane.frames import BrokenFlightError
from lab.sensors.sensor_stream import Sensed
from lab.sensors.suite import SensorSuite

ARRIVAL = 5000.0
RATE = 100.0


@cache
def sent() -> list[tuple[float, bytes, bytes]]:
    """Return time, RREF and RPOS of the frames of a flight."""
    recording = montreal(110.0)
    return [
        (
            time,
            b"RREF,"
            + b"".join(struct.pack("<if", k, values[name]) for k, (_, name, *_) in enumerate(REFERENCES)),
            b"RPOS4" + position,
        )
        for time, (position, values) in zip(
            recording.time - recording.time[0], frames_of(recording), strict=True
        )
    ]


def rows(flight: XPlaneFlight, sensed: list[Sensed]) -> Samples:
    """Return what a device sends."""
    return join_samples(
        [
            Samples(
                imu_rows(
                    one.time, one.gyro.increments * RATE, one.accelerometer.increments * RATE, AxisMap()
                ),
                fix_rows(one.fixes, flight.sensors.gps),
            )
            for one in sensed
        ]
    )


def silent() -> SensorSuite:
    """Return sensors without errors, and a receiver with almost none."""
    sensors = SensorSuite()
    for triad in (sensors.gyro, sensors.accelerometer):
        triad.update({"noise_density": 0.0, "bias_sigma": 0.0})
    sensors.gps.update({"position_variance": 1e-6, "velocity_variance": 1e-8, "period": 0.5})
    return sensors


@pytest.mark.proof
def test_the_errors_of_many_flights_are_as_large_as_their_sigma() -> None:
    """Eight seeds through packets, curve, sensors, bytes, clock and navigator."""
    normed: dict[str, list[float]] = {"position": [], "velocity": [], "attitude": []}
    experiment = Experiment(mission="montreal")
    experiment.navigator.vehicle = "aeroplane"
    flights = [XPlaneFlight(experiment.sensors, seed, RATE) for seed in range(1, 9)]
    navigators = [LiveNavigator(experiment.sensors, experiment.navigator) for _ in flights]
    receptions, encoder = [Reception("vectornav") for _ in flights], ENCODERS["vectornav"]()
    pieces = []
    for time, *both in sent():  # the curve is that of the first flight: it depends on no seed
        for k, packet in enumerate(both):
            for frame, _ in flights[0].frames.accept(packet, ARRIVAL + time + 1e-4 * k):
                pieces += flights[0].pieces(frame, ARRIVAL)
    for flight, navigator, reception in zip(flights, navigators, receptions, strict=True):
        flight.epoch = ARRIVAL
        for piece in pieces:
            found = rows(flight, [flight.measured(piece)])
            if len(found.imu):
                latest = flight.epoch + float(found.imu["time"][-1])
                navigator.feed(*reception.accept(Chunk(latest, encoder.encode(found.imu, found.fix))))
        navigator.finish()
        assert reception.loss.missing == 0
        _, told = navigator.since(HistoryCursor())
        errors = errors_of(told, flight.truth)
        assert np.isfinite(errors.position).all(axis=1).mean() > 0.8
        for name, value in normalised_rms(errors).items():
            normed[name].append(value**2)
    for name, values in normed.items():
        mean, spread = np.mean(values), np.std(values, ddof=1) / np.sqrt(len(values))
        assert abs(mean - 1) < 4 * spread + 0.1, (name, values)


def turning(seconds: float, sensors: SensorSuite, seed: int = 1):
    """Return the samples of a closed turn, and its flight."""
    flight = XPlaneFlight(sensors, seed, RATE)
    found = []
    for frame in Turning().frames(STEP * np.arange(seconds / STEP)):
        position, clock = packets(frame)
        found += flight.accept(clock, ARRIVAL + frame.time)
        found += flight.accept(position, ARRIVAL + frame.time + 1e-4)
    return rows(flight, found), flight


@pytest.mark.proof
def test_sensors_without_errors_feel_the_turn_of_the_aircraft() -> None:
    """Limits: 0.1 mrad/s and 3 mg, from the single precision of angles, velocity and clock in packets."""
    found, flight = turning(20.0, silent())
    zero = Turning().frames(np.array([0.0]))[0].time + flight.frames._last.time - 20.0 + STEP
    begin = flight.epoch - ARRIVAL  # the first frame that was used
    at = begin - 1e-4 + found.imu["time"] - 0.5 / RATE
    rate, force = Turning().felt(at)
    assert abs(zero) < 1e-3
    assert np.abs(found.imu["rate"] - rate)[50:].max() < 1e-4
    assert np.abs(found.imu["force"] - force)[50:].max() < 0.03
    truth = flight.truth.at(flight.epoch + found.fix["time"])
    assert len(found.fix) >= 37
    assert np.abs(found.fix["height"] - truth.position[:, 2]).max() < 6e-3  # 6 σ


def test_samples_follow_each_other_and_their_clock_needs_no_correction() -> None:
    found, flight = turning(12.0, SensorSuite())
    assert np.diff(found.imu["time"]) == pytest.approx(1 / RATE, abs=1e-9)
    assert np.isfinite(flight.truth.at(flight.epoch + found.imu["time"]).position).all()
    reception, encoder = Reception("vectornav"), ENCODERS["vectornav"]()
    timed, fixes = [], []
    for first in range(0, len(found.imu), 9):
        part = found.imu[first : first + 9]
        inside = (found.fix["time"] > part["time"][0] - 0.5 / RATE) & (
            found.fix["time"] < part["time"][-1] + 0.5 / RATE
        )
        data = encoder.encode(part, found.fix[inside])
        imu, fix = reception.accept(Chunk(flight.epoch + float(part["time"][-1]), data))
        timed.append(imu["time"])
        fixes.append(fix["time"])
    assert np.abs(np.concatenate(timed) - flight.epoch - found.imu["time"]).max() < 1e-8
    assert np.abs(np.concatenate(fixes) - flight.epoch - found.fix["time"]).max() < 1e-8
    assert abs(reception.imu.clock.drift) < 1e-9


@pytest.mark.proof
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    one, again, other = (turning(6.0, SensorSuite(), seed)[0] for seed in (3, 3, 4))
    assert one.imu.tobytes() == again.imu.tobytes()
    assert one.fix.tobytes() == again.fix.tobytes()
    assert not np.array_equal(one.imu["rate"], other.imu["rate"])


@pytest.mark.proof
def test_a_jump_begins_another_flight_behind_a_gap_that_is_not_filled() -> None:
    flight = XPlaneFlight(SensorSuite(), 1, RATE)
    imu = []
    frames = Turning().frames(STEP * np.arange(1000))
    for k, frame in enumerate(frames):
        shift = np.array([0.01 if k >= 500 else 0.0, 0, 0])
        position, clock = packets(frame._replace(position=frame.position + shift))
        for packet in (clock, position):
            try:
                imu.append(rows(flight, flight.accept(packet, ARRIVAL + frame.time)).imu)
            except BrokenFlightError as why:
                assert k == 500
                assert "the aircraft was moved by 63.7 km" in str(why)
                flight.begin_anew()
    time = np.concatenate(imu)["time"]
    gap = int(np.argmax(np.diff(time)))
    assert AWAY <= time[gap + 1] - time[gap] < AWAY + 1
    assert LIMITS.longest_filled < AWAY
    truth = flight.truth.at(flight.epoch + np.array([time[gap], time[gap] + 1.0, time[gap + 1], time[-1]]))
    assert np.isfinite(truth.position[[0, 2, 3]]).all()
    assert np.isnan(truth.position[1]).all()
    assert truth.position[2, 0] - truth.position[0, 0] > 0.009


@pytest.mark.proof
def test_the_navigator_aligns_again_after_a_jump() -> None:
    experiment = Experiment(mission="montreal")
    navigator = LiveNavigator(experiment.sensors, experiment.navigator)
    flight = XPlaneFlight(experiment.sensors, 1, RATE)
    reception, encoder = Reception("vectornav"), ENCODERS["vectornav"]()
    shift = 0.0
    for k, (time, clock, position) in enumerate(sent()[:1200]):
        if k == 800:
            shift = 0.05
        row = bytearray(position)
        row[13:21] = struct.pack("<d", struct.unpack("<d", row[13:21])[0] + shift)  # the latitude
        for packet in (clock, bytes(row)):
            try:
                found = rows(flight, flight.accept(packet, ARRIVAL + time))
            except BrokenFlightError:
                reception.lose(ARRIVAL)
                flight.begin_anew()
                continue
            if len(found.imu):
                latest = flight.epoch + float(found.imu["time"][-1])
                navigator.feed(*reception.accept(Chunk(latest, encoder.encode(found.imu, found.fix))))
    assert "so the navigator aligned again" in " ".join(navigator.state.remarks)


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    from lab.motion.truth.growing_truth import GrowingTruth

    monkeypatch.setattr(GrowingTruth, "KEPT", 500)
    _, flight = turning(15.0, SensorSuite())
    truth = flight.truth
    assert len(truth) == 500
    now = flight.epoch + flight._end / RATE
    assert np.isfinite(truth.at(np.array([now, now - 4.9])).position).all()
    assert np.isnan(truth.at(np.array([now - 5.1])).position).all()
