"""Strapdown: from angle and velocity increments to attitude, velocity and position on the ellipsoid.

The navigation frame is north-slaved; `wander` makes the same step in a frame that works over the poles. The
step uses two-sample coning and sculling compensation, and gravity, Coriolis term and transport rate at
mid-interval. The whole state of a navigator is one vector, addressed by the named offsets below.

References
----------
P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, part 1 (attitude) and
2 (velocity and position), JGCD 21 (1998); P. D. Groves, *Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems*, 2nd ed., ch. 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from lab.base.aid_table import FURTHER
from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.ecef import NEAR_POLE
from lab.navigation.kernels.compilation import inline_kernel, kernel

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Quaternion = tuple[float, float, float, float]

LATITUDE = 0  # offsets of the numbers in the state; vectors begin there
LONGITUDE = 1  # [rad]
HEIGHT = 2  # [m]
VELOCITY = 3  # v_n
Q_NB = 6  # scalar first
GYRO_BIAS = 10  # [rad/s]
ACCEL_BIAS = 13  # [m/s²]
GYRO_SCALE = 16  # zero if the filter does not estimate it
ACCEL_SCALE = 19  # as for the gyros
# The next values do not move the navigator: errors of other sensors, zero unless they are estimated.
GPS_DRIFT = 22  # slow error of the receiver's position, north, east, down [m]
BAROMETER_BIAS = 25  # [m]
HEADING_BIAS = 26  # of the heading sensor [rad]
LEVER_ARM = 27  # error of the assumed lever arm, in b [m]
LATENCY = 30  # what the fixes are older than assumed [s]
ODOMETER_SCALE = 31
GYRO_MISALIGNMENT = 32  # parts of other axes in the output: xy, xz, yx, yz, zx, zy; zero unless estimated
ACCEL_MISALIGNMENT = 38  # as for the gyros
GYRO_DRIFT = 44  # second part of the biases, which is added to the first; zero unless estimated [rad/s]
ACCEL_DRIFT = 47  # as for the gyros [m/s²]
WIND = 50  # its speed to the north and to the east [m/s]
AIRSPEED_SCALE = 52
GYRO_G = 53  # what gyros feel of the specific force along their axes; zero unless estimated [rad/s per m/s²]
TO_DRIFT = GYRO_DRIFT - GYRO_BIAS  # from a bias to its second part, for gyros and accelerometers
AID_ERRORS = 56  # one for each of `FURTHER`: its bias or scale factor
# The following values are derived from those above in each step, and kept for the next step and the error
# model.
SINE = AID_ERRORS + len(FURTHER)  # of the latitude
COSINE = SINE + 1  # of the latitude
PREVIOUS_DTHETA = SINE + 2  # increments of the last step [rad]
PREVIOUS_DVELOCITY = SINE + 5  # [m/s]
PREVIOUS_VELOCITY = SINE + 8  # v_n at its start [m/s]
MERIDIAN = SINE + 11  # 1 / (R_M + h)
TRANSVERSE = SINE + 12  # 1 / (R_N + h)
PER_COSINE = SINE + 13  # 1 / cos L
FORCE_N = SINE + 14  # mean specific force of the last step, in n
C_NB = SINE + 17  # attitude at the start of the last step, row by row
PER_STEP = SINE + 26  # one over the length of the last step
GRAVITY = SINE + 27  # during the last step
CORRECTION = SINE + 28  # rotation vector of the corrections before the last step, in n
CORRECTED = SINE + 31  # the same since the last step
LENGTH = SINE + 34  # length of the state

MAX_LATITUDE = NEAR_POLE
"""Limit of north-slaved navigation [rad]: its rate about the vertical grows without bound towards the poles,
and its errors are no longer small where a displacement is not small compared with that to the pole."""

radii = inline_kernel(earth.radii)
gravity = inline_kernel(earth.gravity)


@inline_kernel
def get(state: FloatArray, at: int) -> Vector:
    """Read a vector from the state."""
    return state[at], state[at + 1], state[at + 2]


@inline_kernel
def put(state: FloatArray, at: int, v: Vector) -> None:
    """Write a vector into the state."""
    state[at] = v[0]
    state[at + 1] = v[1]
    state[at + 2] = v[2]


@inline_kernel
def note_correction(state: FloatArray, v: Vector) -> None:
    """Note that the attitude has been corrected by a rotation vector; see `reset_rate`."""
    put(state, CORRECTED, plus(get(state, CORRECTED), 1.0, v))


@inline_kernel
def age_correction(state: FloatArray) -> None:
    """Make the corrections since the last step those before this one."""
    put(state, CORRECTION, get(state, CORRECTED))
    put(state, CORRECTED, (0.0, 0.0, 0.0))


@inline_kernel
def reset_rate(state: FloatArray) -> Vector:
    """Return the rate at which attitude errors φ turn in the step after a correction x [rad/s].

    The error φ' that is left after the correction is that of exp(−φ') = exp(x) exp(−φ). To first order in
    φ − x, it is (I + ½ [x ×]) (φ − x), so P turns by half of the correction. Without that, a filter that
    corrects tilts by degrees relates them to the wrong heading.
    """
    half = 0.5 * state[PER_STEP]
    x = get(state, CORRECTION)
    return half * x[0], half * x[1], half * x[2]


@inline_kernel
def whole_bias(state: FloatArray, bias: int) -> Vector:
    """Return the biases of gyros or accelerometers, which begin at `bias`: the sum of both parts."""
    return (
        state[bias] + state[bias + TO_DRIFT],
        state[bias + 1] + state[bias + 1 + TO_DRIFT],
        state[bias + 2] + state[bias + 2 + TO_DRIFT],
    )


@inline_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline_kernel
def plus(a: Vector, s: float, b: Vector) -> Vector:
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inline_kernel
def rotate(C: Matrix, v: Vector) -> Vector:
    """Return C v."""
    return (
        C[0][0] * v[0] + C[0][1] * v[1] + C[0][2] * v[2],
        C[1][0] * v[0] + C[1][1] * v[1] + C[1][2] * v[2],
        C[2][0] * v[0] + C[2][1] * v[1] + C[2][2] * v[2],
    )


@inline_kernel
def matrix(q: Quaternion) -> Matrix:
    """Return the rotation matrix of a unit quaternion (Groves 2.34)."""
    w, x, y, z = q
    return (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )


@inline_kernel
def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the quaternion product p ⊗ q."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@inline_kernel
def small_rotation(v: Vector) -> Quaternion:
    """Return the quaternion of a rotation vector below 0.5 rad, by series (error below 1e-13)."""
    # s is the square of half of the angle; Horner's scheme for cos √s and for half of sin √s / √s.
    s = 0.25 * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    c = 1 - s * (1 / 2 - s * (1 / 24 - s * (1 / 720 - s * (1 / 40320 - s / 3628800))))
    f = 0.5 * (1 - s * (1 / 6 - s * (1 / 120 - s * (1 / 5040 - s * (1 / 362880 - s / 39916800)))))
    return c, f * v[0], f * v[1], f * v[2]


@inline_kernel
def rotation(v: Vector) -> Quaternion:
    """Return the quaternion of any rotation vector (Groves 2.31)."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if angle < 0.5:
        return small_rotation(v)
    f = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), f * v[0], f * v[1], f * v[2]


