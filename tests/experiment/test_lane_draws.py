"""Lane draws: those of NumPy's generators, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from lab.experiment.ensembles.lane_draws import draw, plain_draw, seed_streams, seeds_abreast
from lab.navigation.kernels.compilation import kernel
from lab.navigation.kernels.lane_views import LANES
from lab.sensors.draws import unit_draws


@kernel
def _fill(streams: np.ndarray, out: np.ndarray) -> None:
    for at in range(0, out.size, LANES):
        draw(streams, out, at)


@pytest.mark.parametrize("first", [0, 2**32 - 4, 2**64 - 4])
def test_they_are_those_of_each_seed_alone(first: int) -> None:
    """So many that each run has hundreds in the tail, and thousands that are refused and drawn again."""
    seeds, out = range(first, first + LANES), np.empty(400_000 * LANES)
    _fill(seed_streams(seeds, "gyro.noise"), out)
    alone = [unit_draws(seed, "gyro.noise", (400_000,)) for seed in seeds]
    assert min(int(np.sum(np.abs(one) > 3.66)) for one in alone) > 50
    np.testing.assert_array_equal(out.reshape(-1, LANES), np.transpose(alone))


def test_runs_that_draw_together_draw_what_each_draws_alone() -> None:
    """Seeds of one and two words, fewer than there are lanes, and names and lengths in any order."""
    seeds = (0, 7, 2**31, 2**32 + 5, 2**64 - 1)
    for name, shape in (("gps.position", (205, 3)), ("gyro.bias", (3,)), ("gps.jump", (0, 3))):
        for seed, own in zip(seeds, seeds_abreast(seeds), strict=True):
            np.testing.assert_array_equal(unit_draws(own, name, shape), unit_draws(seed, name, shape))


def test_a_debugger_has_the_same() -> None:
    seeds, out = range(LANES), np.empty(300 * LANES)
    streams = seed_streams(seeds, "accelerometer.noise")
    for at in range(0, out.size, LANES):
        plain_draw(streams, out, at)
    alone = [unit_draws(seed, "accelerometer.noise", (300,)) for seed in seeds]
    np.testing.assert_array_equal(out.reshape(-1, LANES), np.transpose(alone))
