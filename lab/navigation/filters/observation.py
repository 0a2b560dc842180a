"""Observation: how a filter sees a fix, and the rates at rest, and what they make of [P | x]."""

from __future__ import annotations

import math

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.aids import (
    AIRSPEED,
    FORWARD,
    HEADING,
    LEAST_LEVEL,
    MAGNETIC,
    STILL_AIR,
    WIND,
    azimuth_variance,
    predict_aid,
)
from lab.navigation.filters.blocks import NO_STATE
from lab.navigation.filters.correction import has_estimate, write_corrected_state
from lab.navigation.filters.error_models import ErrorModel, write_fix_map, write_map
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.held_heading import (
    in_body,
    keeps_heading,
    own_attitude,
    own_attitude_in_body,
    restore_heading,
)
from lab.navigation.filters.kalman import (
    EVERY,
    MEASUREMENTS,
    RECOVERED,
    REJECTED,
    USED,
    gate_fix,
    normalised_square,
    predict_fix,
    scalar_update,
    update,
    weight,
)
from lab.navigation.filters.north_slaved import fix_axes, frame_rate, north_axes, north_variance
from lab.navigation.filters.schedule import Schedule
from lab.navigation.filters.vertical_bias import raise_vertical_bias
from lab.navigation.kernels import own_room
from lab.navigation.kernels.compilation import allocating_kernel, embedded_kernel, inline_kernel, kernel
from lab.navigation.kernels.generation import Kernel
from lab.navigation.kernels.propagation import (
    NAV,
    OWN,
    OWN_SIZE,
    PLACES,
    SCALES,
    STATES,
    WIDTH,
    X,
)
from lab.navigation.lever_arm import predict_antenna
from lab.navigation.solution import Solution
from lab.navigation.standstill import GATE, predict_rest
from lab.navigation.strapdown import VELOCITY, Matrix, Vector, get, rotate

GPS_DRIFT = GYRO_DRIFT = GYRO_G_SENSITIVITY = GYRO_MISALIGNMENT = LATENCY = LEVER_ARM = NO_STATE
"""First states of the blocks with these names (`propagation.layout_constants`)."""


