"""MotionPlan: a motion as a list of commands for attitude and velocity, as in files of gnss-ins-sim.

A command gives Euler angles (°, or °/s for type 1) and the velocity along the body's axes (m/s, or m/s² for
type 1). It ends when its target is reached, or after its time; one of type 1 ends after its time. Angles are
used as written: from a yaw of 350° to 10° it turns left by 340°. The response is smooth: accelerations,
turning too, build up within a tenth of a second and stay within the plan's limits.

Type 1 gives rates, 2 attitude and velocity to reach, 3 their changes, 4 attitude to reach and change of
velocity, 5 change of attitude and velocity to reach. Format: https://github.com/Aceinna/gnss-ins-sim, README,
"Create a motion profile".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.bounds import HEIGHTS, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.flying.geodesy import position
from lab.flying.manoeuvres import MAX_DURATION
from lab.flying.plan_table import LATITUDES, SPEEDS, TURNS, number, plain_part, read_part, read_parts
from lab.motion.frames.rotation import C_nb_from_euler, wrap
from lab.motion.recordings.recording import Recording

SAMPLE = 0.05
"""Time between two samples of the recording [s]."""
MAX_COMMANDS = 10_000
"""Most commands in one plan."""
STEPS = 10
"""Steps of the response per sample."""

_STEP = SAMPLE / STEPS
"""Step of the response [s]."""
_MAX_PITCH = math.radians(85)
"""Pitch beyond which Euler angles turn without bound [rad]."""
_MAX_LATITUDE = math.radians(89)
"""Latitude beyond which yaw turns without bound [rad]."""


@dataclass(frozen=True)
class MotionStart:
    """Where and how a motion starts."""

    latitude_deg: float = number("Latitude", "°", LATITUDES, "Geodetic latitude on WGS-84.")
    longitude_deg: float = number("Longitude", "°", TURNS, "Longitude on WGS-84, east positive.")
    height_m: float = number("Height", "m", HEIGHTS, "Height above the ellipsoid.", default=0.0)
    forward_m_s: float = number("Forward", "m/s", SPEEDS, "Velocity along body x.", default=0.0)
    right_m_s: float = number("Right", "m/s", SPEEDS, "Velocity along body y.", default=0.0)
    down_m_s: float = number("Down", "m/s", SPEEDS, "Velocity along body z.", default=0.0)
    yaw_deg: float = number("Yaw", "°", TURNS, "True heading.", default=0.0)
    pitch_deg: float = number("Pitch", "°", (-85, 85), "Pitch, nose up positive.", default=0.0)
    roll_deg: float = number("Roll", "°", TURNS, "Roll, right side down positive.", default=0.0)


@dataclass(frozen=True)
class MotionCommand:
    """One command; its type decides the meaning of its numbers."""

    type: int = number("Type", "", (1, 5), "1 rates; 2 to reach; 3 changes; 4 and 5 mixed.", whole=True)
    seconds: float = number("Time", "s", (0, MAX_DURATION), "Longest time of the command.")
    yaw: float = number("Yaw", "°", (-36_000, 36_000), "Yaw, its change, or its rate in °/s.", default=0.0)
    pitch: float = number("Pitch", "°", TURNS, "Pitch, its change, or its rate in °/s.", default=0.0)
    roll: float = number("Roll", "°", (-36_000, 36_000), "Roll, its change, or its rate in °/s.", default=0.0)
    forward: float = number(
        "Forward", "m/s", SPEEDS, "Velocity along body x, its change, or its rate in m/s².", default=0.0
    )
    right: float = number(
        "Right", "m/s", SPEEDS, "Velocity along body y, its change, or its rate in m/s².", default=0.0
    )
    down: float = number(
        "Down", "m/s", SPEEDS, "Velocity along body z, its change, or its rate in m/s².", default=0.0
    )
    gps: int = number("GPS", "", (0, 1), "1 where GPS is visible, 0 where not.", default=1, whole=True)


@dataclass(frozen=True)
class MotionPlan:
    """A motion as a list of commands."""

    start: MotionStart
    commands: tuple[MotionCommand, ...]
    acceleration_m_s2: float = number(
        "Acceleration",
        "m/s²",
        (0.01, 100),
        "Largest along each axis, but in commands of type 1.",
        default=1.0,
    )
    turn_acceleration_deg_s2: float = number(
        "Turn acceleration", "°/s²", (0.1, 2000), "Largest of each angle.", default=30.0
    )
    turn_rate_deg_s: float = number(
        "Turn rate", "°/s", (0.1, 1000), "Largest of each angle, but in commands of type 1.", default=115.0
    )

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "flight") -> MotionPlan:
        """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

        Parameters
        ----------
        values
            ``start``, a table as `MotionStart`; ``commands``, a list of tables as `MotionCommand`; and the
            limits.
        where
            Name of the mapping in messages.

        Raises
        ------
        MissionError
            If a key is unknown or missing, or a value is not accepted.
        """
        values = dict(values)
        parts: dict[str, Any] = {}
        if "start" in values:
            parts["start"] = read_part(MotionStart, values.pop("start"), f"{where}.start")
        if "commands" in values:
            parts["commands"] = _commands(values.pop("commands"), f"{where}.commands")
        return read_part(cls, values, where, parts)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data without defaults; `from_dict` restores the plan."""
        commands = [plain_part(command) for command in self.commands]
        return {**plain_part(self), "start": plain_part(self.start), "commands": commands}


