"""Errors of simulated receivers, and the likelihood against that of all fixes at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lab.analysis.receiver_errors import (
    AxisErrors,
    FixSeries,
    drop_outliers,
    expected_squares,
    fit,
    fit_memory,
    predict,
    quarters,
)

PERIOD = 0.5


def simulated(
    seed: int,
    white: float = 0.8,
    slow: float = 0.0,
    tau: float = 40.0,
    velocity: float = 0.05,
    claimed: float = 0.8,
    count: int = 800,
    outliers: int = 0,
) -> FixSeries:
    """Return the fixes of a vehicle whose acceleration walks, with errors of known sizes."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(count)
    # The exact walk of the acceleration, and what it does to velocity and position over a step.
    dt, q = PERIOD, 0.3**2
    jerk = np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [0, dt**3 / 3, dt**2 / 2], [0, 0, dt]])
    root = np.linalg.cholesky(q * (jerk + np.triu(jerk, 1).T))
    F = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]])
    x = np.zeros((count, 3, 2))
    for k in range(1, count):
        x[k] = F @ x[k - 1] + root @ rng.normal(size=(3, 2))
    p, v = x[:, 0], x[:, 1]
    error, decay = np.zeros((count, 2)), math.exp(-PERIOD / tau)
    error[0] = rng.normal(size=2)
    drive = math.sqrt(1 - decay**2) * rng.normal(size=(count, 2))
    for k in range(1, count):
        error[k] = decay * error[k - 1] + drive[k]
    position = p + white * rng.normal(size=(count, 2)) + slow * error
    position[rng.choice(count, outliers, replace=False), 0] += 40 * white
    seen = v + velocity * rng.normal(size=(count, 2))
    sigma = np.full((count, 2), claimed)
    return FixSeries(
        t, position, seen, sigma, np.full((count, 2), velocity), np.zeros(count, np.intp), (1e-4, 1e-4)
    )


