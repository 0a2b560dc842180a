"""Fix check: whether the positions of a receiver move as its velocities say.

Both are of one receiver, so that their comparison needs no IMU and holds for every vehicle. Over legs of some
seconds the displacement is the integral of the velocity. A wrong unit of either violates this by a known
factor, swapped columns and reversed signs by a direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import ComplexArray, FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DEGREE, FOOT, KILOMETRE_PER_HOUR, KNOT, MILE_PER_HOUR
from lab.data.checks import limits
from lab.data.log.sensor_log import GnssLog
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap

_RADIANS = "latitude and longitude look like radians where degrees are declared"
_UNITS = {
    KILOMETRE_PER_HOUR: "the velocities look like km/h where m/s are declared",
    KNOT: "the velocities look like knots where m/s are declared",
    MILE_PER_HOUR: "the velocities look like mph where m/s are declared",
    FOOT: "the velocities look like feet per second where m/s are declared",
    0.01: "the velocities look like cm/s where m/s are declared",
    0.001: "the times look like ms where s are declared, or the velocities like mm/s where m/s are declared",
    0.1: "latitude and longitude look like 1e-6° where 1e-7° are declared",
    DEGREE: _RADIANS,
    DEGREE * np.sqrt(2): _RADIANS,
}
"""Likely cause by the ratio of displacement to velocity times time. Radians read as degrees also move the
place to the equator, where those of longitude are longer: by √2 from 45°."""
_HEIGHT_UNITS = {
    1 / FOOT: "the heights look like feet where m are declared",
    1000.0: "the heights look like mm where m are declared",
    100.0: "the heights look like cm where m are declared",
}
"""The same for heights."""
_COLUMNS = "swapped columns or reversed signs of vn_m_s, ve_m_s, lat_deg or lon_deg are likely"


class Legs(NamedTuple):
    """Displacement and integrated velocity over legs: north + i east (k,) and up (k,) [m]."""

    moved: ComplexArray
    gone: ComplexArray
    risen: FloatArray
    climbed: FloatArray


def check_fixes(name: str, gnss: GnssLog) -> None:
    """Raise if the positions of the fixes do not move as their velocities say.

    Raises
    ------
    MissionError
        Naming the likely cause: a wrong unit of velocity, position, height or time; swapped columns; a
        reversed sign.
    """
    legs = legs_of(gnss)
    if legs.moved.size < limits.LOG.fix_legs:
        return
    _check_horizontal(name, legs)
    known = np.isfinite(legs.climbed)
    if known.sum() >= limits.LOG.fix_legs:
        _check_vertical(name, legs.risen[known], legs.climbed[known])


def legs_of(gnss: GnssLog) -> Legs:
    """Return the legs of a receiver in which all intervals between its fixes are usual ones."""
    level = np.isfinite(gnss.position).all(axis=1) & np.isfinite(gnss.velocity_n[:, :2]).all(axis=1)
    time, position, velocity = gnss.time[level], gnss.position[level], gnss.velocity_n[level]
    dt = np.diff(time)
    if dt.size < limits.LOG.fix_legs:
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


def _check_horizontal(name: str, legs: Legs) -> None:
    sizes = _rms(legs.moved), _rms(legs.gone)
    if max(sizes) < limits.LOG.displacement:
        return
    coherence, factor, angle = _compared(legs.moved, legs.gone)
    what = f"{name}: the positions of the GPS "
    if coherence < limits.LOG.incoherent and min(sizes) > limits.LOG.displacement:
        # Swapped columns, or one reversed sign, mirror the direction of the velocity.
        mirrored = _compared(legs.moved, legs.gone.conj())[0]
        if mirrored > limits.LOG.coherent:
            raise MissionError(
                f"{what}do not move where its velocities point (coherence {coherence:.2f}), but do with "
                f"mirrored velocities ({mirrored:.2f}): {_COLUMNS}"
            )
    if coherence < limits.LOG.coherent:
        return
    if not limits.LOG.displacement_ratio[0] < factor < limits.LOG.displacement_ratio[1]:
        raise MissionError(
            f"{what}move {factor:.3g} times as far as its velocities say (coherence {coherence:.2f}): "
            f"{_cause(factor, _UNITS)}"
        )
    if abs(angle) > limits.LOG.rotation:
        raise MissionError(
            f"{what}move {abs(np.degrees(angle)):.0f}° beside the direction of its velocities (coherence "
            f"{coherence:.2f}): {_COLUMNS}"
        )


def _check_vertical(name: str, risen: FloatArray, climbed: FloatArray) -> None:
    if min(_rms(risen), _rms(climbed)) < limits.LOG.vertical_displacement:
        return
    coherence, factor, angle = _compared(risen.astype(complex), climbed.astype(complex))
    if coherence < limits.LOG.coherent:
        return
    if abs(angle) > limits.LOG.rotation:
        raise MissionError(
            f"{name}: the heights of the GPS rise where its velocities point down (coherence "
            f"{coherence:.2f}): vd_m_s is positive down, and looks like a velocity that is positive up"
        )
    if not limits.LOG.displacement_ratio[0] < factor < limits.LOG.displacement_ratio[1]:
        raise MissionError(
            f"{name}: the heights of the GPS change {factor:.3g} times as much as its vertical velocities "
            f"say (coherence {coherence:.2f}): {_cause(factor, _UNITS | _HEIGHT_UNITS)}"
        )


def _compared(moved: ComplexArray, gone: ComplexArray) -> tuple[float, float, float]:
    """Return coherence, ratio of sizes and mean angle [rad] of two motions."""
    cross = complex(np.vdot(gone, moved))
    power = float(np.vdot(gone, gone).real), float(np.vdot(moved, moved).real)
    if not min(power) > 0:
        return 0.0, 1.0, 0.0
    coherence = abs(cross) / float(np.sqrt(power[0] * power[1]))
    return coherence, float(np.sqrt(power[1] / power[0])), float(np.angle(cross))


def _cause(factor: float, units: dict[float, str]) -> str:
    near = min(units, key=lambda unit: abs(np.log(factor / unit)))
    if 1 / limits.LOG.displacement_unit_ratio < factor / near < limits.LOG.displacement_unit_ratio:
        return units[near]
    return "a wrong unit of position, velocity or time is likely"


def _rms(values: NDArray[np.generic]) -> float:
    return float(np.sqrt(np.mean(np.abs(np.asarray(values, dtype=complex)) ** 2)))