def _commands(entries: Any, where: str) -> tuple[MotionCommand, ...]:
    commands = read_parts(MotionCommand, entries, where, 1, MAX_COMMANDS, "commands")
    total = sum(command.seconds for command in commands)
    if not MIN_SAMPLES * SAMPLE <= total <= MAX_DURATION:
        raise MissionError(
            f"{where}: {total:g} s in all; accepted are {MIN_SAMPLES * SAMPLE:g} to {MAX_DURATION:g} s"
        )
    return commands


@dataclass(frozen=True, eq=False)
class Motion:
    """The result of a motion plan.

    Attributes
    ----------
    recording : Recording
        The recorded motion.
    without_gps : tuple of (float, float)
        Times without GPS, start and end [s].
    """

    recording: Recording
    without_gps: tuple[tuple[float, float], ...]


def move(plan: MotionPlan) -> Motion:
    """Carry out the commands of a plan.

    Raises
    ------
    MissionError
        If the motion ends within a few samples, or its pitch passes ±85°, where Euler angles turn without
        bound.
    """
    state, ends = _carry_out(plan)
    time = SAMPLE * np.arange(len(state), dtype=np.float64)
    euler = state[:, 2::-1]
    if len(time) < MIN_SAMPLES:
        raise MissionError("the motion is over after less than four samples: its commands ask for nothing")
    if np.abs(euler[:, 1]).max() > _MAX_PITCH:
        at = time[int(np.argmax(np.abs(euler[:, 1]) > _MAX_PITCH))]
        raise MissionError(f"the pitch passes 85° {at:.2f} s into the motion; accepted are -85° to 85°")
    velocity = np.einsum("nij,nj->ni", C_nb_from_euler(euler), state[:, 3:])
    start = plan.start
    first = np.array([math.radians(start.latitude_deg), math.radians(start.longitude_deg), start.height_m])
    latitude, longitude, height = position(time, velocity, first).T
    if np.abs(latitude).max() > _MAX_LATITUDE:
        raise MissionError("the motion comes within 1° of a pole, where yaw turns without bound")
    recording = Recording(time, latitude, wrap(longitude), height, velocity, euler)
    return Motion(recording, _without_gps(plan, ends, float(time[-1])))


def _without_gps(plan: MotionPlan, ends: FloatArray, last: float) -> tuple[tuple[float, float], ...]:
    spans: list[tuple[float, float]] = []
    begin = 0.0
    for command, end in zip(plan.commands, ends.tolist(), strict=True):
        if not command.gps and end > begin:
            if spans and spans[-1][1] == begin:
                begin = spans.pop()[0]
            spans.append((begin, min(end, last)))
        begin = end
    return tuple(spans)


def _carry_out(plan: MotionPlan) -> tuple[FloatArray, FloatArray]:
    """Return yaw, pitch, roll and body velocity (n, 6) at the samples, and when each command ended [s]."""
    start, to_si = plan.start, np.array([math.radians(1)] * 3 + [1.0] * 3)
    first = np.array(
        [start.yaw_deg, start.pitch_deg, start.roll_deg, start.forward_m_s, start.right_m_s, start.down_m_s]
    )
    table = np.array(
        [[one.type, one.yaw, one.pitch, one.roll, one.forward, one.right, one.down] for one in plan.commands]
    )
    table[:, 1:] *= to_si
    steps = np.array([round(command.seconds / _STEP) for command in plan.commands])
    limits = np.array(
        [
            plan.acceleration_m_s2,
            math.radians(plan.turn_acceleration_deg_s2),
            math.radians(plan.turn_rate_deg_s),
        ]
    )
    from lab.flying.motion_response import respond  # noqa: PLC0415 - compiled, for those who need it

    samples = np.empty((int(steps.sum()) // STEPS + 1, 6))
    ends = np.empty(len(steps))
    count = respond(first * to_si, table, steps, limits, (_STEP, STEPS), samples, ends)
    return samples[:count], ends * _STEP
