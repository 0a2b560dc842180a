"""Coordinated turn: the attitude a vehicle most likely had, from its velocity alone.

No side force acts on an aircraft in a coordinated turn: its lift, the part of the specific force across the
path, lies in its plane of symmetry. That gives the bank; the nose is taken to point along the path (angle of
attack and sideslip 0, no wind). A car follows the slope and does not lean; a boat and a pedestrian stay
level. A copter leans so that its thrust is the specific force: without wind and drag, it accelerates where it
leans. Its nose could point anywhere, and is taken to point along the course. A rocket points along its path
(no wind, no angle of attack) and does not roll. The result is a reconstruction and must be labelled so
wherever it is shown.

In slow motion the noise of the velocity dominates its direction. Where that would turn the heading faster
than a vehicle turns, the heading is held; the pitch follows the path only at speed.

Left out, since only the velocity is known: the Coriolis acceleration and the curvature of the Earth (0.04° of
bank at 50 m/s, 0.2° at 250 m/s), and that gravity is not everywhere the standard one (0.3 % of tan of bank).

References
----------
B. Etkin, L. D. Reid, *Dynamics of Flight*, 3rd ed., ch. 7.3 (the steady turn: tan φ = v ψ̇ / g); P. D.
Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eq. 5.11 (f
= a − g).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.kinematics.running_turns import running_attitudes

Vehicle = Literal["aircraft", "car", "boat", "copter", "rocket", "pedestrian"]

VEHICLES = get_args(Vehicle)
STANDSTILL = 0.5
"""Horizontal speed below which the velocity shows no heading [m/s]: noise of a receiver of 0.1 m/s turns it
by 12° there (σ), noise of 0.3 m/s goes all around."""
TAXIING = 5.0
"""Speed up to which an aircraft does not bank: its wheels carry it [m/s]."""
FLYING = 10.0
"""Speed from which an aircraft banks fully [m/s]."""

ROLLING = 4.0
"""Speed from which the pitch of a car is the whole slope of its path [m/s]."""

_MIN_LIFT = 0.5 * STANDARD_GRAVITY
"""Lift below which the bank is held down [m/s²]: near weightlessness its direction means nothing."""
_MIN_TURN_TIME = 2.0
"""Shortest time in which a vehicle turns to the direction in which it leaves a standstill [s]."""
_MAX_STANDING_TURN_RATE = np.radians(45.0)
"""Rate of that turn where it is a large one [rad/s]: the smooth step reaches 1.5 times as much, which stays
below `_MAX_TURN_RATE`."""
_MAX_TURN_RATE = np.radians(90.0)
"""Largest turn rate of slow motion [rad/s]: nothing on wheels or wings turns faster at a walk; the
direction of noise does, from sample to sample."""
_SLOW = 8.0
"""Speed below which the direction of motion may be noise [m/s]. In simulated noise of 0.5 m/s at 5 Hz, 8 % of
the steps are faster than `_MAX_TURN_RATE` at 4 m/s, and 0.03 % at 8 m/s."""
_MIN_THRUST_UP = 0.2 * STANDARD_GRAVITY
"""Upward part of the thrust below which the lean of a copter is held down [m/s²]: in free fall it has no
direction."""
_LEAVING = 5.0
"""Speed from which the path shows where a rocket points [m/s]: noise of a receiver of 0.5 m/s turns it by 6°
there."""
_MAX_NOSE_RATE = np.radians(180.0)
"""Fastest turn of the path of a rocket that its nose follows [rad/s]. Where the path turns faster, as at the
apogee of a vertical flight, the nose turns from the direction before to the one after."""
_OPPOSITE = 1e-9
"""Sine of the angle between two directions below which they are parallel or opposite."""
_REACHES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Times around such a turn during which the heading is held [s]; each is tried if the previous one is too
short."""


