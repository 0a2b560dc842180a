"""X-Plane as a source: sockets, threads, recordings, and what is told when something is wrong."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from live_batch import follow
from scripted_source import streaming, until
from xplane_simulator import XPlaneSimulator, montreal

import lab.live
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.source import Source
from lab.data.streams.source_status import LOST, STALE
from lab.data.streams.transport import TransportError
from lab.live.live_navigator import LiveNavigator
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    until(lambda: set(threading.enumerate()) <= before)


@pytest.fixture
def xplane() -> Iterator[XPlaneSimulator]:
    with XPlaneSimulator(montreal(60.0)) as running:
        yield running


def opened(xplane: XPlaneSimulator, options: str = "") -> Source:
    return lab.live.open(f"xplane:127.0.0.1:{xplane.port}?protocol=vectornav{options}")


def said(source: Source) -> str:
    return source.status.sentence


def events(source: Source) -> str:
    return " ".join(event.text for event in source.status.events)


@pytest.mark.proof
def test_samples_fixes_and_truth_come_and_a_replay_has_the_same_bits(
    xplane: XPlaneSimulator, tmp_path: Path
) -> None:
    path = tmp_path / "flight.inslab"
    source = opened(xplane, "&hz=200&seed=3")
    source.record(path)
    with source:
        until(lambda: source.end.imu > 600 and source.end.fix > 2)
        status = streaming(source)
        assert status.rate == pytest.approx(200, rel=1e-6)
        assert status.loss.missing == 0
        assert abs(status.drift) < 1e-9
        (subscriber,) = xplane.subscribers.values()
        assert subscriber.rate == 50
        assert source.truth is not None
    read = source.since()
    true = source.truth.at(read.imu["time"])
    assert np.isfinite(true.position).all()
    there = source.truth.at(read.fix["time"])
    assert np.abs(read.fix["height"] - there.position[:, 2]).max() < 5  # σ 0.7 m
    replayed = recorded_samples(path)
    assert replayed.imu.tobytes() == read.imu.tobytes()
    assert replayed.fix.tobytes() == read.fix.tobytes()
    until(lambda: not xplane.subscribers)  # X-Plane is asked to stop


@pytest.mark.proof
def test_a_jump_is_named_and_a_new_flight_begins(xplane: XPlaneSimulator) -> None:
    with opened(xplane) as source:
        until(lambda: source.end.imu > 200)
        xplane.jump(40.0)
        until(lambda: "the aircraft was moved by" in events(source))
        count = source.end.imu
        until(lambda: source.end.imu > count + 100)
        assert "A new flight began" in said(source)
        assert "since the aircraft was moved by" in said(source)
        imu = source.since().imu
    assert imu["gap"].sum() == 2
    assert np.diff(imu["time"]).max() > 2.9


@pytest.mark.proof
def test_the_navigator_tells_the_cause_of_a_jump_once(xplane: XPlaneSimulator) -> None:
    live = LiveNavigator(SensorSuite(), NavigatorSettings())
    with opened(xplane) as source:
        following = threading.Thread(target=follow, args=(live, source), name="follows")
        following.start()
        until(lambda: source.end.imu > 200)
        xplane.jump(40.0)
        until(lambda: live.state.rows.breaks == 1)
    following.join()
    (told,) = [remark for remark in live.state.remarks if "aligned again" in remark]
    assert told.startswith("The stream broke (the aircraft was moved by ")
    assert "silent" not in " ".join(live.state.remarks)


@pytest.mark.proof
def test_a_pause_is_told_and_leaves_no_gap(xplane: XPlaneSimulator) -> None:
    with opened(xplane) as source:
        until(lambda: source.end.imu > 150)
        xplane.paused = True
        until(lambda: bool(re.search(r"is paused: its clock has stood still for \d+ s", said(source))))
        until(lambda: source.status.state == STALE)
        xplane.paused = False
        count = source.end.imu
        until(lambda: source.end.imu > count + 100)
        assert "paused" not in said(source)
        assert streaming(source).rate == pytest.approx(100, rel=1e-6)  # by the time of the stream
        imu = source.since().imu
    assert np.diff(imu["time"]) == pytest.approx(0.01, abs=1e-6)
    assert imu["gap"].sum() == 1


def test_another_pace_is_told_and_changes_no_interval(xplane: XPlaneSimulator) -> None:
    xplane.pace = 2.0
    with opened(xplane) as source:
        until(lambda: "The simulator's clock runs 2.0 times as fast" in said(source))
        imu = source.since().imu
        assert streaming(source).rate == pytest.approx(100, rel=1e-6)
    assert np.diff(imu["time"]) == pytest.approx(0.01, abs=1e-6)


@pytest.mark.proof
def test_lost_frames_are_bridged_or_break_the_flight(xplane: XPlaneSimulator) -> None:
    with opened(xplane) as source:
        until(lambda: source.end.imu > 150)
        xplane.lose = 6
        until(lambda: "1 gap of up to" in said(source))
        xplane.silent = True
        until(lambda: bool(re.search(r"has sent nothing for \d+ s: is it paused", said(source))))
        assert source.status.state == STALE
        xplane.silent = False
        until(lambda: "s of the flight did not come" in events(source))
        count = source.end.imu
        until(lambda: source.end.imu > count + 50)


@pytest.mark.proof
def test_no_x_plane_is_told() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", 0))
        with lab.live.open(f"xplane:127.0.0.1:{deaf.getsockname()[1]}") as source:
            until(lambda: "is X-Plane running with a flight loaded" in said(source))
            assert source.status.state == STALE
            assert source.end.imu == 0


def test_no_such_computer_is_told() -> None:
    with lab.live.open("xplane:no-such-computer.invalid:49000") as source:
        until(lambda: source.status.state == LOST)
        assert said(source).startswith("Not reached: ")


def test_an_x_plane_without_a_clock_is_told(xplane: XPlaneSimulator) -> None:
    xplane.clock = False
    with opened(xplane) as source:
        until(lambda: "X-Plane sends positions without its clock" in said(source))
        assert source.end.imu == 0


@pytest.mark.proof
def test_hostile_packets_among_the_others_change_nothing(xplane: XPlaneSimulator) -> None:
    xplane.noise = b"RPOS4" + bytes(range(64)) * 5
    with opened(xplane) as source:
        until(lambda: source.end.imu > 200)
        assert "of other kinds" in said(source)
        assert np.diff(source.since().imu["time"]) == pytest.approx(0.01, abs=1e-6)


def test_packets_from_elsewhere_are_not_used(
    xplane: XPlaneSimulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(xplane) as source:
        until(lambda: source.end.imu > 50)
        monkeypatch.setattr(source._transport._link, "peer", ("127.0.0.2", xplane.port))
        count = source.end.imu
        until(lambda: "packets from elsewhere were not used" in said(source))
        assert source.end.imu < count + 50


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("xplane:", "accepted is xplane:COMPUTER:PORT"),
        ("xplane:here:0", "names no port from 1 to 65535"),
        ("xplane:here:49000?speed=2", "'speed' is no option of a xplane source"),
        ("xplane:here:49000?hz=5", "accepted are 10 to 1000 Hz"),
        ("xplane:here:49000?frames=0.5", "accepted are 1 to 1000 Hz"),
        ("xplane:here:49000?seed=1.5", "accepted are whole numbers"),
        ("xplane:here:49000?device=toaster", "is no device; accepted are vectornav"),
    ],
)
def test_a_wrong_address_is_refused(address: str, why: str) -> None:
    with pytest.raises(TransportError, match=why.replace("?", r"\?")):
        lab.live.open(address)
