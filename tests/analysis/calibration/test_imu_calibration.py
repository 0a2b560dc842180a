"""Calibration of simulated IMUs: their true errors, σ over seeds, and logs that show nothing."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.calibration.imu_calibration import ImuCalibration, calibrate
from lab.analysis.calibration.rests import Samples, find_rests
from lab.base.files.mission_error import MissionError
from tests.calibration_logs import GRAVITY, Errors, bench, errors


def found(seed: int, size: float = 1.0, **how: object) -> tuple[ImuCalibration, Errors]:
    """Return the calibration of one IMU, and its errors."""
    rng = np.random.default_rng(seed)
    made = errors(rng, size)
    return calibrate(find_rests(*bench(rng, made, **how)), "bench", GRAVITY), made  # type: ignore[arg-type]


def scores(runs: list[tuple[ImuCalibration, Errors]]) -> tuple[float, float]:
    """Return the root mean square of the errors in σ, and the part of the intervals that hold the truth."""
    off, inside = [], []
    for one, made in runs:
        truth = made.terms
        for term in one.terms:
            if term.is_known:
                true = truth[term.group, term.name, term.axis]
                low, high = term.interval
                off.append((term.value - true) / term.sigma)
                inside.append(low <= true <= high)
    return float(np.sqrt(np.mean(np.square(off)))), float(np.mean(inside))


@pytest.mark.parametrize("how", [{}, {"rests": 12, "faces": True}], ids=["any attitudes", "faces twice"])
def test_all_terms_are_found_and_gain(how: dict[str, object]) -> None:
    one, made = found(1, **how)
    assert all(term.is_known for term in one.terms)
    assert len(one.stated) == 24
    assert {(term.group, term.name): term.unit for term in one.terms} == {
        ("accelerometer", "bias"): "m/s²",
        ("gyro", "bias"): "°/s",
        **dict.fromkeys(((group, "scale factor") for group in ("accelerometer", "gyro")), "%"),
        **dict.fromkeys(((group, "misalignment") for group in ("accelerometer", "gyro")), "°"),
    }
    truth = made.terms
    for term in one.terms:
        assert abs(term.value - truth[term.group, term.name, term.axis]) < 5 * term.sigma, str(term)
    assert all(one.gains for one in one.judgements)
    # The file undoes the errors: what was measured becomes what was true.
    known = one.calibration
    assert known.accelerometer is not None
    assert known.gyro is not None
    true = np.random.default_rng(0).normal(size=(5, 3))
    force = known.accelerometer.removed(9.8 * true @ made.K_a.T + made.b_a)
    np.testing.assert_allclose(force, 9.8 * true, atol=0.02)
    np.testing.assert_allclose(known.gyro.removed(true @ made.K_g.T + made.b_g), true, atol=5e-3)


def test_sigma_is_true_over_sensors() -> None:
    rms, inside = scores([found(seed, rests=18) for seed in range(15)])
    print(f"estimate/σ has rms {rms:.3f}; 95 % intervals hold {100 * inside:.1f} %")
    assert 0.85 < rms < 1.15
    assert inside > 0.92


@pytest.mark.proof
@pytest.mark.parametrize("how", [{"rests": 18}, {"rests": 12, "faces": True}], ids=["any", "faces"])
def test_sigma_and_intervals_over_many_sensors(how: dict[str, object]) -> None:
    rms, inside = scores([found(seed, **how) for seed in range(100, 150)])
    print(f"estimate/σ has rms {rms:.3f}; 95 % intervals hold {100 * inside:.1f} %")
    assert 0.9 < rms < 1.1
    assert 0.93 < inside < 0.98


def test_a_sensor_without_errors_gains_nothing() -> None:
    refused = [[not judged.gains for judged in found(seed, 0.0)[0].judgements] for seed in range(10)]
    assert np.mean(refused) > 0.85  # at the level of 5 %
    one, _ = found(1, 0.0)
    assert one.stated == ()
    assert one.calibration.is_empty
    assert "refused, since it gains nothing" in " ".join(one.sentences)


def test_without_turns_the_gyros_keep_unknown_scale_factors() -> None:
    rng = np.random.default_rng(3)
    made = errors(rng)
    gyro, force = bench(rng, made)
    # The logger ran only while the device rested.
    rests = find_rests(gyro, force)
    rows = np.any(
        [(gyro.time > a) & (gyro.time < b) for a, b in zip(rests.begin, rests.end, strict=True)], axis=0
    )
    kept = find_rests(
        Samples(gyro.time[rows], gyro.values[rows]), Samples(force.time[rows], force.values[rows])
    )
    assert kept.turns == ()
    one = calibrate(kept, "bench", GRAVITY)
    unknown = {(term.group, term.name) for term in one.terms if not term.is_known}
    assert unknown == {("gyro", "scale factor"), ("gyro", "misalignment")}
    assert all(term.value == 0 for term in one.terms if not term.is_known)
    assert {term.group for term in one.stated} == {"accelerometer", "gyro"}
    assert any("turns about all three axes" in sentence for sentence in one.sentences)


def test_six_faces_once_leave_misalignments_unknown_or_refused() -> None:
    rng = np.random.default_rng(4)
    rests = find_rests(*bench(rng, errors(rng), rests=6, faces=True))
    one = calibrate(rests, "bench", GRAVITY)
    for term in one.stated:  # nothing is stated without a σ that its own data give
        assert term.is_known
    assert one.sentences


def test_an_unknown_place_is_in_sigma_of_the_scale_factors() -> None:
    rng = np.random.default_rng(5)
    rests = find_rests(*bench(rng, errors(rng)))
    known, unknown = calibrate(rests, "bench", GRAVITY), calibrate(rests, "bench")
    scale = [
        term.sigma for term in unknown.terms if (term.group, term.name) == ("accelerometer", "scale factor")
    ]
    assert min(scale) > 0.15  # 0.015 of 9.8 m/s², in %
    assert max(term.sigma for term in known.terms if term.name == "scale factor") < 0.02
    assert any("--latitude" in sentence for sentence in unknown.sentences)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"shake": 0.3}, "never stands still"),
        ({"rests": 3}, "accepted are at least 6"),
    ],
)
def test_a_log_that_moved_or_rests_too_seldom_is_refused(how: dict[str, object], words: str) -> None:
    rng = np.random.default_rng(6)
    with pytest.raises(MissionError, match=words):
        calibrate(find_rests(*bench(rng, errors(rng), **how)), "bench")  # type: ignore[arg-type]


@pytest.mark.parametrize(("triad", "sigma"), [(0, 5e-3), (1, 0.1)], ids=["turns", "shakes"])
def test_a_rest_much_louder_than_the_others_is_none(triad: int, sigma: float) -> None:
    """A hand holds it for once: six times the noise of the others [rad/s], [m/s²], and far below a motion."""
    rng = np.random.default_rng(9)
    samples = bench(rng, errors(rng))
    quiet = find_rests(*samples)
    held = (samples[triad].time > quiet.begin[4]) & (samples[triad].time < quiet.end[4])
    samples[triad].values[held] += rng.normal(scale=sigma, size=(int(held.sum()), 3))
    np.testing.assert_allclose(find_rests(*samples).begin, np.delete(quiet.begin, 4))


@pytest.mark.parametrize("scale", [1 / 9.80665, 0.0])
def test_a_wrong_unit_is_refused(scale: float) -> None:
    rng = np.random.default_rng(7)
    gyro, force = bench(rng, errors(rng))
    wrong = Samples(force.time, force.values * scale + 1e-3 * rng.normal(size=force.values.shape))
    with pytest.raises(MissionError, match="gravity"):
        find_rests(gyro, wrong)


def test_hostile_samples_are_refused_in_words() -> None:
    rng = np.random.default_rng(8)
    gyro, force = bench(rng, errors(rng), rests=2)
    nothing = Samples(np.zeros(0), np.zeros((0, 3)))
    frozen = Samples(force.time, np.ones_like(force.values))
    unknown = Samples(gyro.time, np.full_like(gyro.values, np.nan))
    backwards = Samples(gyro.time[::-1], gyro.values)
    slow = Samples(force.time[::20], force.values[::20])
    for wrong in ((nothing, force), (gyro, frozen), (unknown, force), (backwards, force), (gyro, slow)):
        with pytest.raises(MissionError):
            find_rests(*wrong)