@inline_kernel
def unit(q: Quaternion) -> Quaternion:
    """Return a nearly unit quaternion, normalised by one Newton step."""
    f = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return f * q[0], f * q[1], f * q[2], f * q[3]


@inline_kernel
def earth_rate(sin_latitude: float, cos_latitude: float) -> Vector:
    """Return ω_ie in n [rad/s]."""
    return earth.RATE * cos_latitude, 0.0, -earth.RATE * sin_latitude


@inline_kernel
def transport_rate(velocity: Vector, per_meridian: float, per_transverse: float, tangent: float) -> Vector:
    """Return ω_en in n [rad/s], north-slaved (Groves 5.44), from 1/(R_M + h), 1/(R_N + h) and tan L."""
    east = velocity[1] * per_transverse
    return east, -velocity[0] * per_meridian, -east * tangent


@kernel
def set_position(state: FloatArray, latitude: float, longitude: float, height: float) -> None:
    """Write the position, the longitude wrapped to ±π."""
    state[LATITUDE] = latitude
    state[LONGITUDE] = longitude - 2 * math.pi * math.floor((longitude + math.pi) / (2 * math.pi))
    state[HEIGHT] = height
    state[SINE] = math.sin(latitude)
    state[COSINE] = math.cos(latitude)
    state[PER_COSINE] = 1 / state[COSINE]


@inline_kernel
def environment(state: FloatArray, height: float) -> tuple[Vector, Vector, float]:
    """Return ω_ie in n, the curvature for `transport_rate`, and gravity; store the derived values."""
    sine, cosine = state[SINE], state[COSINE]
    per_cosine = 1 / cosine
    tangent = sine * per_cosine
    radius_meridian, radius_transverse = radii(sine)
    meridian = 1 / (radius_meridian + height)
    transverse = 1 / (radius_transverse + height)
    state[MERIDIAN], state[TRANSVERSE], state[PER_COSINE] = meridian, transverse, per_cosine
    return earth_rate(sine, cosine), (meridian, transverse, tangent), gravity(sine, height)


