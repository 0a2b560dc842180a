"""Draws: named, independent streams of random numbers, one for each source of error.

Draws have unit variance and are scaled afterwards, so that changing the size of an error keeps its
realisation. A stream depends on the seed and on its own name alone: no error source changes the draws of
another.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray


def unit_draws(seed: int, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return standard normal draws of one error source; a longer draw begins with the shorter one.

    Parameters
    ----------
    seed
        Seed of the run.
    name
        Name of the error source, such as ``"gyro.noise_density"``.
    shape
        Shape of the result, time first.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),))
    return np.random.default_rng(sequence).standard_normal(shape)