@inline_kernel
def through_map(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
    """Transform H of the errors to H of the model's own errors; for `phi`, they are the same."""


@allocating_kernel
def through_fix_map(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
    """Transform H of the errors along the axes of the fix to H of the model's own errors."""
    write_fix_map(state, T)
    row = np.empty(NAV)
    for i in range(MEASUREMENTS):
        for c in range(NAV):
            row[c] = H[i, c]
        for c in range(NAV):
            H[i, c] = 0.0
            for d in range(NAV):
                H[i, c] += row[d] * T[d, c]


@kernel
def see_latency(state: FloatArray, axes: Matrix, at: int, z: FloatArray, H: FloatArray) -> None:
    """Move the navigator back by the estimated error of the latency, to first order, and write H.

    Parameters
    ----------
    state
        The navigator.
    axes
        North, east and down of the fix in the navigation frame.
    at
        The state of the latency.
    z : (6,) array
        Navigator minus fix, changed in place.
    H : (6, n) array
        Receives the column of the latency: −v and −v̇.
    """
    v, before = get(state, VELOCITY), get(state, strapdown.PREVIOUS_VELOCITY)
    late, per_dt = state[strapdown.LATENCY], state[strapdown.PER_STEP]
    velocity = rotate(axes, v)
    acceleration = rotate(
        axes, ((v[0] - before[0]) * per_dt, (v[1] - before[1]) * per_dt, (v[2] - before[2]) * per_dt)
    )
    for i in range(3):
        z[i] -= late * velocity[i]
        z[3 + i] -= late * acceleration[i]
        H[i, at], H[3 + i, at] = -velocity[i], -acceleration[i]


@inline_kernel
def felt_by_gyro(state: FloatArray, axis: int) -> float:
    """Return how much more than a bias the g-sensitivity of an axis acts: the force, inside the scale."""
    force = state[strapdown.PREVIOUS_DVELOCITY + axis] * state[strapdown.PER_STEP]
    return float((1 + state[strapdown.GYRO_SCALE + axis]) * force)


@kernel
def copy_bias_elements(state: FloatArray, H: FloatArray) -> None:
    """Write the elements of a row of H for states that act as gyro biases do, from those of the biases."""
    if GYRO_DRIFT >= 0:
        for i in range(3):
            H[GYRO_DRIFT + i] = H[NAV + i]
    if GYRO_G_SENSITIVITY >= 0:
        for i in range(3):
            H[GYRO_G_SENSITIVITY + i] = H[NAV + i] * felt_by_gyro(state, i)
    for k in range(OWN_SIZE):
        H[OWN + k] = 0.0
        for i in range(3):  # they are taken off behind the scale factors, the biases before them
            effect = state[own_room.EFFECTS + own_room.WIDTH * k + i]
            H[OWN + k] += H[NAV + i] * (1 + state[strapdown.GYRO_SCALE + i]) * effect


@embedded_kernel
def linearise_fix(run: Filter, m: int, age: float, z: FloatArray, out: Solution) -> None:
    """Write H and R of fix m, which is `age` seconds old, and move z from the IMU to the antenna."""
    state, H, R, arm, noise = run.state, run.H, run.R_fix, run.lever_arm, run.noise
    assumed, turn = run.R[min(m, run.R.shape[0] - 1)], run.turns[min(m, run.turns.shape[0] - 1)]
    seen = out.fix_H[m]
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            R[i, j] = assumed[i, j]
        for j in range(STATES):
            # Position and velocity are seen as they are; the lever arm and further states are added below.
            H[i, j] = 1.0 if i == j else 0.0
    axes = fix_axes(state)
    predict_antenna(
        state,
        arm,
        turn,
        age,
        noise,
        axes,
        z,
        H,
        R,
        SCALES > 0,
        LEVER_ARM,
        GYRO_MISALIGNMENT,
    )
    if LATENCY >= 0:
        see_latency(state, axes, LATENCY, z, H)
    if GPS_DRIFT >= 0:
        for i in range(3):
            z[i] += state[strapdown.GPS_DRIFT + i]
            H[i, GPS_DRIFT + i] = 1.0
    for i in range(MEASUREMENTS):
        copy_bias_elements(state, H[i])
        for k in range(OWN_SIZE):  # the rate about the fix is one as measured
            z[i] += H[i, OWN + k] * state[PLACES[OWN - NAV + k]]
        if GYRO_G_SENSITIVITY >= 0:
            for k in range(3):
                z[i] += H[i, GYRO_G_SENSITIVITY + k] * state[strapdown.GYRO_G + k]
        for j in range(STATES):
            seen[i, j] = H[i, j]


@kernel
def bound_vertical_bias(state: FloatArray, P: FloatArray) -> None:
    """Keep σ of the vertical accelerometer bias above what the square of the tilt adds to it."""
    vertical = (0.0, 0.0, 1.0)
    raise_vertical_bias(P, own_attitude(state, vertical), in_body(state, vertical))


@embedded_kernel
def observe(
    run: Filter, m: int, age: float, time: float, schedule: Schedule, z: FloatArray, out: Solution
) -> int:
    """Update [P | x] with fix m, `age` seconds before the sample at `time`; return its outcome.

    z is navigator minus fix, without the lever arm.
    """
    linearise_fix(run, m, age, z, out)
    state, w, P, T, H, R = run.state, run.w, run.P, run.T, run.H, run.R_fix
    nu, S, used = out.innovation[m], out.innovation_covariance[m], out.fix_R[m]
    streak, clock, raised = run.streak, run.clock, run.S
    scalars = run.scalars[min(m, run.scalars.shape[0] - 1)]
    # `linearise_fix` has stored H of the plain errors; from here on, it is that of the model's own ones.
    through_map(state, T, H)
    for i in range(MEASUREMENTS):
        nu[i] = z[i]
        for j in range(STATES):
            nu[i] -= H[i, j] * w[WIDTH * j + X]
    predict_fix(P, H, R, S)
    nis = normalised_square(nu, S)
    became = gate_fix(P, streak, clock, nu, S, nis, time, schedule, STATES)
    if became == REJECTED:
        return REJECTED
    if schedule.robust != EVERY:
        if became == RECOVERED:
            # P was raised, so the weight needs a new S; the stored one remains that of the gate.
            predict_fix(P, H, R, raised)
            nis = normalised_square(nu, raised)
        per_weight = 1 / weight(schedule.robust, nis)
        for i in range(MEASUREMENTS):
            for j in range(MEASUREMENTS):
                R[i, j] *= per_weight
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            used[i, j] = R[i, j]
    may_hold = schedule.hold_heading and became == USED
    held = may_hold and keeps_heading(state, P, H, S, MEASUREMENTS, run.directions, run.kept)
    update(w, z, H, R, scalars)
    if held:
        restore_heading(P, run.directions, run.kept)
        for i in range(3):
            out.fix_held[m, i] = run.directions[1, NAV + i]
    bound_vertical_bias(state, P)
    return became


@embedded_kernel
def observe_rest(run: Filter) -> bool:
    """Update [P | x] with the mean rate about the vertical at rest; return False if the vehicle turns."""
    state, w, done = run.state, run.w, run.rest_scalars[0]
    H = run.z  # a row for six states
    z = predict_rest(state, frame_rate(state), run.noise, run.rest_sums, H)
    for c in range(STATES):
        done[c] = 0.0
    seen = own_attitude(state, (H[0], H[1], H[2]))
    for i in range(3):
        done[6 + i] = seen[i]
        done[NAV + i] = H[3 + i]
    copy_bias_elements(state, done)
    residual, s = z, 1.0
    # A rate at rest shows no position and no velocity.
    for i in range(6, STATES):
        if done[i] != 0:
            residual -= done[i] * w[WIDTH * i + X]
            for j in range(6, STATES):
                s += done[i] * done[j] * w[WIDTH * i + j]
    if residual * residual > GATE * s:
        return False
    scalar_update(w, z, done)
    return True


@inline_kernel
def user_row(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
    """Transform a row of H of the errors to one of the model's own errors; for `phi`, they are the same."""


@allocating_kernel
def through_own_map(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
    """Transform a row of H of the errors to one of the model's own errors."""
    write_map(state, T)
    row = np.empty(NAV)
    for c in range(NAV):
        row[c] = H[c]
    for c in range(NAV):
        H[c] = 0.0
        for d in range(NAV):
            H[c] += row[d] * T[d, c]


@inline_kernel
def variance_across(state: FloatArray, axis: Vector, P: FloatArray) -> float:
    """Return the variance of the attitude about the two directions across an axis in n, together [rad²]."""
    own = own_attitude(state, axis)
    per_square = 1 / (axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    # The trace of P less its part along the axis.
    across = 0.0
    for i in range(3):
        across += P[6 + i, 6 + i]
        for j in range(3):
            across -= own[i] * own[j] * P[6 + i, 6 + j] * per_square
    return across


@inline_kernel
def seen_azimuth_variance(state: FloatArray, kind: int, field: FloatArray, P: FloatArray) -> float:
    """Return the variance of a measured azimuth from the products of tilts [rad²]; 0 for other kinds.

    The azimuth is that of the axis forward, or of the magnetic field. The variance is infinite for an axis
    forward that is steeper than `LEAST_LEVEL` allows.
    """
    if kind not in (HEADING, MAGNETIC):
        return 0.0
    at = strapdown.Q_NB
    C = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    axis = (C[0][0], C[1][0], C[2][0]) if kind == HEADING else rotate(C, get(field, 0))
    # It is (σ of the tip / level part)⁴ with σ² = p d² / 2, so `LEAST_LEVEL` bounds it by its power of −4.
    variance = azimuth_variance(axis, variance_across(state, (0.0, 0.0, 1.0), P))
    return variance if kind == MAGNETIC or variance < LEAST_LEVEL**-4 else math.inf


@kernel
def bent_speed(state: FloatArray, P: FloatArray) -> float:
    """Return how much larger a speed forward appears on average, because the attitude is uncertain [m/s].

    With an angle α between the estimated and the true forward axis, the speed v appears as v cos α. The mean
    of v (1 − cos α) is half of v times the variance p of the attitude across that axis, and its variance is
    at most 2 (v p / 2)² (second-order filter: Bar-Shalom, Li & Kirubarajan 10.3.3). This matters for a
    heading that is uncertain by degrees.
    """
    at = strapdown.Q_NB
    C = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    forward = C[0][0], C[1][0], C[2][0]
    v = get(state, VELOCITY)
    speed = forward[0] * v[0] + forward[1] * v[1] + forward[2] * v[2]
    return 0.5 * speed * variance_across(state, forward, P)


@inline_kernel
def bent_airspeed(state: FloatArray, v: Vector, P: FloatArray) -> float:
    """Return how much larger an airspeed is on average, because the wind is uncertain [m/s].

    A wind across the path adds to the airspeed V whatever its sign: half of its variance over V, with the
    variance of `bent_speed`. This matters for a slow aeroplane in an unknown wind. The velocity v is along
    north, east and down.
    """
    north, east = v[0] - state[strapdown.WIND], v[1] - state[strapdown.WIND + 1]
    square = north * north + east * east
    if WIND < 0 or square < STILL_AIR:
        return 0.0
    cross = P[WIND, WIND + 1] + P[WIND + 1, WIND]
    across = east * east * P[WIND, WIND] + north * north * P[WIND + 1, WIND + 1] - north * east * cross
    return float(0.5 * across / (square * math.sqrt(square + v[2] * v[2])))


@inline_kernel
def mean_speed_excess(state: FloatArray, axes: Matrix, kind: int, P: FloatArray) -> float:
    """Return how much larger a speed is on average than that of the estimates [m/s]; 0 for other kinds."""
    if kind == FORWARD:
        return bent_speed(state, P)
    if kind == AIRSPEED:
        return bent_airspeed(state, rotate(axes, get(state, VELOCITY)), P)
    return 0.0


@kernel
def position_variance(T: FloatArray, P: FloatArray) -> float:
    """Return the mean variance of the position along the horizontal axes [m²]; T must be that of now."""
    total = 0.0
    for row in range(2):
        for i in range(NAV):
            for j in range(NAV):
                total += T[row, i] * T[row, j] * P[i, j]
    return 0.5 * total


@kernel
def observe_aid(run: Filter, a: int, age: float, dt: float, schedule: Schedule, out: Solution) -> bool:
    """Update [P | x] with measurement a of the aids, `age` seconds old; return whether it was used.

    It is linearised about the navigator with the estimated error removed: one that runs free is soon wrong by
    more than its σ, and speeds and azimuths are not linear over such a distance.
    """
    w, T, aids = run.w, run.T, run.aids
    state = write_corrected_state(run.state, w, T, run.x, run.spare) if has_estimate(w) else run.state
    done = run.aid_scalars[min(a, run.aid_scalars.shape[0] - 1), 0]
    seen, gains = out.aid_H[a], out.aid_gain[a]
    axes = north_axes(state, age)
    kind, value, field = aids.kind[a], aids.value[a], aids.field[a]
    of_tilts = seen_azimuth_variance(state, kind, field, run.P)
    if of_tilts == math.inf:
        return False
    residual = predict_aid(state, axes, kind, value, field, aids.place, age, dt, done[:STATES])
    copy_bias_elements(state, done)
    for i in range(STATES):
        seen[i] = done[i]
    user_row(state, T, done)
    variance = aids.variance[a]
    excess = mean_speed_excess(state, axes, kind, run.P)
    # The excess is a mean, so it is taken off; its variance is at most twice its square.
    residual -= excess
    variance += 2 * excess * excess
    if HEADING <= kind <= MAGNETIC:
        variance += of_tilts + north_variance(state, position_variance(T, run.P))
    per_sigma = 1 / math.sqrt(variance)
    # The residual is that of the corrected navigator; `scalar_update` takes H x off once more.
    z, s = residual, variance
    for i in range(STATES):
        z += done[i] * w[WIDTH * i + X]
        if done[i] != 0:
            for j in range(STATES):
                s += done[i] * done[j] * w[WIDTH * i + j]
    out.aid_innovation[a], out.aid_variance[a] = residual, s
    if residual * residual > schedule.aid_gate * s:
        return False
    for i in range(STATES):
        done[i] *= per_sigma
    scalar_update(w, z * per_sigma, done)
    for i in range(STATES):
        gain = done[STATES + i]
        if i < NAV:  # from the model's own errors to those in north, east, down
            gain = 0.0
            for j in range(NAV):
                gain += T[i, j] * done[STATES + j]
        gains[i] = gain * per_sigma
    return True


def observations(model: ErrorModel) -> dict[Kernel, Kernel]:
    """Return the kernels of a model in place of those above."""
    found: dict[Kernel, Kernel] = {}
    if model.in_body:
        found[own_attitude] = own_attitude_in_body
    if model.write_map:
        found |= {through_map: through_fix_map, user_row: through_own_map}
    return found