@inline_kernel
def move(state: FloatArray, velocity: Vector, dt: float) -> None:
    """Move the position by a mean velocity; update sine and cosine of the latitude by a small rotation."""
    sine, cosine, per_cosine = state[SINE], state[COSINE], state[PER_COSINE]
    turn = velocity[0] * state[MERIDIAN] * dt
    half = 0.5 * turn * turn
    state[LATITUDE] += turn
    # To second order: turn³ / 6 is left out, 2e-20 of a sample at 100 Hz and 300 m/s.
    state[SINE] = sine + turn * cosine - half * sine
    state[COSINE] = cosine - turn * sine - half * cosine
    # 1 / cos L at mid-interval.
    per_cosine *= 1 + 0.5 * turn * sine * per_cosine
    longitude = state[LONGITUDE] + velocity[1] * state[TRANSVERSE] * dt * per_cosine
    if longitude >= math.pi:
        longitude -= 2 * math.pi
    elif longitude < -math.pi:
        longitude += 2 * math.pi
    state[LONGITUDE] = longitude
    state[HEIGHT] -= dt * velocity[2]


@inline_kernel
def corrected(state: FloatArray, measured: Vector, dt: float, bias: int, scale: int, off: int) -> Vector:
    """Return the corrected increments (I + S + M)⁻¹ (x − b dt): a sensor shows x = (I + S + M) f dt + b dt.

    This is the one place that says how output, biases, scale factors and misalignments belong together;
    `per_scale` is what its derivatives have in common. The bias is that of the output (Groves 4.16), outside
    the scale factor: with f, it shows an error of the scale factor in the same way whatever is estimated.

    Parameters
    ----------
    state
        The navigator's state vector.
    measured
        Measured increments x, of three axes.
    dt
        Length of the interval [s].
    bias, scale, off
        Where the biases b, the scale factors S and the misalignments M begin in the state. b includes the
        second part of the biases.

    Notes
    -----
    M is applied to third order: 1° leaves 5 millionths.
    """
    x, y, z = per_scale(state, scale)
    unbiased = plus(measured, -dt, whole_bias(state, bias))
    scaled = unbiased[0] * x, unbiased[1] * y, unbiased[2] * z
    # Solves f = (I + S)⁻¹ (u − M f) by iteration: each round adds one power of M.
    aligned = scaled
    for _ in range(2):
        aligned = (
            scaled[0] - x * (state[off] * aligned[1] + state[off + 1] * aligned[2]),
            scaled[1] - y * (state[off + 2] * aligned[0] + state[off + 3] * aligned[2]),
            scaled[2] - z * (state[off + 4] * aligned[0] + state[off + 5] * aligned[1]),
        )
    return aligned


@inline_kernel
def per_scale(state: FloatArray, scale: int) -> Vector:
    """Return 1 / (1 + s) of three axes: by this, `corrected` falls where a bias grows by one.

    A scale factor that is wrong by δs acts as a bias that is wrong by f δs. A misalignment that is wrong by
    δm_xy acts as a bias of x that is wrong by f_y δm_xy. Misalignments change these factors by a percent,
    which is left out.
    """
    return 1 / (1 + state[scale]), 1 / (1 + state[scale + 1]), 1 / (1 + state[scale + 2])


@inline_kernel
def without_bias(state: FloatArray, measured: Vector, dt: float, bias: int, scale: int, off: int) -> Vector:
    """Return increments as `corrected` does without scale factors and misalignments."""
    return plus(measured, -dt, get(state, bias))


@inline_kernel
def without_g(state: FloatArray, dtheta: Vector, dvelocity: Vector) -> Vector:
    """Return angle increments without what the gyros feel of the specific force along their axes.

    Parameters
    ----------
    state
        The navigator's state vector.
    dtheta, dvelocity
        Corrected increments: a gyro feels the force inside its scale factor and misalignments, as its bias.
    """
    return (
        dtheta[0] - state[GYRO_G] * dvelocity[0],
        dtheta[1] - state[GYRO_G + 1] * dvelocity[1],
        dtheta[2] - state[GYRO_G + 2] * dvelocity[2],
    )


@inline_kernel
def feeling_no_g(state: FloatArray, dtheta: Vector, dvelocity: Vector) -> Vector:
    """Return angle increments as `without_g` does for gyros that feel no specific force."""
    return dtheta


@inline_kernel
def no_scale(state: FloatArray, scale: int) -> Vector:
    """Return `per_scale` without scale factors."""
    return 1.0, 1.0, 1.0


UNSCALED: dict[Callable[..., Any], Callable[..., Any]] = {
    corrected: without_bias,
    per_scale: no_scale,
    without_g: feeling_no_g,
}
"""Kernels of a filter with 15 states in place of those above, with the same results but for rounding: a
division takes as long as seven products."""


@inline_kernel
def bias_taken(state: FloatArray, bias: int, scale: int) -> Vector:
    """Return what the biases take off the corrected rates or specific forces, b / (1 + s)."""
    b, per = whole_bias(state, bias), per_scale(state, scale)
    return b[0] * per[0], b[1] * per[1], b[2] * per[2]


