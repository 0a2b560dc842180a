"""Frames: the frame in which a navigator computes, and its change close to a pole.

The north-slaved frame turns about the vertical with the meridians, faster and faster towards a pole. A
navigator in it therefore goes on in a wander-azimuth frame (`wander`) beyond 89°, and comes back below 88.9°.
The output of both is in north, east, down, so the callers of a navigator do not ask for its frame.

A change of the frame moves nothing. It maps the filter's own errors x so that its output errors are the same,
T' x' = T x, with T and T' as of `error_models` in the two frames.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.navigation import strapdown, wander
from lab.navigation.filters.error_models import NORTH_SLAVED, WANDER_AZIMUTH, ErrorModel
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.kernels.generation import interpret_kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.solution import Solution
from lab.navigation.strapdown import PREVIOUS_VELOCITY, Q_NB, VELOCITY

RETURN = math.sin(strapdown.MAX_LATITUDE - math.radians(0.1))
"""Sine of the latitude below which a navigator is north-slaved again: 11 km further from the pole than the
way in, so that corrections of its position do not make it change to and fro."""


def in_wander(state: FloatArray) -> bool:
    """Return whether a navigator computes in a wander-azimuth frame now."""
    return bool(state[wander.Q_EW : wander.AXIS].any())


def choose_model_here(state: FloatArray, model: ErrorModel) -> ErrorModel:
    """Return the error model in the frame in which a navigator computes now.

    Parameters
    ----------
    state
        The navigator.
    model
        The model with which it began.

    Raises
    ------
    SettingError
        If the model is not written for that frame.
    """
    if model.mechanization == NORTH_SLAVED and in_wander(state):
        return with_blocks(linear_model(model.name, WANDER_AZIMUTH), model.blocks)
    return model


def write_position(state: FloatArray, position: FloatArray, model: ErrorModel) -> None:
    """Write a position, in the frame in which a navigator of the model computes there.

    Parameters
    ----------
    state
        The navigator; north, east and down at the position are the axes of its frame.
    position : (3,) array
        Latitude, longitude [rad], height [m].
    model
        The error model; one of the wander-azimuth frame stays in it everywhere.
    """
    always = model.mechanization == WANDER_AZIMUTH
    state[wander.Q_EW : wander.LENGTH] = 0.0
    if always or abs(position[0]) > strapdown.MAX_LATITUDE:
        interpret_kernel(wander.place)(state, *position)
        state[wander.LEAST_SINE] = 0.0 if always else RETURN
    else:
        interpret_kernel(strapdown.set_position)(state, *position)
    keep_radii(state)


def keep_radii(state: FloatArray) -> None:
    """Fill in the curvatures at a new position; later, each step updates them."""
    frame = wander if in_wander(state) else strapdown
    interpret_kernel(frame.environment)(state, state[strapdown.HEIGHT])


def shown(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity (3,) and attitude (4,) of a navigator, in north, east, down."""
    if not in_wander(state):
        q_nb = state[Q_NB : Q_NB + 4].copy()
        return state[:VELOCITY].copy(), state[VELOCITY:Q_NB].copy(), q_nb
    out = Solution.empty(1, 0)
    interpret_kernel(wander.store_state)(out, 0, state)
    return out.position[0], out.velocity_n[0], out.q_nb[0]


def set_motion(state: FloatArray, position: FloatArray, velocity_n: FloatArray, q_nb: FloatArray) -> None:
    """Set a navigator to a position, velocity and attitude in n, as of `Start`; its covariance stays.

    In a wander-azimuth frame, the frame goes to the new place without a turn about the vertical.
    """
    if in_wander(state):
        interpret_kernel(wander.move_to)(state, position)
        C_wn = np.array(interpret_kernel(wander.north_axes)(state)).T
        velocity_n = C_wn @ velocity_n
        q_nb = (Rotation.from_matrix(C_wn) * Rotation.from_quat(q_nb, scalar_first=True)).as_quat(
            scalar_first=True
        )
    else:
        interpret_kernel(strapdown.set_position)(state, *position)
    state[VELOCITY : VELOCITY + 3] = velocity_n
    state[Q_NB : Q_NB + 4] = q_nb


def change(state: FloatArray, P: FloatArray, model: ErrorModel) -> FloatArray:
    """Take a navigator to the other frame, and return C: its own errors are x' = C x from now on.

    Parameters
    ----------
    state
        The navigator between two samples; changed in place.
    P : (n, n + 1 or more) array
        [P | x] of its filter; changed in place.
    model
        The model with which it began.

    Returns
    -------
    (9, 9) array
        C; the other errors stay as they are.
    """
    n = model.states
    before = choose_model_here(state, model).map(state)[:NAV, :NAV]
    position, velocity_n, q_nb = shown(state)
    earlier = state[PREVIOUS_VELOCITY : PREVIOUS_VELOCITY + 3].copy()
    if in_wander(state):
        earlier = np.array(interpret_kernel(wander.north_axes)(state)) @ earlier
        state[wander.Q_EW : wander.LENGTH] = 0.0
        interpret_kernel(strapdown.set_position)(state, *position)
    else:
        interpret_kernel(wander.place)(state, *position)
        state[wander.LEAST_SINE] = RETURN
    state[VELOCITY : VELOCITY + 3], state[PREVIOUS_VELOCITY : PREVIOUS_VELOCITY + 3] = velocity_n, earlier
    state[Q_NB : Q_NB + 4] = q_nb
    keep_radii(state)
    C = np.linalg.solve(choose_model_here(state, model).map(state)[:NAV, :NAV], before)
    P[:NAV, : n + 1] = C @ P[:NAV, : n + 1]
    P[:, :NAV] = P[:, :NAV] @ C.T
    P[:, :n] = (P[:, :n] + P[:, :n].T) / 2
    return np.asarray(C)