def attitude(time: FloatArray, velocity_n: FloatArray, vehicle: Vehicle = "aircraft") -> FloatArray:
    """Return the attitude that goes with a velocity.

    At a standstill the last heading is kept; if the vehicle leaves in another direction, it turns to it
    within the last seconds before. The same holds where the direction of slow motion turns faster than 90
    °/s. Where an aircraft is nearly weightless or worse, its bank is held down instead of rolling it over.

    Parameters
    ----------
    time : (n,) array
        Times, increasing [s].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down, smooth enough to differentiate [m/s].
    vehicle
        "aircraft" banks into its turns, "car" follows the slope, "boat" and "pedestrian" stay level, "copter"
        leans where it accelerates, "rocket" points along its path.

    Returns
    -------
    (n, 3) array
        Roll, pitch, yaw [rad]; yaw within ±π, and without jumps but for those of a full turn.

    Raises
    ------
    ValueError
        For another vehicle, times that do not increase, fewer than two samples, or numbers that are not
        finite.
    """
    time, velocity = np.asarray(time, dtype=np.float64), np.asarray(velocity_n, dtype=np.float64)
    _check(time, velocity, vehicle)
    north, east, down = velocity.T
    if vehicle == "rocket":
        return _along_path(time, velocity)
    speed = np.hypot(north, east)
    yaw = _believable_heading(time, speed, np.arctan2(east, north))
    euler = np.zeros_like(velocity)
    euler[:, 2] = wrap(yaw)
    if vehicle == "copter":
        euler[:, :2] = _lean_angles(time, velocity, yaw)
    if vehicle in ("aircraft", "car"):
        slowest, full = (TAXIING, FLYING) if vehicle == "aircraft" else (STANDSTILL, ROLLING)
        follows = _smooth_step((np.linalg.norm(velocity, axis=1) - slowest) / (full - slowest))
        euler[:, 1] = follows * np.arctan2(-down, _raise_to_floor(speed, STANDSTILL))
    if vehicle == "aircraft":
        euler[:, 0] = _bank(time, velocity, euler[:, 1], yaw)
    return euler


def _check(time: FloatArray, velocity: FloatArray, vehicle: str) -> None:
    if vehicle not in VEHICLES:
        raise ValueError(f"vehicle {vehicle!r} is unknown; accepted: {', '.join(VEHICLES)}")
    if time.ndim != 1 or velocity.shape != (time.size, 3) or time.size < 2:
        raise ValueError(
            f"time of shape {time.shape} and velocity of shape {velocity.shape} do not go together; accepted "
            "are (n,) and (n, 3) of at least two samples"
        )
    if not (np.isfinite(time).all() and np.isfinite(velocity).all()):
        raise ValueError("time and velocity are not all finite")
    if (np.diff(time) <= 0).any():
        raise ValueError("time does not increase from sample to sample")


def _believable_heading(time: FloatArray, speed: FloatArray, course: FloatArray) -> FloatArray:
    """Return the heading, held for increasing times where slow motion would turn it too fast."""
    moving = speed > STANDSTILL
    for reach in _REACHES:
        heading = _heading(time, moving, course)
        too_fast = np.abs(np.diff(heading)) > _MAX_TURN_RATE * np.diff(time)
        turns = time[1:][too_fast & (np.minimum(speed[1:], speed[:-1]) < _SLOW)]
        if not turns.size:
            break
        after = np.searchsorted(turns, time)
        before = turns[np.maximum(after - 1, 0)]
        away = np.minimum(np.abs(time - before), np.abs(turns[np.minimum(after, turns.size - 1)] - time))
        moving &= (away > reach) | (speed >= _SLOW)
    else:
        heading = _heading(time, moving, course)
    return heading


def _heading(time: FloatArray, moves: NDArray[np.bool_], course: FloatArray) -> FloatArray:
    """Return the heading without jumps: the course while moving, the last one at a standstill."""
    moving = np.flatnonzero(moves)
    if not moving.size:
        return np.zeros_like(time)
    seen = np.unwrap(course[moving])
    after = np.searchsorted(moving, np.arange(time.size))
    last, following = np.maximum(after - 1, 0), np.minimum(after, moving.size - 1)
    turn = seen[following] - seen[last]
    start, end = time[moving[last]], time[moving[following]]
    # A turn takes its time, as far as the standstill has it.
    lasts = np.minimum(np.maximum(_MIN_TURN_TIME, np.abs(turn) / _MAX_STANDING_TURN_RATE), end - start)
    done = 1.0 - (end - time) / np.where(lasts > 0, lasts, 1.0)
    heading = seen[last] + turn * _smooth_step(done)
    heading[moving] = seen
    return np.asarray(heading)


