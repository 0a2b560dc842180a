"""Live algorithms: pieces of a stream, what they may return, and files that hold none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.clock.timed_samples import TIMED_IMU
from lab.live.beside.live_algorithm import (
    FixPiece,
    LiveAlgorithmError,
    Piece,
    cut_pieces,
    load_live_algorithm,
    step_algorithm,
)


def imu(time: np.ndarray) -> np.ndarray:
    rows = np.zeros(len(time), TIMED_IMU)
    rows["time"] = time
    rows["rate"] = np.arange(3 * len(time)).reshape(-1, 3)
    return rows


def fixes(time: list[float]) -> FixPiece:
    count = len(time)
    return FixPiece(np.array(time, float), *(np.zeros((count, 3)) for _ in range(3)))


@given(
    st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=60),
    st.lists(st.floats(0.0, 130.0), max_size=10),
    st.floats(0.05, 3.0),
)
def test_pieces_hold_each_sample_and_each_fix_once_and_in_order(
    steps: list[float], times: list[float], longest: float
) -> None:
    rows = imu(7.0 + np.cumsum(steps))
    given_fixes = fixes(sorted(7.0 + one for one in times))
    pieces = cut_pieces(rows, given_fixes, 7.0, longest)
    assert np.array_equal(np.concatenate([one.imu.time for one in pieces]), rows["time"])
    assert np.array_equal(np.concatenate([one.imu.rate for one in pieces]), rows["rate"])
    assert np.array_equal(np.concatenate([one.fixes.time for one in pieces]), given_fixes.time)
    assert np.concatenate([one.imu.dt for one in pieces]).sum() == pytest.approx(sum(steps))
    for one in pieces:
        assert one.imu.time.size > 0
        assert one.imu.time[-1] - one.imu.time[0] <= longest
    for one in pieces[:-1]:
        assert (one.fixes.time <= one.imu.time[-1]).all()


def test_the_first_sample_of_a_stream_has_the_usual_step() -> None:
    (piece,) = cut_pieces(imu(np.array([5.0, 5.01, 5.02])), fixes([]), np.nan, 1.0)
    assert piece.imu.dt == pytest.approx([0.01, 0.01, 0.01])
    assert cut_pieces(imu(np.zeros(0)), fixes([1.0]), np.nan, 1.0) == []


class Returns:
    """An algorithm that returns, or raises, always the same."""

    def __init__(self, what: object) -> None:
        self.what = what

    def step(self, _imu: object, _fixes: object) -> object:
        """Return it."""
        if isinstance(self.what, BaseException):
            raise self.what
        return self.what


PIECE: Piece = cut_pieces(imu(np.array([1.0, 2.0])), fixes([]), 0.0, 5.0)[0]


@pytest.mark.parametrize("what", [[1, 0, 0, 0], np.float32([[1, 0, 0, 0], [0.6, 0.8, 0, 0]])])
def test_attitudes_after_the_last_sample_or_after_each_are_accepted(what: object) -> None:
    found = step_algorithm(Returns(what), "Mine", PIECE)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert found == pytest.approx(np.reshape(what, (-1, 4)), abs=1e-6)
    assert step_algorithm(Returns(None), "Mine", PIECE).shape == (0, 4)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("north", "returned str"),
        ([1, 0, 0], r"shape \(3,\)"),
        (np.ones((3, 4)), r"accepted is \(4,\) or \(2, 4\)"),
        ([1, 0, 0, 1], "no unit quaternion"),
        ([np.nan, 0, 0, 0], "not finite"),
        ({}, "returned dict"),
        (ValueError("no idea"), "test_live_algorithm.py, line .*, in step: ValueError: no idea"),
        (SystemExit(), "SystemExit"),
    ],
)
def test_anything_else_is_refused_under_the_name_of_the_algorithm(what: object, words: str) -> None:
    with pytest.raises(LiveAlgorithmError, match=r"^Mine: ") as refusal:
        step_algorithm(Returns(what), "Mine", PIECE)
    assert refusal.match(words)


def test_a_file_without_such_an_algorithm_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("class Mine:\n    def step(self, imu, fixes): return None\nclass Other: pass\n")
    assert load_live_algorithm(f"{path}:Mine").step(*PIECE) is None
    with pytest.raises(LiveAlgorithmError, match=r"without a method step.*live algorithms in the file: Mine"):
        load_live_algorithm(f"{path}:Other")
    for place in ("Mine", f"{path}:No", "no.py:Mine"):
        with pytest.raises(LiveAlgorithmError):
            load_live_algorithm(place)
