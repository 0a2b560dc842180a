"""Receivers of NMEA: which of several on one line a sentence is of, so that two are not mixed into one path.

Two letters before the name of a sentence name its sender. Receivers with the same letters show by two
positions at one time of day, which no receiver sends alone; each sentence is then of the one whose path its
position goes on. A sentence without a position is of the receiver that was heard last.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from itertools import pairwise

from lab.base.parameters.units import DAY
from lab.motion.frames.earth import SEMI_MAJOR_AXIS

Place = tuple[float, float]  # latitude, longitude [rad]

_HEARD = 16
"""Last positions of one kind in which two senders are seen; 10 times a second beside once are 11."""
_TURNS = 2
"""Changes between the two letters of the sender within these from which the sentences are of two receivers.
One alone that begins to use another system of satellites changes them once."""
_SAME = 3e-8
"""Largest difference of positions in different sentences of one receiver [rad], 0.2 m: cells of four decimals
of a minute are rounded to 0.1 m."""
_TWICE = 3
"""Times with two positions from which there are two receivers: a receiver that is set may say one twice."""
_SILENT = 3.0
"""Silence after which the other receiver is read [s]: a receiver that sends once a second misses two."""
_NEARER = 2.0
"""How many times as near the other path is to the first position at a time that is of it, where they do not
come in one order."""
_GOES_ON = 2.0
"""Longest time over which a path is continued straight on [s]."""


class _Path:
    """The last position of a receiver, and how it moves."""

    def __init__(self, now: float, place: Place) -> None:
        self.now, self.place = now, place
        self._pace = (0.0, 0.0)

    @property
    def pace(self) -> complex:
        """How fast it goes north, and as the imaginary part east [rad/s]."""
        return complex(self._pace[0], self._pace[1] * math.cos(self.place[0]))

    def offset_to(self, now: float, place: Place) -> complex:
        """Return how far north, and as the imaginary part east, a position is of this path [rad]."""
        since = _elapsed_time(self.now, now)
        step = since if 0 < since <= _GOES_ON else 0.0
        north, east = (one + step * pace for one, pace in zip(self.place, self._pace, strict=True))
        return _measure_offset((north, east), place)

    def go_on(self, now: float, place: Place) -> None:
        """Take the next position."""
        since = _elapsed_time(self.now, now)
        if 0 < since <= _GOES_ON:
            self._pace = (place[0] - self.place[0]) / since, (place[1] - self.place[1]) / since
        elif since:
            self._pace = (0.0, 0.0)
        self.now, self.place = now, place if since else self.place

    def exchange(self, other: _Path) -> None:
        """Take the place of another path, which was this one's; the errors of both paces cancel."""
        self.place, other.place = other.place, self.place
        north, east = (sum(both) / 2 for both in zip(self._pace, other._pace, strict=True))
        self._pace = other._pace = (north, east)


