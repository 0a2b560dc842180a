"""Unscented aids: how the nonlinear filter sees measurements other than fixes, by its sigma points.

What the navigator says of a measurement is computed at every sigma point, with the north of that point. So a
heading counts as it should where the attitude is uncertain by tens of degrees, and close to a pole, where
north differs from point to point.

References
----------
S. J. Julier, J. K. Uhlmann, *Unscented filtering and nonlinear estimation*, Proc. IEEE 92 (2004).
"""

from __future__ import annotations

import math

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.aids import HEADING, MAGNETIC, predict_aid
from lab.navigation.filters.north_slaved import north_axes, north_variance
from lab.navigation.filters.observation import seen_azimuth_variance
from lab.navigation.filters.schedule import Schedule
from lab.navigation.filters.sigma_points import SPREAD, WEIGHT, displace, draw_sigma_points, transport
from lab.navigation.filters.unscented_filter import UnscentedFilter
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.lane_points import view_point
from lab.navigation.solution import Solution


@inline_kernel
def _difference(kind: int, a: float, b: float) -> float:
    """Return a − b; that of azimuths is from −π to π."""
    off = a - b
    if kind in (HEADING, MAGNETIC):
        off -= 2 * math.pi * math.floor(off / (2 * math.pi) + 0.5)
    return float(off)


@inline_kernel
def _turn_as_biased(state: FloatArray, there: FloatArray) -> None:
    """Give a point just placed the increments of the last step that its own gyro biases leave.

    Likewise its own g-sensitivity.
    """
    here = strapdown.bias_taken(state, strapdown.GYRO_BIAS, strapdown.GYRO_SCALE)
    own = strapdown.bias_taken(there, strapdown.GYRO_BIAS, strapdown.GYRO_SCALE)
    for i in range(3):
        there[strapdown.PREVIOUS_DTHETA + i] += (here[i] - own[i]) / state[strapdown.PER_STEP]
        felt = state[strapdown.GYRO_G + i] - there[strapdown.GYRO_G + i]
        there[strapdown.PREVIOUS_DTHETA + i] += felt * state[strapdown.PREVIOUS_DVELOCITY + i]


@kernel
def observe_aid(
    run: UnscentedFilter, a: int, age: float, dt: float, schedule: Schedule, out: Solution
) -> bool:
    """Update the filter with measurement a of the aids, `age` seconds old; return whether it was used.

    The navigator must be the mean, and its points outdated: they are placed anew. With d the predicted
    measurement of the navigator minus that of a point, and x the error of the navigator relative to the
    point, the innovation is z minus the mean of d, its variance that of d plus R, and the gain the covariance
    of x and d over that variance.
    """
    state, P, x, aids = run.state, run.P, run.x, run.aids
    kind, value, field, n = aids.kind[a], aids.value[a], aids.field[a], x.size
    row, gain = run.H[0], run.H[1]  # workspace
    of_tilts = seen_azimuth_variance(state, kind, field, P)
    if of_tilts == math.inf:
        return False
    z = predict_aid(state, north_axes(state, age), kind, value, field, aids.place, age, dt, row)
    draw_sigma_points(state, P, run.order, run.root, x, run.points, run.places)
    mean, square = 0.0, 0.0
    for i in range(n):
        gain[i] = 0.0
    for point in range(2 * n):
        there = view_point(run.points, point)
        _turn_as_biased(state, there)
        seen = predict_aid(there, north_axes(there, age), kind, value, field, aids.place, age, dt, row)
        d = _difference(kind, z, seen)
        mean += WEIGHT * d
        square += WEIGHT * d * d
        size = SPREAD if point < n else -SPREAD
        for i in range(n):
            gain[i] += WEIGHT * d * size * run.root[i, point % n]
    nu, s = _difference(kind, z, mean), square - mean * mean + aids.variance[a]
    if kind in (HEADING, MAGNETIC):  # where even the points do not show how north and azimuth vary
        s += of_tilts + north_variance(state, 0.5 * (P[0, 0] + P[1, 1]))
    out.aid_innovation[a], out.aid_variance[a] = nu, s
    if nu * nu > schedule.aid_gate * s:
        return False
    for i in range(n):
        x[i] = gain[i] / s * nu
        for j in range(n):
            P[i, j] -= gain[i] * gain[j] / s
    displace(state, x, run.places)
    transport(P, (x[6], x[7], x[8]))
    return True
