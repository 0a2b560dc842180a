"""Wander: the strapdown in a wander-azimuth frame, which works over the poles.

The frame w is horizontal and initially aligned with north, east, down. Relative to the Earth, it does not
rotate about the vertical, ω_ew,z = 0, so that no tan L appears. The position is the quaternion q_ew and the
height. The transport rate follows from the curvature of the ellipsoid, written without longitude or north,

    ω_ew = (u_y, −u_x, 0),   u = K v,   K = t I + k c cᵀ,   k = R_M e² / (1 − e²) · m t

with m = 1/(R_M + h), t = 1/(R_N + h) and c the horizontal part of the Earth's axis in w, of length cos L:
along it, K is m, across it t; K is smooth over the pole.

The step is that of `strapdown`, with the kernels below instead of its own. A navigator has the same state,
with w instead of n, followed by the values named here. Latitude and longitude are not stored: they are
computed from q_ew when needed. Corrections, and the difference to a fix, are in the computer frame, as for
the error model `psi`: true matrices and vectors resolved in the computed w.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 5.3;
P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, part 2, JGCD 21 (1998); D. O.
Benson, *A comparison of two approaches to pure-inertial and Doppler-inertial error analysis*, IEEE Trans. AES
11 (1975).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.navigation import strapdown
from lab.navigation.kernels.compilation import allocating_kernel, embedded_kernel, inline_kernel, kernel
from lab.navigation.strapdown import (
    HEIGHT,
    MERIDIAN,
    PREVIOUS_VELOCITY,
    Q_NB,
    SINE,
    TRANSVERSE,
    VELOCITY,
    Matrix,
    Quaternion,
    Vector,
    get,
    gravity,
    matrix,
    note_correction,
    product,
    put,
    radii,
    rotate,
    rotation,
    unit,
)

if TYPE_CHECKING:
    from lab.navigation.solution import Solution


Q_EW = strapdown.LENGTH  # position, scalar first
AXIS = Q_EW + 4  # the Earth's axis in w: cos L in the direction of north, and −sin L
BEND = AXIS + 3  # k of the curvature K
FIX_AXES = BEND + 1  # north, east and down of the last fix, in w
LEAST_SINE = FIX_AXES + 9  # of the latitude, without sign, at which the navigator stays in this frame
LENGTH = LEAST_SINE + 1
"""Length of the state."""

_SECOND_SQUARED = earth.ECCENTRICITY_SQUARED / (1 - earth.ECCENTRICITY_SQUARED)
"""Square of the second eccentricity: R_N − R_M = R_M e'² cos² L."""
_AT_POLE = 1e-15
"""cos L below which the frame's x replaces north: 6 nm from the pole."""


@inline_kernel
def quaternion(state: FloatArray, at: int) -> Quaternion:
    """Read a quaternion from the state."""
    return state[at], state[at + 1], state[at + 2], state[at + 3]


@inline_kernel
def put_quaternion(state: FloatArray, at: int, q: Quaternion) -> None:
    """Write a quaternion into the state."""
    state[at] = q[0]
    put(state, at + 1, (q[1], q[2], q[3]))


@inline_kernel
def _keep_axis(state: FloatArray) -> None:
    """Write the Earth's axis and the sine of the latitude from the position."""
    w, x, y, z = quaternion(state, Q_EW)
    # The third row of C_ew: the Earth's axis, resolved in w.
    state[AXIS] = 2 * (x * z - w * y)
    state[AXIS + 1] = 2 * (y * z + w * x)
    state[AXIS + 2] = 1 - 2 * (x * x + y * y)
    state[SINE] = -state[AXIS + 2]


@kernel
def place(state: FloatArray, latitude: float, longitude: float, height: float) -> None:
    """Write the position, with w aligned with north, east, down there."""
    # C_en = R_z(longitude) R_y(−latitude − 90°): half angles, as quaternions have them.
    turn, tilt = 0.5 * longitude, -0.5 * (latitude + 0.5 * math.pi)
    about_axis = (math.cos(turn), 0.0, 0.0, math.sin(turn))
    put_quaternion(state, Q_EW, product(about_axis, (math.cos(tilt), 0.0, math.sin(tilt), 0.0)))
    state[HEIGHT] = height
    _keep_axis(state)


