"""X-Plane frames: packets in the order of their arrival become frames, and what breaks a flight is named.

RPOS brings position, attitude and velocity without a time, RREF the simulator's clock. X-Plane sends both in
one frame, either of them first. Which one, the waits between the first packets show, as for recorded flights
(`lab.data.protocols.xplane_packets`).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from lab.base.parameters.counted import counted, were
from lab.data.protocols import xplane_packets
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import C_nb_from_euler
from lab.motion.recordings.recording import Frame

LOOKED_AT = 12
"""Positions whose packets show which of the two comes first: 0.24 s at 50 Hz."""
CLOSEST = 1e-3
"""Least time between two frames [s]: that of the largest rate that is asked for."""
BRIDGED = 1.0
"""Longest time of the flight without a frame over which the curve goes on [s]. Longer ones break the flight:
a curve with known ends only would be another motion than that of the simulator."""
_SLACK, _ACCELERATION = 5.0, 100.0
"""Displacement [m] that the velocities before and after do not explain, and acceleration [m/s²] of 10 g, from
which the aircraft was moved: a frame at 80 m/s with a clock wrong by 20 ms is off by 1.6 m."""
_TURN, _TURN_RATE = 0.5, 10.0
"""Turn [rad] and rate [rad/s] from which the aircraft was moved: no aircraft turns by 570°/s."""
MOST_LATE = 5
"""Most frames in a row with an earlier time that are late packets, which networks deliver now and then; more
say that the clock was set back."""
PACE_OVER = 3.0
"""Time over which the pace of the simulator's clock is taken [s]."""
PACE_OFF = 0.1
"""Smallest part by which a pace that is reported differs from that of this computer."""
STANDS = 0.5
"""Time for which the clock stands still while packets come until the simulator is paused [s]."""
_GAP = 2.5
"""Interval, in usual ones, from which a bridged gap is reported: two frames are missing. One is not worth a
remark: X-Plane sends at most one position in a frame, and its frames are not even."""
_REMEMBERED = 0.02
"""Part that a new interval has in the usual one, as in `lab.data.clock.clock_watch`: at 50 Hz, a second is
remembered."""
_KILOMETRE = 1000.0
"""Length from which kilometres are shown [m]."""


class BrokenFlightError(ValueError):
    """A flight does not go on as it was; the message says why, as a clause."""


