"""Filter log: what a filter that is not ours says of itself: innovations, their variances, states, events.

A log has one lane for each filter that ran side by side. Times are those of the log. The innovations of a
measurement are one row for each fusion that was logged: autopilots log the latest one at a steady rate, so
that rows which repeat the row before are dropped, and rows without a variance were not fused.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import Flags, FloatArray, IntArray

AXES = ("north", "east", "down")
"""Axes of vectors resolved in n."""
FEW = 2
"""Messages of which none can be compared with those beside it."""
LONG = 100.0
"""Longest time to the last message, in usual steps: a later one is damaged."""
MAX_LANES = 16
"""Most lanes of a log that are read: autopilots have three or four, damaged numbers are anything."""
MAX_EVENTS = 500
"""Most events of a log that are kept: a damaged file must not fill a page with them."""


class Measured(NamedTuple):
    """What innovations are of.

    Attributes
    ----------
    name : str
        The measurement, such as ``"GPS position"``.
    axes : tuple of str
        What each column is; empty names for a measurement without axes.
    unit : str
        Of the innovations.
    """

    name: str
    axes: tuple[str, ...]
    unit: str


@dataclass(frozen=True, eq=False)
class Innovations:
    """The innovations of one measurement.

    Attributes
    ----------
    name : str
        The measurement.
    axes : tuple of str
        What each column is.
    unit : str
        Of the innovations; all three as of `Measured`.
    time : (n,) array
        Increasing [s].
    values : (n, k) array
        Innovations.
    normalised : (n, k) array
        Innovations in their σ; NaN in a row whose variances cannot be reconstructed.
    square : (n,) array
        Mean square of the normalised innovations of each row: 1 on average for a matched filter.
    ratio : (n,) array
        The filter's own test ratio, ν² over the gate squared times the variance: it rejects above 1. NaN
        without one.
    source : str
        Where the log says it: message and field, or heading.
    """

    name: str
    axes: tuple[str, ...]
    unit: str
    time: FloatArray
    values: FloatArray
    normalised: FloatArray
    square: FloatArray
    ratio: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class Track:
    """The states of a filter with the σ that it states.

    Attributes
    ----------
    time : (n,) array
        Increasing [s].
    position : (n, 3) array
        Latitude, longitude [rad], height [m].
    sigma : (n, 3) array
        σ of the position north, east, down [m]; NaN if unknown.
    source : str
        Where the log says it.
    """

    time: FloatArray
    position: FloatArray
    sigma: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class Lane:
    """One filter: ArduPilot's core, PX4's instance.

    Attributes
    ----------
    name : str
        As its program counts it.
    innovations : tuple of Innovations
        One for each measurement that it fused.
    track : Track or None
        Its position.
    """

    name: str
    innovations: tuple[Innovations, ...]
    track: Track | None = None


def track_of(time: FloatArray, position: FloatArray, sigma: FloatArray, source: str) -> Track | None:
    """Return the positions of a filter that can be places, in the order of their times; None without any.

    The parameters are the attributes of `Track`; rows with damaged numbers are left out.
    """
    fine = np.isfinite(time) & np.isfinite(position).all(axis=1)
    fine &= (np.abs(position[:, 0]) <= np.pi / 2) & (np.abs(position[:, 1]) <= np.pi)
    rows = np.flatnonzero(fine)
    rows = rows[in_order(time[rows])]
    return Track(time[rows], position[rows], sigma[rows], source) if rows.size else None


class Event(NamedTuple):
    """Something that a filter did, or said.

    Attributes
    ----------
    time : float
        [s].
    kind : str
        ``"lane"``, ``"reset"``, ``"rejected"``, ``"fault"``, ``"timeout"``, or ``"message"``.
    text : str
        What happened, as a sentence.
    source : str
        What it rests on: message and field.
    """

    time: float
    kind: str
    text: str
    source: str


@dataclass(frozen=True, eq=False)
class FilterLog:
    """What a filter says of itself.

    Attributes
    ----------
    name : str
        Its source, for messages.
    filter : str
        The filter, such as ``"PX4 EKF2"``.
    lanes : tuple of Lane
        At least one.
    primary : int
        Index of the lane whose solution was used most of the time.
    events : tuple of Event
        By time.
    flags : str
        What the flags of the log say, in a sentence.
    fusing : float
        Time from which its use of fixes was under way [s]: resets before are its start.
    """

    name: str
    filter: str
    lanes: tuple[Lane, ...]
    primary: int = 0
    events: tuple[Event, ...] = ()
    flags: str = ""
    fusing: float = -np.inf

    @classmethod
    def of(
        cls,
        path: Path,
        name: str,
        lanes: Sequence[Lane],
        primary: int,
        events: Iterable[Event],
        flags: str,
        fusing: float,
    ) -> FilterLog:
        """Return what the filter of a file says, with its first events in order."""
        first = tuple(sorted(events)[:MAX_EVENTS])
        return cls(str(path), name, tuple(lanes), primary, first, flags, fusing)

    @property
    def lane(self) -> Lane:
        """The lane whose solution was used most of the time."""
        return self.lanes[self.primary]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of an innovation or a state of the primary lane [s]."""
        times = [one.time for one in self.lane.innovations if one.time.size]
        times += [self.lane.track.time] if self.lane.track is not None else []
        return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def innovations_of(
    measured: Measured,
    time: FloatArray,
    values: FloatArray,
    source: str,
    *,
    variance: FloatArray | None = None,
    square: FloatArray | None = None,
    ratio: FloatArray | None = None,
    used: Flags | None = None,
) -> Innovations | None:
    """Return the innovations of one measurement that were fused, each once; None if there are none.

    Parameters
    ----------
    measured, source
        What they are of, and where the log says it.
    time : (n,) array
        [s]; rows whose time does not increase are dropped.
    values : (n, k) array
        Innovations.
    variance : (n, k) array
        Their variances; or
    square : (n,) array
        their sum of squares over the sum of their variances, from which a common variance follows.
    ratio : (n,) array
        The filter's own test ratio.
    used : (n,) array
        Rows in which the filter fused this measurement.
    """
    ratio = np.full(len(time), np.nan) if ratio is None else ratio
    with np.errstate(all="ignore"):
        if variance is None:
            assert square is not None
            common = np.sum(values**2, axis=1) / (values.shape[1] * square)
            variance = np.repeat(common[:, None], values.shape[1], axis=1)
            known = np.isfinite(square)
        else:
            known = np.all(np.isfinite(variance) & (variance > 0), axis=1)
            square = np.mean(values**2 / variance, axis=1)
        normalised = values / np.sqrt(variance)
    normalised[~np.isfinite(normalised)] = np.nan
    kept: Flags = np.asarray(known) & np.isfinite(values).all(axis=1) & np.isfinite(time + square)
    if used is not None:
        kept &= used
    rows = np.flatnonzero(kept)
    rows = rows[in_order(time[rows])]
    content = np.column_stack((values, square, np.nan_to_num(ratio)))[rows]
    rows = rows[np.append(True, (np.diff(content, axis=0) != 0).any(axis=1))[: rows.size]]
    if not rows.size or not values[rows].any():
        return None
    time, values, normalised = time[rows], values[rows], normalised[rows]
    return Innovations(*measured, time, values, normalised, square[rows], ratio[rows], source)


