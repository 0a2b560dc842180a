"""Unscented filter: the state of the nonlinear filter between two samples, and how it begins."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation import frames, strapdown, wander, wander_models
from lab.navigation.filter import initial_covariance
from lab.navigation.further_columns import with_states
from lab.navigation.kalman import MEASUREMENTS
from lab.navigation.lever_arm import NO_TURNS
from lab.navigation.solution import Belief, Start
from lab.navigation.standstill import ROOM
from lab.navigation.strapdown import GYRO_BIAS, VELOCITY

FloatArray = NDArray[np.float64]


class Filter(NamedTuple):
    """An unscented filter between two samples, with the workspace of its kernels.

    Attributes
    ----------
    state : (LENGTH,) array
        The navigator: the mean, and the centre of the sigma points.
    points : (2 n, LENGTH) array
        The sigma points, navigators of the same kind.
    P : (n, n) array
        Covariance of the error, 15 or 21 states, in the computer frame as of `wander_models.psi`.
    """

    state: FloatArray
    points: FloatArray
    P: FloatArray
    root: FloatArray  # lower Cholesky factor of P
    deviations: FloatArray  # error of the navigator relative to each sigma point
    attitudes: FloatArray  # of the sigma points, in the frame of the navigator
    order: NDArray[np.int64]  # order of the states in the root: the attitude first
    x: FloatArray
    mean: FloatArray  # error of the navigator relative to the mean of the sigma points
    driven: FloatArray  # covariance from process noise since the points were placed
    T: FloatArray  # derivative of the output errors with respect to the filter's own
    half: FloatArray  # T P, its first nine rows
    shown: FloatArray  # covariance of the output errors, T P Tᵀ
    spare: FloatArray  # a navigator
    counts: NDArray[np.int64]  # next fix; samples since mean and covariance were computed
    clock: FloatArray  # s since then; s since the points were placed, negative before; time of last fix
    streak: FloatArray  # of implausible fixes, see `kalman.stands_out`
    R: FloatArray  # of all fixes, or of each
    R_fix: FloatArray  # of this fix
    H: FloatArray  # of this fix
    noise: FloatArray
    decay: FloatArray
    lever_arm: FloatArray
    turns: FloatArray  # rates about all fixes, or about each, see `lever_arm.turns`
    rest_sums: FloatArray  # of the rates at rest, see `standstill`

    @classmethod
    def begin(cls, start: Start, belief: Belief, time: float = 0.0, turned: FloatArray = NO_TURNS) -> Filter:
        """Return a filter at its start, at a time [s]; for `turned` see `filter.Filter.begin`."""
        n = belief.P0.shape[0]
        model = with_states(wander_models.PSI, n)
        state = np.zeros(wander.LENGTH)
        frames.place(state, start.position, model)
        state[VELOCITY : VELOCITY + 3] = start.velocity_n
        state[strapdown.Q_NB : strapdown.Q_NB + 4] = start.q_nb
        state[GYRO_BIAS : GYRO_BIAS + 3] = start.gyro_bias
        return cls(
            state,
            np.zeros((2 * n, wander.LENGTH)),
            np.array(initial_covariance(model, state, belief.P0), dtype=np.float64, order="C"),
            np.zeros((n, n)),
            np.zeros((2 * n, n)),
            np.zeros((2 * n, 4)),
            np.r_[6:9, 0:6, 9:n],
            np.zeros(n),
            np.zeros(n),
            np.zeros((n, n)),
            np.zeros((9, 9)),
            np.zeros((9, n)),
            np.zeros((n, n)),
            np.zeros(wander.LENGTH),
            np.zeros(2, dtype=np.int64),
            np.array([0.0, -1.0, time]),
            np.zeros(2 + MEASUREMENTS),
            np.array(belief.R, dtype=np.float64).reshape(-1, MEASUREMENTS, MEASUREMENTS),
            np.zeros((MEASUREMENTS, MEASUREMENTS)),
            np.zeros((MEASUREMENTS, n)),
            np.array(belief.noise, dtype=np.float64),
            np.array(belief.decay, dtype=np.float64),
            np.array(belief.lever_arm, dtype=np.float64),
            np.array(turned, dtype=np.float64),
            np.zeros(ROOM),
        )
