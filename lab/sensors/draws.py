"""Draws: named, independent streams of random numbers, one for each source of error.

Draws have unit variance and are scaled afterwards, so that changing the size of an error keeps its
realisation. A stream depends on the seed and on its own name alone: no error source changes the draws of
another.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray


class DrawStream:
    """The draws of one seed piece by piece: each source goes on where its last piece ended.

    The pieces joined are the draws of `unit_draws`, bit for bit. It stands in the place of a seed.

    Parameters
    ----------
    seed
        Seed of the run.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._generators: dict[str, np.random.Generator] = {}

    def following(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the next draws of one error source; see `unit_draws`."""
        if name not in self._generators:
            self._generators[name] = generator(self._seed, name)
        return self._generators[name].standard_normal(shape)


Seed = int | DrawStream
"""What draws come from: a seed for all samples at once, or a stream for those of the next piece."""


def unit_draws(seed: Seed, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return standard normal draws of one error source; a longer draw begins with the shorter one.

    Parameters
    ----------
    seed
        Seed of the run, or a stream, of which the next draws are taken.
    name
        Name of the error source, such as ``"gyro.noise_density"``.
    shape
        Shape of the result, time first.
    """
    if isinstance(seed, DrawStream):
        return seed.following(name, shape)
    if 0 in shape:
        return np.empty(shape)
    return generator(seed, name).standard_normal(shape)


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the draws of one error source; see `unit_draws`."""
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),))
    return np.random.Generator(np.random.PCG64(sequence))
