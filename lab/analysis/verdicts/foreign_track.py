"""Foreign track: the positions of a filter that is not ours, against fixes and against a smoothed solution.

The filter used the fixes, so that its errors depend on theirs, and a distance within the σ of both together
proves nothing; a larger one contradicts at least one of them. Positions are compared horizontally, because
the heights of a log may have another zero than the receiver's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.analysis.consistency import autocorrelation, chi_square_interval
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Weighed, size_weight
from lab.analysis.verdicts.finding_table import FOREIGN_FINDINGS
from lab.analysis.verdicts.foreign_evidence import FEWEST, LONGEST_MEMORY, find_isolated, memory
from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.numbers import format_number
from lab.data.log.filter_log import Track
from lab.data.log.sensor_log import GnssLog
from lab.motion.frames.displacement import displacement

LEAST = 1e-3
"""Least distance by which positions are compared [m]: logs round them to centimetres."""


class Statement(NamedTuple):
    """A sentence, and what it rests on."""

    sentence: str
    evidence: str


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison of positions: what it says, and a finding if they contradict each other."""

    statement: Statement
    weighed: tuple[Weighed, ...] = ()


class Jump(NamedTuple):
    """A jump of a receiver's position that its own velocity does not show.

    Attributes
    ----------
    time : float
        When it is seen [s].
    size : float
        Horizontally [m].
    usual : float
        What the difference usually is [m].
    """

    time: float
    size: float
    usual: float


def compare_positions(
    track: Track,
    what: str,
    time: FloatArray,
    place: FloatArray,
    sigma: FloatArray,
    velocity_n: FloatArray,
    arm: float = 0.0,
) -> Compared | None:
    """Return how far the positions of a filter are from others; None if too few can be compared.

    Parameters
    ----------
    track
        The positions of the filter.
    what
        What the others are, in words.
    time : (m,) array
        Their times of validity, by the clock of the filter [s].
    place, sigma, velocity_n : (m, 3) arrays
        Their positions, σ [m] and velocities [m/s], north, east, down; NaN if unknown.
    arm
        Distance between the places that both are of [m].
    """
    at = np.clip(np.searchsorted(track.time, time), 1, max(len(track.time) - 1, 1))
    if len(track.time) < FEWEST:
        return None
    gap = track.time[at] - track.time[at - 1]
    inside = (time >= track.time[0]) & (time <= track.time[-1]) & (gap <= limits.VERDICT.track_gap)
    inside &= np.isfinite(place[:, :2]).all(axis=1)
    if inside.sum() < FEWEST:
        return None
    own = interpolate_columns(time, track.time, track.position)[inside]
    apart = displacement(place[inside], own)[:, :2]
    fine = ~find_isolated(apart / max(float(np.median(np.abs(apart))), LEAST))
    there, apart = np.flatnonzero(inside)[fine], apart[fine]
    lag, late = _without_lag(apart, velocity_n[there, :2])
    size = float(np.sqrt(np.mean(np.sum(late**2, axis=1))))
    of_track = interpolate_columns(time, track.time, track.sigma)[there, :2]
    variance = of_track**2 + sigma[there, :2] ** 2 + arm**2
    variance += (limits.VERDICT.stamp_error * np.nan_to_num(velocity_n[there, :2])) ** 2
    known = np.isfinite(variance).all(axis=1) & (variance > 0).all(axis=1)
    begin = f"Its horizontal position is {format_number(size)} m rms from {what}"
    behind = f", after {lag:+.2f} s between the clocks" if lag else ""
    rests = f"{len(there)} positions{behind} ({track.source})"
    if known.sum() < FEWEST:
        return Compared(Statement(f"{begin}; the σ of one of them is unknown.", rests))
    values = late[known] / np.sqrt(variance[known])
    square = float(np.mean(values**2))
    independent = values.size / memory(autocorrelation(values, LONGEST_MEMORY) ** 2, len(values))
    high = chi_square_interval(round(independent, 1), 1, 1 - limits.VERDICT.doubt)[1] / independent
    said = Statement(
        f"{begin}, {format_number(square**0.5)} times the σ of both together.",
        f"normalised mean square {format_number(square, 3)} of {rests}, {independent:.0f} independent "
        "values; up "
        f"to {high:.2f} is chance",
    )
    if square < max(high, limits.VERDICT.consistent_nis):
        return Compared(said)
    finding = FOREIGN_FINDINGS["far"].finding(
        square, said.evidence, direction="too small", root=square**0.5, what=what
    )
    return Compared(said, (Weighed(size_weight(square * independent, independent), finding),))


def _without_lag(apart: FloatArray, velocity: FloatArray) -> tuple[float, FloatArray]:
    """Return the time between two clocks that the distances show [s], and the distances without it."""
    moving = np.isfinite(velocity).all(axis=1)
    speed = float(np.sum(velocity[moving] ** 2))
    if not moving.any() or speed / moving.sum() < limits.VERDICT.lag_speed**2:
        return 0.0, apart
    # An error along the motion that never changes may be one of the clocks, and accuses nobody.
    lag = float(np.sum(apart[moving] * velocity[moving]) / speed)
    if abs(lag) > limits.VERDICT.track_gap:  # no clock, but an error that the motion explains by chance
        return 0.0, apart
    return lag, apart - lag * np.where(np.isfinite(velocity), velocity, 0.0)


def jumps(gnss: GnssLog, epoch: float) -> list[Jump]:
    """Return where positions of a receiver jump while its velocities do not.

    Parameters
    ----------
    gnss
        The fixes.
    epoch
        What time 0 of the log is in the clock of the filter [s].
    """
    dt = np.diff(gnss.time)
    velocity = np.nan_to_num(gnss.velocity_n[:, :2])
    way = np.cumsum(np.vstack((np.zeros(2), 0.5 * (velocity[:-1] + velocity[1:]) * dt[:, None])), axis=0)
    apart = _velocity_mismatch(gnss.position, way, 1)
    # A single position that is off goes there and back: it is an outlier, and no jump.
    lasting = np.append(_velocity_mismatch(gnss.position, way, 2), np.nan)
    known = np.all(np.isfinite(gnss.velocity_n[:, :2]), axis=1)
    known = np.asarray(known)
    fine = known[:-1] & known[1:] & (dt <= limits.VERDICT.jump_interval)
    if fine.sum() < FEWEST:
        return []
    usual = float(np.median(apart[fine]))
    limit = max(limits.VERDICT.jump_size, limits.VERDICT.jump_factor * usual)
    return [
        Jump(float(gnss.time[at + 1] + epoch), float(apart[at]), usual)
        for at in np.flatnonzero(fine & (apart > limit) & (lasting > limit))
    ]


def _velocity_mismatch(position: FloatArray, way: FloatArray, fixes: int) -> FloatArray:
    """Return the distance of positions some fixes later from where the velocities lead [m]."""
    moved = displacement(position[:-fixes], position[fixes:])[:, :2]
    return np.asarray(np.linalg.norm(moved - (way[fixes:] - way[:-fixes]), axis=1))