def _bank(time: FloatArray, velocity: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """Return the bank [rad] at which the specific force has no part along the wings."""
    ahead, right, down = _force(time, velocity, yaw)
    up = -(np.sin(pitch) * ahead + np.cos(pitch) * down)
    bank = np.arctan2(right, _raise_to_floor(up, _MIN_LIFT))
    airborne = (np.linalg.norm(velocity, axis=1) - TAXIING) / (FLYING - TAXIING)
    return np.asarray(bank * _smooth_step(airborne))


def _lean_angles(time: FloatArray, velocity: FloatArray, yaw: FloatArray) -> FloatArray:
    """Return roll and pitch (n, 2) [rad] with which the thrust, upwards in b, is the specific force."""
    ahead, right, down = _force(time, velocity, yaw)
    up = _raise_to_floor(-down, _MIN_THRUST_UP)
    return np.stack((np.arctan2(right, np.hypot(ahead, up)), np.arctan2(-ahead, up)), axis=-1)


def _along_path(time: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return roll, pitch, yaw (n, 3) [rad] of a nose along the path that turns without rolling.

    Near the vertical, yaw and roll alone mean nothing: attitudes follow each other by the shortest turns.
    Before it moves, a rocket points where it will go, and it keeps its direction when it stands again.
    """
    speed = np.linalg.norm(velocity, axis=1)
    moving = np.flatnonzero(speed > _LEAVING)
    if not moving.size:
        return np.tile((0.0, np.pi / 2, 0.0), (time.size, 1))
    nose = velocity[moving] / speed[moving, None]
    while moving.size > 2:  # each round halves at least what turns too fast, or ends
        turn = np.arccos(np.clip(np.sum(nose[1:] * nose[:-1], axis=1), -1.0, 1.0))
        fast = np.flatnonzero(turn > _MAX_NOSE_RATE * np.diff(time[moving]))
        left_out = np.setdiff1d(np.union1d(fast, fast + 1), (0, moving.size - 1))
        if not left_out.size:
            break
        moving, nose = np.delete(moving, left_out), np.delete(nose, left_out, axis=0)
    return _without_roll(time, time[moving], nose)


def _without_roll(time: FloatArray, at: FloatArray, nose: FloatArray) -> FloatArray:
    """Return roll, pitch, yaw (n, 3) at times (n,), from directions (k, 3) of the nose at other times."""
    axis = np.cross(nose[:-1], nose[1:])
    sine, cosine = np.linalg.norm(axis, axis=1), np.sum(nose[1:] * nose[:-1], axis=1)
    # Any axis across the nose turns it over.
    across = np.cross(nose[:-1], np.eye(3)[np.argmin(np.abs(nose[:-1]), axis=1)])
    axis = np.where(sine[:, None] > _OPPOSITE, axis, across)
    turns = axis * (np.arctan2(sine, cosine) / np.linalg.norm(axis, axis=1))[:, None]
    level = np.hypot(nose[0, 0], nose[0, 1])
    heading = np.arctan2(nose[0, 1], nose[0, 0]) if level > _OPPOSITE else 0.0
    C_nb = running_attitudes(-turns).inv() * Rotation.from_euler(
        "ZY", (heading, np.arctan2(-nose[0, 2], level))
    )
    last = np.clip(np.searchsorted(at, time, side="right") - 1, 0, max(at.size - 2, 0))
    if at.size > 1:
        part = _smooth_step((time - at[last]) / np.diff(at)[last])
        C_nb = Rotation.from_rotvec(part[:, None] * turns[last]) * C_nb[last]
    q_nb = np.broadcast_to(np.atleast_2d(C_nb.as_quat(scalar_first=True)), (time.size, 4))
    return euler_from_quaternion(q_nb)


def _force(time: FloatArray, velocity: FloatArray, yaw: FloatArray) -> tuple[FloatArray, ...]:
    """Return the specific force along the heading, to its right and down, (n,) each [m/s²]."""
    north, east, down = scipy.interpolate.CubicSpline(time, velocity)(time, 1).T
    s, c = np.sin(yaw), np.cos(yaw)
    return c * north + s * east, c * east - s * north, down - STANDARD_GRAVITY


def _raise_to_floor(values: FloatArray, floor: float) -> FloatArray:
    """Return values; those below the floor are brought smoothly between it and its half."""
    below = np.minimum(values / floor, 1.0)
    return np.where(values >= floor, values, 0.5 * floor * (1.0 + np.exp(2.0 * (below - 1.0))))


def _smooth_step(part: FloatArray) -> FloatArray:
    """Return 0 up to 0, 1 from 1 on, and a smooth step between them."""
    part = np.clip(part, 0.0, 1.0)
    return np.asarray(part * part * (3.0 - 2.0 * part))