def find_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True values."""
    edges = np.diff(np.concatenate(([0], mask.astype(np.int8), [0])))
    first, behind = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    return list(zip(first.tolist(), (behind - 1).tolist(), strict=True))


def rejections(one: Innovations, lane: str) -> list[Event]:
    """Return an event for each run of innovations that the filter's own test rejected."""
    found = []
    for first, last in find_runs(one.ratio > 1)[:MAX_EVENTS]:
        begin, end = one.time[first], one.time[last]
        when = f"at {begin:.1f} s" if first == last else f"from {begin:.1f} s to {end:.1f} s"
        count = last - first + 1
        text = (
            f"{lane} rejected the {one.name} {when} ({count} logged innovation{'s' * (count > 1)}, test "
            f"ratio up to {one.ratio[first : last + 1].max():.3g})."
        )
        found.append(Event(float(begin), "rejected", text, f"test ratio of {one.source} above 1"))
    return found


def while_set(time: FloatArray, is_set: Flags, kind: str, text: str, source: str) -> list[Event]:
    """Return an event for each time that a flag (n,) is set; the text goes on with when that is."""
    return [
        Event(float(time[first]), kind, f"{text} from {time[first]:.1f} s to {time[last]:.1f} s.", source)
        for first, last in find_lasting_runs(is_set)
    ]


