"""Row repair: the samples of a raw flight that make one unbroken flight, in order; the others are counted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import HEIGHTS, LATITUDES, LONGITUDES, MAX_SPEED, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.checks.estimator_resets import JUMP, jumps, reported_step
from lab.data.clock.faults import usual_step
from lab.data.rebuild.raw_flight import Dropped, RawFlight, Reset
from lab.motion.frames import ecef

LIMITS: dict[str, tuple[float, float, str]] = {
    "time": (-1e13, 1e13, "a time stamp beyond ±10¹³ s"),
    "latitude": (*np.radians(LATITUDES), "a latitude beyond ±90°"),
    "longitude": (*np.radians(LONGITUDES), "a longitude beyond ±360°"),
    "height": (*HEIGHTS, "a height outside −1 to 100 km"),
    "velocity_n": (-MAX_SPEED, MAX_SPEED, "a velocity beyond 1000 m/s"),
    "euler": (-4 * np.pi, 4 * np.pi, "an angle of attitude beyond two turns"),
    "airspeed": (-MAX_SPEED, MAX_SPEED, "an airspeed beyond 1000 m/s"),
    "alpha": (-np.pi, np.pi, "an angle of attack beyond ±180°"),
    "beta": (-np.pi, np.pi, "a sideslip beyond ±180°"),
}
"""Smallest and largest value of each quantity [SI], and the reason reported for a row beyond them."""
NO_FIX = "at 0° N 0° E, which receivers write without a fix"
"""The reason reported for positions of zero, written without a fix."""
CHECKED_WITH = ("body_rate", "acceleration_b")
"""Quantities that are only compared: impossible values are left out, and the row is kept."""

_NOT_USED: dict[str, Any] = {name: {name: None} for name in CHECKED_WITH}
_MAX_CHECKED = 1e4
"""Largest recorded rate [rad/s] or acceleration [m/s²] that is used for checking: a thousand g."""
_MIN_KEPT = 0.5
"""Part of the samples that has to be possible: if most are not, a unit is wrong and not the samples."""
_LIMIT_ROUNDING = 1e-9
"""Slack of the limits, as a part of their width: numbers converted from degrees or feet miss them by
1e-15."""
_MIN_MOVING_SPEED = 0.5
"""Mean speed after a repeated state from which the vehicle was moving [m/s]: below a walk, above the creep of
positions at rest. The tests pass at half and at twice it."""
_MIN_LEAVING_SPEED = 5.0
"""The same after a state that lasted [m/s]: from rest that takes 10 m/s² over `_STOP_TIME`. The tests pass
at half and at twice it."""
_STOP_TIME = 1.0
"""Time from which on a repeated state is a stop [s]: loggers that ask too often repeat for less. The tests
pass at half and at twice it."""
_MAX_LATE_RUN = 3
"""Longest run of late samples that is sorted into place: threads swap a few, a restart sends the clock
back for good. The tests pass at half and at twice it."""
_MIN_JUMP = 300.0
"""Shortest distance between samples that can be a jump [m]: the spread of a receiver that finds itself
anew. The tests pass at half and at twice it."""
_MIN_JUMP_SPEED = 100.0
"""Speed of a jump beyond that of the flight [m/s], so that a recording at rest is not cut by its noise.
The tests pass at half and at twice it."""
_JUMP_SPEED_RATIO = 8
"""Speed of a jump beyond which no flight accelerates between two samples, over its usual speed."""
_MAX_JUMPS = 1000
"""Most jumps at which a recording is cut."""
_MIN_STEP = 1e-3
"""Least time between samples by which a speed is computed [s]."""
_MIN_FOR_SPIKE = 5
"""Fewest samples among which one can be a spike: with fewer its distances are most of those it is judged
by."""
_MAX_SPIKE_RETURN = 0.2
"""Distance between the neighbours of a spike over the path to it and back: a spike comes back."""
MAX_BRIDGED_GAP = 3600.0
"""Longest gap that may be bridged [s]: what moved in an hour nothing says."""
_MAX_GAPS_TRIED = 50
"""Most values of `longest_gap` tried for a suggestion: each costs one pass over the recording."""
_SUGGESTED_PARTS = (0.5, 0.95)
"""Parts of what any gap keeps for which the shortest gap is suggested: most, and nearly all."""
_MIN_GAIN = 0.05
"""Part of the samples that a suggested gap has to keep beyond what is kept already. The tests pass at half
and at twice it."""
_ZERO_ANGLE = 1e-9
"""Latitude and longitude that are zero except for rounding [rad]: 6 mm."""
_MAX_DISTANCE_FROM_ZERO = 10_000.0
"""Distance of the flight to 0° N 0° E within which its zeros are positions [m]. The tests pass at half and
at twice it."""


def drop_impossible(raw: RawFlight) -> RawFlight:
    """Return the samples whose numbers lie within `LIMITS`.

    Raises
    ------
    MissionError
        If less than half of them do, or fewer than a curve needs.
    """
    if (raw.latitude is None) != (raw.longitude is None):
        raw = replace(raw, latitude=None, longitude=None)
    for name in CHECKED_WITH:
        value = getattr(raw, name)
        if value is not None and np.abs(value).max(initial=0.0) > _MAX_CHECKED:
            words = name.removesuffix("_b").replace("_", " ")
            remark = f"The recorded {words} is impossible and is not used."
            raw = replace(raw, remarks=(*raw.remarks, remark), **_NOT_USED[name])
    kept = np.ones(len(raw.time), dtype=bool)
    dropped: list[Dropped] = []
    for name, (low, high, words) in LIMITS.items():
        value = getattr(raw, name)
        if value is None:
            continue
        slack = _LIMIT_ROUNDING * (high - low)
        inside = ((value >= low - slack) & (value <= high + slack)).reshape(len(value), -1).all(axis=1)
        # A row counts for the first limit that it misses, so that the counts add up to the rows lost.
        dropped += _report_dropped(raw, kept & ~inside, words)
        kept &= inside
    if kept.sum() < max(MIN_SAMPLES, _MIN_KEPT * len(kept)):
        worst = max(dropped, key=lambda one: one.count, default=None)
        why = f"{worst.count} of {len(kept)} samples have {worst.reason}" if worst else f"{len(kept)} samples"
        hint = "; is a column in another unit? A unit is given with --unit COLUMN=UNIT" if worst else ""
        raise MissionError(f"{why}{hint}; accepted are at least {MIN_SAMPLES} good ones, and half of all")
    return raw.rows(kept, tuple(dropped)) if dropped else raw


def drop_null_island(raw: RawFlight) -> RawFlight:
    """Return the samples without those at exactly 0° N 0° E, unless the flight comes close to there.

    Receivers and loggers write zeros while they have no position. If they never have one, the flight is
    made of the velocity alone.

    Raises
    ------
    MissionError
        If there is no other position, and no velocity.
    """
    if raw.latitude is None or raw.longitude is None:
        return raw
    nowhere = (np.abs(raw.latitude) < _ZERO_ANGLE) & (np.abs(raw.longitude) < _ZERO_ANGLE)
    if not nowhere.any():
        return raw
    if nowhere.all():
        if raw.velocity_n is None:
            raise MissionError(
                f"all {len(nowhere)} positions are {NO_FIX}; accepted are recordings with positions or "
                "velocities"
            )
        if np.abs(raw.velocity_n).max() < _MIN_MOVING_SPEED:
            return raw
        remark = f"The positions are not used: all are {NO_FIX}."
        return replace(raw, latitude=None, longitude=None, remarks=(*raw.remarks, remark))
    places = positions_in_ecef(raw)
    assert places is not None
    # All zeros are one place, so the first of them stands for all.
    off = np.linalg.norm(places[~nowhere] - places[np.argmax(nowhere)], axis=1)
    if off.min() < _MAX_DISTANCE_FROM_ZERO:
        return raw
    return drop_samples(raw, nowhere, f"a position {NO_FIX}")


def drop_stale(raw: RawFlight) -> RawFlight:
    """Return the samples without those that repeat the one before in everything though the vehicle moves.

    A logger that polls faster than the simulator steps writes the same state again with a new time; a paused
    simulator repeats it for longer.
    """
    again = _mask_repeated(raw, "time")
    places = positions_in_ecef(raw) if again.any() else None
    if places is None:
        return raw
    first = ~again
    starts = np.flatnonzero(first)
    ends = np.append(starts[1:], len(first)) - 1
    moving = _mask_moving_runs(raw.time, places, starts, ends)[np.cumsum(first) - 1]
    return drop_samples(raw, ~first & moving, "the state of the row before at a later time")


def _mask_moving_runs(
    time: FloatArray, places: FloatArray, starts: NDArray[np.intp], ends: NDArray[np.intp]
) -> Flags:
    """Return after which runs of equal rows, from `starts` to `ends`, the vehicle is seen to be moving.

    A run that lasts is a stop, unless the vehicle is at speed at once: rounded positions start with a jump
    too.
    """
    lasts = time[ends] - time[starts] > _STOP_TIME
    # What follows a repeated row shows motion at once; what follows a stop has a second to get going.
    after = np.where(lasts, np.searchsorted(time, time[ends] + _STOP_TIME), ends + 1)
    seen = after < len(time)
    # The last run is judged by the data before it.
    here = np.where(seen, ends, np.maximum(starts - 1, 0))
    there = np.where(seen, np.minimum(after, len(time) - 1), starts)
    distance = np.linalg.norm(places[there] - places[here], axis=1)
    return np.asarray(
        distance > np.where(lasts, _MIN_LEAVING_SPEED, _MIN_MOVING_SPEED) * np.abs(time[there] - time[here])
    )


def in_order(raw: RawFlight) -> tuple[RawFlight, NDArray[np.intp]]:
    """Return the samples with slightly late ones sorted, and where a new recording begins.

    Returns
    -------
    raw : RawFlight
        Time does not decrease between breaks; stamps may still repeat.
    breaks : (m,) array
        Indices of the first samples after the clock was set back.
    """
    # Before any earlier stamp, not only the last one: or just the first of a late run would count.
    late = raw.time < np.maximum.accumulate(raw.time)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], late, [False])).astype(int)))
    # Edges are begins and ends by turns: every second difference is the length of a run.
    if late.any() and np.diff(edges)[::2].max() <= _MAX_LATE_RUN:
        remark = f"{int(late.sum())} rows were out of order and have been sorted."
        in_time = raw.rows(np.argsort(raw.time, kind="stable"))
        raw = replace(in_time, remarks=(*raw.remarks, remark))
    return raw, np.flatnonzero(np.diff(raw.time) < 0) + 1


def drop_repeated(raw: RawFlight) -> RawFlight:
    """Return the samples without those that repeat the one before in everything, time included."""
    return drop_samples(raw, _mask_repeated(raw), "the values of the row before, time included")


def _mask_repeated(raw: RawFlight, *but: str) -> Flags:
    """Return which samples (n,) repeat the one before in everything, but for some quantities."""
    same = np.ones(len(raw.time) - 1, dtype=bool)
    for name in set(raw.quantities) - {*but}:
        value = getattr(raw, name).reshape(len(raw.time), -1)
        same &= (value[1:] == value[:-1]).all(axis=1)
    return np.concatenate(([False], same))


def without_spikes(raw: RawFlight) -> RawFlight:
    """Return the samples without single positions far from the path between their neighbours."""
    places = positions_in_ecef(raw)
    if places is None or len(places) < _MIN_FOR_SPIKE:
        return raw
    step = np.linalg.norm(np.diff(places, axis=0), axis=1)
    far = _too_far(step, np.diff(raw.time))
    across = np.linalg.norm(places[2:] - places[:-2], axis=1)
    spike = np.zeros(len(places), dtype=bool)
    # A jump that stays is far from one neighbour alone, and does not come back.
    spike[1:-1] = far[1:] & far[:-1] & (across < _MAX_SPIKE_RETURN * (step[1:] + step[:-1]))
    return drop_samples(raw, spike, "a position far from the path of its neighbours")


def with_jumps(raw: RawFlight) -> RawFlight:
    """Return the samples with the jumps of their positions as resets, if the file says of none."""
    position = raw.position
    if raw.resets or position is None:
        return raw
    found = [
        Reset(float(raw.time[at]), reported_step(JUMP, position, int(at)))
        for at in jumps(raw.time, position)[:_MAX_JUMPS]
    ]
    return replace(raw, resets=tuple(found))


def longest_stretch(
    raw: RawFlight, jumps: Flags, bridged: float
) -> tuple[RawFlight, tuple[tuple[float, float], ...]]:
    """Return the longest stretch of a recording without a gap, a restart or a jump of the place.

    Parameters
    ----------
    raw
        Samples in order.
    jumps : (n - 1,) array
        As of `jumps_between`.
    bridged
        Longest pause between samples that is bridged [s].

    Returns
    -------
    raw : RawFlight
        The stretch that lasts longest.
    cuts : tuple of (float, float)
        Time of the samples before and after each gap or jump that was cut at [s].

    Raises
    ------
    MissionError
        If no stretch has samples enough.
    """
    cut = jumps | (np.diff(raw.time) > bridged)
    edges = np.concatenate(([0], np.flatnonzero(cut) + 1, [len(raw.time)]))
    # By time, not by samples, since rates change; −1 keeps a piece too short for a curve from being best.
    lengths = np.where(np.diff(edges) >= MIN_SAMPLES, raw.time[edges[1:] - 1] - raw.time[edges[:-1]], -1.0)
    best = int(np.argmax(lengths))
    if lengths[best] <= 0:
        raise MissionError(
            f"no stretch of {MIN_SAMPLES} samples without a gap in time or a jump of the position: the "
            f"samples are usually {usual_step(raw.time):.3g} s apart; longer gaps are bridged "
            "with --set longest_gap=SECONDS"
        )
    kept = np.zeros(len(raw.time), dtype=bool)
    kept[edges[best] : edges[best + 1]] = True
    words = "beyond a gap, a jump or a restart: only the longest stretch is taken"
    if raw.resets:
        words = words.replace(" or a restart", ", a restart or a reset of the estimator")
    where = [(float(raw.time[i]), float(raw.time[i + 1])) for i in np.flatnonzero(cut)]
    return (drop_samples(raw, ~kept, words) if where else raw), tuple(where)


@dataclass(frozen=True)
class Bridging:
    """What a longer `longest_gap` would keep of a recording.

    Attributes
    ----------
    gap : float
        The setting [s].
    share : float
        Which part of the samples it keeps.
    """

    gap: float
    share: float


def bridge_gaps(raw: RawFlight, jumps: Flags, bridged: float) -> tuple[Bridging, ...]:
    """Return the longer gaps with which most, and nearly all, of a recording would be kept.

    Parameters
    ----------
    raw
        Samples in order.
    jumps : (n - 1,) array
        As of `jumps_between`.
    bridged
        Longest pause between samples that is bridged so far [s].
    """
    steps = np.diff(raw.time)
    # Up to whole seconds: a suggestion that is typed in must not fall short of its pause by rounding.
    pauses = np.unique(np.ceil(steps[~jumps & (steps > bridged) & (steps <= MAX_BRIDGED_GAP)]))
    if not pauses.size:
        return ()
    tried = pauses[np.unique(np.linspace(0, len(pauses) - 1, _MAX_GAPS_TRIED).astype(int))]
    kept = [_longest_piece(jumps | (steps > gap)) / len(raw.time) for gap in tried]
    worthwhile = _longest_piece(jumps | (steps > bridged)) / len(raw.time) + _MIN_GAIN
    # Pauses increase, so the first that keeps enough is the shortest.
    enough = dict.fromkeys(int(np.argmax(np.array(kept) >= part * max(kept))) for part in _SUGGESTED_PARTS)
    return tuple(Bridging(float(tried[i]), kept[i]) for i in enough if kept[i] > worthwhile)


def _longest_piece(cut: Flags) -> int:
    """Return how many samples the longest piece between cuts has."""
    edges = np.concatenate(([-1], np.flatnonzero(cut), [len(cut)]))
    return int(np.diff(edges).max())


def jumps_between(raw: RawFlight, breaks: NDArray[np.intp]) -> Flags:
    """Return between which samples (n - 1,) the clock was set back, or the place jumps.

    Parameters
    ----------
    raw
        Samples in order.
    breaks
        Where the clock was set back.
    """
    places, jumps = positions_in_ecef(raw), np.zeros(len(raw.time) - 1, dtype=bool)
    if places is not None:
        jumps = _too_far(np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(raw.time))
    jumps[breaks - 1] = True
    return jumps


def _too_far(distance: FloatArray, steps: FloatArray) -> Flags:
    """Return which displacements between samples are too large for a vehicle."""
    speed = distance / np.maximum(steps, _MIN_STEP)
    # The median, which the jumps themselves do not raise.
    usual = float(np.median(speed)) if len(speed) else 0.0
    return np.asarray((distance > _MIN_JUMP) & (speed > _JUMP_SPEED_RATIO * usual + _MIN_JUMP_SPEED))


def positions_in_ecef(raw: RawFlight) -> FloatArray | None:
    """Return the positions in Earth-fixed axes (n, 3) [m]; without heights, those on the ellipsoid."""
    position = raw.position
    return None if position is None else ecef.position(position)


def drop_samples(raw: RawFlight, mask: Flags, words: str) -> RawFlight:
    """Return a flight without samples (n,), with the report on these and why they are left out."""
    return raw.rows(~mask, _report_dropped(raw, mask, words))


def _report_dropped(raw: RawFlight, mask: Flags, words: str) -> tuple[Dropped, ...]:
    """Return the report on samples left out: why, and when the first was by the file's own clock."""
    first = f", first at {raw.time[np.argmax(mask)]:.12g} s" if mask.any() else ""
    return Dropped.of(f"{words}{first}", mask)
