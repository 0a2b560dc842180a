"""Rests: where an IMU stands still in a log, in which attitude, and how it turns between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun
from lab.base.parameters.units import STANDARD_GRAVITY


@dataclass(frozen=True)
class RestLimits:
    """What counts as a rest, and as a turn between two."""

    block: float = 0.25
    """Time over which samples are averaged before they are compared [s]: hands shake slower."""
    fewest: int = 4
    """Fewest samples of a block: their spread shows whether the device was moved within it."""
    quiet: float = 0.2
    """Part of the blocks that is taken as the quietest: the noise of the sensor is theirs."""
    louder: float = 3.0
    """Spread within a block, in that of the quiet ones, up to which it may be still."""
    rate_floor: float = np.radians(0.1)
    """Spread of the rate within a block that is still whatever the noise is [rad/s]."""
    rate_spread: float = np.radians(1.5)
    """Largest spread of the rate within a still block [rad/s]: three times that of a loud consumer gyro."""
    force_floor: float = 0.02
    """Spread of the specific force within a block that is still whatever the noise is [m/s²]."""
    force_spread: float = 0.5
    """Largest spread of the specific force within a still block [m/s²]: a shaking hand makes more."""
    rate: float = np.radians(1.0)
    """Largest difference of the mean rate of a still block from that of the others [rad/s]."""
    tilted: float = 0.1
    """Largest change of the specific force within a rest [m/s²]: a turn by 0.6°."""
    shortest: float = 1.5
    """Shortest rest [s]: six blocks, of which the first and the last are left out."""
    longest_turn: float = 60.0
    """Longest time between two rests over which gyros carry an attitude [s]: 1 °/s/√Hz is 8° then."""
    gap: float = 5.0
    """Step between samples, in the usual one, that breaks a turn."""
    most: int = 300
    """Most rests that are used, the first ones: more improve nothing."""
    off_gravity: float = 0.2
    """Part by which the specific force at rest may differ from gravity: a wrong unit is a factor of 9.8."""


LIMITS = RestLimits()
"""The limits in use."""


class Samples(NamedTuple):
    """Samples of a triad: times (n,) [s], and rates [rad/s] or specific forces [m/s²] (n, 3)."""

    time: FloatArray
    values: FloatArray


class Turn(NamedTuple):
    """The samples of the gyros between two rests.

    Attributes
    ----------
    first, last : int
        Numbers of the rest before and after it.
    rate : (n, 3) array
        Rates [rad/s].
    dt : (n,) array
        Their intervals [s].
    """

    first: int
    last: int
    rate: FloatArray
    dt: FloatArray

    @property
    def duration(self) -> float:
        """Its length [s]."""
        return float(self.dt.sum())


@dataclass(frozen=True, eq=False)
class Rests:
    """The rests of a log.

    Attributes
    ----------
    begin, end : (n,) arrays
        Times between which each lasts [s].
    force, rate : (n, 3) arrays
        Means of the specific force [m/s²] and of the rate [rad/s].
    force_sigma, rate_sigma : (n, 3) arrays
        σ of the noise of these means.
    turns : tuple of Turn
        The turns between neighbouring rests.
    """

    begin: FloatArray
    end: FloatArray
    force: FloatArray
    rate: FloatArray
    force_sigma: FloatArray
    rate_sigma: FloatArray
    turns: tuple[Turn, ...]

    @property
    def count(self) -> int:
        """Number of rests."""
        return int(self.begin.size)


def find_rests(gyro: Samples, accelerometer: Samples) -> Rests:
    """Return the rests in the samples of an IMU.

    Parameters
    ----------
    gyro, accelerometer
        Samples in the axes of the device, in the order of time.

    Raises
    ------
    MissionError
        If the log nowhere shows a device that stands still, or its specific force is not that of gravity.
    """
    gyro, accelerometer = (
        _drop_unusable_samples("gyro", gyro),
        _drop_unusable_samples("accelerometer", accelerometer),
    )
    start, stop = max(gyro.time[0], accelerometer.time[0]), min(gyro.time[-1], accelerometer.time[-1])
    count = int((stop - start) / LIMITS.block) if stop > start else 0
    edges = start + LIMITS.block * np.arange(count + 1)
    if count < LIMITS.shortest / LIMITS.block:
        raise MissionError(
            f"gyros and accelerometers were recorded together for {max(stop - start, 0.0):.1f} s; accepted "
            f"are rests of {LIMITS.shortest:g} s or more in several attitudes, with turns between them"
        )
    rate, force = _blocks(gyro, edges), _blocks(accelerometer, edges)
    still = _find_still_blocks(rate, force)
    pieces = [piece for piece in _find_still_runs(still) if _is_steady(force.mean[slice(*piece)])][
        : LIMITS.most
    ]
    if not pieces:
        if not np.isfinite(rate.spread + force.spread).any():
            often = gyro.time.size / (gyro.time[-1] - gyro.time[0])
            raise MissionError(
                f"the samples come {often:.3g} times a second; accepted are at least "
                f"{LIMITS.fewest / LIMITS.block:g}"
            )
        moved = np.degrees(np.nanmedian(np.linalg.norm(rate.spread, axis=1)))
        raise MissionError(
            f"the device never stands still for {LIMITS.shortest:g} s: within {LIMITS.block:g} s its "
            "rates spread by "
            f"{moved:.2g} °/s; accepted is a log with rests on something solid, in several attitudes"
        )
    _check_gravity(force.mean, pieces)
    means = [[values[slice(*piece)].mean(axis=0) for piece in pieces] for values in (force.mean, rate.mean)]
    sigmas = [_sigma(one.mean, pieces) for one in (force, rate)]
    begin = edges[[first for first, _ in pieces]]
    end = edges[[last for _, last in pieces]]
    return Rests(
        begin,
        end,
        np.array(means[0]),
        np.array(means[1]),
        sigmas[0],
        sigmas[1],
        _find_turns(gyro, begin, end),
    )


class _Blocks(NamedTuple):
    """Mean and spread (k, 3) of the samples of each block; NaN where there are too few."""

    mean: FloatArray
    spread: FloatArray


def _drop_unusable_samples(triad: str, samples: Samples) -> Samples:
    """Return the samples with known numbers whose time goes on, without those that repeat the one before."""
    time, values = samples
    known = np.isfinite(time) & np.isfinite(values).all(axis=1)
    time, values = time[known], values[known]
    fresh: Flags = np.append(True, np.diff(np.maximum.accumulate(time)) > 0)[: time.size]
    fresh[1:] &= (np.diff(values, axis=0) != 0).any(axis=1)
    time, values = time[fresh], values[fresh]
    if time.size < LIMITS.fewest:
        raise MissionError(
            f"{count_noun(time.size, 'sample')} of the {triad}s; accepted is a log with rests and turns"
        )
    return Samples(time, values)


def _blocks(samples: Samples, edges: FloatArray) -> _Blocks:
    rows = np.searchsorted(samples.time, edges)
    count = np.diff(rows)[:, None]
    whole = samples.values.mean(axis=0)
    sums, squares = running_sums(samples.values - whole), running_sums((samples.values - whole) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.diff(sums[rows], axis=0) / count
        spread = np.sqrt(np.maximum(np.diff(squares[rows], axis=0) / count - mean**2, 0.0))
    few = (count < LIMITS.fewest)[:, 0]
    mean[few], spread[few] = np.nan, np.nan
    return _Blocks(mean + whole, spread)


def _find_still_blocks(rate: _Blocks, force: _Blocks) -> Flags:
    """Return the blocks in which nothing moves."""
    calm: Flags = np.asarray(np.isfinite(rate.spread + force.spread).all(axis=1))
    for blocks, floor, most in (
        (rate, LIMITS.rate_floor, LIMITS.rate_spread),
        (force, LIMITS.force_floor, LIMITS.force_spread),
    ):
        spread = np.linalg.norm(blocks.spread, axis=1)
        if calm.any():
            quiet = float(np.quantile(spread[calm], LIMITS.quiet))
            calm &= spread < min(max(LIMITS.louder * quiet, floor), most)
    if not calm.any():
        return calm
    usual = np.median(rate.mean[calm], axis=0)
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(rate.mean - usual, axis=1) < LIMITS.rate
    return np.asarray(calm & near, dtype=np.bool_)


def _find_still_runs(still: Flags) -> list[tuple[int, int]]:
    """Return the runs of still blocks, without their first and last block, that are long enough."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], still.astype(np.int64), [0]))))
    fewest = round(LIMITS.shortest / LIMITS.block)
    return [
        (first + 1, last - 1)
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if last - first >= fewest
    ]


