"""IMU calibration: bias, scale factor and misalignment of both triads, judged on withheld rests and turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.analysis.calibration.imu_fit import (
    BIAS_A,
    BIAS_G,
    ENTRIES,
    MATRIX_G,
    PRIOR,
    SHAPE_A,
    TERMS,
    Fit,
    Problem,
    integrate_turn,
    matrices,
    solve,
    solve_linear,
)
from lab.analysis.calibration.rests import LIMITS, Rests, attitudes
from lab.analysis.calibration.terms import Judgement, Term, judge
from lab.base.arrays import Flags, FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.log.calibration import Calibration, Linear

GRAVITY_SIGMA = 0.015
"""σ of gravity where the place is unknown [m/s²]: at sea level it is 9.780 to 9.832 m/s², evenly spread."""
APART = math.radians(20.0)
"""Angle between two attitudes from which they count as two: below, a box was put down askew."""
FEWEST_ATTITUDES = 6
"""Fewest attitudes: the six faces of a box show biases and scale factors."""
TURNED = math.radians(10.0)
"""Smallest turn between two rests that counts as one."""
SHOWN = 0.2
"""σ of a term, in that before the log is seen, below which the log shows the term."""
FOLDS = 12
"""Most parts in which rests are withheld in turn."""
UNDEFINED = 2.0
"""Degrees of freedom up to which Student's distribution has no σ."""
AXES = "xyz"
ACCELEROMETER, GYRO = "accelerometer", "gyro"
"""The sensors."""
GYRO_BIAS, GYRO_MATRIX = "gyro bias", "gyro scale factors and misalignments"
"""The groups that are judged besides all of the accelerometers."""
CONVENTION = (
    "The axes of the device are those about which the accelerometers are skewed evenly (xy is yx); "
    "rests and turns do not show how they stand in the vehicle, which is the mounting."
)


@dataclass(frozen=True, eq=False)
class ImuCalibration:
    """The constant errors of an IMU.

    Attributes
    ----------
    terms : tuple of Term
        Every term, also those that the log does not show.
    judgements : tuple of Judgement
        What withheld rests and turns say.
    sentences : tuple of str
        What was found, each with what it rests on.
    calibration : Calibration
        What gains, ready to apply; empty if nothing does.
    """

    terms: tuple[Term, ...]
    judgements: tuple[Judgement, ...]
    sentences: tuple[str, ...]
    calibration: Calibration

    @property
    def stated(self) -> tuple[Term, ...]:
        """The known terms of the groups that gain."""
        gaining = {one.group for one in self.judgements if one.gains}
        return tuple(term for term in self.terms if term.is_known and _group(term) in gaining)


def _group(term: Term) -> str:
    if term.group == ACCELEROMETER:
        return ACCELEROMETER
    return GYRO_BIAS if term.name == "bias" else GYRO_MATRIX


def calibrate(rests: Rests, source: str, gravity: float | None = None) -> ImuCalibration:
    """Return the calibration of an IMU by its rests and turns.

    Parameters
    ----------
    rests
        The rests and turns of a log.
    source
        The log, for the calibration.
    gravity
        Gravity at the place [m/s²]; None if unknown.

    Raises
    ------
    MissionError
        If the log rests in too few attitudes.
    """
    number = attitudes(rests.force, APART)
    count = int(number.max()) + 1
    if count < FEWEST_ATTITUDES:
        raise MissionError(
            f"the device rests in {count_noun(count, 'attitude')} ({count_noun(rests.count, 'rest')}); "
            "accepted "
            f"are at least {FEWEST_ATTITUDES}, such as the six faces of a box, each of them twice, with "
            "turns between them"
        )
    size = STANDARD_GRAVITY if gravity is None else gravity
    fit, problem = solve(rests, size)
    known = _find_known_terms(fit)
    folds = [
        np.asarray(part, dtype=np.int64)
        for part in np.array_split(np.arange(rests.count), min(rests.count, FOLDS))
    ]
    judgements = _judge_withheld_parts(rests, size, problem, folds, known)
    terms = _terms(fit, known, 0.0 if gravity is not None else GRAVITY_SIGMA / size)
    gaining = {one.group for one in judgements if one.gains}
    stated = np.where(known, fit.terms, 0.0)
    K_a, K_g = matrices(stated)
    gyro = (
        Linear(stated[BIAS_G], K_g if GYRO_MATRIX in gaining else np.eye(3)) if GYRO_BIAS in gaining else None
    )
    calibration = Calibration(
        source=source,
        accelerometer=Linear(stated[BIAS_A], K_a) if ACCELEROMETER in gaining else None,
        gyro=gyro if gyro is not None else (Linear(np.zeros(3), K_g) if GYRO_MATRIX in gaining else None),
    )
    sentences = [
        f"The log has {count_noun(rests.count, 'rest')} in {count_noun(count, 'attitude')} and "
        f"{count_noun(_count_measurable_turns(rests), 'turn')} between them, found by the spread of the "
        "samples within "
        f"{LIMITS.block:g} s.",
        *map(str, judgements),
        *_describe_unknown_terms(terms, rests),
    ]
    if ACCELEROMETER in gaining:
        sentences.append(CONVENTION)
    if gravity is None and ACCELEROMETER in gaining:
        sentences.append(
            f"Gravity is taken as {size:.4f} ± {GRAVITY_SIGMA:g} m/s², since the place is unknown: it is in "
            "σ of the scale factors of the accelerometers, which it changes all alike. --latitude says where "
            "the log is from."
        )
    return ImuCalibration(terms, judgements, tuple(sentences), calibration)


