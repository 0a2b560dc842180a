"""X-Plane frames: the positions of a running X-Plane become frames, and what breaks a flight is named."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.clock.limits import LIMITS
from lab.data.protocols import xplane
from lab.data.protocols.xplane import REFERENCES, Position, XPlanePackets
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import C_nb_from_euler
from lab.motion.recordings.recording import Frame

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
_KILOMETRE = 1000.0
"""Length from which kilometres are shown [m]."""


class BrokenFlightError(ValueError):
    """A flight does not go on as it was; the message says why, as a clause."""


class XPlaneFrames:
    """Makes frames of the packets of one X-Plane.

    Attributes
    ----------
    packets : XPlanePackets
        What the frames are made of.
    untimed, unbelievable : int
        Positions without the simulator's clock; with numbers that no flight has.
    late : int
        Positions that came after a later one.
    bridged, longest : int, float
        Gaps of the flight that were bridged, and the longest of them [s].
    """

    def __init__(self) -> None:
        self.packets = XPlanePackets()
        self.untimed = self.unbelievable = self.late = self.bridged = 0
        self.longest = 0.0
        self._last: Frame | None = None
        self._back = 0  # late frames in a row
        self._usual = math.nan  # interval of the frames [s]
        self._moved = self._came = -math.inf  # when the clock last went on, and a position last came
        self._paces: deque[tuple[float, float]] = deque()
        self._span: tuple[tuple[float, float], tuple[float, float]] | None = None  # the ends of these

    def begin_anew(self) -> None:
        """Forget the flight before a break, and the packets that wait."""
        self.packets.begin_anew()
        self._last, self._back = None, 0
        self._paces.clear()
        self._span = None

    def accept(self, packet: bytes, arrival: float) -> list[tuple[Frame, float]]:
        """Return the frames that a packet completes, with their arrival [s].

        Parameters
        ----------
        packet
            Any bytes.
        arrival
            When they came, by the host's monotonic clock [s].

        Raises
        ------
        BrokenFlightError
            If a frame does not continue the flight; the next flight begins after `begin_anew`.
        """
        found = []
        for position in self.packets.accept(packet, arrival):
            self._came = position.arrival
            if math.isnan(position.references[0]):
                self.untimed += 1
            elif (frame := _frame(position)) is None:
                self.unbelievable += 1
            elif (following := self._continue_flight(frame, position.arrival)) is not None:
                found.append((following, position.arrival))
        return found

    def _continue_flight(self, frame: Frame, arrival: float) -> Frame | None:
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
        # One missing frame is not worth a remark: the frames of X-Plane are not even.
        if step > LIMITS.filled * self._usual:
            self.bridged += 1
            self.longest = max(self.longest, step)
        before = step if math.isnan(self._usual) else self._usual
        self._usual = before + LIMITS.remembered * (step - before)
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
                f"{REFERENCES[0][1]}): no true motion can be made of them."
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
                f"{count_noun(self.bridged, 'gap')} of up to {self.longest:.2f} s between frames "
                f"{was_or_were(self.bridged)} bridged by the curve of the true motion."
            )
        lost = [
            f"{count_noun(count, 'packet')} {what}"
            for count, what in (
                (self.untimed if self._last is not None else 0, "without the simulator's clock"),
                (self.unbelievable, "with numbers that no flight has"),
                (self.late, "too late"),
                (self.packets.ignored, "of other kinds"),
            )
            if count
        ]
        if lost:
            found.append(f"Not used: {', '.join(lost)}.")
        return found


def _frame(position: Position) -> Frame | None:
    """Return the state of the aircraft in one frame, or None if its numbers are those of no flight."""
    known = xplane.columns(position.record, position.references)
    for name, *_ in REFERENCES[3:]:
        del known[name]  # of the air, which a frame does not need
    if not xplane.mask_possible(known).all():
        return None
    return Frame(
        float(known["time"][0]),
        xplane.matrix(known, "latitude", "longitude", "height")[0],
        xplane.velocity_n(known)[0],
        xplane.matrix(known, "roll", "pitch", "heading")[0],
    )


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