class XPlaneFrames:
    """Makes frames of the packets of one X-Plane.

    Attributes
    ----------
    ignored : int
        Packets of other kinds.
    untimed, unbelievable : int
        Positions without the simulator's clock; with numbers that no flight has.
    late : int
        Positions that came after a later one.
    bridged, longest : int, float
        Gaps of the flight that were bridged, and the longest of them [s].
    """

    def __init__(self) -> None:
        self.ignored = self.untimed = self.unbelievable = self.late = self.bridged = 0
        self.longest = 0.0
        self._values = [math.nan] * len(xplane_packets.REFERENCES)
        self._first: list[tuple[float, bytes | None]] = []
        self._clock_first: bool | None = None
        self._waiting: bytes | None = None  # a position that waits for its clock
        self._fresh = False  # whether the clock was not yet used
        self._last: Frame | None = None
        self._back = 0  # late frames in a row
        self._usual = math.nan  # interval of the frames [s]
        self._moved = self._came = -math.inf  # when the clock last went on, and a position last came
        self._paces: deque[tuple[float, float]] = deque()
        self._span: tuple[tuple[float, float], tuple[float, float]] | None = None  # the ends of these

    def begin_anew(self) -> None:
        """Forget the flight before a break, and the packets that wait."""
        self._waiting, self._fresh, self._last, self._back = None, False, None, 0
        self._first.clear()
        self._clock_first = None
        self._paces.clear()
        self._span = None

    @property
    def heard(self) -> bool:
        """Whether a position has come."""
        return self._came > -math.inf

    def accept(self, packet: bytes, arrival: float) -> Frame | None:
        """Return the frame that a packet completes, if it does.

        Parameters
        ----------
        packet
            Any bytes.
        arrival
            When they came, by the host's monotonic clock [s].

        Raises
        ------
        BrokenFlightError
            If this frame does not continue the flight; the next flight begins after `begin_anew`.
        """
        record = xplane_packets.position(packet)
        if record is None:
            found = xplane_packets.references(packet)
            if found is None:
                self.ignored += 1
                return None
            for index, value in found.items():
                self._values[index] = value
            if 0 not in found:
                return None
        else:
            self._came = arrival
        if self._clock_first is None:
            self._look(arrival, record)
            return None
        complete = self._paired(record)
        if complete is None:
            return None
        frame = xplane_packets.frame(complete, self._values)
        if frame is None:
            self.unbelievable += 1
            return None
        return self._following(frame, arrival)

    def _look(self, arrival: float, record: bytes | None) -> None:
        """Find out which packet comes first in a frame, from the shorter of the waits."""
        self._first.append((arrival, record))
        positions = [k for k, (_, one) in enumerate(self._first) if one is not None]
        if len(positions) < LOOKED_AT:
            return
        before, after = [], []
        for k in positions[1:-1]:
            if self._first[k - 1][1] is None:
                before.append(self._first[k][0] - self._first[k - 1][0])
            if self._first[k + 1][1] is None:
                after.append(self._first[k + 1][0] - self._first[k][0])
        if not before and not after:
            self.untimed += len(positions)
            self._first.clear()
            return
        self._clock_first = bool(before) and (not after or bool(np.median(before) <= np.median(after)))
        self._first.clear()

    def _paired(self, record: bytes | None) -> bytes | None:
        """Return the record of a frame whose position and clock are there."""
        if self._clock_first:
            if record is None:
                self._fresh = True
                return None
            if not self._fresh:
                self.untimed += 1
                return None
            self._fresh = False
            return record
        if record is not None:
            self.untimed += self._waiting is not None
            self._waiting = record
            return None
        complete, self._waiting = self._waiting, None
        return complete

    def _following(self, frame: Frame, arrival: float) -> Frame | None:
        """Return a frame that continues the flight, or None for one of the same moment."""
        last = self._last
        if last is None:
            self._last, self._moved = frame, arrival
            return frame
        step = frame.time - last.time
        if -CLOSEST < step < CLOSEST:
            self._check_still(last, frame)
            return None
        if -BRIDGED < step < 0 and self._back < MOST_LATE:
            self.late += 1
            self._back += 1
            return None
        why = _break(last, frame, step)
        if why:
            raise BrokenFlightError(why)
        self._back = 0
        if step > _GAP * self._usual:
            self.bridged += 1
            self.longest = max(self.longest, step)
        self._usual = step if math.isnan(self._usual) else self._usual + _REMEMBERED * (step - self._usual)
        self._last, self._moved = frame, arrival
        self._paces.append((arrival, frame.time))
        while arrival - self._paces[0][0] > PACE_OVER:
            self._paces.popleft()
        self._span = self._paces[0], self._paces[-1]
        return frame

    def _check_still(self, last: Frame, frame: Frame) -> None:
        """Break if the aircraft is moved while the clock stands, as on the map of a paused simulator."""
        why = _break(last, frame, 0.0)
        if why:
            raise BrokenFlightError(why)

    def remarks(self, now: float) -> list[str]:
        """Return what a user should know, in sentences.

        Parameters
        ----------
        now
            Time of the host's monotonic clock [s].
        """
        found, span = [], self._span  # which the thread of the source may replace
        if self._last is None and self.untimed:
            found.append(
                "X-Plane sends positions without its clock (the data reference "
                f"{xplane_packets.REFERENCES[0][1]}): no true motion can be made of them."
            )
        elif self._last is not None and self._came - self._moved > STANDS > now - self._came:
            found.append(f"X-Plane is paused: its clock has stood still for {now - self._moved:.0f} s.")
        elif span is not None and span[1][0] - span[0][0] > PACE_OVER / 2:
            (begin, first), (end, last) = span
            pace = (last - first) / (end - begin)
            if abs(pace - 1) > PACE_OFF:
                found.append(f"The simulator's clock runs {pace:.1f} times as fast as that of this computer.")
        if self.bridged:
            found.append(
                f"{counted(self.bridged, 'gap')} of up to {self.longest:.2f} s between frames "
                f"{were(self.bridged)} bridged by the curve of the true motion."
            )
        lost = [
            f"{counted(count, 'packet')} {what}"
            for count, what in (
                (self.untimed if self._last is not None else 0, "without the simulator's clock"),
                (self.unbelievable, "with numbers that no flight has"),
                (self.late, "too late"),
                (self.ignored, "of other kinds"),
            )
            if count
        ]
        if lost:
            found.append(f"Not used: {', '.join(lost)}.")
        return found


def _break(last: Frame, frame: Frame, step: float) -> str:
    """Return why a frame does not continue the flight; empty if it does."""
    if step < 0:
        return f"X-Plane's clock went back by {-step:.1f} s: another flight was loaded"
    if step > BRIDGED:
        return f"{step:.1f} s of the flight did not come"
    moved = displacement(last.position[None], frame.position[None])[0]
    unexplained = float(np.linalg.norm(moved - step * (last.velocity_n + frame.velocity_n) / 2))
    if unexplained > _SLACK + _ACCELERATION * step**2:
        return f"the aircraft was moved by {_length(float(np.linalg.norm(moved)))}"
    change = float(np.linalg.norm(frame.velocity_n - last.velocity_n))
    if change > _SLACK + _ACCELERATION * step:
        return f"the velocity of the aircraft was changed by {change:.0f} m/s"
    C = C_nb_from_euler(last.euler).T @ C_nb_from_euler(frame.euler)
    turn = float(np.arccos(np.clip((np.trace(C) - 1) / 2, -1, 1)))
    if turn > _TURN + _TURN_RATE * step:
        return f"the aircraft was turned by {np.degrees(turn):.0f}°"
    return ""


def _length(metres: float) -> str:
    return f"{metres / _KILOMETRE:.1f} km" if metres >= _KILOMETRE else f"{metres:.0f} m"
