"""DataFlash time: when the messages of a DataFlash log were written, in seconds on one clock.

Since 2015 every message has the time since boot (``TimeUS``). Before, most have it in milliseconds
(``TimeMS``), but the GPS's ``TimeMS`` (in 2012 ``Time``) counts from the start of the GPS week and ``T``,
if it is there, since boot; in 2012 and 2013 IMU and attitude have no time at all. Loggers write in order,
so the places of messages in the file relate the GPS week to the clock of the others, and messages without
a time get one by their place between those that have one.

References
----------
ArduPilot, *DataFlash.h* and *Log.pde* of ArduCopter 2.9 to 3.2 and ArduPlane 2.68 to 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lab.base.arrays import FloatArray, IntArray, running_sums
from lab.base.parameters.units import DAY
from lab.data.clock.faults import increasing
from lab.data.files.dataflash_file import Log
from lab.data.files.streams import TIME, Messages

_GPS = "GPS"
_AVERAGED = 2.0
"""Reach of the mean over the times of messages that have none of their own [s]: single ones are shifted by
those between them, the mean is not."""
_MAX_AVERAGED = 10_000
"""The same reach in messages at most: it bounds the work where stamps are damaged."""
_MIN_STEP = 1e-6
"""Least step between messages by which that reach is counted [s]."""
_LEAST_BETWEEN = 3
"""Fewest messages whose times are averaged: the first and the last keep theirs."""
_FIX_2D = 2
"""Status from which a fix has a time; a two-dimensional one does, and old logs know no higher one."""


class MessageTimes:
    """The times of the messages of a log.

    Parameters
    ----------
    log
        The log.
    names
        The messages that are used.

    Attributes
    ----------
    unstamped : list of str
        Messages that were timed by their order in the file.
    of_week : bool
        Whether the clock is that of the GPS week, since the log has no other.
    """

    def __init__(self, log: Log, names: Sequence[str]) -> None:
        self._log, self._names = log, names
        self.unstamped: list[str] = []
        self.of_week = False

    def of(self, name: str) -> Messages | None:
        """Return the messages of a name with their time under `TIME`; None without any, or without a time."""
        messages = self._log.numbers(name)
        if messages is None:
            return None
        places = self._log.places(name)
        time = _since_boot(name, messages)
        if time is None and name == _GPS:
            time = self._of_week(messages, places)
        if time is None and not any(one.startswith("Time") for one in messages) and len(self._anchors[0]) > 1:
            time = self._by_order(places)
            self.unstamped += [name] if name not in self.unstamped else []
        return None if time is None else {**messages, TIME: time}

    @cached_property
    def _anchors(self) -> tuple[IntArray, FloatArray]:
        """Return places in the file of messages with a time, and that time, both increasing."""
        places, times = [np.empty(0, np.int64)], [np.empty(0)]
        for name in self._names:
            messages = self._log.numbers(name)
            time = None if messages is None else _since_boot(name, messages)
            if time is not None:
                places.append(self._log.places(name))
                times.append(time)
        if len(places) == 1 and (gps := self._log.numbers(_GPS)) is not None:
            time = _in_week(gps)
            if time is not None:
                fixed = gps.get("Status", np.full(len(time), _FIX_2D)) >= _FIX_2D
                self.of_week = True
                places.append(self._log.places(_GPS)[fixed])
                times.append(time[fixed])
        place, time = np.concatenate(places), np.concatenate(times)
        order = np.argsort(place, kind="stable")
        place, time = place[order], time[order]
        later = increasing(time)
        return place[later], time[later]

    def _of_week(self, gps: Messages, places: IntArray) -> FloatArray | None:
        """Return the times of the GPS's messages, from those of the week, on the clock of the others."""
        week = _in_week(gps)
        place, time = self._anchors
        if week is None or not len(place):
            return week
        there = (places >= place[0]) & (places <= place[-1]) & np.isfinite(week)
        fixed = there & (gps.get("Status", np.full(len(week), _FIX_2D)) >= _FIX_2D)
        if not fixed.any():
            return week
        logged = np.interp(places[fixed], place, time)
        return week - float(np.median(week[fixed] - logged))

    def _by_order(self, places: IntArray) -> FloatArray:
        """Return the times of messages written at a steady rate, by those that stand around them."""
        time = np.interp(places, *self._anchors, left=np.nan, right=np.nan)
        known = np.flatnonzero(np.isfinite(time))
        if len(known) < _LEAST_BETWEEN:
            return time
        at = time[known]
        count = np.arange(len(at), dtype=np.float64)
        step = float(at[-1] - at[0]) / (len(at) - 1)
        # Messages of other kinds shift single ones; the mean over seconds does not.
        reach = int(min(_AVERAGED / max(step, _MIN_STEP), len(at) - 1, _MAX_AVERAGED))
        time[known] = np.maximum.accumulate(step * count + _average_neighbours(at - step * count, reach))
        return time


def _average_neighbours(values: FloatArray, reach: int) -> FloatArray:
    """Return the means over as many neighbours on both sides, at most `reach`."""
    total = running_sums(values)
    place = np.arange(len(values))
    both = np.minimum(np.minimum(place, place[::-1]), reach)
    return np.asarray((total[place + both + 1] - total[place - both]) / (2 * both + 1))


def _since_boot(name: str, messages: Messages) -> FloatArray | None:
    if "TimeUS" in messages:
        return messages["TimeUS"] * 1e-6
    if name == _GPS:
        return messages["T"] * 1e-3 if "T" in messages and (messages["T"] > 0).any() else None
    return messages["TimeMS"] * 1e-3 if "TimeMS" in messages else None


def _in_week(gps: Messages) -> FloatArray | None:
    """Return GPS time, from the start of the first week [s]."""
    name = next((name for name in ("TimeMS", "Time") if name in gps), None)
    if name is None:
        return None
    week = gps.get("Week", np.zeros(len(gps[name])))
    counted = np.where(week > 0, week, np.nan)
    first = np.nanmin(counted) if np.isfinite(counted).any() else 0.0
    return np.asarray(gps[name] * 1e-3 + 7 * DAY * np.nan_to_num(counted - first))
