"""Unscented filter: the state of the nonlinear filter between two samples, and how it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.navigation import frames, strapdown, wander
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters import blocks, wander_models
from lab.navigation.filters.error_models import ATT
from lab.navigation.filters.filter import initial_covariance
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.heading_observability import DIRECTIONS
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import Schedule
from lab.navigation.kernels.lane_points import allocate_points
from lab.navigation.lever_arm import NO_TURNS
from lab.navigation.solution import Belief, Start, read_only
from lab.navigation.standstill import ROOM
from lab.navigation.strapdown import GYRO_BIAS, VELOCITY

SEEN = (
    blocks.GYRO_SCALE,
    blocks.GYRO_MISALIGNMENT,
    blocks.GYRO_G,
    blocks.GYRO_DRIFT,
    blocks.GPS_DRIFT,
    blocks.LEVER_ARM,
    blocks.LATENCY,
)
"""Blocks of states that appear in fixes or in the rates at rest."""
SCALE, MISALIGNMENT, GYRO_G, GYRO_DRIFT, GPS_DRIFT, LEVER_ARM, LATENCY = range(len(SEEN))
"""Their places in `UnscentedFilter.first`."""


class UnscentedFilter(NamedTuple):
    """An unscented filter between two samples, with the workspace of its kernels.

    Attributes
    ----------
    state : (LENGTH,) array
        The navigator: the mean, and the centre of the sigma points.
    points
        The 2 n sigma points, navigators of the same kind, see `lane_points`.
    P : (n, n) array
        Covariance of the error, in the computer frame as of `wander_models.psi`; 15 states of every filter,
        then those of its further blocks.
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
    counts: NDArray[np.int64]  # next fix; samples since mean and covariance were computed; next of the aids
    clock: FloatArray  # s since then; s since the points were placed, negative before; time of last fix
    streak: FloatArray  # of implausible fixes, see `kalman.is_outlier`
    R: FloatArray  # of all fixes, or of each
    R_fix: FloatArray  # of this fix
    H: FloatArray  # of this fix
    S: FloatArray  # covariance of an innovation
    directions: FloatArray  # of heading and vertical gyro bias, see `heading_observability`
    kept: FloatArray  # covariance of the states along them
    noise: FloatArray
    decay: FloatArray
    lever_arm: FloatArray
    turns: FloatArray  # rates about all fixes, or about each, see `lever_arm.mean_rates_at_fixes`
    rest_sums: FloatArray  # of the rates at rest, see `standstill`
    places: NDArray[np.int64]  # of the states from the biases on in the state of the navigator
    first: NDArray[np.int64]  # first state of each of the blocks `SEEN`; −1 without it
    aids: Aids  # measurements other than fixes

    @classmethod
    def begin(
        cls,
        start: Start,
        belief: Belief,
        time: float = 0.0,
        turned: FloatArray = NO_TURNS,
        names: Sequence[str] = (),
        aids: Aids = NO_AIDS,
    ) -> UnscentedFilter:
        """Return a filter with some further blocks at its start, at a time [s].

        For `turned` and `aids` see `filter.Filter.begin`.
        """
        n = blocks.count(names)
        model = with_blocks(wander_models.PSI, names)
        state = np.zeros(wander.LENGTH)
        frames.write_position(state, start.position, model)
        state[VELOCITY : VELOCITY + 3] = start.velocity_n
        state[strapdown.Q_NB : strapdown.Q_NB + 4] = start.q_nb
        state[GYRO_BIAS : GYRO_BIAS + 3] = start.gyro_bias
        return cls(
            state,
            allocate_points(2 * n),
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
            np.zeros(3, dtype=np.int64),
            np.array([0.0, -1.0, time]),
            np.zeros(2 + MEASUREMENTS),
            np.array(belief.R, dtype=np.float64).reshape(-1, MEASUREMENTS, MEASUREMENTS),
            np.zeros((MEASUREMENTS, MEASUREMENTS)),
            np.zeros((MEASUREMENTS, n)),
            np.zeros((MEASUREMENTS, MEASUREMENTS)),
            np.zeros((DIRECTIONS, n)),
            np.zeros((DIRECTIONS, DIRECTIONS)),
            np.array(belief.noise, dtype=np.float64),
            np.array(belief.decay, dtype=np.float64),
            np.array(belief.lever_arm, dtype=np.float64),
            np.array(turned, dtype=np.float64),
            np.zeros(ROOM),
            np.array(blocks.find_places(names), dtype=np.int64),
            np.array([blocks.first_state(names, name) for name in SEEN], dtype=np.int64),
            read_only(aids),
        )


LARGEST_SIGMA = math.radians(60)
"""Largest σ of an initial attitude error [rad]: the sigma points lie at √3 σ, and for σ of 104° and more they
overlap on the other side of the circle."""


def check_heading(P0: FloatArray) -> None:
    """Raise `SettingError` if an initial attitude is too uncertain for sigma points."""
    sigma = math.sqrt(float(np.max(np.diag(P0)[ATT])))
    if sigma > LARGEST_SIGMA:
        raise SettingError(
            "navigator.model: the sigma points of the model nonlinear do not span an initial attitude with a "
            f"σ of {math.degrees(sigma):.0f}°; accepted are up to {math.degrees(LARGEST_SIGMA):.0f}° "
            "(navigator.attitude_sigma, navigator.p0), or the model invariant, which also starts from an "
            "unknown heading"
        )


def check(schedule: Schedule) -> None:
    """Raise `SettingError` if a schedule leaves the navigator uncorrected."""
    if not schedule.feedback:
        raise SettingError(
            "navigator.correction: the nonlinear filter places its sigma points about its estimate, so it "
            "has no free-running navigator; accepted is feedback"
        )
    if schedule.correction_period:
        raise SettingError(
            "navigator.correction_period: the nonlinear filter places its sigma points about the corrected "
            "navigator, so it corrects at each fix; accepted is 0"
        )
