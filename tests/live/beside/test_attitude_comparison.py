"""Attitudes side by side: against rotations that are known, in a notebook's way, and with a played phone."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from played_phone import Played
from scipy.spatial.transform import Rotation, Slerp

import lab.live
from lab.data.clock.timed_samples import TIMED_READING
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.ring import Cursor, Read
from lab.live.beside import attitude_comparison
from lab.live.beside.attitude_comparison import DEVICE, OURS, TRUTH, AttitudeComparison
from lab.live.live_state import HistoryCursor
from lab.live.phone.hub import PhoneHub
from lab.live.phone.server import PhoneServer
from lab.live.station import Station
from lab.motion.truth.growing_truth import Kinematics

TURNS = np.radians([[0, 5, 10], [10, -20, 90], [-30, 60, 200], [5, 5, 359]])
"""Roll, pitch and heading at 0, 10, 20 and 30 s."""


def rotation(euler: Any) -> Rotation:
    return Rotation.from_euler("ZYX", np.asarray(euler)[..., ::-1])


MOTION = Slerp([0.0, 10.0, 20.0, 30.0], rotation(TURNS))


class Own:
    """An algorithm that has finished; it errs by a rotation in north, east, down."""

    name = "Mine"
    reached = np.inf

    def __init__(self, error: Rotation) -> None:
        self._error = error

    def since(self, row: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Return the attitudes after a row, 27 a second."""
        time = np.arange(row * 0.037, 30.0, 0.037)
        return row + len(time), time, (self._error * MOTION(time)).as_quat(scalar_first=True)


def station_of(error: Rotation, device: Rotation | None = None) -> Any:
    """Return a station whose navigator errs by a rotation, and whose device by another."""
    time = np.arange(0.0, 30.0, 0.05)
    euler = (error * MOTION(time)).as_euler("ZYX")[:, ::-1]
    readings = np.zeros(0, TIMED_READING)
    if device is not None:
        readings = np.zeros(290, TIMED_READING)
        readings["time"] = np.linspace(0.3, 29.9, 290)
        readings["attitude"] = (device * MOTION(readings["time"])).as_quat(scalar_first=True)

    def history(cursor: HistoryCursor) -> tuple[HistoryCursor, Any]:
        part = slice(cursor.row, None)
        return HistoryCursor(len(time), 0), SimpleNamespace(time=time[part], euler=euler[part])

    def since(cursor: Cursor) -> Read:
        end = Cursor(0, 0, len(readings))
        return Read(end, readings[:0], readings[:0], 0, readings[cursor.reading :])

    truth = SimpleNamespace(at=kinematics)
    source = SimpleNamespace(truth=truth, end=Cursor(0, 0, len(readings)), since=since)
    return SimpleNamespace(source=source, begun=1, zero=0.0, newest=29.95, history=history)


def kinematics(time: np.ndarray) -> Kinematics:
    nothing = np.zeros((len(time), 3))
    return Kinematics(nothing, nothing, MOTION(time).as_euler("ZYX")[:, ::-1])


def test_differences_are_those_of_the_rotations_that_were_put_in() -> None:
    """A heading off by 30° changes no tilt, and a tilt of 2° about north and east is 2°."""
    tilt = 2.0 * np.array([0.6, 0.8, 0.0])
    ours, device = (Rotation.from_rotvec(one, degrees=True) for one in (tilt, [0.0, 0.0, 30.0]))
    comparison = AttitudeComparison(station_of(ours, device), [Own(Rotation.identity())])  # type: ignore[list-item]
    time, euler = comparison.advance(finish=True)
    assert comparison.names == comparison.known == (OURS, "Mine", DEVICE, TRUTH)
    assert np.diff(time) == pytest.approx(1 / 20)
    found = {(one.first, one.second): one for one in comparison.differences()}
    of_ours, of_mine = found[OURS, TRUTH], found["Mine", TRUTH]
    assert np.degrees(of_ours.tilt) == pytest.approx(2.0, abs=0.01)
    assert np.degrees(of_mine[3:]) == pytest.approx(np.zeros(5), abs=0.01)
    of_device = found[DEVICE, TRUTH]
    assert np.degrees(of_device.tilt) == pytest.approx(0.0, abs=0.02)
    assert np.degrees(of_device.heading_offset) == pytest.approx(30.0, abs=0.05)
    assert np.degrees(of_device.heading) == pytest.approx(0.0, abs=0.05)
    assert np.degrees(found[DEVICE, OURS].tilt) == pytest.approx(2.0, abs=0.01)
    shown = comparison.dataset()
    assert list(shown.estimate.values) == [OURS, "Mine", DEVICE, TRUTH]
    assert np.radians(shown.attitude.sel(estimate=TRUTH).values) == pytest.approx(euler[:, 3], nan_ok=True)
    last = comparison.differences(5.0)
    assert last[0].seconds == pytest.approx(5.0, abs=0.1)


