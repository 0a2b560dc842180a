"""Lane draws: those of NumPy's generators, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from lab.experiment.ensembles.lane_draws import draw, plain_draw, streams_of
from lab.navigation.kernels.compilation import kernel
from lab.navigation.kernels.lane_views import LANES
from lab.sensors.draws import unit_draws


@kernel
def _fill(streams: np.ndarray, out: np.ndarray) -> None:
    for at in range(0, out.size, LANES):
        draw(streams, out, at)


@pytest.mark.parametrize("first", [0, 2**32 - 4])
def test_they_are_those_of_each_seed_alone(first: int) -> None:
    """So many that each run has hundreds in the tail, and thousands that are refused and drawn again."""
    seeds, out = range(first, first + LANES), np.empty(400_000 * LANES)
    _fill(streams_of(seeds, "gyro.noise"), out)
    alone = [unit_draws(seed, "gyro.noise", (400_000,)) for seed in seeds]
    assert min(int(np.sum(np.abs(one) > 3.66)) for one in alone) > 50
    np.testing.assert_array_equal(out.reshape(-1, LANES), np.transpose(alone))


def test_a_debugger_has_the_same() -> None:
    seeds, out = range(LANES), np.empty(300 * LANES)
    streams = streams_of(seeds, "accelerometer.noise")
    for at in range(0, out.size, LANES):
        plain_draw(streams, out, at)
    alone = [unit_draws(seed, "accelerometer.noise", (300,)) for seed in seeds]
    np.testing.assert_array_equal(out.reshape(-1, LANES), np.transpose(alone))
