"""Hard and soft iron of simulated magnetometers: true values, σ over seeds, and logs that show too little."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

from lab.analysis.calibration.magnetometer import ELLIPSOID, PLANE, SPHERE, calibrate
from lab.base.files.mission_error import MissionError
from tests.calibration_logs import fields


def iron(rng: np.random.Generator, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return soft iron of some percent and hard iron of 20 µT, times a size."""
    skew = rng.normal(scale=0.05 * size, size=(3, 3))
    return np.eye(3) + np.triu(skew) + np.triu(skew, 1).T, rng.normal(scale=20.0 * size, size=3)


def of_one_size(K: np.ndarray) -> np.ndarray:
    """Return soft iron as the calibration has it: its inverse has the trace of the unit matrix."""
    T = np.linalg.inv(K)
    return np.linalg.inv(3 * T / np.trace(T))


def test_hard_and_soft_iron_with_true_sigma() -> None:
    off, inside = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        K, hard = iron(rng)
        one = calibrate(*fields(rng, K, hard), "walk")
        assert one.model == ELLIPSOID
        assert one.judgement.gains
        soft = 100 * (of_one_size(K) - np.eye(3))
        for term in one.stated:
            places = ["xyz".index(axis) for axis in term.axis]
            true = hard[places[0]] if term.name == "hard iron" else soft[places[0], places[1]]
            low, high = term.interval
            off.append((term.value - true) / term.sigma)
            inside.append(low <= true <= high)
    rms = float(np.sqrt(np.mean(np.square(off))))
    print(f"estimate/σ has rms {rms:.3f}; 95 % intervals hold {100 * np.mean(inside):.1f} %")
    assert 0.9 < rms < 1.1
    assert 0.93 < np.mean(inside) < 0.97


def test_the_file_makes_a_sphere_of_the_fields() -> None:
    rng = np.random.default_rng(1)
    K, hard = iron(rng)
    time, measured = fields(rng, K, hard)
    linear = calibrate(time, measured, "walk").calibration.magnetometer
    assert linear is not None
    sizes = np.linalg.norm(linear.removed(measured), axis=1)
    assert np.std(np.linalg.norm(measured, axis=1)) > 5
    assert np.std(sizes) < 0.5  # the noise is 0.4 µT


def test_a_turn_about_one_axis_shows_the_iron_in_its_plane_alone() -> None:
    rng = np.random.default_rng(2)
    hard = np.array([12.0, -20.0, 30.0])
    one = calibrate(*fields(rng, np.eye(3), hard, level=True), "car")
    assert one.model == PLANE
    assert one.judgement.gains
    known = {term.axis: term for term in one.terms if (term.name, term.unit) == ("hard iron", "µT")}
    assert not known["z"].is_known
    for k, axis in enumerate("xy"):
        assert (
            abs(known[axis].value - hard[k]) < 2.5
        )  # the vertical field leans by 0.02 of 50 µT and of 30 µT
    assert any("Only the iron in this plane is known" in sentence for sentence in one.sentences)


def test_a_magnetometer_without_iron_gains_nothing() -> None:
    refused = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        one = calibrate(*fields(rng, *iron(rng, 0.0)), "walk")
        refused.append(one.calibration.is_empty)
        assert one.judgement.gains or one.stated == ()
    assert np.mean(refused) > 0.9


def test_too_little_is_refused_in_words() -> None:
    rng = np.random.default_rng(3)
    time, measured = fields(rng, np.eye(3), np.zeros(3), level=True)
    for rows, words in ((slice(0, 60), "accepted are at least 100"), (slice(0, 290), "turned too little")):
        with pytest.raises(MissionError, match=words):
            calibrate(time[rows], measured[rows], "car")
    with pytest.raises(MissionError, match="shows its noise alone"):  # about one point
        calibrate(time, np.array([20.0, 0.0, 40.0]) + rng.normal(scale=0.4, size=(1500, 3)), "desk")
    with pytest.raises(MissionError, match="accepted are at least 100"):
        calibrate(time, np.full((1500, 3), np.nan), "nothing")
    with pytest.raises(MissionError, match="0 fields"):
        calibrate(time, np.zeros((1500, 3)), "nothing")


def test_an_ellipsoid_that_grows_without_end_is_given_up() -> None:
    """On a paraboloid; a recording of a hall, carried past iron, was like this."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-20.0, 20.0, (2, 3000))
    measured = np.column_stack((x, y, (x**2 + y**2) / 20 - 15 + rng.normal(size=3000)))
    before = process_time()
    assert calibrate(np.arange(3000) / 50, measured, "hall").model == SPHERE
    assert process_time() - before < 10