def test_a_phone_that_stands_upright_has_a_tilt_and_no_roll() -> None:
    """At a pitch of 90° roll and heading are one angle; only the tilt is compared there."""
    upright = Slerp([0.0, 30.0], rotation(np.radians([[0, 90, 0], [0, 90, 0]])))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("test_attitude_comparison.MOTION", upright)
        station = station_of(Rotation.from_rotvec([3.0, 0, 0], degrees=True))
        comparison = AttitudeComparison(station)
        comparison.advance(finish=True)
    (one,) = comparison.differences()
    assert np.degrees(one.tilt) == pytest.approx(3.0, abs=0.05)
    assert np.isnan(one.roll)
    assert " - " in str(one)


def test_a_row_waits_two_seconds_for_who_is_late_and_no_longer() -> None:
    own = Own(Rotation.identity())
    own.reached = 10.0
    own.since = lambda row: (row, np.zeros(0), np.zeros((0, 4)))  # type: ignore[method-assign]
    comparison = AttitudeComparison(station_of(Rotation.identity()), [own])  # type: ignore[list-item]
    time, euler = comparison.advance()
    assert time[-1] == pytest.approx(27.95, abs=0.051)
    assert np.isnan(euler[:, 1]).all()
    assert np.isfinite(euler[1:, 0]).all()


def test_a_stream_that_begins_anew_is_compared_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attitude_comparison, "KEPT", 100)
    station = station_of(Rotation.identity())
    comparison = AttitudeComparison(station)
    first, _ = comparison.advance()
    assert len(first) <= 101
    assert len(comparison.advance()[0]) == 0
    station.begun += 1
    again, _ = comparison.advance()
    assert np.array_equal(first, again)


class Still:
    """A filter of a notebook: whatever comes, north and level."""

    def step(self, imu: Any, fixes: Any) -> list[float]:
        """Return no rotation."""
        return [1.0, 0.0, 0.0, 0.0]


class Other:
    """No algorithm."""


def test_a_notebook_compares_a_class_of_its_own(tmp_path: Path) -> None:
    """The simulated device on a table stands at roll 2°, pitch -3°, heading 40°."""
    with lab.live.attitudes("simulated:rest?device=vectornav", Still) as laboratory:
        laboratory.run(5)
        shown = str(laboratory)
        known = laboratory.dataset().attitude.sel(estimate=TRUTH)[-1].values
    found = {(one.first, one.second): one for one in laboratory.differences()}
    mine = found["Still", TRUTH]
    roll, pitch, heading = known
    assert np.degrees(mine[4:7]) == pytest.approx([abs(roll), abs(pitch), -heading], abs=0.01)
    assert "Still - truth" in shown
    for what, words in ((Station, "without arguments"), (object(), "__slots__"), (Other, "no method step")):
        with pytest.raises(ValueError, match=words):
            lab.live.attitudes("simulated:rest", what)


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    with PhoneServer(PhoneHub(), folder=tmp_path, push_port=0) as server:
        yield Played(server)