@inline_kernel
def environment(state: FloatArray, height: float) -> tuple[Vector, tuple[float, float, float, float], float]:
    """Return ω_ie in w, the curvature for `transport_rate`, and gravity; store the curvature."""
    sine = state[SINE]
    axis = get(state, AXIS)
    radius_meridian, radius_transverse = radii(sine)
    m = 1 / (radius_meridian + height)
    t = 1 / (radius_transverse + height)
    k = radius_meridian * _SECOND_SQUARED * m * t
    state[MERIDIAN], state[TRANSVERSE], state[BEND] = m, t, k
    omega_ie = earth.RATE * axis[0], earth.RATE * axis[1], earth.RATE * axis[2]
    return omega_ie, (t, k, axis[0], axis[1]), gravity(sine, height)


@inline_kernel
def transport_rate(velocity: Vector, t: float, k: float, c_x: float, c_y: float) -> Vector:
    """Return ω_ew in w [rad/s]: the horizontal rate from K v, zero about the vertical."""
    along = k * (c_x * velocity[0] + c_y * velocity[1])
    return t * velocity[1] + along * c_y, -t * velocity[0] - along * c_x, 0.0


@inline_kernel
def turn_of(state: FloatArray, displacement: Vector) -> Vector:
    """Return the rotation of the frame along a displacement in w [rad]."""
    return transport_rate(displacement, state[TRANSVERSE], state[BEND], state[AXIS], state[AXIS + 1])


@inline_kernel
def move(state: FloatArray, velocity: Vector, dt: float) -> None:
    """Move the position by a mean velocity."""
    x, y, _ = turn_of(state, velocity)
    # Quaternion of the turn, without its third order, below 10⁻¹⁸: a step turns the frame by microradians.
    a, b = 0.5 * dt * x, 0.5 * dt * y
    c = 1 - 0.5 * (a * a + b * b)
    # The product q_ew ⊗ (c, a, b, 0), written out: this frame turns about level axes alone.
    q_w, q_x, q_y, q_z = quaternion(state, Q_EW)
    q = (
        c * q_w - a * q_x - b * q_y,
        c * q_x + a * q_w - b * q_z,
        c * q_y + b * q_w + a * q_z,
        c * q_z + b * q_x - a * q_y,
    )
    put_quaternion(state, Q_EW, unit(q))
    state[HEIGHT] -= dt * velocity[2]
    _keep_axis(state)


STEP: dict[Callable[..., Any], Callable[..., Any]] = {
    strapdown.environment: environment,
    strapdown.transport_rate: transport_rate,
    strapdown.move: move,
}
"""The kernels above in place of those of `strapdown.step`."""


@inline_kernel
def leaves_frame(state: FloatArray) -> bool:
    """Return whether the navigator is so far from the poles that it goes on in the north-slaved frame."""
    return bool(abs(state[SINE]) < state[LEAST_SINE])


@inline_kernel
def north(state: FloatArray) -> tuple[float, float, float]:
    """Return the horizontal unit vector to the north, x and y, and cos L."""
    x, y = state[AXIS], state[AXIS + 1]
    cosine = math.sqrt(x * x + y * y)
    if cosine < _AT_POLE:
        return 1.0, 0.0, _AT_POLE
    return x / cosine, y / cosine, cosine


@inline_kernel
def heading_turn(x: float, y: float) -> Quaternion:
    """Return q_nw, where north is the horizontal unit vector (x, y) of w."""
    # Half angles from sine and cosine of the angle, by the one of both that is not small.
    if x > 0:
        cosine = math.sqrt(0.5 * (1 + x))
        return cosine, 0.0, 0.0, -0.5 * y / cosine
    sine = math.copysign(math.sqrt(0.5 * (1 - x)), y)
    return 0.5 * y / sine, 0.0, 0.0, -sine


@inline_kernel
def north_axes(state: FloatArray) -> Matrix:
    """Return north, east and down at the navigator, in w."""
    x, y, _ = north(state)
    return (x, y, 0.0), (-y, x, 0.0), (0.0, 0.0, 1.0)