def _is_steady(force: FloatArray) -> bool:
    """Return whether the specific force (k, 3) of a rest stays the same from its first to its last half."""
    half = len(force) // 2
    change = np.linalg.norm(force[half:].mean(axis=0) - force[:half].mean(axis=0))
    return bool(change < LIMITS.tilted)


def _check_gravity(force: FloatArray, pieces: list[tuple[int, int]]) -> None:
    size = float(np.median([np.linalg.norm(force[slice(*piece)].mean(axis=0)) for piece in pieces]))
    if abs(size / STANDARD_GRAVITY - 1) > LIMITS.off_gravity:
        hint = "; this looks like g" if abs(size - 1) < LIMITS.off_gravity else ""
        raise MissionError(
            f"the specific force at rest is {size:.3g} m/s²{hint}; accepted is that of gravity, "
            f"{STANDARD_GRAVITY:.1f} m/s² within {100 * LIMITS.off_gravity:g} %"
        )


def _sigma(means: FloatArray, pieces: list[tuple[int, int]]) -> FloatArray:
    """Return σ (n, 3) of the mean of each rest, by the scatter of its blocks, common to all rests."""
    squares = sum(
        ((means[slice(*piece)] - means[slice(*piece)].mean(axis=0)) ** 2).sum(axis=0) for piece in pieces
    )
    degrees = sum(last - first - 1 for first, last in pieces)
    of_block = np.sqrt(squares / degrees)
    size = np.array([last - first for first, last in pieces])
    return np.asarray(np.maximum(of_block, np.finfo(np.float32).tiny) / np.sqrt(size)[:, None])


