"""Navigator: strapdown and error-state Kalman filter run together over IMU increments and GPS fixes.

`advance` is the navigator's time step, one for all: a batch run hands it a whole flight, a live run hands it
one sample at a time.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.navigation import strapdown, wander
from lab.navigation.compilation import interpreted
from lab.navigation.driver import driver
from lab.navigation.error_models import NORTH_SLAVED, PHI, WANDER_AZIMUTH, ErrorModel
from lab.navigation.propagation import NAV, layout
from lab.navigation.solution import EVERY_FIX, Belief, Fixes, Imu, Schedule, Solution, Start
from lab.navigation.strapdown import VELOCITY

FloatArray = NDArray[np.float64]


class PolarError(ValueError):
    """The flight comes closer to a pole than a north-slaved navigation frame allows."""


class Filter(NamedTuple):
    """A navigator between two samples: the strapdown's state, the filter's workspace, and what both need."""

    state: FloatArray
    w: FloatArray
    F: FloatArray
    F_sum: FloatArray  # of F dt since P was last propagated
    T: FloatArray  # derivative of the errors with respect to the model's own
    counts: NDArray[np.int64]  # next fix; samples since P was last propagated
    clock: FloatArray  # time of the last feedback correction; seconds since P was last propagated
    R: FloatArray
    R_root: FloatArray
    noise: FloatArray
    bias_decay: FloatArray

    @classmethod
    def begin(cls, start: Start, belief: Belief, time: float, model: ErrorModel = PHI) -> Filter:
        """Return a navigator that starts at a time [s], with the error model it will be advanced with."""
        in_wander = model.mechanization == WANDER_AZIMUTH
        state = np.zeros(wander.LENGTH if in_wander else strapdown.LENGTH)
        interpreted(wander.place if in_wander else strapdown.set_position)(state, *start.position)
        state[VELOCITY : VELOCITY + 3] = start.velocity_n
        state[strapdown.Q_NB : strapdown.Q_NB + 4] = start.q_nb
        n, space = model.states, layout(model.states)
        w = _aligned_zeros(space.size)
        w[: space.product].reshape(n, space.WIDTH)[:, :n] = initial_covariance(model, state, belief.P0)
        R = np.ascontiguousarray(belief.R)
        return cls(
            state,
            w,
            np.zeros((n, n)),
            np.zeros((n, n)),
            np.zeros((NAV, NAV)),
            np.zeros(2, dtype=np.int64),
            np.array([time, 0.0]),
            R,
            np.asarray(np.linalg.cholesky(R), dtype=np.float64),
            np.ascontiguousarray(belief.noise),
            np.ascontiguousarray(belief.bias_decay),
        )


def initial_covariance(model: ErrorModel, state: FloatArray, P0: FloatArray) -> FloatArray:
    """Return the covariance (n, n) of a model's own errors at the start.

    Parameters
    ----------
    model
        The error model.
    state
        The strapdown's state, position, velocity and attitude set; the radii are filled in.
    P0 : (n, n) array
        Covariance of the initial error.
    """
    if model.write_map is None:
        return P0
    meridian, transverse = earth.radii(float(state[strapdown.SINE]))
    state[strapdown.MERIDIAN] = 1 / (meridian + state[strapdown.HEIGHT])
    state[strapdown.TRANSVERSE] = 1 / (transverse + state[strapdown.HEIGHT])
    back = np.linalg.inv(model.map(state))
    P = back @ P0 @ back.T
    return np.asarray((P + P.T) / 2)


def _aligned_zeros(size: int) -> FloatArray:
    """Return zeros on a 64-byte boundary; vector loads that cross cache lines cost a tenth of a run."""
    buffer = np.zeros(size + 8)
    offset = (-buffer.ctypes.data // 8) % 8
    return buffer[offset : offset + size]


def navigate(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule = EVERY_FIX,
    model: ErrorModel = PHI,
) -> Solution:
    """Navigate a whole flight with the compiled filter.

    Parameters
    ----------
    imu, fixes
        The measurements.
    start
        Initial position, velocity and attitude; initial biases and scale factor errors are zero.
    belief
        What the filter assumes.
    schedule
        When it propagates its covariance and corrects.
    model
        Error model of the filter, with as many states as the belief.

    Raises
    ------
    PolarError
        If a north-slaved navigator comes closer than 0.1° to a pole.
    """
    solution = Solution.empty(imu.time.size, fixes.time.size, model.states)
    if model.mechanization == NORTH_SLAVED and abs(start.position[0]) > strapdown.MAX_LATITUDE:
        raise PolarError(POLAR.format(time=imu.time[0]))
    run = Filter.begin(start, belief, imu.time[0], model)
    stopped = advance(run, imu, fixes, solution, 0, schedule, model)
    if stopped < imu.time.size:
        raise PolarError(POLAR.format(time=imu.time[stopped - 1]))
    return solution


POLAR = (
    "t = {time:.3f} s: closer than 0.1° to a pole, where a north-slaved navigation frame cannot follow; "
    "accepted are latitudes up to 89.9°, or navigator.mechanization = wander azimuth, which works over the "
    "poles"
)
"""What a `PolarError` says."""


def advance(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    model: ErrorModel = PHI,
) -> int:
    """Advance a navigator over the samples of `imu` from number `first` on.

    Returns the number of samples written: fewer than there are times in `imu` if the navigator comes too
    close to a pole. The flight may be handed over in one piece or piece by piece: the result is the same.
    The model must be the one the navigator began with.
    """
    return driver(model, summed=schedule.stride > 1)(run, imu, fixes, out, first, schedule)


def is_compiled(model: ErrorModel = PHI) -> bool:
    """Say whether the driver of a model is ready in this process: compiled, or loaded from the disk."""
    return bool(driver(model, summed=False).signatures)  # type: ignore[attr-defined]
