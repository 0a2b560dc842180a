"""Full scale: samples at the end of a range are found, and the largest samples of a right sensor are not."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.checks.full_scale import full_scales

RNG = np.random.default_rng(7)
TURNS = np.sin(np.arange(6000) / 100)


def six(first: np.ndarray) -> np.ndarray:
    """Return rates of which the first axis is given, and the others are noise."""
    return np.column_stack((first, RNG.normal(size=(first.size, 5))))


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_both_ends_of_a_range_are_found(noise, step):
    values = TURNS + RNG.normal(scale=noise, size=TURNS.size)
    values = np.round(values / step) * step if step else values
    found = full_scales(six(np.clip(values, -0.6, 0.6)))
    assert {(one.axis, round(one.limit, 6)) for one in found} == {(0, 0.6), (0, -0.6)}
    upper = next(one for one in found if one.limit > 0)
    assert np.count_nonzero(upper.at) == np.count_nonzero(np.clip(values, -0.6, 0.6) == 0.6)
    assert "the forward one stands at 34.38 °/s" in upper.words


@pytest.mark.parametrize(
    "values",
    [
        TURNS + RNG.normal(scale=0.01, size=TURNS.size),
        np.round(RNG.normal(size=6000)),
        np.round(TURNS * 1.4),
        np.zeros(6000),
        np.round(np.sign(TURNS) + RNG.normal(scale=0.05, size=6000), 3),
    ],
)
def test_a_sensor_within_its_range_is_not_accused(values):
    """Noise, a coarse sensor at rest and in turns, a constant, and a turntable that turns to and fro."""
    assert not full_scales(six(values))


def test_an_axis_that_stands_at_its_end_most_of_the_time_is_found():
    """As the forward accelerometer of an aeroplane that climbs all the time."""
    found = full_scales(six(np.clip(TURNS + 0.8 + RNG.normal(scale=0.05, size=TURNS.size), -0.6, 0.6)))
    upper = next(one for one in found if one.axis == 0 and one.limit > 0)
    assert upper.limit == 0.6
    assert upper.at.mean() > 0.55


def test_a_coarse_sensor_that_mostly_rests_is_not_accused():
    """It shows one value near zero again and again, and turns to one side only."""
    resting = np.where(np.arange(6000) % 1000 < 700, 0.02, -np.abs(RNG.normal(size=6000)))
    assert not full_scales(six(np.round(resting / 0.02) * 0.02))
