"""X-Plane flight: the packets of a running X-Plane become samples of simulated sensors, and the truth.

The time of the stream is that of the simulator's clock, placed on the host's clock where a flight begins: a
pause or another pace of the simulator changes no interval. A flight that breaks begins again `AWAY` later on
this line of time, which is more than a navigator bridges.
"""

from __future__ import annotations

import math

import numpy as np

from lab.data.clock.limits import LIMITS
from lab.live.xplane.frames import BrokenFlightError, XPlaneFrames
from lab.motion.recordings.recording import Frame
from lab.motion.truth.growing_trajectory import FlownPiece, GrowingTrajectory
from lab.motion.truth.growing_truth import GrowingTruth
from lab.sensors.sensor_stream import Sensed, SensorStream
from lab.sensors.suite import SensorSuite

AWAY = LIMITS.longest_filled + 1.0
"""Least time between a flight that broke and the next one [s]: longer than a gap that is filled."""


class XPlaneFlight:
    """Simulated sensors in the aircraft of X-Plane.

    Parameters
    ----------
    sensors
        Their errors.
    seed
        Of their random numbers.
    rate
        Samples of the IMU per second [Hz].

    Attributes
    ----------
    frames : XPlaneFrames
        What became of the packets.
    truth : GrowingTruth
        The true motion by the host's clock.
    sensors, rate
        As given.
    epoch : float
        Time of the host at time 0 of the samples [s]; NaN before the first frame.
    """

    def __init__(self, sensors: SensorSuite, seed: int, rate: float) -> None:
        self.frames = XPlaneFrames()
        self.truth = GrowingTruth()
        self.epoch = math.nan
        self.sensors, self.rate = sensors, rate
        self._stream = SensorStream(sensors, seed, rate)
        self._curve: GrowingTrajectory | None = None
        self._end = 0  # number of the last knot that was given

    def begin_anew(self) -> None:
        """Begin another flight with the next frame."""
        self.frames.begin_anew()
        self._curve = None

    def accept(self, packet: bytes, arrival: float) -> list[Sensed]:
        """Return what the sensors measure in the pieces that become known by a packet, since `epoch`.

        Parameters
        ----------
        packet
            Any bytes.
        arrival
            When they came, by the host's monotonic clock [s].

        Raises
        ------
        BrokenFlightError
            If the flight does not go on; `begin_anew` begins the next one.
        """
        found = self.frames.accept(packet, arrival)
        return [self.measured(piece) for frame, came in found for piece in self.pieces(frame, came)]

    def pieces(self, frame: Frame, arrival: float) -> list[FlownPiece]:
        """Return the pieces of the curve that become known by a frame; see `take`."""
        if self._curve is None:
            self._begin(arrival)
        assert self._curve is not None
        try:
            return list(self._curve.add(frame))
        except ValueError as error:
            raise BrokenFlightError(f"the aircraft is {error}") from error

    def _begin(self, arrival: float) -> None:
        """Begin a curve at a knot of the grid, behind the one before."""
        start = 0
        if math.isnan(self.epoch):
            self.epoch = arrival
        else:
            start = math.ceil(max(self._end + AWAY * self.rate, (arrival - self.epoch) * self.rate))
            self.truth.break_off(self.epoch + (self._end + start) / 2 / self.rate)
            self._stream.break_off()
        self._curve = GrowingTrajectory(self.rate, start, self.sensors.gps.latency)
        self._end = start

    def measured(self, piece: FlownPiece) -> Sensed:
        """Return what the sensors measure in a piece, whose truth is then known."""
        sensed = self._stream.sensed(piece)
        times = np.arange(piece.begin + (piece.begin > piece.first), piece.end + 1) / self.rate
        self.truth.append(self.epoch + times, piece.trajectory.at(piece.since(times)))
        self._end = piece.end
        return sensed
