"""Path check: whether positions move as the velocities beside them say.

Both are of one receiver or estimator, so that their comparison needs no IMU and holds for every vehicle. Over
legs of some seconds the displacement is the integral of the velocity. A wrong unit of either violates this by
a known factor, swapped columns and reversed signs by a direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.base.arrays import ComplexArray, FloatArray
from lab.base.parameters.units import DEGREE
from lab.data.checks import limits
from lab.data.checks.likeness import UNITS, Likeness, likeness, rms
from lab.motion.frames import ecef
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap

TURNED, UNIT, UNLIKE = "turned", "unit", "unlike"
"""What can be wrong: the direction, the size, or all of it."""
_RADIANS = "latitude and longitude look like radians where degrees are declared"
_OTHERS = {
    0.001: "the times look like ms where s are declared, or the velocities like mm/s where m/s are declared",
    1000.0: "the times look like s where ms are declared",
    0.1: "latitude and longitude look like 1e-6° where 1e-7° are declared",
    DEGREE: _RADIANS,
    DEGREE * np.sqrt(2): _RADIANS,
    2 * DEGREE: _RADIANS,
}
"""Likely cause by the ratio of displacement to velocity times time, but for the units of velocities. Radians
read as degrees also move the place to the equator, where those of longitude are longer: by √2 from 45°."""
_MIRRORED = {
    0: "the east component of velocity or position has the opposite sign",
    180: "the north component of velocity or position has the opposite sign",
    90: "its components north and east look exchanged",
    -90: "its components north and east look exchanged, and both have the opposite sign",
}
"""Likely cause by the angle to the mirrored velocity [°]."""
_LOOK = "the {} look like {} where {} are declared"
_HALF_TURN = "both components of velocity or position have the opposite sign"


class PathFound(NamedTuple):
    """A contradiction of positions and velocities.

    Attributes
    ----------
    kind : str
        `TURNED`, `UNIT` or `UNLIKE`.
    vertical : bool
        Whether it is the vertical motion, and not the horizontal one.
    like : Likeness
        How the displacements follow the velocities.
    cause : str
        The likely cause.
    """

    kind: str
    vertical: bool
    like: Likeness
    cause: str


class Legs(NamedTuple):
    """Displacement and integrated velocity over legs: north + i east (k,) and up (k,) [m]."""

    moved: ComplexArray
    gone: ComplexArray
    risen: FloatArray
    climbed: FloatArray


def path_faults(time: FloatArray, position: FloatArray, velocity_n: FloatArray) -> list[PathFound]:
    """Return how positions do not move as the velocities say, horizontally and vertically.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    position : (n, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (n, 3) array
        North, east, down; NaN where it is not measured [m/s].
    """
    legs = legs_of(time, position, velocity_n)
    if legs.moved.size < limits.LOG.fix_legs:
        return []
    found = [_horizontal(legs)]
    if found[0] is not None and found[0].kind == UNLIKE:
        swapped = legs_of(time, position[:, [1, 0, 2]], velocity_n)
        if swapped.moved.size == legs.moved.size and _horizontal(swapped) is None:
            cause = "latitude and longitude are exchanged"
            found[0] = PathFound(TURNED, False, likeness(legs.gone, legs.moved, centred=False), cause)
    known = np.isfinite(legs.climbed)
    if known.sum() >= limits.LOG.fix_legs:
        found.append(_vertical(legs.risen[known], legs.climbed[known]))
    return [one for one in found if one is not None]


def legs_of(time: FloatArray, position: FloatArray, velocity_n: FloatArray) -> Legs:
    """Return the legs in which all intervals are usual ones, as `path_faults`."""
    level = np.isfinite(position).all(axis=1) & np.isfinite(velocity_n[:, :2]).all(axis=1)
    time, position, velocity = time[level], position[level], velocity_n[level]
    dt = np.diff(time)
    if dt.size < limits.LOG.fix_legs or ecef.near_pole(position[:, 0]).any():
        nothing = np.empty(0)
        return Legs(nothing.astype(complex), nothing.astype(complex), nothing, nothing)
    usual = float(np.median(dt))
    north, east = metres_per_radian(position[:-1, 0], position[:-1, 2])
    step = np.diff(position, axis=0)
    step[:, 1] = wrap(step[:, 1])
    mean = 0.5 * (velocity[1:] + velocity[:-1]) * dt[:, None]
    leg = ((time[:-1] - time[0]) // max(limits.LOG.fix_leg, limits.LOG.fix_leg_intervals * usual)).astype(
        np.intp
    )
    _, leg = np.unique(leg, return_inverse=True)
    whole = np.bincount(leg, dt > limits.LOG.fix_gap * usual) == 0
    columns = (step[:, 0] * north, step[:, 1] * east, mean[:, 0], mean[:, 1], step[:, 2], -mean[:, 2])
    sums = [np.bincount(leg, column)[whole] for column in columns]
    return Legs(sums[0] + 1j * sums[1], sums[2] + 1j * sums[3], sums[4], sums[5])


def _horizontal(legs: Legs) -> PathFound | None:
    sizes = rms(legs.moved), rms(legs.gone)
    if max(sizes) < limits.LOG.displacement:
        return None
    like = likeness(legs.gone, legs.moved, centred=False)
    if like.coherence < limits.LOG.incoherent and min(sizes) > limits.LOG.displacement:
        # Swapped columns, or one reversed sign, mirror the direction of the velocity.
        mirrored = likeness(legs.gone.conj(), legs.moved, centred=False)
        if mirrored.coherence > limits.LOG.coherent:
            near = min(_MIRRORED, key=lambda one: abs(wrap(mirrored.angle - np.radians(one))))
            return PathFound(TURNED, False, like, _MIRRORED[near])
        return PathFound(UNLIKE, False, like, "other axes than north, east, down, or another clock")
    if like.coherence < limits.LOG.coherent:
        return None
    found = _of_size(like, vertical=False)
    if found is None and abs(like.angle) >= limits.LOG.rotation:
        reversed_ = abs(like.angle) > np.pi - limits.LOG.rotation
        found = PathFound(TURNED, False, like, _HALF_TURN if reversed_ else _MIRRORED[90])
    return found


def _vertical(risen: FloatArray, climbed: FloatArray) -> PathFound | None:
    if min(rms(risen), rms(climbed)) < limits.LOG.vertical_displacement:
        return None
    like = likeness(climbed, risen, centred=False)
    if like.coherence < limits.LOG.incoherent:
        return PathFound(UNLIKE, True, like, "another axis or clock")
    if like.coherence < limits.LOG.coherent:
        return None
    if like.correlation < 0:
        cause = "the velocity down has the opposite sign: it looks like a velocity that is positive up"
        return PathFound(TURNED, True, like, cause)
    return _of_size(like, vertical=True)


def _of_size(like: Likeness, *, vertical: bool) -> PathFound | None:
    low, high = limits.LOG.displacement_ratio
    if low < like.ratio < high:
        return None
    return PathFound(UNIT, vertical, like, _cause(like.ratio, heights=vertical))


def _cause(factor: float, *, heights: bool = False) -> str:
    """Return the likely cause of displacements that are too large or too small by a factor."""
    words: dict[float, str] = dict(_OTHERS)
    if heights and factor > 1:
        words |= {unit: _LOOK.format("heights", *names) for unit, names in UNITS["height"].items()}
    for unit, names in UNITS["speed"].items():
        words.setdefault(1 / unit, _LOOK.format("velocities", *names))
    near = min(words, key=lambda unit: abs(np.log(factor / unit)))
    is_near = abs(np.log(factor / near)) < np.log(limits.LOG.displacement_unit_ratio)
    return words[near] if is_near else "a wrong unit of position, velocity or time is likely"
