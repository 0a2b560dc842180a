"""Sheet axes: which axes of an unknown IMU point forward, right and down, from gravity and from the motion.

Gravity shows which axis points down. Forward is the axis with which the log passes
`lab.data.checks.log_check`; if several pass, the motion does not show it, and the usual one is taken and
reported as an assumption.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.checks import limits
from lab.data.checks.gyro_check import GyroError
from lab.data.checks.imu_axes import XYZ, axes_matrix
from lab.data.checks.log_check import check_log, is_explained, match_windows
from lab.data.checks.window_matches import WindowMatches
from lab.data.log.sensor_log import SensorLog
from lab.data.sheets.column_names import OF_DIRECTIONS

Axes = tuple[str, str, str]

_IF_REVERSED = (
    ". With the signs of all accelerations reversed the log agrees: some phones, such as iPhones, report "
    "them along gravity and not against it. If this one does: --column HEADING=-force_x[m/s²], "
    "and y and z alike"
)
_OR_REVERSED = (
    " This holds if the accelerations are written against gravity, as most programs do. If this one writes "
    "them along gravity, as some do on iPhones, {}: the motion does not show which. Then state it: --column "
    "HEADING=-force_x[m/s²], and y and z alike."
)
_FIRST, _FIRST_PART = 20, 0.01
"""Fewest samples, and part of them, at the start, in which a rocket stands upright or is launched."""
_BY_WORDS = ("the roll rate", "the pitch rate", "the yaw rate", "forward", "the lateral acceleration", "up")
"""What headings call the columns of an IMU without saying to which side they count."""
_TILTED = np.radians(20.0)
"""Angle between gravity and the nearest axis from which it is reported [rad]."""


class Oriented(NamedTuple):
    """A log in forward, right, down.

    Attributes
    ----------
    log : SensorLog
        The log.
    axes : tuple of str
        The axes of the IMU that point forward, right and down.
    """

    log: SensorLog
    axes: Axes


def orient_log(
    samples: FloatArray,
    build: Callable[[FloatArray], SensorLog],
    given: Sequence[str] = (),
    phone: bool = False,
    signed: bool = True,
    shown: Callable[[FloatArray], SensorLog] | None = None,
    level: bool = True,
    by_words: AbstractSet[str] = frozenset(),
) -> Oriented:
    """Return a log in forward, right, down, with the axes that point there.

    Parameters
    ----------
    samples : (n, 6) array
        Angular rate and specific force in the axes of the IMU.
    build
        Returns the log of samples in forward, right, down.
    given
        The axes that point forward, right and down, if a person gives them.
    phone
        Whether the IMU is that of a phone, whose y axis points to its top.
    signed
        Whether it is known that the accelerations are specific force, and not the negative of it.
    shown
        As `build`, with velocities by which the axes are judged in place of those that the filter gets.
    level
        Whether the vehicle is level on average; a rocket stands on its tail.
    by_words
        Which of `OF_DIRECTIONS` the sensors are: the signs of what is named by a direction, such as lateral
        or yaw, are open. Gyros beside accelerometers with axes are taken as they are if the motion allows it.

    Raises
    ------
    MissionError
        If the log is implausible whatever the axes, or with those given.
    """
    if given:
        log = build(_turn_samples(samples, given))
        check_log(log)
        return Oriented(
            _add_remark(log, f"Axes: {_describe(given)}, as given."), (given[0], given[1], given[2])
        )
    judged = shown or build
    signs = ""
    if OF_DIRECTIONS[1] in by_words:
        samples, signs = _in_signs_of_motion(samples, judged, phone, level, by_words)
    passed, refused = _try_axes(samples, judged, phone, level)
    if not passed and by_words == {OF_DIRECTIONS[0]}:
        samples, signs = _in_signs_of_motion(samples, judged, phone, level, by_words)
        passed = _try_axes(samples, judged, phone, level)[0] if signs else passed
    reversed_ = samples * np.array([1.0] * 3 + [-1.0] * 3)
    if not passed:
        agreeing = any(is_explained(log) for _, log in _try_axes(reversed_, judged, phone, level)[0][:1])
        hint = _IF_REVERSED if agreeing else ""
        raise MissionError(f"{str(refused[0]).removesuffix('.')}{hint}")
    axes, log = passed[0]
    why = "gravity shows down; the motion does not show forward, which is assumed"
    if not level:
        why = "the force at the start shows where the nose points; the roll is assumed"
    elif len(passed) == 1:
        why = "gravity and the motion show them"
    log = log if shown is None else build(_turn_samples(samples, axes))
    log = replace(log, auxiliary=replace(log.auxiliary, forward_assumed=len(passed) > 1))
    other = (_opposite_axis(axes[0]), axes[1], _opposite_axis(axes[2]))
    doubtful = not signed and _passes_check(judged(_turn_samples(reversed_, other)))
    doubt = _OR_REVERSED.format(_describe(other)) if doubtful else ""
    return Oriented(_add_remark(log, f"Axes: {_describe(axes)}: {why}{_tilt(samples)}.{signs}{doubt}"), axes)


def _in_signs_of_motion(
    samples: FloatArray,
    build: Callable[[FloatArray], SensorLog],
    phone: bool,
    level: bool,
    by_words: AbstractSet[str],
) -> tuple[FloatArray, str]:
    """Return samples in the signs of lateral force and gyros that the motion shows, and a sentence on them.

    Loggers of cars count lateral acceleration and yaw to either side: the two may be of left-handed axes.
    Gyros that are named x, y, z are right-handed, with y and z to either side.
    """
    axes = next(_candidates(samples, phone, level))
    C, matches = axes_matrix(axes), match_windows(build(_turn_samples(samples, axes)))
    if len(matches.windows) < limits.LOG.gyro_windows:
        return samples, ""

    def misfit(signs: tuple[float, ...]) -> float:
        rates, forces = (C @ np.diag(one) @ C.T for one in (signs[:3], (1.0, signs[3], 1.0)))
        return float(np.mean([matches.misfit(at, rates, forces) for at in range(len(matches.windows))]))

    handed = ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0))
    gyros, forces = (name in by_words for name in OF_DIRECTIONS)
    open_signs = (
        one
        for one in product((1.0, -1.0), repeat=4)
        if (gyros or one[:3] in handed) and (forces or one[3] > 0)
    )
    tried = sorted((misfit(one), one) for one in open_signs)
    fitting = [one for one in tried if one[0] < limits.LOG.gyro_misfit]
    turned = [(left, np.array((*one[:3], 1.0, one[3], 1.0))) for left, one in fitting]
    passed = [
        (left, signs) for left, signs in turned if _passes_check(build(_turn_samples(samples * signs, axes)))
    ]
    if not passed:
        return samples, ""
    alike = [signs for left, signs in passed if left < limits.LOG.alike_misfit * passed[0][0]]
    taken = max(alike, key=lambda one: one.sum())  # as they are, if the motion allows it

    def named(which: NDArray[np.bool_]) -> str:
        return " and ".join(name for name, is_one in zip(_BY_WORDS, which, strict=True) if is_one)

    open_ = np.ptp(alike, axis=0) > 0
    doubt = f", but not to which side {named(open_)} count" if open_.any() else ""
    if (taken > 0).all():
        return samples, ""
    return samples * taken, (
        f" The motion shows that {named(taken < 0)} count to the other side, which no heading says{doubt}."
    )


def _passes_check(log: SensorLog) -> bool:
    try:
        check_log(log)
    except MissionError:
        return False
    return True


def _opposite_axis(axis: str) -> str:
    return axis[1:] if axis.startswith("-") else f"-{axis}"


class _SharedMatches:
    """The matches of a log whose axes are tried: of the first ones that get so far, turned for the others."""

    def __init__(self) -> None:
        self._first: tuple[FloatArray, WindowMatches] | None = None

    def of(self, C: FloatArray, log: SensorLog) -> WindowMatches:
        """Return the matches of a log whose axes are C times those of the IMU."""
        if self._first is None:
            self._first = (C, match_windows(log))
        return self._first[1].turned(C @ self._first[0].T)


def _try_axes(
    samples: FloatArray, build: Callable[[FloatArray], SensorLog], phone: bool, level: bool
) -> tuple[list[tuple[Axes, SensorLog]], list[MissionError]]:
    """Return the axes with which a log passes, each with the log, and why it does not with the others."""
    passed: list[tuple[Axes, SensorLog]] = []
    refused: list[MissionError] = []
    shared = _SharedMatches()
    for axes in _candidates(samples, phone, level):
        log = build(_turn_samples(samples, axes))
        try:
            check_log(log, partial(shared.of, axes_matrix(axes)))
        except GyroError as error:
            refused.append(error.seen_in(axes_matrix(axes)))
            break  # it holds whichever way the IMU points
        except MissionError as error:
            refused.append(error)
        else:
            passed.append((axes, log))
    return passed, refused


def _turn_samples(samples: FloatArray, axes: Sequence[str]) -> FloatArray:
    C = axes_matrix(axes)
    return np.column_stack((samples[:, :3] @ C.T, samples[:, 3:] @ C.T))


def _gravity(samples: FloatArray) -> FloatArray:
    return np.asarray(np.nanmedian(samples[:, 3:], axis=0))


def _candidates(samples: FloatArray, phone: bool, level: bool) -> Iterator[Axes]:
    """Yield the axes that fit gravity, the usual ones first; the first alone if only the roll is unknown."""
    up = _gravity(samples if level else samples[: max(_FIRST, int(_FIRST_PART * len(samples)))])
    vertical = int(np.argmax(np.abs(up)))
    down = np.zeros(3)
    down[vertical] = -np.sign(up[vertical])
    if not level:
        right = np.roll(np.abs(down), 1)
        yield _name(-down), _name(right), _name(np.cross(-down, right))
        return
    # A phone lies with its top forward, or stands with its screen, z, to the rear.
    first = (("y", "x") if phone else ("x", "y")) if vertical == XYZ.index("z") else ("-z",)
    order = [*first, *(name for name in ("x", "y", "z", "-x", "-y", "-z") if name not in first)]
    for name in order:
        forward = np.zeros(3)
        forward[XYZ.index(name[-1])] = -1 if name.startswith("-") else 1
        if forward[vertical] == 0:
            yield _name(forward), _name(np.cross(down, forward)), _name(down)


def _name(axis: FloatArray) -> str:
    place = int(np.argmax(np.abs(axis)))
    return f"{'-' if axis[place] < 0 else ''}{XYZ[place]}"


def _describe(axes: Sequence[str]) -> str:
    return f"forward is {axes[0]}, right is {axes[1]}, down is {axes[2]} of the IMU"


def _tilt(samples: FloatArray) -> str:
    up = _gravity(samples)
    angle = float(np.arccos(np.abs(up).max() / np.linalg.norm(up)))
    return f"; gravity is {np.degrees(angle):.0f}° off the nearest axis" if angle > _TILTED else ""


def _add_remark(log: SensorLog, sentence: str) -> SensorLog:
    return replace(log, repairs=(sentence, *log.repairs))