@inline_kernel
def without_own_errors(
    state: FloatArray, dtheta: Vector, dvelocity: Vector, dt: float
) -> tuple[Vector, Vector]:
    """Return increments without the errors that a user declared: none here; see `user_states`."""
    return dtheta, dvelocity


@inline_kernel
def step(state: FloatArray, dtheta_measured: Vector, dvelocity_measured: Vector, dt: float) -> None:
    """Advance the navigator by one IMU sample.

    Parameters
    ----------
    state
        The navigator's state vector, changed in place.
    dtheta_measured, dvelocity_measured
        Integrals of angular rate [rad] and specific force [m/s] over the interval, in b.
    dt
        Length of the interval [s].
    """
    dtheta = corrected(state, dtheta_measured, dt, GYRO_BIAS, GYRO_SCALE, GYRO_MISALIGNMENT)
    dvelocity = corrected(state, dvelocity_measured, dt, ACCEL_BIAS, ACCEL_SCALE, ACCEL_MISALIGNMENT)
    dtheta = without_g(state, dtheta, dvelocity)
    dtheta, dvelocity = without_own_errors(state, dtheta, dvelocity, dt)
    dtheta_before = get(state, PREVIOUS_DTHETA)
    dvelocity_before = get(state, PREVIOUS_DVELOCITY)
    v = get(state, VELOCITY)
    q = (state[Q_NB], state[Q_NB + 1], state[Q_NB + 2], state[Q_NB + 3])
    C_nb = matrix(q)

    # Savage's two-sample form: the previous sample gives the curvature of this one.
    coned = plus(dtheta, 1 / 12, cross(dtheta_before, dtheta))
    turned = cross(dtheta, dvelocity)
    # 1/2 and 1/6 turn the increment back to the axes at the begin of the sample, to second order; both 1/12
    # are sculling.
    sculled = plus(plus(dvelocity, 0.5, turned), 1 / 6, cross(dtheta, turned))
    sculled = plus(sculled, 1 / 12, cross(dtheta_before, dvelocity))
    sculled = plus(sculled, 1 / 12, cross(dvelocity_before, dtheta))

    # The velocity is positive down, so the height in the middle of the sample is lower by half of its way.
    omega_ie, curvature, g = environment(state, state[HEIGHT] - 0.5 * dt * v[2])

    # Predict the velocity at mid-interval, then evaluate every rate there.
    omega_en = transport_rate(v, *curvature)
    dvelocity_n = rotate(C_nb, sculled)
    coriolis = cross(plus(omega_en, 2.0, omega_ie), v)
    v_mid = plus(plus(v, 0.5, dvelocity_n), -0.5 * dt, coriolis)
    v_mid = (v_mid[0], v_mid[1], v_mid[2] + 0.5 * dt * g)
    omega_en = transport_rate(v_mid, *curvature)
    omega_in = plus(omega_en, 1.0, omega_ie)
    # The navigation frame turns by ω_in dt during the sample: on average, by half of it.
    dvelocity_n = plus(dvelocity_n, -0.5 * dt, cross(omega_in, dvelocity_n))
    coriolis = cross(plus(omega_en, 2.0, omega_ie), v_mid)
    v_new = plus(plus(v, 1.0, dvelocity_n), -dt, coriolis)
    v_new = (v_new[0], v_new[1], v_new[2] + dt * g)

    v_mean = (0.5 * (v[0] + v_new[0]), 0.5 * (v[1] + v_new[1]), 0.5 * (v[2] + v_new[2]))
    move(state, v_mean, dt)
    # The frame turns on the left of q_nb, the body on the right; `unit` stops rounding errors from growing.
    frame = small_rotation((-dt * omega_in[0], -dt * omega_in[1], -dt * omega_in[2]))
    q = unit(product(frame, product(q, rotation(coned))))
    put(state, Q_NB, (q[0], q[1], q[2]))
    state[Q_NB + 3] = q[3]
    put(state, VELOCITY, v_new)

    put(state, PREVIOUS_VELOCITY, v)
    # Without coning and sculling, which the next step computes from these.
    put(state, PREVIOUS_DTHETA, dtheta)
    put(state, PREVIOUS_DVELOCITY, dvelocity)
    age_correction(state)
    per_dt = 1 / dt
    state[PER_STEP], state[GRAVITY] = per_dt, g
    put(state, FORCE_N, (dvelocity_n[0] * per_dt, dvelocity_n[1] * per_dt, dvelocity_n[2] * per_dt))
    put(state, C_NB, C_nb[0])
    put(state, C_NB + 3, C_nb[1])
    put(state, C_NB + 6, C_nb[2])