@inline_kernel
def north_axes_before(state: FloatArray, age: float) -> Matrix:
    """Return north, east and down where the navigator was `age` seconds ago, in w.

    At 100 m/s and 100 m from a pole, north turns by 0.6° in 10 ms.
    """
    v = get(state, VELOCITY)
    turn = turn_of(state, (-age * v[0], -age * v[1], 0.0))
    # What is fixed to the Earth turns against the frame: c − θ × c.
    x, y = state[AXIS] - turn[1] * state[AXIS + 2], state[AXIS + 1] + turn[0] * state[AXIS + 2]
    cosine = max(math.sqrt(x * x + y * y), _AT_POLE)
    x, y = x / cosine, y / cosine
    return (x, y, 0.0), (-y, x, 0.0), (0.0, 0.0, 1.0)


@inline_kernel
def north_variance(state: FloatArray, variance: float) -> float:
    """Return the variance of north from the curvature of the meridians [rad²].

    North at a distance d from the pole turns by 1/d with a displacement across, and to second order by 1/d²
    times the product of one along and one across. With the variance σ² of the position along each axis, that
    is (σ/d)⁴ (second-order filter: Bar-Shalom, Li & Kirubarajan 10.3.3): a heading says nothing where the
    pole is closer than the position is known.

    Parameters
    ----------
    state
        The navigator.
    variance
        Variance of its position along each horizontal axis [m²].
    """
    x, y = max(abs(state[AXIS]), _AT_POLE), state[AXIS + 1]
    bend = variance * state[MERIDIAN] * state[MERIDIAN] / (x * x + y * y)
    return float(bend * bend)


@embedded_kernel
def store_state(out: Solution, k: int, state: FloatArray) -> None:
    """Write position, velocity and attitude of sample k, in north, east, down."""
    C_ew = matrix(quaternion(state, Q_EW))
    x, y, cosine = north(state)
    out.position[k, 0] = math.atan2(state[SINE], cosine)
    # The third column of C_ew is down, so up has the opposite signs.
    out.position[k, 1] = math.atan2(-C_ew[1][2], -C_ew[0][2])
    out.position[k, 2] = state[HEIGHT]
    v_x, v_y, v_z = get(state, VELOCITY)
    out.velocity_n[k, 0] = x * v_x + y * v_y
    out.velocity_n[k, 1] = x * v_y - y * v_x
    out.velocity_n[k, 2] = v_z
    q_nb = product(heading_turn(x, y), quaternion(state, Q_NB))
    for i in range(4):
        out.q_nb[k, i] = q_nb[i]


@inline_kernel
def _minus(state: FloatArray, at: int, C: Matrix, error: Vector) -> None:
    """Subtract an error from a vector, and rotate the difference by C."""
    x, y, z = get(state, at)
    put(state, at, rotate(C, (x - error[0], y - error[1], z - error[2])))


@kernel
def displace(state: FloatArray, x: FloatArray) -> None:
    """Correct position, velocity and attitude by an error x, with exact rotations.

    C_wb = exp([δθ×]) exp([ψ×]) Ĉ_wb, v = exp([δθ×]) (v̂ − δv_c) and C_ew = Ĉ_ew exp(−[δθ×]), with δθ the
    rotation of the frame along the position error.
    """
    turn = turn_of(state, get(x, 0))
    q = rotation(turn)
    C = matrix(q)
    _minus(state, VELOCITY, C, get(x, 3))
    _minus(state, PREVIOUS_VELOCITY, C, get(x, 3))
    put_quaternion(state, Q_NB, product(q, product(rotation(get(x, 6)), quaternion(state, Q_NB))))
    note_correction(state, get(x, 6))
    put_quaternion(state, Q_EW, product(quaternion(state, Q_EW), (q[0], -q[1], -q[2], -q[3])))
    state[HEIGHT] += x[2]
    _keep_axis(state)


@inline_kernel
def back(C: Matrix, v: Vector) -> Vector:
    """Return Cᵀ v."""
    return (
        C[0][0] * v[0] + C[1][0] * v[1] + C[2][0] * v[2],
        C[0][1] * v[0] + C[1][1] * v[1] + C[2][1] * v[2],
        C[0][2] * v[0] + C[1][2] * v[1] + C[2][2] * v[2],
    )


@inline_kernel
def displacement_from(state: FloatArray, up: Vector, height: float) -> Vector:
    """Return the displacement to the navigator [m] from a point with a height and the vertical `up`, in w.

    The verticals differ by K times the displacement; K⁻¹ = (I − k/m c cᵀ) / t.
    """
    t, c_x, c_y = state[TRANSVERSE], state[AXIS], state[AXIS + 1]
    along = state[BEND] / state[MERIDIAN] * (c_x * up[0] + c_y * up[1])
    return (along * c_x - up[0]) / t, (along * c_y - up[1]) / t, height - state[HEIGHT]


