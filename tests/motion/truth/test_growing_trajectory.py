"""The growing trajectory: a turn in closed form, its pieces, and the tie to the positions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from turning_flight import Turning

from lab.motion.frames.displacement import displacement
from lab.motion.recordings.recording import Frame
from lab.motion.truth import growing_trajectory
from lab.motion.truth.growing_trajectory import FOLLOWS, FlownPiece, GrowingTrajectory

RATE = 100.0


def pieces(frames: list[Frame], rate: float = RATE, start: int = 0, behind: float = 0.0) -> list[FlownPiece]:
    growing = GrowingTrajectory(rate, start, behind)
    return [piece for frame in frames for piece in growing.add(frame)]


def times(seconds: float, *, jitter: float = 0.0) -> np.ndarray:
    """Return times of frames at 50 Hz that vary as those of a simulator do."""
    regular = np.arange(0.0, seconds, 0.02)
    return regular + np.random.default_rng(1).uniform(-jitter, jitter, regular.size)


def increments(piece: FlownPiece) -> tuple[np.ndarray, np.ndarray]:
    ideal = piece.trajectory.increments()
    part = slice(piece.begin - piece.first, piece.end - piece.first)
    return ideal.dtheta[part], ideal.dvelocity[part]


@pytest.mark.proof
@pytest.mark.parametrize("jitter", [0.0, 0.004])
@pytest.mark.parametrize("where", [Turning(), Turning(latitude=-1.2, longitude=np.pi - 1e-5, bank=-0.3)])
def test_a_turn_feels_what_its_closed_form_feels(where: Turning, jitter: float) -> None:
    """Limits: a fiftieth of the Earth's rate, and 5 µg."""
    t = times(30, jitter=jitter)
    found = pieces(where.frames(t))
    assert found[0].begin == 0
    assert all(a.end == b.begin for a, b in pairwise(found))
    assert found[-1].end > RATE * (t[-1] - 0.5)
    dtheta, dvelocity = (np.concatenate(column) for column in zip(*map(increments, found), strict=True))
    # Simpson's rule over each interval of 10 ms is exact to 10⁻¹² here.
    nodes = t[0] + (np.arange(len(dtheta))[:, None] + (0.0, 0.5, 1.0)) / RATE
    for mine, felt, limit in zip((dtheta, dvelocity), where.felt(nodes.ravel()), (1.5e-6, 5e-5), strict=True):
        mean = np.einsum("nkj,k->nj", felt.reshape(-1, 3, 3), (1, 4, 1)) / 6
        off = np.abs(RATE * mine - mean)
        assert off[50:].max() < limit
        assert off.max() < 20 * limit  # the end of the spline at the first frame
    assert np.linalg.norm(mean, axis=1).min() > 9


def test_the_truth_of_a_turn_is_the_turn() -> None:
    where, t = Turning(), times(20)
    for piece in pieces(where.frames(t)):
        at = np.arange(piece.begin, piece.end + 1) / RATE
        truth = piece.trajectory.at(piece.since(at))
        for k, frame in enumerate(where.frames(at)):
            assert np.abs(displacement(frame.position[None], truth.position[k : k + 1])).max() < 1e-4
            assert np.abs(truth.velocity_n[k] - frame.velocity_n).max() < 1e-4
            assert np.abs(np.exp(1j * truth.euler[k]) - np.exp(1j * frame.euler)).max() < 1e-6


def joints(found: list[FlownPiece]) -> np.ndarray:
    """Return the largest steps from piece to piece of position [m], velocity [m/s], rate and force [SI]."""
    steps = []
    for one, other in pairwise(found):
        at = np.array([one.end / RATE])
        before, after = (piece.trajectory.at(piece.since(at)) for piece in (one, other))
        felt = zip(*(piece.trajectory.rates(piece.since(at)) for piece in (one, other)), strict=True)
        steps.append(
            [
                np.abs(displacement(before.position, after.position)).max(),
                np.abs(after.velocity_n - before.velocity_n).max(),
                *(np.abs(b - a).max() for a, b in felt),
            ]
        )
    return np.max(steps, axis=0)


def rough(t: np.ndarray) -> list[Frame]:
    """Return a turn whose velocity and attitude are rough, as those of single precision and a bumpy road."""
    rng = np.random.default_rng(2)
    return [
        frame._replace(
            velocity_n=frame.velocity_n + rng.normal(scale=0.05, size=3),
            euler=frame.euler + rng.normal(scale=1e-3, size=3),
        )
        for frame in Turning().frames(t)
    ]


def test_pieces_join_to_one_curve(monkeypatch: pytest.MonkeyPatch) -> None:
    position, velocity, rate, force = joints(pieces(rough(times(10))))
    assert position < 1e-8
    assert velocity < 1e-8
    assert rate < 1e-6
    assert force < 1e-5
    monkeypatch.setattr(growing_trajectory, "OVERLAP", 2)
    assert joints(pieces(rough(times(10))))[3] > 1e-3


@pytest.mark.proof
def test_the_curve_is_tied_to_the_positions() -> None:
    """A velocity that is 0.1 m/s too large, for minutes: the curve stays 2/ω of it ahead."""
    t = times(150)
    wrong = [f._replace(velocity_n=f.velocity_n + np.array((0.1, 0, -0.1))) for f in Turning().frames(t)]
    last = pieces(wrong)[-1]
    at = np.array([last.end / RATE])
    truth = last.trajectory.at(last.since(at))
    off = displacement(Turning().frames(at)[0].position[None], truth.position)[0]
    assert off == pytest.approx((0.2 / FOLLOWS, 0.0, -0.2 / FOLLOWS), abs=0.02)


def test_it_reaches_back_and_begins_anywhere() -> None:
    found = pieces(Turning().frames(times(10)), start=777, behind=1.5)
    assert found[0].first == found[0].begin == 777
    assert found[-1].begin - found[-1].first >= 150
    late = found[-1].trajectory.at(found[-1].since(np.array([found[-1].begin / RATE - 1.5])))
    there = Turning().frames(np.array([(found[-1].begin - 777) / RATE - 1.5]))[0]
    assert np.abs(displacement(there.position[None], late.position)).max() < 1e-3


@pytest.mark.proof
def test_memory_is_bounded_and_irregular_frames_are_taken() -> None:
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.choice([0.001, 0.02, 0.06, 0.5], 3000, p=[0.2, 0.6, 0.19, 0.01]))
    growing, most = GrowingTrajectory(RATE), 0
    end = 0
    for frame in Turning().frames(t):
        for piece in growing.add(frame):
            assert piece.begin == end
            end = piece.end
            most = max(most, len(piece.trajectory.time))
    assert end > RATE * (t[-1] - t[0] - 3.0)
    assert most < 500
    assert len(growing._frames) < 50


def test_no_curve_close_to_a_pole() -> None:
    frame = Turning(latitude=1.56).frames(np.array([0.0]))[0]
    with pytest.raises(ValueError, match="closer than 1° to a pole"):
        list(GrowingTrajectory(RATE).add(frame))
