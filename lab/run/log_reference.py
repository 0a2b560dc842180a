"""Log reference: the reference of a log, or another solution, at the navigator's times, and differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from lab.base.arrays import FloatArray, interpolate_columns
from lab.data.log.auxiliary_data import Comparison, Reference
from lab.motion.frames.displacement import displacement, metres_per_radian
from lab.motion.frames.rotation import euler_from_quaternion, quaternion_from_euler, wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.solution import Solution

_LONGEST = 1.0
"""Longest time between two rows of a reference that is interpolated [s]."""
_LONGEST_STEP = 2.5
"""The same in usual steps, of a slow reference: one lost row makes two of them, and two lost rows three."""


def interpolate_reference(reference: Reference, time: FloatArray) -> Truth | None:
    """Return a reference at other times; None if it has no row within them.

    Positions follow a cubic curve through the rows with their velocities, or straight lines if velocities are
    unknown. Velocities follow straight lines, attitudes rotations at a constant rate. The values are NaN
    outside the time of the reference, where the reference has no values, and between rows that are far apart.

    Parameters
    ----------
    reference
        The reference, or another solution.
    time : (n,) array
        Times [s].
    """
    rows = reference.time
    step = np.diff(rows)
    after = np.clip(np.searchsorted(rows, time), 1, rows.size - 1)
    far = np.asarray(step > max(_LONGEST, _LONGEST_STEP * float(np.median(step))))
    known = (time >= rows[0]) & (time <= rows[-1])
    known &= ~far[after - 1] | (time >= rows[after])
    if not known.any():
        return None
    position = np.where(known[:, None], _positions(reference, time, after), np.nan)
    velocity = interpolate_columns(time, rows, reference.velocity_n)
    q_nb, euler = _attitudes(reference, time, after)
    velocity[~known], q_nb[~known], euler[~known] = np.nan, np.nan, np.nan
    latitude, longitude, height = position.T
    return Truth(time, latitude, wrap(longitude), height, velocity, q_nb, euler)


def _positions(reference: Reference, time: FloatArray, after: NDArray[np.intp]) -> FloatArray:
    """Return positions (n, 3); NaN if a neighbouring row is unknown."""
    given = np.asarray(np.isfinite(reference.position).all(axis=1))
    if given.sum() < 2:
        return np.full((time.size, 3), np.nan)
    rows, velocity_n = reference.time[given], reference.velocity_n[given]
    latitude, longitude, height = reference.position[given].T
    values = np.column_stack((latitude, np.unwrap(longitude), height))
    if np.isnan(velocity_n).any():
        there = interpolate_columns(time, rows, values)
    else:
        per_latitude, per_longitude = metres_per_radian(latitude, height)
        north, east, down = velocity_n.T
        slopes = np.column_stack((north / per_latitude, east / per_longitude, -down))
        from scipy.interpolate import CubicHermiteSpline  # noqa: PLC0415 - only a reference needs it

        there = np.asarray(CubicHermiteSpline(rows, values, slopes)(time))
    there[~(given[after] & given[after - 1])] = np.nan
    return there


def _attitudes(
    reference: Reference, time: FloatArray, after: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return quaternions (n, 4) and Euler angles (n, 3); NaN if a neighbouring row is unknown."""
    q_nb, euler = np.full((time.size, 4), np.nan), np.full((time.size, 3), np.nan)
    given = np.asarray(np.isfinite(reference.euler).all(axis=1))
    if given.sum() < 2:
        return q_nb, euler
    attitude = Rotation.from_quat(quaternion_from_euler(reference.euler[given]), scalar_first=True)
    rows = reference.time[given]
    between = np.asarray(given[after] & given[after - 1] & (time >= rows[0]) & (time <= rows[-1]))
    there = Slerp(rows, attitude)(time[between])
    q_nb[between] = there.as_quat(scalar_first=True)
    euler[between] = there.as_euler("ZYX")[:, ::-1]
    return q_nb, euler


def differences(other: Reference, time: FloatArray, solution: Solution) -> dict[str, FloatArray] | None:
    """Return the estimate minus another solution: position, velocity (north, east, down), Euler angles.

    Parameters
    ----------
    other
        The other solution.
    time : (n,) array
        Times of the estimate [s].
    solution
        The estimate.

    Returns
    -------
    dict or None
        ``position`` [m], ``velocity`` [m/s], ``attitude`` [rad], each (n, 3); NaN where the other solution
        has no values. None if it has no row within the times.
    """
    there = interpolate_reference(other, time)
    if there is None:
        return None
    position = -displacement(solution.position, there.position)
    attitude = wrap(euler_from_quaternion(solution.q_nb) - there.euler)
    return {
        "position": position,
        "velocity": solution.velocity_n - there.velocity_n,
        "attitude": np.asarray(attitude),
    }


def comparison_remark(other: Comparison, time: FloatArray, solution: Solution) -> str:
    """Return a sentence with the rms difference of an estimate to another solution."""
    apart = differences(other, time, solution)
    if apart is None:
        return f"{other.name} has no rows during the IMU data, so there is no comparison."
    parts = []
    if np.isfinite(apart["position"]).any():
        north, east, down = apart["position"].T
        constant = float(np.nanmean(down))
        # Heights above sea level and above the ellipsoid differ by nearly a constant.
        parts.append(
            f"position {np.hypot(_rms(north), _rms(east)):.2g} m horizontal, {_rms(down - constant):.2g} m "
            f"vertical (besides a constant offset of {abs(constant):.2g} m)"
        )
    if np.isfinite(apart["velocity"]).any():
        parts.append(f"velocity {np.sqrt(sum(_rms(column) ** 2 for column in apart['velocity'].T)):.2g} m/s")
    if np.isfinite(apart["attitude"]).any():
        roll, pitch, heading = (np.degrees(_rms(column)) for column in apart["attitude"].T)
        parts.append(f"roll {roll:.2g}°, pitch {pitch:.2g}°, heading {heading:.2g}°")
    return (
        f"Rms difference to {other.name}, which is not the truth: {'; '.join(parts) or 'nothing in common'}."
    )


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0