def test_a_phone_s_own_attitude_comes_through_in_the_axes_of_the_vehicle(played: Played) -> None:
    """A phone face up whose top points 40° west of north, then is raised by 20° and rolled by 10°."""
    angles = [(40.0, 0.0, 0.0), (40.0, 20.0, 0.0), (40.0, 20.0, 10.0)]
    source = lab.live.open(
        played.hub.transport(played.ticket.key), protocol="phone", axes="y,x,-z", name="phone"
    )
    with source:
        while not played.post().said["read"]:
            pass
        for number, one in enumerate(angles):
            batch = still(number, [[1000 + 100 * number, *one]])
            assert played.post(batch).status == 200
        while source.end.reading < 3:
            source.wait(source.end, 1.0)
        found = source.since().reading
    assert np.isnan(found["heading"]).all()
    for row, (alpha, beta, gamma) in zip(found, angles, strict=True):
        # Of the specification: turns about z, x and y of the device from axes that point east, north and up.
        east_north_up = Rotation.from_euler("ZXY", [alpha, beta, gamma], degrees=True)
        forward, right, down = (
            east_north_up.apply(one) for one in ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0])
        )
        ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ np.column_stack((forward, right, down))
        assert Rotation.from_quat(row["attitude"], scalar_first=True).as_matrix() == pytest.approx(
            ned, abs=1e-5
        )
    roll, pitch, heading = np.degrees(rotation_euler(found["attitude"]).T)
    assert heading[0] == pytest.approx(-40.0, abs=0.01)
    assert pitch[1] == pytest.approx(20.0, abs=0.01)
    assert roll[1] == pytest.approx(0.0, abs=0.01)


def rotation_euler(q_nb: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q_nb, scalar_first=True).as_euler("ZYX")[:, ::-1]


def still(number: int, turned: Any) -> dict[str, Any]:
    first = 6 * number
    rows = [[1000 + (first + one) * 1000 / 60, 0, 0, 0, 0, 0, 9.8] for one in range(6)]
    return {
        "number": number,
        "first": first,
        "imu": rows,
        "fix": [],
        "up": [0, 0, 1],
        "turned": turned,
    }


@pytest.mark.parametrize(
    "turned",
    ["x", [[1]], [[1, 2, 3, 4, 5]], [[1000, 0, 0, 0]] * 201, [["a", 1, 2, 3]], {}, [[None, 0, 0, 0]]],
)
def test_what_is_no_attitude_is_refused_as_no_batch(played: Played, turned: Any) -> None:
    assert played.post(still(0, turned)).status == 400


def test_angles_that_are_not_known_are_left_out(played: Played) -> None:
    transport = played.hub.transport(played.ticket.key)
    with lab.live.open(transport, protocol="phone") as source:
        while not played.post().said["read"]:
            pass
        assert played.post(still(0, [[1000, None, 1, 2], [1010, 10, 1, 2]])).status == 200
        while source.end.imu < 6 or source.end.reading < 1:
            source.wait(source.end, 1.0)
        assert source.end.reading == 1


def test_axes_turn_an_attitude_with_the_vehicle() -> None:
    """A vector that is fixed to the Earth has the same components whatever the axes are called."""
    for axes in (("y", "x", "-z"), ("-z", "x", "-y"), ("x", "y", "z")):
        q_nd = Rotation.random(5, random_state=3).as_quat(scalar_first=True)
        q_nb = AxisMap(axes).attitude(q_nd)
        of_device = np.array([0.1, -0.2, 0.3])
        there = Rotation.from_quat(q_nd, scalar_first=True).apply(of_device)
        mapped = AxisMap(axes).mapped(of_device[None])[0]
        assert Rotation.from_quat(q_nb, scalar_first=True).apply(mapped) == pytest.approx(there)
    gaps = np.array([[np.nan] * 4, [1.0, 0, 0, 0]])
    assert np.isnan(AxisMap(("y", "x", "-z")).attitude(gaps)[0]).all()


def test_the_page_draws_while_a_station_is_read_by_two(tmp_path: Path) -> None:
    """Two watchers of one station share an algorithm, and see the same."""
    path = tmp_path / "mine.py"
    path.write_text("class Still:\n    def step(self, imu, fixes): return [1.0, 0, 0, 0]\n")
    with lab.live.attitudes("simulated:rest?device=vectornav", f"{path}:Still") as laboratory:
        station = laboratory.station
        assert station.beside("Still", "another") is laboratory.algorithms[0]
        other = AttitudeComparison(station, laboratory.algorithms)
        laboratory.run(3)
        other.advance(finish=True)
        assert threading.active_count() < 30
        one, two = laboratory.differences(), other.differences()
    assert [(a.first, a.second) for a in one] == [(b.first, b.second) for b in two]
    assert np.array(one[0][3:]) == pytest.approx(np.array(two[0][3:]), abs=1e-3, nan_ok=True)
