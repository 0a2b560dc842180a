"""Filter: a navigator between two samples, as arrays for the compiled loop, and its start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.navigation import frames, strapdown, wander
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import PHI, ErrorModel
from lab.navigation.filters.heading_observability import DIRECTIONS
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.kernels import own_room
from lab.navigation.kernels.propagation import NAV, layout
from lab.navigation.lever_arm import NO_TURNS
from lab.navigation.solution import Belief, Start, read_only
from lab.navigation.standstill import ROOM
from lab.navigation.strapdown import GYRO_BIAS, VELOCITY


class Filter(NamedTuple):
    """A navigator between two samples: state of the strapdown, workspace of the filter, parameters."""

    state: FloatArray
    w: FloatArray
    P: FloatArray  # [P | x] of the workspace, (n, width)
    F: FloatArray
    F_sum: FloatArray  # of F dt since P was last propagated
    F_step: FloatArray  # transition of the errors over the sum
    T: FloatArray  # derivative of the errors with respect to the model's own; the unit matrix of `phi`
    counts: NDArray[np.int64]  # next fix; samples since P was last propagated; next of the aids
    clock: FloatArray  # of the last feedback correction; seconds since P was last propagated; of the last fix
    streak: FloatArray  # of implausible fixes, see `kalman.is_outlier`
    R: FloatArray  # of all fixes, or of each
    R_fix: FloatArray  # of this fix
    H: FloatArray  # of this fix, for the model's own errors
    z: FloatArray  # navigator minus this fix
    S: FloatArray  # of this fix once P was raised
    directions: FloatArray  # of heading and vertical gyro bias, see `heading_observability`
    kept: FloatArray  # covariance and estimate of the states along them
    x: FloatArray  # an estimated error
    spare: FloatArray  # a navigator
    scalars: FloatArray  # updates of the last fix, or of each; see `kalman.update`
    rest_sums: FloatArray  # of the rates at rest, see `standstill`
    rest_scalars: FloatArray  # updates of the last update at rest
    noise: FloatArray
    decay: FloatArray
    lever_arm: FloatArray
    turns: FloatArray  # rates about all fixes, or about each, see `lever_arm.mean_rates_at_fixes`
    aids: Aids  # measurements other than fixes
    aid_scalars: FloatArray  # update by the last of them, or by each

    @classmethod
    def begin(
        cls,
        start: Start,
        belief: Belief,
        time: float,
        model: ErrorModel = PHI,
        kept_fixes: int = 1,
        turned: FloatArray = NO_TURNS,
        aids: Aids = NO_AIDS,
        kept_aids: int = 1,
    ) -> Filter:
        """Return a navigator that starts at a time [s]; it must be advanced with the same error model.

        `kept_fixes` is the number of fixes whose updates are kept for a smoother: all, or only the last.
        `turned` (m, 4) holds the angular rates about each fix; a navigator with a lever arm needs it. `aids`
        are measurements other than fixes, of which `kept_aids` updates are kept, likewise.
        """
        state, P0 = initial_state(start, belief, model)
        n, space = model.states, layout(model.blocks)
        w = aligned_zeros(space.size)
        P = w[: space.product].reshape(n, space.WIDTH)
        P[:, :n] = P0
        return cls(
            state,
            w,
            P,
            np.zeros((n, n)),
            np.zeros((n, n)),
            np.zeros((n, n)),
            np.eye(NAV),
            np.zeros(3, dtype=np.int64),
            np.array([time, 0.0, time]),
            np.zeros(2 + MEASUREMENTS),
            np.array(belief.R, dtype=np.float64).reshape(-1, MEASUREMENTS, MEASUREMENTS),
            np.zeros((MEASUREMENTS, MEASUREMENTS)),
            np.zeros((MEASUREMENTS, n)),
            np.zeros(MEASUREMENTS),
            np.zeros((MEASUREMENTS, MEASUREMENTS)),
            np.zeros((DIRECTIONS, n)),
            np.zeros((DIRECTIONS, DIRECTIONS + 1)),
            np.zeros(n),
            np.zeros(state.size),
            np.zeros((max(kept_fixes, 1), MEASUREMENTS, 2 * n + 2)),
            np.zeros(ROOM),
            np.zeros((1, 2 * n + 2)),
            np.array(belief.noise, dtype=np.float64),
            np.array(belief.decay, dtype=np.float64),
            np.array(belief.lever_arm, dtype=np.float64),
            np.array(turned, dtype=np.float64),
            read_only(aids),
            np.zeros((max(kept_aids, 1), 1, 2 * n + 2)),
        )


def initial_state(start: Start, belief: Belief, model: ErrorModel) -> tuple[FloatArray, FloatArray]:
    """Return state and covariance (n, n) of a navigator at its start."""
    own = blocks.user_states(model.blocks)
    state = np.zeros(own_room.END if own.stop > own.start else wander.LENGTH)
    frames.write_position(state, start.position, model)
    state[VELOCITY : VELOCITY + 3] = start.velocity_n
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = start.q_nb
    state[GYRO_BIAS : GYRO_BIAS + 3] = start.gyro_bias
    return state, initial_covariance(frames.choose_model_here(state, model), state, belief.P0)


def initial_covariance(model: ErrorModel, state: FloatArray, P0: FloatArray) -> FloatArray:
    """Return the covariance (n, n) of a model's own errors at the start.

    Parameters
    ----------
    model
        The error model.
    state
        The strapdown's state with position, velocity and attitude; the radii are filled in.
    P0 : (n, n) array
        Covariance of the initial error.
    """
    if model.write_map is None:
        return P0
    frames.keep_radii(state)
    back = np.linalg.inv(model.map(state))
    P = back @ P0 @ back.T
    return np.asarray((P + P.T) / 2)


def aligned_zeros(size: int) -> FloatArray:
    """Return zeros on a 64-byte boundary; vector loads across cache lines take a tenth of a run's time."""
    buffer = np.zeros(size + 8)
    offset = (-buffer.ctypes.data // 8) % 8
    return buffer[offset : offset + size]