class Receivers:
    """Says of each sentence whether it is of the receiver that is read."""

    def __init__(self) -> None:
        self._heard: dict[str, deque[bytes]] = {}  # who sent the last positions, by kind
        self._main = b""  # who is read where several send positions
        self._now = math.nan
        self._said: dict[str, Place] = {}  # positions at this time of day, by kind
        self._twice = 0  # times with two positions
        self._last_twice = math.nan
        self._paths: list[_Path] = []  # of two receivers of one name, that is read first
        self._apart = (0.0, 0.0)  # from the one to the other, in latitude and longitude [rad]
        self._in_order: deque[bool] = deque(maxlen=_HEARD)  # whether the one was heard before the other
        self._first_is_other = False
        self._last_is_other = False
        self._middle: _Path | None = None  # of both, whichever is which
        self._error = 0j  # by how much it left its straight path last
        self._bend = 0j  # and will next

    @property
    def remark(self) -> str:
        """Which of several receivers is read, in a sentence; empty for one."""
        others = {one for heard in self._heard.values() for one in heard} - {self._main}
        if self._main and others:
            names = ", ".join(one.decode() for one in sorted(others))
            return f"Sentences of two receivers come: ${self._main.decode()}… is read, and {names} is not."
        if self._paths:
            north, east = self._apart
            apart = SEMI_MAJOR_AXIS * math.hypot(north, math.cos(self._paths[0].place[0]) * east)
            return (
                f"Sentences of two receivers with the same name come, {apart:.1f} m apart: the one that was "
                "heard first is read, and the other is not."
            )
        return ""

    def is_other(self, kind: str, sender: bytes, now: float | None, place: Place | None) -> bool:
        """Return whether a sentence is of another receiver than the one that is read.

        Parameters
        ----------
        kind, sender
            The name of the sentence, and the two letters before it.
        now
            Its time of day [s]; None without one.
        place
            Its position; None without one.
        """
        if place is not None:
            heard = self._heard.setdefault(kind, deque(maxlen=_HEARD))
            heard.append(sender)
            if self._main and self._main not in heard:
                self._main = b""  # it fell silent
                self._heard.clear()
            elif not self._main and sum(one != other for one, other in pairwise(heard)) >= _TURNS:
                self._main = Counter(heard).most_common(1)[0][0]
        is_other = bool(self._main) and sender != self._main
        if is_other and any(sender in senders for senders in self._heard.values()):
            return True
        if place is not None and now is not None:
            self._last_is_other = self._is_twin(kind, now, place)
        return self._last_is_other

    def _is_twin(self, kind: str, now: float, place: Place) -> bool:
        """Return whether a position is of the second of two receivers of one name."""
        if now != self._now:
            self._now = now
            self._said.clear()
        before = self._said.setdefault(kind, place)
        if not self._paths:
            # Counted once for each time, however many sentences say the two positions.
            is_twice = abs(_measure_offset(before, place)) > _SAME and now != self._last_twice
            self._twice += is_twice
            self._last_twice = now if is_twice else self._last_twice
            if self._twice < _TWICE:
                return False
            self._paths = [_Path(now, before), _Path(now, place)]
            self._apart = place[0] - before[0], place[1] - before[1]
        main, other = self._paths
        if _elapsed_time(main.now, now) > _SILENT >= _elapsed_time(other.now, now):
            self._paths = [other, main]
            main, other = self._paths
            # From the new first one to the other: the opposite direction.
            self._apart = -self._apart[0], -self._apart[1]
            self._in_order.clear()
        mine, its = (abs(path.offset_to(now, place) - self._bend) for path in (main, other))
        # The first has its position of this time already: another place is the other's, the same one is only
        # said again.
        if main.now == now != other.now:
            is_other = abs(_measure_offset(main.place, place)) > _SAME
        elif other.now == now != main.now:
            is_other = abs(_measure_offset(other.place, place)) <= _SAME
        else:
            is_other = not all(self._in_order) and _NEARER * its < mine
            self._first_is_other = is_other
        (other if is_other else main).go_on(now, place)
        if main.now == other.now:
            self._check_direction()
        return is_other

    def _check_direction(self) -> None:
        """See by the direction between two positions of one time whether they were taken for each other."""
        main, other = self._paths
        apart = other.place[0] - main.place[0], other.place[1] - main.place[1]
        exchanged = apart[0] * self._apart[0] + apart[1] * self._apart[1] < 0
        if exchanged:
            main.exchange(other)
        self._apart = (-apart[0], -apart[1]) if exchanged else apart
        self._in_order.append(exchanged == self._first_is_other)
        self._first_is_other ^= exchanged  # once for each time
        self._follow_middle(main, other)

    def _follow_middle(self, main: _Path, other: _Path) -> None:
        """See by how much the path bends, which both share: 1.5 m in a second at 30 km/h and 20 °/s."""
        place = (main.place[0] + other.place[0]) / 2, (main.place[1] + other.place[1]) / 2
        middle = self._middle = self._middle or _Path(main.now, place)
        if middle.now == main.now:
            return
        before, error, pace = self._error, middle.offset_to(main.now, place), middle.pace
        middle.go_on(main.now, place)
        turn = middle.pace / pace if pace else 1.0
        turn = turn / abs(turn) if turn else 1.0
        # Noise bends it this way and that.
        self._bend = error * turn if abs(error - before * turn) < abs(error) / 2 else 0j
        self._error = error


def _measure_offset(one: Place, other: Place) -> complex:
    """Return how far north, and east, a position is of another one near it, on a sphere of radius 1."""
    # Across the date line too.
    east = (other[1] - one[1] + math.pi) % (2 * math.pi) - math.pi
    return complex(other[0] - one[0], math.cos(one[0]) * east)


def _elapsed_time(before: float, now: float) -> float:
    """Return the time from one time of day to another, which may be of the next day [s]."""
    return (now - before + DAY / 2) % DAY - DAY / 2
