"""Lane views: the numbers of eight runs as vectors, which compute as those of each run do."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from lab.base.compiling.compiled_cache import DISABLE_JIT
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels.lane_views import LANES, view_plain, wide


def compute(buffer: np.ndarray, count: int, factor: float) -> None:
    """Write into the second half of a buffer what follows from the first, with all operators."""
    given, found = wide(buffer, 0), wide(buffer, count)
    for k in range(count):
        found[k] = 0.0
        found[k] += given[k] * factor - 2 / (given[k] + 3)
        found[k] -= given[k] / factor
        found[k] *= 1 - given[count - 1 - k]


@pytest.mark.skipif(DISABLE_JIT, reason="without the compiler, there are no vectors")
def test_vectors_compute_as_numpy_does() -> None:
    count = 5
    buffer = aligned_zeros(2 * count * LANES)
    buffer[: count * LANES] = np.random.default_rng(1).uniform(1.0, 2.0, count * LANES)
    x = view_plain(buffer, 0)[:count].copy()
    numba.njit(compute)(buffer, count, 0.7)
    np.testing.assert_allclose(
        view_plain(buffer, count), (x * 0.7 - 2 / (x + 3) - x / 0.7) * (1 - x[::-1]), rtol=1e-14
    )
    assert np.array_equal(view_plain(buffer, 0)[:count], x)
