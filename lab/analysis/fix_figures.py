"""Fix figures: errors, NEES and NIS of a run at its fixes and along its path, as one compiled function.

The figures are those of `consistency`, `errors` and `path_errors`, which compute them with many temporary
arrays. For thousands of runs that takes longer than the runs. Positions must be away from the poles, where
`errors` computes in Earth-fixed axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import SINGULAR
from lab.base.arrays import FloatArray
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.truth.trajectory import Truth
from lab.navigation.kernels import compilation
from lab.navigation.kernels.compilation import allocating_kernel, entry_kernel, inline_kernel, kernel
from lab.navigation.solution import Solution
from lab.navigation.strapdown import Vector, get

Samples = NDArray[np.int64]

TURN = 2 * math.pi  # [rad]
DEGREES = 180 / math.pi  # per radian
QUANTITIES = 9
"""Errors of position, velocity and attitude."""


class TruthArrays(NamedTuple):
    """The truth at n times as arrays for the compiled function.

    Attributes
    ----------
    position : (n, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (n, 3) array
        Velocity north, east, down [m/s].
    q_nb : (n, 4) array
        Attitude, scalar first.
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    metres : (n, 2) array
        Metres to the north and to the east for each radian of latitude and longitude.
    """

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    euler: FloatArray
    metres: FloatArray

    @classmethod
    def of(cls, truth: Truth) -> TruthArrays:
        """Return the truth as contiguous arrays."""
        metres = np.stack(metres_per_radian(truth.latitude, truth.height), axis=-1)
        arrays = truth.position, truth.velocity_n, truth.q_nb, truth.euler, metres
        return cls(*(np.ascontiguousarray(values, dtype=np.float64) for values in arrays))


class FixFigures(NamedTuple):
    """The figures of a run with m used fixes and k times between them.

    Attributes
    ----------
    x : (m, states) array
        Error state after each fix.
    nees, nis : (m,) arrays
        NEES and NIS.
    error, sigma : (m, 9) arrays
        Errors east, north, up [m], [m/s], of roll, pitch, heading [°], and their σ.
    between : (k,) array
        NEES of the position between the fixes.
    rms, largest : (9,) arrays
        Root mean square and largest size of the errors along the path.
    horizontal : (l,) array
        Length of the horizontal error along the path [m].
    """

    x: FloatArray
    nees: FloatArray
    nis: FloatArray
    error: FloatArray
    sigma: FloatArray
    between: FloatArray
    rms: FloatArray
    largest: FloatArray
    horizontal: FloatArray

    @classmethod
    def empty(cls, fixes: int, between: int, states: int, path: int) -> FixFigures:
        """Return room for the figures."""
        return cls(
            np.empty((fixes, states)),
            np.empty(fixes),
            np.empty(fixes),
            np.empty((fixes, QUANTITIES)),
            np.empty((fixes, QUANTITIES)),
            np.empty(between),
            np.empty(QUANTITIES),
            np.empty(QUANTITIES),
            np.empty(path),
        )


@inline_kernel
def _wrap_angle(angle: float) -> float:
    """Return an angle brought to ±π."""
    return angle - TURN * math.floor(angle / TURN + 0.5)


@inline_kernel
def _offset(position: FloatArray, there: TruthArrays, k: int) -> Vector:
    """Return the displacement from the true position at time k, north, east, down of it [m]."""
    true, metres = there.position[k], there.metres[k]
    north = (position[0] - true[0]) * metres[0]
    return north, _wrap_angle(position[1] - true[1]) * metres[1], true[2] - position[2]


@inline_kernel
def _euler(q: FloatArray) -> Vector:
    """Return roll, pitch, yaw of a unit quaternion (Groves 2.37)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    down, right = 1 - 2 * (x * x + y * y), 2 * (y * z + w * x)
    pitch = math.atan2(2 * (w * y - x * z), math.sqrt(right * right + down * down))
    return math.atan2(right, down), pitch, math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


@inline_kernel
def _attitude_error(q: FloatArray, true: FloatArray) -> Vector:
    """Return φ of Ĉ_nb = exp(−[φ×]) C_nb [rad]."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    a, b, c, d = true[0], true[1], true[2], true[3]
    scalar = w * a + x * b + y * c + z * d
    v0, v1, v2 = (
        -w * b + x * a - y * d + z * c,
        -w * c + x * d + y * a - z * b,
        -w * d - x * c + y * b + z * a,
    )
    length = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    # The shorter of the two turns: q and −q are the same attitude.
    factor = 2 * math.atan2(length, abs(scalar)) / length if length > 1e-12 else 2.0
    factor = -factor if scalar >= 0 else factor
    return factor * v0, factor * v1, factor * v2


@kernel
def normalised_square(v: FloatArray, P: FloatArray, root: FloatArray, row: FloatArray) -> float:
    """Return vᵀ P⁻¹ v of an epoch; NaN if P is singular.

    States without variance are omitted, as in `consistency.normalised_squares`.

    Parameters
    ----------
    v : (n,) array
        Error or innovation.
    P : (n, n) array
        Its covariance.
    root, row : (n, n), (2, n) arrays
        Room for the root of P scaled to unit diagonal, the whitened error, and the scales.
    """
    white, scales = row[0], row[1]
    total, used = 0.0, 0
    for i in range(v.size):
        if not P[i, i] > 0:
            continue
        scale = 1 / math.sqrt(P[i, i])
        scales[used] = scale
        residual = v[i] * scale
        column, diagonal = 0, 1.0
        for j in range(i):
            if not P[j, j] > 0:
                continue
            entry = P[i, j] * scale * scales[column]
            for k in range(column):
                entry -= root[used, k] * root[column, k]
            entry /= root[column, column]
            root[used, column] = entry
            diagonal -= entry * entry
            residual -= entry * white[column]
            column += 1
        # Not `<`: NaN must be refused too.
        if not diagonal >= SINGULAR * SINGULAR:
            return math.nan
        root[used, used] = math.sqrt(diagonal)
        white[used] = residual / root[used, used]
        total += white[used] * white[used]
        used += 1
    return total


@inline_kernel
def _put_errors(error: FloatArray, off: Vector, faster: Vector, turn: Vector) -> None:
    """Write errors north, east, down and of the Euler angles [rad] as the nine errors of an ensemble."""
    error[0], error[1], error[2] = off[1], off[0], -off[2]
    error[3], error[4], error[5] = faster[1], faster[0], -faster[2]
    for i in range(3):
        error[6 + i] = DEGREES * _wrap_angle(turn[i])


@inline_kernel
def _put_sigma(sigma: FloatArray, euler: Vector, variance: FloatArray, covariance: FloatArray) -> None:
    """Write σ of the nine errors; `covariance` has three elements of P's attitude block."""
    for block in range(2):
        at = 3 * block
        sigma[at] = math.sqrt(variance[at + 1])
        sigma[at + 1] = math.sqrt(variance[at])
        sigma[at + 2] = math.sqrt(variance[at + 2])
    # Euler angles by the attitude error in n: roll and yaw grow by tan θ of the tilt along the heading.
    tan, cosine, sine = math.tan(euler[1]), math.cos(euler[2]), math.sin(euler[2])
    cross = 2 * sine * cosine * covariance[0]
    along = cosine * cosine * variance[6] + sine * sine * variance[7] + cross
    across = sine * sine * variance[6] + cosine * cosine * variance[7] - cross
    mixed = 2 * (cosine * covariance[1] + sine * covariance[2])
    sigma[6] = DEGREES * math.sqrt(max((1 + tan * tan) * along, 0.0))
    sigma[7] = DEGREES * math.sqrt(max(across, 0.0))
    sigma[8] = DEGREES * math.sqrt(max(variance[8] + tan * (tan * along + mixed), 0.0))


@allocating_kernel
def _at_fixes(
    solution: Solution,
    fixes: Samples,
    there: TruthArrays,
    bias: FloatArray,
    scale: FloatArray,
    further: FloatArray,
    out: FixFigures,
) -> None:
    """Write errors, σ, NEES and NIS after the used fixes."""
    states = out.x.shape[1]
    root, row = np.empty((states, states)), np.empty((2, states))
    for m in range(fixes.size):
        s = solution.fix_sample[fixes[m]]
        q, x = solution.q_nb[s], out.x[m]
        off, euler = _offset(solution.position[s], there, s), _euler(q)
        phi = _attitude_error(q, there.q_nb[s])
        x[0], x[1], x[2] = off
        x[6], x[7], x[8] = phi
        for i in range(3):
            x[3 + i] = solution.velocity_n[s, i] - there.velocity_n[s, i]
        for i in range(6):
            x[9 + i] = solution.bias[s, i] - bias[s, i]
        for i in range(scale.shape[1]):
            x[15 + i] = solution.scale[s, i] - scale[s, i]
        for i in range(further.size):
            x[states - further.size + i] = solution.further[s, i] - further[i]
        turn = euler[0] - there.euler[s, 0], euler[1] - there.euler[s, 1], euler[2] - there.euler[s, 2]
        _put_errors(out.error[m], off, get(x, 3), turn)
        _put_sigma(out.sigma[m], euler, solution.variance[s], solution.covariance[s, 1])
        f = fixes[m]
        out.nees[m] = normalised_square(x, solution.fix_covariance[f], root, row)
        out.nis[m] = normalised_square(solution.innovation[f], solution.innovation_covariance[f], root, row)


@allocating_kernel
def _write_position_nees(solution: Solution, before: Samples, there: TruthArrays, out: FixFigures) -> None:
    """Write NEES of the position at some stored samples."""
    v, P = np.empty(3), np.empty((3, 3))
    root, row = np.empty((3, 3)), np.empty((2, 3))
    for k in range(before.size):
        s = before[k]
        v[0], v[1], v[2] = _offset(solution.position[s], there, s)
        for i in range(3):
            P[i, i] = solution.variance[s, i]
        c = solution.covariance[s, 0]
        # `normalised_square` reads the lower triangle only.
        P[1, 0], P[2, 0], P[2, 1] = c[0], c[1], c[2]
        out.between[k] = normalised_square(v, P, root, row)


@allocating_kernel
def _write_path_errors(motion: FloatArray, path: TruthArrays, out: FixFigures) -> None:
    """Write rms and largest size of the errors along the path, and the length of the horizontal ones."""
    error = np.empty(QUANTITIES)
    out.rms[:] = 0.0
    out.largest[:] = 0.0
    for k in range(motion.shape[0]):
        here = motion[k]
        off, euler = _offset(here, path, k), _euler(here[6:])
        faster = (
            here[3] - path.velocity_n[k, 0],
            here[4] - path.velocity_n[k, 1],
            here[5] - path.velocity_n[k, 2],
        )
        turn = euler[0] - path.euler[k, 0], euler[1] - path.euler[k, 1], euler[2] - path.euler[k, 2]
        _put_errors(error, off, faster, turn)
        out.horizontal[k] = math.hypot(error[0], error[1])
        for i in range(QUANTITIES):
            out.rms[i] += error[i] * error[i]
            out.largest[i] = max(out.largest[i], abs(error[i]))
    for i in range(QUANTITIES):
        out.rms[i] = math.sqrt(out.rms[i] / motion.shape[0])


@entry_kernel
def _measure(
    solution: Solution,
    fixes: Samples,
    before: Samples,
    there: TruthArrays,
    bias: FloatArray,
    scale: FloatArray,
    further: FloatArray,
    motion: FloatArray,
    path: TruthArrays,
    out: FixFigures,
) -> None:
    _at_fixes(solution, fixes, there, bias, scale, further, out)
    _write_position_nees(solution, before, there, out)
    _write_path_errors(motion, path, out)


def is_ready() -> bool:
    """Return whether the function waits for no compiler: compiled here, or on the disk."""
    return compilation.is_ready(_measure)


def fix_figures(
    solution: Solution,
    before: Samples,
    there: TruthArrays,
    bias: FloatArray,
    scale: FloatArray,
    further: FloatArray,
    motion: FloatArray,
    path: TruthArrays,
) -> FixFigures:
    """Return the figures of a run, of which NEES or NIS is NaN where the covariance is singular.

    Parameters
    ----------
    solution
        The solution at some samples, among which `fix_sample` counts.
    before : (k,) array
        The samples for NEES of the position, counted likewise.
    there
        The truth at the same samples.
    bias, scale : (n, 6) arrays
        True biases [rad/s], [m/s²] and scale factors at these samples; (n, 0) for a filter without states for
        scale factors.
    further : (k,) array
        True values of the states after these, which are constants.
    motion : (l, 10) array
        Position, velocity and attitude along the path.
    path
        The truth along the path.
    """
    fixes = np.flatnonzero(solution.fix_sample >= 0)
    out = FixFigures.empty(fixes.size, before.size, solution.states, motion.shape[0])
    _measure(solution, fixes, before, there, bias, scale, further, motion, path, out)
    return out