def _count_measurable_turns(rests: Rests) -> int:
    """Return how many turns show an angle."""
    angles = [np.linalg.norm((turn.rate * turn.dt[:, None]).sum(axis=0)) for turn in rests.turns]
    return sum(bool(angle > TURNED) for angle in angles)


def _find_known_terms(fit: Fit) -> Flags:
    """Return the terms (21,) that the log shows."""
    return np.asarray(fit.sigma < SHOWN * PRIOR)


def _terms(fit: Fit, known: Flags, of_gravity: float) -> tuple[Term, ...]:
    found: list[Term] = []
    degrees = np.empty(TERMS)
    degrees[:9], degrees[BIAS_G], degrees[MATRIX_G] = fit.degrees[0], fit.degrees[2], fit.degrees[1]
    spread = np.where(
        degrees > UNDEFINED, np.sqrt(degrees / np.maximum(degrees - UNDEFINED, 1e-9)), 1.0
    )  # σ of Student's t
    sigma = fit.sigma * spread
    sigma[SHAPE_A.start : SHAPE_A.start + 3] = np.hypot(sigma[SHAPE_A.start : SHAPE_A.start + 3], of_gravity)

    def add(group: str, name: str, axis: str, place: int, scale: float, unit: str) -> None:
        value = float(fit.terms[place]) * scale if known[place] else 0.0
        found.append(
            Term(
                group,
                name,
                axis,
                value,
                float(sigma[place]) * scale,
                unit,
                float(degrees[place]),
                bool(known[place]),
            )
        )

    for k, axis in enumerate(AXES):
        add(ACCELEROMETER, "bias", axis, BIAS_A.start + k, 1.0, "m/s²")
    for k, axis in enumerate(AXES):
        add(ACCELEROMETER, "scale factor", axis, SHAPE_A.start + k, 100.0, "%")
    for place, (row, column) in enumerate(ENTRIES[3:], SHAPE_A.start + 3):
        for one, other in ((row, column), (column, row)):
            add(ACCELEROMETER, "misalignment", AXES[one] + AXES[other], place, math.degrees(1.0), "°")
    for k, axis in enumerate(AXES):
        add(GYRO, "bias", axis, BIAS_G.start + k, math.degrees(1.0), "°/s")
    for k, axis in enumerate(AXES):
        add(GYRO, "scale factor", axis, MATRIX_G.start + 4 * k, 100.0, "%")
    for row in range(3):
        for column in range(3):
            if row != column:
                place = MATRIX_G.start + 3 * row + column
                add(GYRO, "misalignment", AXES[row] + AXES[column], place, math.degrees(1.0), "°")
    return tuple(found)


def _describe_unknown_terms(terms: tuple[Term, ...], rests: Rests) -> list[str]:
    """Return which terms the log does not show, and what would show them."""
    sentences = []
    for group, name, wanted in (
        (ACCELEROMETER, "bias", "rests with each axis up and down"),
        (ACCELEROMETER, "scale factor", "rests with each axis up and down"),
        (
            ACCELEROMETER,
            "misalignment",
            "rests in further attitudes between the faces, or turns between the faces",
        ),
        (GYRO, "bias", "rests"),
        (GYRO, "scale factor", "turns about this axis while it is level"),
        (GYRO, "misalignment", "turns about all three axes"),
    ):
        missing = [one.axis for one in terms if (one.group, one.name) == (group, name) and not one.is_known]
        if missing:
            sentences.append(
                f"Unknown stays the {name} of the {group}s, {', '.join(missing)}: it needs {wanted} (σ that "
                f"the {count_noun(rests.count, 'rest')} and {count_noun(len(rests.turns), 'turn')} leave "
                "is above "
                f"{100 * SHOWN:g} % of that beforehand)."
            )
    return sentences


def _judge_withheld_parts(
    rests: Rests, gravity: float, problem: Problem, folds: list[NDArray[np.int64]], known: Flags
) -> tuple[Judgement, ...]:
    """Return what each withheld part says, by the terms that the other parts give."""
    sizes: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    rates: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    angles: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    none = np.zeros(TERMS)
    for withheld in folds:
        fit, _ = solve_linear(problem.without(withheld))
        terms = np.where(known, fit.terms, 0.0)
        for before, one in ((0, none), (1, terms)):
            force = _correct_force(rests.force[withheld], one)
            sizes[before].append(np.linalg.norm(force, axis=1) - gravity)
            rates[before].append(np.linalg.norm(rests.rate[withheld] - one[BIAS_G], axis=1))
        bias_only = none.copy()
        bias_only[:12] = terms[:12]
        turns = [turn for turn in rests.turns if turn.last in withheld]
        for before, one in ((0, bias_only), (1, terms)):
            _, K_g = matrices(one)
            up = _correct_force(rests.force, one)
            up /= np.linalg.norm(up, axis=1)[:, None]
            carried = [integrate_turn(turn, K_g, one[BIAS_G]).R @ up[turn.first] for turn in turns]
            apart = [_angle(v, up[turn.last]) for v, turn in zip(carried, turns, strict=True)]
            angles[before].append(np.degrees(apart))
    rows = (
        (ACCELEROMETER, "specific force at rest minus gravity", "m/s²", sizes, 1.0),
        (GYRO_BIAS, "rate at rest", "°/s", rates, math.degrees(1.0)),
        (GYRO_MATRIX, "angle between the carried and the measured vertical", "°", angles, 1.0),
    )
    return tuple(
        judge(group, measure, unit, scale * np.concatenate(values[0]), scale * np.concatenate(values[1]))
        for group, measure, unit, values, scale in rows
    )


def _correct_force(force: FloatArray, terms: FloatArray) -> FloatArray:
    return np.asarray((force - terms[BIAS_A]) @ np.linalg.inv(matrices(terms)[0]).T)


def _angle(one: FloatArray, other: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