def test_the_likelihood_is_that_of_all_fixes_at_once() -> None:
    """The joint normal density of all positions and velocities of short series, whose covariance is dense."""
    n, errors = 12, AxisErrors(np.array([0.7]), 0.1, 1.3, 5.0, 0.4, 0.0)
    t = np.cumsum(np.random.default_rng(3).uniform(0.2, 0.9, n))
    rng = np.random.default_rng(4)
    series = FixSeries(
        t, rng.normal(size=(n, 1)), rng.normal(size=(n, 1)), np.ones((n, 1)), np.ones((n, 1)),
        np.zeros(n, np.intp),
    )  # fmt: skip
    # States from the first fix on by explicit transition matrices; the prior is that of the filter.
    F, Q = np.eye(4), np.zeros((4, 4))
    prior = np.diag([1e8, 1e4, 1e2, errors.slow**2])
    moved, covariances = [np.eye(4)], [prior]
    for dt in np.diff(t):
        F = np.eye(4)
        F[0, 1], F[0, 2], F[1, 2], F[3, 3] = dt, dt * dt / 2, dt, math.exp(-dt / errors.tau)
        jerk = np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [0, dt**3 / 3, dt**2 / 2], [0, 0, dt]])
        Q = np.zeros((4, 4))
        Q[:3, :3] = errors.motion * (jerk + np.triu(jerk, 1).T)
        Q[3, 3] = errors.slow**2 * (1 - F[3, 3] ** 2)
        covariances.append(F @ covariances[-1] @ F.T + Q)
        moved.append(F)
    H = np.array([[1.0, 0, 0, 1.0], [0, 1.0, 0, 0]])
    whole = np.zeros((2 * n, 2 * n))
    for i in range(n):
        across = covariances[i]
        for j in range(i, n):
            if j > i:
                across = moved[j] @ across
            block = H @ across @ H.T
            whole[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = block
            whole[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = block.T
    whole += np.diag([0.7**2, 0.1**2] * n)
    values = np.column_stack((series.position[:, 0], series.velocity[:, 0])).ravel()
    values[::2] -= np.median(series.position)
    # The first four fixes start the filter and do not count; x[0] begins at the first position.
    mean = np.zeros(2 * n)
    mean[::2] = values[0]
    first = 8
    density = [
        -0.5 * (off @ np.linalg.solve(C, off) + np.linalg.slogdet(C)[1])
        for C, off in ((whole, values - mean), (whole[:first, :first], (values - mean)[:first]))
    ]
    found = predict(series, errors, np.zeros((n, 1, 2), np.bool_)).likelihood
    assert found == pytest.approx(density[0] - density[1], rel=1e-4, abs=1e-3)


def test_white_errors_are_found_and_no_slow_one() -> None:
    found = [fit(simulated(seed)) for seed in range(4)]
    white = np.array([one.white[0] for one in found])
    assert np.abs(white - 1).max() < 0.08
    assert np.abs([one.velocity - 1 for one in found]).max() < 0.15
    assert sum(one.slow > 0 for one in found) == 0


def test_slow_errors_are_told_from_white_ones() -> None:
    found = [fit(simulated(seed, slow=2.0, tau=40.0)) for seed in range(4)]
    assert all(one.slow > 0 for one in found)
    assert np.median([one.slow for one in found]) == pytest.approx(2.0, rel=0.25)
    assert 15 < np.median([one.tau for one in found]) < 100
    assert np.median([one.white[0] for one in found]) == pytest.approx(1.0, rel=0.1)


def test_a_claim_160_times_too_small_is_found() -> None:
    found = fit(simulated(2, claimed=0.8 / 160))
    assert found.white[0] == pytest.approx(160, rel=0.1)


def test_the_second_half_confirms_the_first() -> None:
    """A receiver that stays as it is has NIS of one in the half that was not fitted."""
    ratios = []
    for seed in range(4):
        series = simulated(seed, slow=1.0)
        half = series.time.size // 2
        seen = drop_outliers(series, fit(series.rows(slice(0, half))))
        ratios.append(seen.nis[half:].sum() / seen.degrees[half:].sum())
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.array(ratios) - 1).max() < 0.1


def test_a_receiver_whose_errors_change_within_the_half_is_told_from_one_that_stays() -> None:
    rng = np.random.default_rng(1)
    degrees = np.full(200, 2.0)
    for size in (0.5, 1.0, 2.0):
        found = [quarters(size * rng.chisquare(2, 200), degrees) for _ in range(100)]
        assert sum(varies for _, varies in found) <= 2
        assert all(0.5 * size < low < high < 1.7 * size for (low, high), _ in found)
    moving = np.where(np.arange(200) < 150, 1.0, 0.05)
    (low, high), varies = quarters(moving * rng.chisquare(2, 200), degrees)
    assert varies
    assert low == pytest.approx(0.05, rel=0.4)
    assert high > 0.8
    few, unknown = quarters(rng.chisquare(2, 100), degrees[:100])
    assert np.isnan(few).all()
    assert not unknown


def test_outliers_are_left_out() -> None:
    series = simulated(5, outliers=12)
    found = fit(series)
    assert found.white[0] == pytest.approx(1.0, rel=0.08)
    assert drop_outliers(series, found).outlier.sum() in range(10, 15)


def test_kinds_have_their_own_size() -> None:
    fine, coarse = simulated(1, white=0.2), simulated(1, white=2.0)
    kind = (np.arange(fine.time.size) // 100 % 2).astype(np.intp)
    position = np.where(kind[:, None] == 0, fine.position, coarse.position)
    found = fit(fine._replace(position=position, kind=kind))
    assert found.white * 0.8 == pytest.approx([0.2, 2.0], rel=0.12)


def test_a_receiver_without_velocity_is_fitted() -> None:
    series = simulated(3)
    found = fit(series._replace(velocity=np.full_like(series.velocity, np.nan)))
    assert math.isnan(found.velocity)
    assert found.white[0] == pytest.approx(1.0, rel=0.12)


def test_a_size_that_changes_is_followed_and_one_that_stays_is_confirmed() -> None:
    rng = np.random.default_rng(1)
    degrees = np.full(2000, 2.0)
    same = (rng.normal(size=(2000, 2)) ** 2).sum(axis=1)
    assert fit_memory(same, degrees)[0] >= 40
    # The variance changes between a quarter and four times over 400 fixes.
    changing = same * np.exp(np.log(4) * np.sin(2 * np.pi * np.arange(2000) / 400))
    memory, scale = fit_memory(changing[:1000], degrees[:1000])
    expected = scale * expected_squares(changing, degrees, memory)
    assert memory <= 20
    assert np.mean(changing[1000:] / expected[1000:]) / 2 == pytest.approx(1.0, abs=0.08)
    # Nothing of a fix is in what is expected of it.
    other = changing.copy()
    other[1500] = 1e3
    np.testing.assert_array_equal(scale * expected_squares(other, degrees, memory)[:1501], expected[:1501])


@pytest.mark.parametrize("components", [2, 4])
def test_a_receiver_that_stays_is_confirmed_by_a_size_that_follows(components: int) -> None:
    """Sizes of one half have an error of their own, so that they confirm themselves less often."""
    degrees, found, fixed = np.full(500, float(components)), [], []
    for seed in range(40):
        squares = np.random.default_rng(seed).chisquare(components, 500)
        squares /= np.mean(squares[:250]) / components
        memory, scale = fit_memory(squares[:250], degrees[:250])
        expected = scale * expected_squares(squares, degrees, memory)
        found.append(np.mean(squares[250:] / expected[250:]) / components)
        fixed.append(np.mean(squares[250:]) / components)
    kept = [np.mean(np.abs(np.array(one) - 1) <= 0.1) for one in (found, fixed)]
    assert kept[0] >= 0.95
    assert kept[0] > kept[1]
    assert np.mean(found) == pytest.approx(1.0, abs=0.02)


def test_fixes_that_repeat_one_place_show_nothing() -> None:
    assert np.isnan(quarters(np.zeros(400), np.full(400, 2.0))[0]).all()
