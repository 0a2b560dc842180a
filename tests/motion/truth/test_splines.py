"""Splines: the lab's own against those of SciPy, which are the independent truth here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_lsq_spline
from scipy.spatial.transform import Rotation
from scipy.spatial.transform import RotationSpline as SciPySpline

from lab.base.arrays import FloatArray
from lab.motion.kinematics.cubic_spline import cubic_spline, fit_spline
from lab.motion.kinematics.rotation_spline import RotationSpline


def irregular(count: int, random: np.random.Generator) -> FloatArray:
    """Return times whose steps differ by up to a factor of ten [s]."""
    return np.cumsum(random.uniform(0.1, 1.0, count))


@pytest.mark.parametrize("knots", [4, 5, 300])
def test_a_cubic_spline_its_derivatives_and_its_integral(knots: int) -> None:
    random = np.random.default_rng(knots)
    times, values = irregular(knots, random), np.cumsum(random.normal(size=(knots, 3)), axis=0)
    at = np.concatenate((random.uniform(times[0], times[-1], 1000), times, times[[0, -1]] + [-0.05, 0.05]))
    own, scipys = cubic_spline(times, values), CubicSpline(times, values)
    together = np.split(own.derivatives(at, range(3)), 3, axis=1)
    for derivative in range(3):
        expected = scipys(at, derivative)
        np.testing.assert_allclose(own(at, derivative), expected, rtol=0, atol=1e-13 * np.ptp(expected))
        np.testing.assert_array_equal(together[derivative], own(at, derivative))
    expected = scipys.antiderivative()(at)
    np.testing.assert_allclose(own.antiderivative()(at), expected, rtol=0, atol=1e-13 * np.ptp(expected))


@pytest.mark.parametrize(("samples", "pieces"), [(4, 1), (30, 9), (3000, 1), (3000, 150)])
def test_a_spline_of_few_pieces(samples: int, pieces: int) -> None:
    random = np.random.default_rng(samples + pieces)
    times, values = irregular(samples, random), np.cumsum(random.normal(size=(samples, 3)), axis=0)
    inner = times[np.linspace(0, samples - 1, pieces + 1).astype(int)[1:-1]]
    knots = np.concatenate((np.full(4, times[0]), inner, np.full(4, times[-1])))
    at = np.concatenate((times, random.uniform(times[0], times[-1], 1000)))
    expected = make_lsq_spline(times, values, knots, k=3)(at)
    np.testing.assert_allclose(
        fit_spline(times, values, knots)(at), expected, rtol=0, atol=1e-11 * np.ptp(expected)
    )


@pytest.mark.parametrize("knots", [2, 3, 4, 300])
@pytest.mark.parametrize("largest", [1e-6, 0.3, 3.0])
def test_a_rotation_spline_and_its_rate_at_any_attitude(knots: int, largest: float) -> None:
    random = np.random.default_rng(knots)
    times = irregular(knots, random)
    turns = Rotation.from_rotvec(largest * random.uniform(-1, 1, (knots, 3)) / np.sqrt(3))
    attitudes = [Rotation.random(rng=random)]
    for turn in turns[1:]:
        attitudes.append(attitudes[-1] * turn)
    through = Rotation.concatenate(attitudes)
    # Both signs of a quaternion are one attitude.
    q_nb = through.as_quat(scalar_first=True) * random.choice([-1.0, 1.0], (knots, 1))
    own, scipys = RotationSpline(times, q_nb), SciPySpline(times, through)
    at = np.concatenate((random.uniform(times[0], times[-1], 1000), times))
    off = scipys(at).inv() * Rotation.from_quat(own.attitude(at), scalar_first=True)
    assert off.magnitude().max() < 1e-12
    rate = scipys(at, 1)
    np.testing.assert_allclose(own.rate(at), rate, rtol=0, atol=1e-12 * (1 + np.abs(rate).max()))