def lane_changes(time: FloatArray, chosen: FloatArray, lane: str, name: str, source: str) -> list[Event]:
    """Return an event for each change from one lane of an autopilot's filter to another."""
    text = f"The autopilot changed from {lane} {{:.0f}} to {lane} {{:.0f}} of {name} at {{:.1f}} s."
    found = changes(time, chosen)
    return [Event(at, "lane", text.format(before, after, at), source) for at, before, after in found]


def in_order(time: FloatArray) -> IntArray:
    """Return the rows whose times increase, without single ones that damaged bytes put elsewhere.

    Parameters
    ----------
    time : (n,) array
        Times of messages, finite, in the order in which they were logged [s].
    """
    rows = np.arange(len(time))
    if len(time) > FEW:
        step = float(np.median(np.abs(np.diff(time))))
        middle = np.median((time[:-2], time[1:-1], time[2:]), axis=0)
        fine = np.concatenate(
            ([time[0] <= time[1]], middle == time[1:-1], [time[-1] - time[-2] <= LONG * step])
        )
        rows = rows[fine]
    later = np.append(True, np.diff(np.maximum.accumulate(time[rows])) > 0)[: rows.size]
    return np.asarray(rows[later])


def nearest(times: FloatArray, wanted: FloatArray) -> IntArray:
    """Return the row (m,) of the message that is nearest to each wanted time, among those in order.

    Parameters
    ----------
    times : (n,) array
        Times of messages, of which at least one is finite [s].
    wanted : (m,) array
        [s].
    """
    finite = np.flatnonzero(np.isfinite(times))
    rows = finite[in_order(times[finite])]
    after = np.clip(np.searchsorted(times[rows], wanted), 0, len(rows) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.abs(times[rows[before]] - wanted) <= np.abs(times[rows[after]] - wanted)
    return np.asarray(rows[np.where(closer, before, after)])


def steady(values: FloatArray) -> FloatArray:
    """Return numbers without single ones that differ from equal ones around them, as damaged bytes make."""
    found = values.copy()
    single = (values[:-2] == values[2:]) & (values[1:-1] != values[2:])
    found[1:-1][single] = values[2:][single]
    return found


def find_lasting_runs(is_set: Flags) -> list[tuple[int, int]]:
    """Return first and last index of each run of a flag of two messages or more: one may be damaged."""
    return [(first, last) for first, last in find_runs(is_set) if last > first][:MAX_EVENTS]


def changes(time: FloatArray, counter: FloatArray) -> list[tuple[float, float, float]]:
    """Return time, value before and value after of each change of a number that is constant otherwise.

    Single messages with another value are left out.
    """
    fine = np.isfinite(counter) & np.isfinite(time)
    time, counter = time[fine], steady(counter[fine])
    at = np.flatnonzero(np.diff(counter))
    # The last message alone is not believed either.
    at = at[at < len(counter) - 2][:MAX_EVENTS]
    return [(float(time[k + 1]), float(counter[k]), float(counter[k + 1])) for k in at]
