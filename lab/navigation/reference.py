"""Reference: the same filter in filterpy, written to be read rather than to be fast.

It shares the strapdown step and the error model with the compiled navigator. Covariance, update, correction
and bookkeeping are written here independently, with whole matrices.

References
----------
R. R. Labbe, filterpy (https://filterpy.readthedocs.io); P. D. Groves, *Principles of GNSS,
Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3 and 14.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.motion.frames import earth
from lab.motion.frames.rotation import skew
from lab.navigation import strapdown
from lab.navigation.aids import AIRSPEED, FORWARD, HEADING, MAGNETIC, NO_AIDS, Aids
from lab.navigation.filters import blocks
from lab.navigation.filters.blocks import LEVER_ARM
from lab.navigation.filters.correction import apply_group_exponential
from lab.navigation.filters.error_models import ATT, GYRO_BIAS, PHI, POS, VEL, ErrorModel
from lab.navigation.filters.filter import initial_covariance
from lab.navigation.filters.schedule import EVERY_FIX, SLACK, Schedule
from lab.navigation.filters.user_states import of_blocks
from lab.navigation.kernels import own_room
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.reference_aids import (
    as_biases,
    azimuth_variance,
    bent_airspeed,
    bent_speed,
    predict_aid,
    shows_heading,
    vertical_bias_noise,
    vertical_directions,
)
from lab.navigation.reference_fixes import (
    alignment,
    gyro_bias,
    metres_per_radian,
    navigator_minus_fix,
    part_of,
    predict_antenna,
    predict_receiver_errors,
    user_values,
)
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import GATE, NEAREST, SPAN
from lab.navigation.strapdown import Vector

ACCEL, ACCEL_DRIFT = (slice(at, at + 3) for at in (strapdown.ACCEL_BIAS, strapdown.ACCEL_DRIFT))
"""Both parts of the accelerometer biases in the state of the navigator."""


def navigate(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule = EVERY_FIX,
    model: ErrorModel = PHI,
    aids: Aids = NO_AIDS,
    *,
    progress: Callable[[float], None] | None = None,
) -> Solution:
    """Navigate a whole flight; arguments and result as for `navigator.navigate`.

    Parameters
    ----------
    imu, fixes, start, belief, schedule, model, aids
        As for `navigator.navigate`.
    progress
        Called with the fraction done, from 0 to 1.

    Raises
    ------
    SettingError
        If the estimate comes closer than 1° to a pole.
    """
    n = model.states
    state, kalman = _start_filter(start, belief, model)
    out = Solution.empty(imu.time.size, fixes.time.size, model.blocks, aids=aids.time.size)
    _store(out, 0, state, kalman, model)

    F, F_sum = np.zeros((n, n)), np.zeros((n, n))
    waited, elapsed, next_fix, next_aid = 0, 0.0, 0, 0
    rest, feedback = _Rest(belief, model), _Feedback(schedule, model, float(imu.time[0]))
    turned = mean_rates_at_fixes(imu, fixes.time, belief.lever_arm, estimated=LEVER_ARM in model.blocks)
    # Without a lever arm, one row without a turn stands for all fixes.
    turned = np.broadcast_to(turned, (fixes.time.size, 4))
    driven = list(blocks.find_places(model.blocks))[: belief.decay.size]
    for k, (time, dt) in enumerate(zip(imu.time[1:], np.diff(imu.time), strict=True)):
        _check_frame(state, time)
        increments = _without_own(state, imu.dtheta[k], imu.dvelocity[k], dt, model.blocks)
        strapdown.step(state, *increments, dt)
        rest.hold(state, imu, k)
        model.write(state, F)
        F_sum += F * dt
        waited += 1
        elapsed += dt
        due, due_aids = (
            _due_measurements(times, first, time, dt)
            for times, first in ((fixes.time, next_fix), (aids.time, next_aid))
        )
        if due or due_aids or waited >= schedule.stride:
            C_nb = np.eye(3) if model.in_body else part_of(state, strapdown.C_NB, 9).reshape(3, 3)
            _predict(kalman, F_sum, belief, C_nb, elapsed, summed=schedule.stride > 1)
            state[driven] *= _decay_factors(belief, elapsed, summed=schedule.stride > 1)
            F_sum[:] = 0
            waited, elapsed = 0, 0.0
        if rest.add_rate(state, imu, k, dt) and rest.update(kalman, state):
            out.rest[k + 1] = True
            feedback.apply(state, kalman, time, dt)
        for a in due_aids:
            _use_aid(out, a, k, state, kalman, model, schedule, aids, feedback, time, dt)
        for m in due:
            _use_fix(out, m, k, state, kalman, model, belief, schedule, fixes, turned[m], feedback, time, dt)
        next_fix, next_aid = next_fix + len(due), next_aid + len(due_aids)
        _store(out, k + 1, state, kalman, model)
        if progress and k % 1000 == 0:
            progress(k / imu.dtheta.shape[0])
    return out


def _check_frame(state: FloatArray, time: float) -> None:
    """Raise `SettingError` close to a pole, where a north-slaved navigator cannot compute."""
    if abs(state[strapdown.LATITUDE]) > strapdown.MAX_LATITUDE:
        raise SettingError(
            "navigator.engine: the reference in filterpy is a north-slaved navigator, which ends "
            f"{90 - np.degrees(strapdown.MAX_LATITUDE):.0f}° from a pole; the estimate is closer at "
            f"t = {time:.1f} s. Accepted there is the compiled engine"
        )


def _due_measurements(times: FloatArray, first: int, now: float, dt: float) -> list[int]:
    """Return the measurements from number `first` on that are due after a sample of the length dt."""
    return [m for m in range(first, times.size) if times[m] <= now + SLACK * dt]


class _Feedback:
    """Corrects the navigator after an update, unless the last correction was too short a time ago."""

    def __init__(self, schedule: Schedule, model: ErrorModel, begin: float) -> None:
        self.schedule, self.model, self.last = schedule, model, begin

    def apply(self, state: FloatArray, kalman: KalmanFilter, time: float, dt: float) -> None:
        """Correct the navigator if it is time, and set the estimated error to zero."""
        if self.schedule.feedback and time - self.last >= self.schedule.correction_period - SLACK * dt:
            correct(state, kalman.x, self.model)
            kalman.x = np.zeros(self.model.states)
            self.last = time


def _use_fix(
    out: Solution,
    m: int,
    k: int,
    state: FloatArray,
    kalman: KalmanFilter,
    model: ErrorModel,
    belief: Belief,
    schedule: Schedule,
    fixes: Fixes,
    turn: FloatArray,
    feedback: _Feedback,
    time: float,
    dt: float,
) -> None:
    """Update with fix m after sample k, and write what came of it."""
    age = time - fixes.time[m]
    # It is older than the sample, as before a start: the navigator is interpolated within one sample only.
    if age > dt * (1 + SLACK):
        return
    before = kalman.x, kalman.P
    H, antenna, gyro_noise = predict_antenna(state, belief, turn, age, model.blocks)
    R = belief.fix_covariance(np.array([m])).reshape(6, 6) + gyro_noise
    z = navigator_minus_fix(state, fixes, m, age, dt) + antenna
    z += predict_receiver_errors(state, H, model.blocks)
    D = vertical_directions(state, kalman.P, in_body=model.in_body)
    held = _update(kalman, z, H @ model.map(state), R, D, may_hold=schedule.hold_heading)
    kalman.P = kalman.P + vertical_bias_noise(state, kalman.P, D)
    out.innovation[m], out.innovation_covariance[m] = kalman.y, kalman.S
    out.fix_H[m], out.fix_R[m], out.fix_held[m] = H, R, held * D[1, GYRO_BIAS]
    if kalman.y @ np.linalg.solve(kalman.S, kalman.y) > schedule.gate:
        # filterpy has updated already: what a rejected fix did is undone.
        kalman.x, kalman.P = before
        out.fix_rejected[m], out.fix_held[m] = True, 0.0
        return
    feedback.apply(state, kalman, time, dt)
    T = model.map(_corrected(state, kalman.x, model))
    out.fix_covariance[m], out.fix_sample[m] = T @ kalman.P @ T.T, k + 1


def _use_aid(
    out: Solution,
    a: int,
    k: int,
    state: FloatArray,
    kalman: KalmanFilter,
    model: ErrorModel,
    schedule: Schedule,
    aids: Aids,
    feedback: _Feedback,
    time: float,
    dt: float,
) -> None:
    """Update with measurement a of the aids after sample k, and write what came of it.

    It is linearised about the navigator with the estimated error removed.
    """
    age = time - aids.time[a]
    if age > dt * (1 + SLACK):
        return
    here = _corrected(state, kalman.x, model)
    residual, row = predict_aid(here, aids, a, age, dt, model.blocks)
    as_biases(here, row[None], model.blocks)
    T = model.map(here)
    H, R = row[None] @ T, np.array([[aids.variance[a]]])
    if aids.kind[a] == FORWARD:
        excess = bent_speed(here, kalman.P[ATT, ATT], in_body=model.in_body)
        residual, R = residual - excess, R + 2 * excess**2
    if aids.kind[a] == AIRSPEED:
        wind = blocks.find_states(model.blocks, blocks.WIND)
        excess = bent_airspeed(here, kalman.P[wind, wind])
        residual, R = residual - excess, R + 2 * excess**2
    if aids.kind[a] in (HEADING, MAGNETIC):
        of_tilts = azimuth_variance(here, aids, a, kalman.P[ATT, ATT], in_body=model.in_body)
        if np.isinf(of_tilts):
            return
        R = R + of_tilts
    out.aid_innovation[a] = residual
    out.aid_variance[a] = float((H @ kalman.P @ H.T + R)[0, 0])
    out.aid_H[a] = row
    if out.aid_innovation[a] ** 2 > schedule.aid_gate * out.aid_variance[a]:
        return
    out.aid_gain[a] = T @ kalman.P @ H[0] / out.aid_variance[a]
    # filterpy takes H x off itself, and the residual is already that of the corrected navigator.
    kalman.update(residual + H @ kalman.x, R=R, H=H)
    kalman.P = (kalman.P + kalman.P.T) / 2
    out.aid_sample[a] = k + 1
    feedback.apply(state, kalman, time, dt)


def _write_state(state: FloatArray, at: int, values: FloatArray) -> None:
    state[at : at + values.size] = values


def _predict(
    kalman: KalmanFilter, A: FloatArray, belief: Belief, C_nb: FloatArray, elapsed: float, *, summed: bool
) -> None:
    """Propagate over the time elapsed, given the sum A of F dt and the axes of the noise.

    Over one sample: to first order in time, with the noise after it. Over a sum of samples: to third order,
    with half of the noise before and half after.
    """
    driven = slice(GYRO_BIAS.start, GYRO_BIAS.start + belief.decay.size)
    A = A.copy()
    A[driven, driven] = -elapsed * np.diag(belief.decay)
    Phi = np.eye(A.shape[0]) + A
    Q = np.zeros_like(Phi)
    Q[ATT, ATT] = C_nb @ np.diag(belief.noise[0:3]) @ C_nb.T
    Q[VEL, VEL] = C_nb @ np.diag(belief.noise[3:6]) @ C_nb.T
    Q[driven, driven] = np.diag(belief.noise[6:])
    Q *= elapsed
    if summed:
        Phi += A @ A / 2 + A @ A @ A / 6
        Q = (Q + Phi @ Q @ Phi.T) / 2
    kalman.predict(F=Phi, Q=Q)


def _start_filter(start: Start, belief: Belief, model: ErrorModel) -> tuple[FloatArray, KalmanFilter]:
    """Return a navigator at its start, and its filter."""
    state = np.zeros(own_room.END)
    strapdown.set_position(state, *start.position)
    _write_state(state, strapdown.VELOCITY, start.velocity_n)
    _write_state(state, strapdown.Q_NB, start.q_nb)
    _write_state(state, strapdown.GYRO_BIAS, start.gyro_bias)
    kalman = KalmanFilter(dim_x=model.states, dim_z=6)
    kalman.x = np.zeros(model.states)
    kalman.P = initial_covariance(model, state, belief.P0).copy()
    return state, kalman


class _Rest:
    """The updates at rest: the held attitude, and the rates since the last update."""

    def __init__(self, belief: Belief, model: ErrorModel) -> None:
        self.belief, self.model = belief, model
        self.held: FloatArray | None = None
        self.rates: list[FloatArray] = []
        self.length = 0.0

    def hold(self, state: FloatArray, imu: Imu, k: int) -> None:
        """Give the error model the attitude at the beginning of the rest."""
        if not imu.rest.size or not imu.rest[k]:
            self.held, self.rates, self.length = None, [], 0.0
            return
        if self.held is None:
            self.held = part_of(state, strapdown.C_NB, 9).reshape(3, 3).copy()
        force = part_of(state, strapdown.PREVIOUS_DVELOCITY) * state[strapdown.PER_STEP]
        _write_state(state, strapdown.C_NB, self.held.ravel())
        _write_state(state, strapdown.FORCE_N, self.held @ force)

    def add_rate(self, state: FloatArray, imu: Imu, k: int, dt: float) -> bool:
        """Add the rate of a sample at rest; return whether an update is due."""
        if self.held is None:
            return False
        # As measured, the bias put back: an update within this second changes the estimate.
        self.rates.append(part_of(state, strapdown.PREVIOUS_DTHETA) / dt + _bias_taken(state))
        self.length += dt
        return self.length >= SPAN - NEAREST * dt

    def update(self, kalman: KalmanFilter, state: FloatArray) -> bool:
        """Update with the mean rate; return whether it was used."""
        rates, length, held = np.array(self.rates), self.length, self.held
        assert held is not None
        self.rates, self.length = [], 0.0
        C_nb = Rotation.from_quat(part_of(state, strapdown.Q_NB, 4), scalar_first=True).as_matrix()
        latitude = np.arcsin(state[strapdown.SINE])
        omega_ie = earth.RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
        down = held[2]
        R = down**2 @ np.maximum(self.belief.noise[:3] / length, rates.var(axis=0) / rates.shape[0])
        H = np.zeros((1, self.model.states))
        # As `standstill.predict_rest`, in matrices: only the vertical row of ω_ie × φ.
        H[:, ATT] = skew(omega_ie)[2] @ (C_nb if self.model.in_body else np.eye(3))
        H[:, GYRO_BIAS] = -down / (1 + part_of(state, strapdown.GYRO_SCALE))
        as_biases(state, H, self.model.blocks)
        z = down @ (rates.mean(axis=0) - _bias_taken(state) - C_nb.T @ omega_ie)
        if ((z - H @ kalman.x) ** 2 > GATE * (H @ kalman.P @ H.T + R)).any():
            return False
        kalman.update(z, R=np.array([[R]]), H=H)
        kalman.P = (kalman.P + kalman.P.T) / 2
        return True


def _decay_factors(belief: Belief, elapsed: float, *, summed: bool) -> FloatArray:
    """Return the decay factors (k,) of the driven states over a time, to the order of `_predict`."""
    x = elapsed * belief.decay
    return np.asarray(1 - x + (x**2 / 2 - x**3 / 6 if summed else 0))


def _bias_taken(state: FloatArray) -> FloatArray:
    """Return what the gyro biases take off the corrected rates (3,)."""
    return gyro_bias(state) / (1 + part_of(state, strapdown.GYRO_SCALE))


def _without_own(
    state: FloatArray, dtheta: FloatArray, dvelocity: FloatArray, dt: float, names: tuple[str, ...]
) -> tuple[Vector, Vector]:
    """Return increments without the errors that a user declared, and keep their effects E (6, k).

    The navigator removes biases, scale factors and misalignments afterwards, so what is subtracted here is
    what that turns into the errors.
    """
    measured = np.concatenate((dtheta, dvelocity))
    own = of_blocks(names)
    if own:
        corrects = np.zeros((6, 6))
        for at, scale, off in (
            (0, strapdown.GYRO_SCALE, strapdown.GYRO_MISALIGNMENT),
            (3, strapdown.ACCEL_SCALE, strapdown.ACCEL_MISALIGNMENT),
        ):
            corrects[at : at + 3, at : at + 3] = alignment(state, scale, off)
        bias = np.concatenate((gyro_bias(state), state[ACCEL] + state[ACCEL_DRIFT]))
        true = corrects @ (measured / dt - bias)
        E = np.concatenate([one.effects(true[None, :3], true[None, 3:])[0] for one in own], axis=1)
        state[own_room.EFFECTS : own_room.EFFECTS + E.size] = E.T.ravel()
        measured = measured - np.linalg.solve(corrects, E @ user_values(state, names)) * dt
    return (measured[0], measured[1], measured[2]), (measured[3], measured[4], measured[5])


def _update(
    kalman: KalmanFilter, z: FloatArray, H: FloatArray, R: FloatArray, D: FloatArray, *, may_hold: bool
) -> bool:
    """Update with a measurement; return whether the states along D (2, n) kept their estimates.

    They keep them if the measurement shows them at most by chance, by the gain K − Dᵀ D K of Schmidt's filter
    (`heading_observability`).
    """
    x, P = kalman.x, kalman.P
    kalman.update(z, R=R, H=H)
    held = may_hold and not shows_heading(P, H, np.diag(kalman.S), D)
    if held:
        kalman.K = kalman.K - D.T @ D @ kalman.K
        kalman.x = x + kalman.K @ kalman.y
        # Along D, what the optimal update took off is put back.
        kalman.P = kalman.P + D.T @ D @ (P - kalman.P) @ D.T @ D
    kalman.P = (kalman.P + kalman.P.T) / 2
    return held


def correct(state: FloatArray, own: FloatArray, model: ErrorModel, *, bent: bool = True) -> None:
    """Correct the navigator by an estimated error in the coordinates of the model.

    For a model in the body frame, the correction is the group's exponential, unless the estimate is only
    pending (`bent` is false).
    """
    own = own.copy()
    if model.in_body and bent:
        apply_group_exponential(own)
    x = model.map(state) @ own
    per_latitude, per_longitude = metres_per_radian(state)
    # The position error is positive down, so that of the height is added.
    latitude, longitude, height = part_of(state, strapdown.LATITUDE)
    strapdown.set_position(
        state, latitude - x[0] / per_latitude, longitude - x[1] / per_longitude, height + x[2]
    )
    _write_state(state, strapdown.VELOCITY, part_of(state, strapdown.VELOCITY) - x[VEL])
    # A second fix before the next sample interpolates between this one and the one before.
    _write_state(state, strapdown.PREVIOUS_VELOCITY, part_of(state, strapdown.PREVIOUS_VELOCITY) - x[VEL])
    _write_state(state, strapdown.CORRECTED, part_of(state, strapdown.CORRECTED) + x[ATT])
    # Ĉ = (I − [φ×]) C, so the truth is exp(+[φ×]) Ĉ.
    q_nb = Rotation.from_rotvec(x[ATT]) * Rotation.from_quat(
        part_of(state, strapdown.Q_NB, 4), scalar_first=True
    )
    _write_state(state, strapdown.Q_NB, q_nb.as_quat(scalar_first=True))
    state[list(blocks.find_places(model.blocks))] -= x[GYRO_BIAS.start :]


def _corrected(state: FloatArray, x: FloatArray, model: ErrorModel) -> FloatArray:
    """Return the state corrected by an estimated error."""
    corrected = state.copy()
    if x.any():
        correct(corrected, x, model, bent=False)
    return corrected


def _store(out: Solution, k: int, state: FloatArray, kalman: KalmanFilter, model: ErrorModel) -> None:
    """Write sample k of the solution, corrected by the estimated error."""
    corrected = _corrected(state, kalman.x, model)
    T = model.map(corrected)
    P = T @ kalman.P @ T.T
    out.position[k] = part_of(corrected, strapdown.LATITUDE)
    out.velocity_n[k] = part_of(corrected, strapdown.VELOCITY)
    out.q_nb[k] = part_of(corrected, strapdown.Q_NB, 4)
    out.bias[k] = part_of(corrected, strapdown.GYRO_BIAS, 6)
    scales = out.scale.shape[1]
    out.scale[k] = part_of(corrected, strapdown.GYRO_SCALE, scales)
    out.further[k] = corrected[list(blocks.find_places(model.blocks))[6 + scales :]]
    out.variance[k] = np.diag(P)
    for block, at in enumerate((POS.start, ATT.start)):
        out.covariance[k, block] = P[at, at + 1], P[at, at + 2], P[at + 1, at + 2]
