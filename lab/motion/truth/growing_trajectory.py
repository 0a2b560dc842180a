"""Growing trajectory: the true curve of a flight that is still being flown, piece by piece.

The construction is that of `Trajectory.from_recording`: the velocity is splined, integrated over the
ellipsoid and tied to the positions by a slow correction; the curve has its knots on the grid of the IMU, and
truth and increments are exact derivatives of it. Only the past and a few frames are known, so three things
differ. Splines see `MARGIN` frames around the knots that they give. The correction follows the difference to
the positions by a critically damped filter in place of a least-squares spline. A knot is final once it is
given, so that pieces join to one curve.

A piece depends on the frames alone, not on how many came at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import ecef, rotation
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.kinematics.attitude_curve import RotationCurve
from lab.motion.recordings.recording import Frame
from lab.motion.truth.flight_paths import GeodeticPath
from lab.motion.truth.trajectory import Trajectory

BLOCK = 4
"""Frames that are taken together: 0.08 s at 50 Hz, in which a page is drawn once."""
MARGIN = 8
"""Frames on both sides that a spline through frames sees: an end changes it there by 3.7⁻⁸ = 3·10⁻⁵ of what
it changes at the end itself."""
OVERLAP = 16
"""Knots on both sides that the spline through the grid sees: pieces join to 3.7⁻¹⁶ = 10⁻⁹ of what an end
changes, below 10⁻⁶ m/s² for any motion that a frame shows."""
FOLLOWS = 0.2
"""Bandwidth of the correction [rad/s], two over `anchoring.ANCHOR_SPACING`: a position that is wrong by 1 cm
accelerates the curve by 0.4 mm/s²."""


class FlownPiece(NamedTuple):
    """A piece of a flight, with the curve on both sides of it.

    Attributes
    ----------
    trajectory : Trajectory
        The curve about the piece; its time 0 is that of its first knot.
    first : int
        Number of that knot on the grid of the IMU.
    begin, end : int
        Numbers of the knots between which the piece lies.
    """

    trajectory: Trajectory
    first: int
    begin: int
    end: int

    def since(self, times: FloatArray) -> FloatArray:
        """Return times of the grid [s] as times of `trajectory` [s]."""
        return times - self.first / self.trajectory.imu_rate


class GrowingTrajectory:
    """The curve through frames that come one by one.

    Parameters
    ----------
    rate
        Rate of the IMU, whose grid carries the knots [Hz].
    start
        Number of the knot at the first frame.
    behind
        How far the curve reaches back before a piece, beside `OVERLAP` [s].
    """

    def __init__(self, rate: float, start: int = 0, behind: float = 0.0) -> None:
        self._rate = rate
        self._kept = OVERLAP + int(np.ceil(behind * rate))
        self._frames: list[Frame] = []
        self._at = 0  # frame among them from which the next block begins
        self._start = self._emitted = start
        self._knots = 0  # knots given since `start`, the first included
        self._zero = 0.0  # time of the first frame
        self._origin = np.zeros(3)
        self._flown = np.zeros(3)  # integrated velocity, at the frame `_at`
        self._correction = np.zeros((2, 3))  # and its rate, there
        self._offsets = np.empty((0, 3))  # of the last knots, from the origin
        self._attitudes = np.empty((0, 4))

    def add(self, frame: Frame) -> Iterator[FlownPiece]:
        """Take a frame, later than all before; yield the piece that is known by it, if there is one.

        Raises
        ------
        ValueError
            If it is closer than 1° to a pole, where there is no such curve.
        """
        if ecef.near_pole(frame.position[:1]).any():
            raise ValueError("closer than 1° to a pole, where no live truth is made")
        if not self._frames:
            self._zero, self._origin = frame.time, frame.position.copy()
        else:
            east = frame.position[1] - self._frames[-1].position[1]
            position = frame.position.copy()
            position[1] = self._frames[-1].position[1] + float(rotation.wrap(east))
            frame = frame._replace(position=position)
        self._frames.append(frame)
        if len(self._frames) > self._at + BLOCK + MARGIN:
            self._give()
            yield from self._iterate_piece()

    def _give(self) -> None:
        """Give the knots within the next block of frames."""
        at, end = self._at, self._at + BLOCK
        frames = self._frames
        time = np.array([frame.time for frame in frames]) - self._zero
        position = np.array([frame.position for frame in frames])
        velocity_n = np.array([frame.velocity_n for frame in frames])
        per_latitude, per_longitude = metres_per_radian(position[:, 0], position[:, 2])
        to_rate = np.stack((1 / per_latitude, 1 / per_longitude, np.full_like(time, -1.0)), axis=-1)
        integral = scipy.interpolate.CubicSpline(time, velocity_n * to_rate).antiderivative()
        flown = self._flown + integral(time[at : end + 1]) - integral(time[at])
        highest = int(np.floor(time[end] * self._rate + 1e-6))  # 1e-6, because times are rounded
        number = np.arange(self._knots, highest + 1)
        grid = np.clip(number / self._rate, time[at], time[end])
        offsets = self._flown + integral(grid) - integral(time[at])
        # In which of the block's intervals each knot lies; the correction is a new one after each frame.
        inside = np.searchsorted(time[at + 1 : end], grid, side="right")
        for k in range(BLOCK):
            away = position[at + k] - self._origin - flown[k]
            here = inside == k
            offsets[here] += _correction_after(self._correction, away, grid[here] - time[at + k])[0]
            step = time[at + k + 1 : at + k + 2] - time[at + k]
            self._correction = _correction_after(self._correction, away, step)[:, 0]
        euler = np.array([frame.euler for frame in frames])
        attitude = Rotation.from_quat(rotation.quaternion_from_euler(euler), scalar_first=True)
        if number.size:
            q_nb = RotationCurve(time, attitude).attitude(grid).as_quat(scalar_first=True)
            self._offsets = np.concatenate((self._offsets, offsets))
            self._attitudes = np.concatenate((self._attitudes, q_nb))
            self._knots = highest + 1
        self._flown = flown[-1]
        drop = max(0, end - MARGIN)
        self._frames = frames[drop:]
        self._at = end - drop

    def _iterate_piece(self) -> Iterator[FlownPiece]:
        """Yield the piece up to `OVERLAP` knots before the last, and forget what no later one needs."""
        knots = self._start + self._knots  # number after the last
        end = knots - 1 - OVERLAP
        if end <= self._emitted:
            return
        first = max(self._start, self._emitted - self._kept)
        drop = first - (knots - len(self._offsets))
        self._offsets, self._attitudes = self._offsets[drop:], self._attitudes[drop:]
        time = np.arange(len(self._offsets)) / self._rate
        base = self._offsets[0]
        attitude = RotationCurve(time, Rotation.from_quat(self._attitudes, scalar_first=True))
        path = GeodeticPath(time, self._origin + base, self._offsets - base, attitude)
        begin, self._emitted = self._emitted, end
        yield FlownPiece(Trajectory(time, path, self._rate), first, begin, end)


def _correction_after(state: FloatArray, wanted: FloatArray, after: FloatArray) -> FloatArray:
    """Return the correction and its rate (2, n, 3), times after it had a state (2, 3), for a wanted value."""
    t = after[:, None]
    error = state[0] - wanted
    # Critical damping: e(t) = (e₀ + (ė₀ + ω e₀) t) exp(−ω t).
    slope = state[1] + FOLLOWS * error
    decay = np.exp(-FOLLOWS * t)
    return np.stack((wanted + (error + slope * t) * decay, (state[1] - FOLLOWS * slope * t) * decay))
