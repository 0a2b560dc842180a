"""Velocity matching: attitudes of increments, its derivatives, and where the fit ends."""

from __future__ import annotations

import numpy as np
import pytest
from copter_logs import copter
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.data.checks import velocity_matching
from lab.data.checks.velocity_matching import Window, match, window_of
from lab.motion.kinematics.running_turns import running_attitudes


@pytest.mark.parametrize("count", [0, 1, 2, 57])
def test_attitudes_are_the_products_of_all_increments_until_each(count: int) -> None:
    increments = np.random.default_rng(count).normal(0.0, 1.0, (count, 3))
    increments[: count // 3] = 0.0
    made = running_attitudes(increments)
    expected = Rotation.identity()
    for attitude, increment in zip(made[:-1], increments, strict=True):
        assert (attitude.inv() * expected).magnitude() < 1e-13
        expected = expected * Rotation.from_rotvec(increment)
    assert (made[-1].inv() * expected).magnitude() < 1e-13


@pytest.fixture(scope="module")
def window() -> Window:
    """Return a window of a copter in flight, its steps 0.05 s."""
    flown = copter(60)
    time, dt = flown.imu[:, 0] - flown.imu[0, 0], np.diff(flown.imu[:, 0])[:, None]
    velocity_n = flown.gnss[:, 4:7]
    found = window_of(
        (
            time,
            flown.imu[1:, 1:4] * dt,
            flown.imu[1:, 4:7] * dt,
            flown.gnss[:, 0] - flown.imu[0, 0],
            velocity_n,
            np.full_like(velocity_n, 0.1),
        ),
        5.0,
    )
    assert found is not None
    return found


def test_the_derivatives_are_those_of_the_velocity(window: Window) -> None:
    rng = np.random.default_rng(1)
    C_nb, bias = Rotation.from_rotvec(rng.normal(0.0, 1.0, 3)).as_matrix(), rng.normal(0.0, 0.02, 6)

    def gained(change: NDArray[np.float64]) -> NDArray[np.float64]:
        turned_by = Rotation.from_rotvec(change[:3]).as_matrix()
        return velocity_matching._model(window, turned_by @ C_nb, bias + change[3:9], 0.03 + change[9])[0]

    _, *derivatives, by_lag = velocity_matching._model(window, C_nb, bias, 0.03)
    by_each = np.concatenate((*derivatives, by_lag[:, :, None]), axis=2)
    step = 1e-5
    for column, row in enumerate(np.eye(10) * step):
        numeric = (gained(row) - gained(-row)) / (2 * step)
        # The gyro bias acts on the attitude as if it were constant within a step of 0.05 s.
        np.testing.assert_allclose(by_each[:, :, column], numeric, atol=2e-3 * max(1, np.abs(numeric).max()))


def test_the_fit_ends_where_more_rounds_would(window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = []
    model = velocity_matching._model
    monkeypatch.setattr(velocity_matching, "_model", lambda *given: rounds.append(1) or model(*given))
    found = match(window, lags=(-1.0, 0.0, 1.0))
    taken = len(rounds)
    monkeypatch.setattr(velocity_matching, "_SETTLED", -1.0)
    longer = match(window, lags=(-1.0, 0.0, 1.0))
    assert taken < 0.9 * (len(rounds) - taken)
    assert (found.C_nb.inv() * longer.C_nb).magnitude() < 1e-3 * longer.heading_sigma
    assert np.abs((found.gyro_bias - longer.gyro_bias) / longer.gyro_bias_sigma).max() < 1e-3
    assert abs(found.lag - longer.lag) < 1e-3 * longer.lag_sigma
    assert found.cost == pytest.approx(longer.cost, rel=1e-9)
