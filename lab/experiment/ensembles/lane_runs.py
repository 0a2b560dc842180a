"""Lane runs: what the sensors of a run abreast measured, what it navigated, and its used fixes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_figures import FixFigures
from lab.base.arrays import FloatArray
from lab.experiment.ensembles.run_at_fixes import ChannelSums
from lab.navigation.kernels.lanes import LaneSolution
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start
from lab.navigation.strapdown import MAX_LATITUDE
from lab.sensors import gps, imu

Samples = NDArray[np.int64]


class Sensed(NamedTuple):
    """What the sensors of one run measured, and what its filter assumes."""

    seed: int
    start: Start
    belief: Belief
    constants: FloatArray | None
    gyro: imu.Measured
    accelerometer: imu.Measured
    fixes: gps.GpsFixes
    seen: Fixes

    def imu(self, time: FloatArray) -> Imu:
        """Return what the IMU measured at the times (n,) of the samples [s]."""
        return Imu(time, self.gyro.increments, self.accelerometer.increments)


Navigated = tuple[int, Sensed, LaneSolution]
"""Lane, sensors and solution of a run."""


class Places(NamedTuple):
    """Places among the stored samples: of all fixes, and where NEES of the position is wanted."""

    fixes: Samples
    judged: Samples  # of `RunAtFixes.grid`, then those of `between_fixes`


class Judged(NamedTuple):
    """A run that is judged: its place among those of its block, its lane, and what is known of it."""

    place: int
    lane: int
    one: Sensed
    navigated: LaneSolution
    solution: Solution  # its fixes tell their places among the stored samples
    figures: FixFigures
    means: tuple[FloatArray, FloatArray]


def used_fixes(solution: Solution) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return covariance, innovation and its covariance of the used fixes, without a copy if all are used."""
    used = solution.fix_sample >= 0
    every: Samples | slice = slice(None) if used.all() else np.flatnonzero(used)
    return (
        solution.fix_covariance[every],
        solution.innovation[every],
        solution.innovation_covariance[every],
    )


def channel_sums(used: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> list[ChannelSums]:
    """Return the sums of the innovations of runs; see `used_fixes`."""
    if len({len(nu) for _, nu, _ in used}) == 1:
        return ChannelSums.of_used(*(np.stack([one[part] for one in used]) for part in (1, 2)))
    return [ChannelSums.of_used(nu[None], S[None])[0] for _, nu, S in used]


def diverged(navigated: LaneSolution) -> bool:
    """Return whether a run is not finite, or came too close to a pole for its frame."""
    motion = navigated.motion
    finite = np.isfinite(motion).all() and np.isfinite(navigated.solution.variance).all()
    return not finite or bool(np.abs(motion[:, 0]).max() > MAX_LATITUDE)
