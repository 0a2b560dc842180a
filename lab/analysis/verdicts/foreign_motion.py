"""Foreign motion: whether the innovations of a velocity depend on the motion as a wrong heading makes them.

A heading that is off by ψ turns the acceleration that a filter integrates. The filter forgets the error with
its gain K. So an innovation is ψ times a sum of gains of velocity, turned by 90°, whose weights fall by 1 − K
from fix to fix. K is not known, so that several are tried. In an even turn, fixes that are late by τ make the
same innovations, τ times changes of the acceleration: the heading is named where a delay explains much less.

The noise of a fix is in its own innovation, so that the accelerations are those without this fix. The
innovations of a matched filter are independent of the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Weighed
from lab.analysis.verdicts.finding_table import FOREIGN_FINDINGS
from lab.analysis.verdicts.foreign_evidence import FEWEST, Measurement
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.data.log.filter_log import AXES, nearest
from lab.data.log.sensor_log import GnssLog

GAINS = (0.02, 0.03, 0.05, 0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.8)
"""Gains of the velocity that are tried: memories of 50 fixes to one."""
BASELINE = 0.5
"""Least time before and after over which an acceleration is taken [s]: its noise falls with that."""
LATEST = 0.5
"""Longest delay that is a delay [s]: receivers have 0.05 to 0.3 s."""
LEFT_OUT = 1
"""Fixes beside that of an innovation that are left out with it: clocks of a log differ."""
SECOND_DIFFERENCES = 0.455 * 6
"""Median square of second differences of white noise, in its variance."""
CLEAR = 4.0
"""Smallest mean square of the accelerations over that of their noise."""


class HeadingError(NamedTuple):
    """What innovations of a velocity say of the heading.

    Attributes
    ----------
    size, sigma : float
        Heading error while the velocity changed, without a sign, and its σ [rad]; true within a factor of
        two, since K is one of a few.
    gain : float
        Growth of the log-likelihood by it.
    delay : float
        Growth of the log-likelihood by a delay of at most `LATEST` in its place.
    number : int
        Of innovations.
    """

    size: float
    sigma: float
    gain: float
    delay: float
    number: int


def heading_error(one: Measurement, gnss: GnssLog, epoch: float) -> HeadingError | None:
    """Return what the innovations of a velocity say of the heading; None if the log does not show it.

    Parameters
    ----------
    one
        Innovations.
    gnss
        The fixes of the same log.
    epoch
        Time of the log at their time zero [s].
    """
    velocity = np.asarray(gnss.velocity_n)[:, :2]
    fine = np.isfinite(velocity).all(axis=1)
    at, velocity = (gnss.time - gnss.latency + epoch)[fine], velocity[fine]
    time, axes = one.innovations.time, one.innovations.axes
    if one.innovations.unit != "m/s" or not set(AXES[:2]) <= set(axes) or min(len(at), len(time)) < FEWEST:
        return None
    level = [axes.index(name) for name in AXES[:2]]
    nu, values = one.innovations.normalised[:, level], one.innovations.values[:, level]
    period = float(np.median(np.diff(at)))
    if not period > 0:
        return None  # damaged times
    width = max(1, round(BASELINE / period))
    rows = nearest(at, time)
    inside = (np.abs(at[rows] - time) < period) & np.isfinite(nu).all(axis=1)
    inside &= (rows >= width + LEFT_OUT) & (rows < len(at) - width - LEFT_OUT)
    nu, values, rows = nu[inside], values[inside], rows[inside]
    a = _acceleration(velocity, width, period)
    noise = float(np.median(np.diff(velocity, 2, axis=0) ** 2)) / SECOND_DIFFERENCES
    if len(rows) < FEWEST or not nu.any() or np.mean(a**2) < CLEAR * noise / (2 * (width * period) ** 2):
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.abs(values / nu)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0), sigma, np.nanmedian(sigma))
    turned, late = [], []
    for gain in GAINS:
        both = (_interpolate_neighbours(velocity, width, period, gain)[:, rows] / sigma).reshape(2, -1)
        turned.append(_growth(both[0], nu.ravel()))
        late.append(_growth(both[1], nu.ravel(), LATEST))
    growth, size, spread = max(turned)
    return HeadingError(abs(size), spread, growth, max(late)[0], len(rows))


def _acceleration(velocity: FloatArray, width: int, period: float) -> FloatArray:
    """Return the accelerations (m, 2) over some fixes before and after; zero at both ends."""
    a = np.zeros_like(velocity)
    a[width:-width] = (velocity[2 * width :] - velocity[: -2 * width]) / (2 * width * period)
    return a


def _responses(velocity: FloatArray, width: int, period: float, gain: float) -> FloatArray:
    """Return the innovations (2, m, 2) by a heading error and by a delay of one."""
    a = _acceleration(velocity, width, period)
    changes = np.diff(a, axis=0, prepend=a[:1])
    inputs = np.stack((period * a[:, ::-1] * (-1.0, 1.0), changes))
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, gain - 1.0], inputs, axis=1))


def _interpolate_neighbours(velocity: FloatArray, width: int, period: float, gain: float) -> FloatArray:
    """Return the same with each fix and those beside it interpolated between the next ones."""
    found = _responses(velocity, width, period, gain)
    centre, span = 2 * width + LEFT_OUT + 1, LEFT_OUT + 1
    impulse = np.zeros((2 * centre + 1, 2))
    impulse[centre] = 1.0
    weights = _responses(impulse, width, period, gain)
    last = len(velocity) - span
    for offset in range(-LEFT_OUT, LEFT_OUT + 1):
        part = (offset + span) / (2 * span)
        change = np.zeros_like(velocity)
        between = (1 - part) * velocity[: -2 * span] + part * velocity[2 * span :]
        change[span:last] = between - velocity[span + offset : last + offset]
        found += weights[:, None, centre - offset] * np.stack((change[:, ::-1], change))
    return found


def _growth(response: FloatArray, nu: FloatArray, most: float = np.inf) -> tuple[float, float, float]:
    """Return the growth of the log-likelihood by a multiple of a response, the multiple, and its σ."""
    square = float(response @ response)
    if not square > 0:
        return 0.0, 0.0, np.inf
    size = float(np.clip(response @ nu / square, -most, most))
    left = float(np.mean((nu - size * response) ** 2))
    growth = nu.size / 2 * float(np.log(np.mean(nu**2) / left)) if left > 0 else 0.0
    return growth, size, float(np.sqrt(left / square))


def of_heading(one: Measurement, gnss: GnssLog, epoch: float) -> list[Weighed]:
    """Return the finding that the heading is wrong, if the innovations of a velocity show it."""
    found = heading_error(one, gnss, epoch)
    if found is None or found.size < limits.VERDICT.foreign_heading:
        return []
    if found.gain < max(limits.VERDICT.heading_gain, limits.VERDICT.over_delay * found.delay):
        return []
    degrees = np.degrees([found.size, found.sigma])
    evidence = (
        f"{format_number(degrees[0])} ± {format_number(degrees[1])}° within a factor of two, by the "
        "accelerations of the "
        f"fixes; growth of the log-likelihood {found.gain:.0f}, by a delay {found.delay:.0f}; {found.number} "
        f"innovations ({one.innovations.source})"
    )
    finding = FOREIGN_FINDINGS["heading"].finding(
        found.size, evidence, kind=one.innovations.name, size=format_number(degrees[0])
    )
    return [Weighed(float("inf"), finding)]  # it stands before what it explains
