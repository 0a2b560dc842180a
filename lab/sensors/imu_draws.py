"""IMU draws: the unit draws behind the random errors of a triad, for all samples or piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.sensors import processes
from lab.sensors.draws import DrawStream, Seed, unit_draws


class ImuDraws(NamedTuple):
    """Unit draws of a triad for n samples.

    Attributes
    ----------
    bias, scale, start : (3,) arrays
        Turn-on bias, scale factor, and the first sample of the instability.
    drive, flicker, walk : (n, 3) arrays, or (0, 3) where the triad has no such error
        Drive of the instability; flicker and random walk of unit coefficient.
    noise : (n, 3) array
        White noise.
    """

    bias: FloatArray
    scale: FloatArray
    start: FloatArray
    drive: FloatArray
    flicker: FloatArray
    walk: FloatArray
    noise: FloatArray

    @classmethod
    def of(
        cls,
        seed: Seed,
        sensor: str,
        samples: int,
        *,
        instability: bool,
        flicker: bool = False,
        walk: bool = False,
        noise: bool = True,
    ) -> ImuDraws:
        """Draw for one triad, named by `sensor`; long draws only for the errors that it has."""

        def draw_long(name: str, wanted: bool = True) -> FloatArray:
            return unit_draws(seed, f"{sensor}.{name}", (samples if wanted else 0, 3))

        return cls(
            bias=unit_draws(seed, f"{sensor}.bias", (3,)),
            scale=unit_draws(seed, f"{sensor}.scale_factor", (3,)),
            start=unit_draws(seed, f"{sensor}.instability.start", (3,)),
            drive=draw_long("instability", instability),
            flicker=processes.flicker(draw_long("flicker", flicker)),
            walk=processes.random_walk(draw_long("rate_random_walk", walk)),
            noise=draw_long("noise", noise),
        )

    @classmethod
    def constants(cls, seeds: Sequence[Seed], sensor: str) -> ImuDraws:
        """Draw turn-on bias and scale factor of a triad for some seeds, (runs, 3) each, and nothing else."""
        bias, scale = (
            np.stack([unit_draws(seed, f"{sensor}.{name}", (3,)) for seed in seeds])
            for name in ("bias", "scale_factor")
        )
        none = np.zeros((0, 3))
        return cls(bias, scale, *(none,) * 5)


class ImuDrawStream:
    """The draws of `ImuDraws.of` piece by piece.

    The pieces joined are the same bits; the flicker is another sum of the same draws, which agrees to
    10⁻⁶.

    Parameters
    ----------
    seed
        Seed of the run.
    sensor
        Name of the triad.
    instability, flicker, walk
        Which long draws it needs.
    """

    def __init__(self, seed: int, sensor: str, *, instability: bool, flicker: bool, walk: bool) -> None:
        self._sensor = sensor
        self._stream = DrawStream(seed)
        self._wanted = {"instability": instability, "flicker": flicker, "rate_random_walk": walk}
        # The constants are drawn once.
        self._constant = ImuDraws.of(seed, sensor, 0, instability=False)
        self._flicker = processes.Flicker()
        self._walk = np.zeros(3)

    def following(self, samples: int) -> ImuDraws:
        """Return the draws for the next n samples."""

        def draw_long(name: str) -> FloatArray:
            size = samples if self._wanted.get(name, True) else 0
            return self._stream.following(f"{self._sensor}.{name}", (size, 3))

        walk = processes.random_walk(draw_long("rate_random_walk"), self._walk)
        self._walk = walk[-1].copy() if walk.size else self._walk
        return self._constant._replace(
            drive=draw_long("instability"),
            flicker=self._flicker.following(draw_long("flicker")),
            walk=walk,
            noise=draw_long("noise"),
        )
