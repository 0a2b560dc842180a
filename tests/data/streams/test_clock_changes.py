"""Clocks of devices that are set, begin anew, turn over, repeat or run backwards, with even arrivals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from live_streams import RATE, motion
from scripted_source import Scripted, until

import lab.live
from lab.data.clock.limits import LIMITS
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.samples import FIX
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.transport import Chunk

COUNT, AT, BEGIN, HOST = 700, 300, 4000.0, 9000.0
TRUE = BEGIN + np.arange(COUNT) / RATE
"""Times of a clock with which nothing is wrong [s]."""
DEVICES = ("vectornav", "xsens", "mip", "mavlink", "text")
"""Devices with a clock. That of MEMSense turns over every 0.14 s and that of u-blox's IMU every 11 minutes,
so changes by more cannot be seen."""


def set_by(step: float) -> np.ndarray:
    return np.asarray(TRUE + step * (np.arange(COUNT) >= AT))


def stream(device: str, times: np.ndarray, many: int = 1, silence: float = 0.0) -> list[Chunk]:
    """Return samples with these times, which arrive evenly; after `AT` of them, a silence [s] later."""
    encoder, sent = ENCODERS[device](), motion(COUNT)
    sent["time"] = times
    chunks = []
    for k in range(0, COUNT, many):
        arrival = HOST + (k + many - 1) / RATE + (silence if k >= AT else 0.0)
        chunks.append(Chunk(arrival, encoder.encode(sent[k : k + many], np.empty(0, FIX))))
    return chunks


def received(device: str, chunks: list[Chunk]) -> tuple[Reception, np.ndarray]:
    reception = Reception(device)
    parts = [reception.accept(chunk)[0] for chunk in chunks]
    return reception, np.concatenate([*parts, reception.lose(chunks[-1].arrival)[0]])


@pytest.mark.proof
@pytest.mark.parametrize("many", [1, 10])
@pytest.mark.parametrize("step", [1.0, -1.0, 3600.0, -3600.0, 0.3, -0.02, -(BEGIN + AT / RATE)])
@pytest.mark.parametrize("device", [*DEVICES, "ublox"])
def test_a_clock_that_is_set_is_one_event_with_its_size(device: str, step: float, many: int) -> None:
    if device == "ublox" and abs(step) > 300:
        pytest.skip("its clock turns over every 11 minutes, so it shows only a part of this step")
    reception, imu = received(device, stream(device, set_by(step), many))
    assert len(imu) == COUNT  # none is lost
    assert np.abs(np.diff(imu["time"]) - 1 / RATE).max() < 1e-3  # as they arrived
    assert np.allclose(imu["rate"], motion(COUNT)["rate"], atol=0.01)  # in order
    (event,) = reception.imu.watch.events
    assert event.size == pytest.approx(step, abs=1e-3)
    words = "forward by" if step > 0 else "began anew" if step < -3601 else "back by"
    assert words in event.text
    assert f"{abs(step):.2f}" in event.text
    assert (reception.loss.missing, reception.loss.backwards, reception.loss.jumps) == (0, 0, 1)


@pytest.mark.parametrize(
    ("device", "turn", "words"),
    [
        *((device, 2**32 * 1e-6, "32 bits of microseconds") for device in ("vectornav", "mip", "mavlink")),
        *(("vectornav", 2**bits * 1e-3, f"{bits} bits of milliseconds") for bits in (16, 24, 32)),
    ],
)
def test_a_counter_that_turns_over_is_called_so(device: str, turn: float, words: str) -> None:
    reception, imu = received(device, stream(device, (TRUE - BEGIN - 3.0) % turn))
    (event,) = reception.imu.watch.events
    assert "turned over" in event.text
    assert words in event.text
    assert len(imu) == COUNT


@pytest.mark.proof
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("words", ["runs backwards", "repeats"])
def test_a_useless_clock_is_one_event_and_samples_are_timed_by_number(device: str, words: str) -> None:
    times = set_by(0.0)
    times[AT:] = TRUE[AT] - (TRUE[AT:] - TRUE[AT]) if words == "runs backwards" else TRUE[AT]
    reception, imu = received(device, stream(device, times))
    assert len(imu) == COUNT
    assert np.abs(np.diff(imu["time"]) - 1 / RATE).max() < 1e-3
    (event,) = reception.imu.watch.events
    assert words in event.text
    assert reception.imu.timing == "by the number of samples at 100 Hz, measured"


def test_time_stamps_that_are_rounded_from_the_beginning_lose_no_sample() -> None:
    reception, imu = received("vectornav", stream("vectornav", np.floor(10 * TRUE) / 10))
    assert len(imu) == COUNT
    assert np.abs(np.diff(imu["time"])[20:] - 1 / RATE).max() < 2e-3
    assert len(reception.imu.watch.events) == 1


def test_a_clock_that_runs_evenly_again_is_used_again() -> None:
    times = set_by(0.0)
    times[AT : AT + 50] = TRUE[AT]
    reception, imu = received("vectornav", stream("vectornav", times))
    assert ["repeats" in event.text for event in reception.imu.watch.events] == [True, False]
    assert "evenly again" in reception.imu.watch.events[-1].text
    assert reception.imu.timing == "by the clock of the device"
    assert LIMITS.even + 50 < COUNT - AT
    assert len(imu) == COUNT
    assert np.abs(np.diff(imu["time"]) - 1 / RATE).max() < 5e-3


@pytest.mark.parametrize("step", [-5.0, 3600.0, -4000.0])
def test_a_silence_in_which_the_clock_was_set_lasts_as_the_arrivals_show(step: float) -> None:
    reception, imu = received("vectornav", stream("vectornav", set_by(step + 3.0), silence=3.0))
    assert len(imu) == COUNT
    steps = np.diff(imu["time"])
    assert steps[AT - 1] == pytest.approx(3.0 + 1 / RATE, abs=0.02)
    assert np.abs(np.delete(steps, AT - 1) - 1 / RATE).max() < 1e-3
    assert imu["gap"][AT]
    (event,) = reception.imu.watch.events
    assert event.size == pytest.approx(step, abs=0.02)


def test_a_datagram_that_comes_after_later_ones_is_no_change_of_the_clock() -> None:
    chunks = stream("vectornav", TRUE)
    chunks[AT], chunks[AT + 1] = (
        Chunk(chunks[AT].arrival, chunks[AT + 1].data),
        Chunk(chunks[AT + 1].arrival, chunks[AT].data),
    )
    reception, imu = received("vectornav", chunks)
    assert (len(imu), reception.loss.backwards, reception.loss.jumps) == (COUNT - 1, 1, 0)


@pytest.mark.proof
@pytest.mark.parametrize("words", ["set", "backwards"])
@pytest.mark.parametrize("begin", [0, AT - 50, AT + 100])
def test_a_recording_of_it_has_the_samples_of_the_stream(words: str, begin: int, tmp_path: Path) -> None:
    times = set_by(-1.0)
    if words == "backwards":
        times[AT:] = TRUE[AT] - (TRUE[AT:] - TRUE[AT])
    transport, path = Scripted(), tmp_path / "clock.inslab"
    chunks = stream("vectornav", times)
    transport.steps = list(chunks[:begin])
    with lab.live.open(transport, protocol="vectornav") as source:
        until(lambda: source.end.imu == begin)
        source.record(path)
        transport.steps.extend(chunks[begin:])
        until(lambda: source.end.imu == COUNT)
        live, events = source.since().imu, source.status.events
        source.stop_recording()
    told = [event.text for event in events if "clock" in event.text]
    assert len(told) == 1
    replayed = recorded_samples(path).imu
    assert replayed["time"].tobytes() == live["time"][begin:].tobytes()
    assert LIMITS.within < 50  # the change before the last recording was reported before it began