@kernel
def difference(
    state: FloatArray, age: float, fraction: float, position: FloatArray, velocity: FloatArray, z: FloatArray
) -> None:
    """Write navigator minus fix, the navigator interpolated to `age` seconds (`fraction` of a step) ago.

    The components are along north, east and down of the fix, the axes of its velocity, which are stored in
    `FIX_AXES`.
    """
    s, c = math.sin(position[0]), math.cos(position[0])
    sl, cl = math.sin(position[1]), math.cos(position[1])
    C_ew = matrix(quaternion(state, Q_EW))
    put(state, FIX_AXES, back(C_ew, (-s * cl, -s * sl, c)))
    put(state, FIX_AXES + 3, back(C_ew, (-sl, cl, 0.0)))
    down = back(C_ew, (-c * cl, -c * sl, -s))
    put(state, FIX_AXES + 6, down)
    offset = displacement_from(state, (-down[0], -down[1], -down[2]), position[2])
    v, before = get(state, VELOCITY), get(state, PREVIOUS_VELOCITY)
    for i in range(3):
        axis = get(state, FIX_AXES + 3 * i)
        z[i], z[3 + i] = 0.0, -velocity[i]
        for j in range(3):
            z[i] += axis[j] * (offset[j] - 0.5 * age * (v[j] + before[j]))
            z[3 + i] += axis[j] * (v[j] - fraction * (v[j] - before[j]))


@allocating_kernel
def move_to(state: FloatArray, position: FloatArray) -> None:
    """Move the frame to a latitude, longitude and height nearby; velocity and attitude turn with it."""
    s, c = math.sin(position[0]), math.cos(position[0])
    up = c * math.cos(position[1]), c * math.sin(position[1]), s
    error = np.zeros(9)
    put(error, 0, displacement_from(state, back(matrix(quaternion(state, Q_EW)), up), position[2]))
    displace(state, error)


@inline_kernel
def frame_rate(state: FloatArray) -> Vector:
    """Return the Earth's rate in w."""
    x, y, z = get(state, AXIS)
    return earth.RATE * x, earth.RATE * y, earth.RATE * z


@inline_kernel
def fix_axes(state: FloatArray) -> Matrix:
    """Return north, east and down of the last fix, in w."""
    return get(state, FIX_AXES), get(state, FIX_AXES + 3), get(state, FIX_AXES + 6)


@kernel
def to_fix(state: FloatArray, T: FloatArray) -> None:
    """Rotate the rows of T from w to the axes of the last fix."""
    for j in range(9):
        for row in range(0, 9, 3):
            x, y, z = T[row, j], T[row + 1, j], T[row + 2, j]
            for i in range(3):
                a, b, c = get(state, FIX_AXES + 3 * i)
                T[row + i, j] = a * x + b * y + c * z


@kernel
def to_north(state: FloatArray, T: FloatArray) -> None:
    """Rotate the rows of T from w to n, and convert computer-frame errors to the output errors of a filter.

    δr, δv = δv_c + v × δθ and φ = ψ + δθ, with the rotation δθ of the north-slaved frame along δr. Close to a
    pole, the errors of heading and of the velocity components grow as tan L.
    """
    x, y, cosine = north(state)
    m, t, tangent = state[MERIDIAN], state[TRANSVERSE], state[SINE] / cosine
    v_x, v_y, v_d = get(state, VELOCITY)
    v_n, v_e = x * v_x + y * v_y, x * v_y - y * v_x
    for j in range(9):
        for row in range(0, 9, 3):
            # The position is among these rows: δθ below is made of its components north and east.
            a, b = T[row, j], T[row + 1, j]
            T[row, j], T[row + 1, j] = x * a + y * b, x * b - y * a
        turn_n, turn_e, turn_d = t * T[1, j], -m * T[0, j], -tangent * t * T[1, j]
        T[3, j] += v_e * turn_d - v_d * turn_e
        T[4, j] += v_d * turn_n - v_n * turn_d
        T[5, j] += v_n * turn_e - v_e * turn_n
        T[6, j] += turn_n
        T[7, j] += turn_e
        T[8, j] += turn_d