def _find_turns(gyro: Samples, begin: FloatArray, end: FloatArray) -> tuple[Turn, ...]:
    """Return the turns between neighbouring rests; none across a gap, or if it lasts too long."""
    usual = float(np.median(np.diff(gyro.time)))
    found = []
    for first in range(begin.size - 1):
        rows = slice(*np.searchsorted(gyro.time, (end[first], begin[first + 1]), side="right"))
        dt = np.diff(gyro.time[max(rows.start - 1, 0) : rows.stop])
        if begin[first + 1] - end[first] > LIMITS.longest_turn or (dt > LIMITS.gap * usual).any():
            continue
        # A rate is that of the interval which it ends.
        found.append(Turn(first, first + 1, gyro.values[rows][-dt.size :], dt))
    return tuple(found)


def attitudes(force: FloatArray, apart: float) -> NDArray[np.int64]:
    """Return the number of the attitude (n,) of each rest; those that differ by less than an angle are one.

    Parameters
    ----------
    force : (n, 3) array
        Specific forces at rest.
    apart
        The angle [rad].
    """
    up = force / np.linalg.norm(force, axis=1)[:, None]
    number = np.full(len(up), -1, dtype=np.int64)
    seen: list[FloatArray] = []
    for row, one in enumerate(up):
        near = [place for place, other in enumerate(seen) if one @ other > np.cos(apart)]
        number[row] = near[0] if near else len(seen)
        if not near:
            seen.append(one)
    return number
