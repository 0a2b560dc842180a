"""Observability: the reduction of the filter's σ by the fixes, over time and by manoeuvre.

A GPS receiver measures only position and velocity. Attitude and biases are observed through their effect on
the velocity, which depends on the motion: the tilts through gravity at all times, the heading through
horizontal acceleration, the biases through turns. See Groves, *Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems*, 2nd ed., ch. 14.2.1 and 14.2.6, and D. Goshen-Meskin, I. Y. Bar-Itzhack,
*Observability analysis of piece-wise constant systems*, IEEE Trans. AES 28 (1992).
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.budget import (
    believed_sigma,
    check_gains,
    quantities,
    sigma_of_quantities,
)
from lab.analysis.gains import choose_epochs
from lab.base.arrays import FloatArray
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation import strapdown
from lab.navigation.filters.error_models import ATT, ErrorModel
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.schedule import EVERY_FIX
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.frames import set_motion
from lab.navigation.navigator import advance, free_inertial
from lab.navigation.solution import Fixes, Imu, Solution, Start
from lab.run.run import Run

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


AT_REST = 0.5
"""Speed below which a vehicle is at rest [m/s]. On the shipped flights, 0.2 to 1.2 m/s give the same
manoeuvres."""
TURNING = np.radians(1.5)
"""Rate of the heading above which it turns, half the rate of a standard turn [rad/s]."""
ACCELERATING = 0.5
"""Rate of change of the speed above which it accelerates or brakes [m/s²]. The level stretches of Montréal
reach 0.46 m/s², its take-off run 2 m/s²; 0.35 to 1.2 m/s² give the same manoeuvres of Montréal and of Los
Angeles."""
CLIMBING = 1.0
"""Vertical speed above which it climbs or descends [m/s]. The climbs of Montréal and Los Angeles have 2.9 to
4.3 m/s; 0.4 to 2 m/s give the same manoeuvres."""
SMOOTHING = 3.0
"""Averaging time of these quantities [s]."""
SHORTEST = 4.0
"""Shorter stretches are merged with the previous one [s]."""

REST, TAKE_OFF = "rest", "take-off run"
KINDS = (REST, "right turn", "left turn", "acceleration", "braking", "climb", "descent", "level stretch")
"""Kinds of manoeuvres in their order of precedence."""
AT_ONCE = 2**16
"""Samples whose attitude is computed together, with some 100 bytes each."""
WORTH_A_WORD = 10.0
"""Smallest share of the reduction for which a manoeuvre is named [%]: at most ten manoeuvres have as much."""
LEAST_REDUCTION = 0.01
"""Relative reduction of σ in a flight below which no manoeuvre is credited with it: rounding of P, and the
correlation with other states, reduce σ of what no manoeuvre shows by thousandths."""
MOVING = 2.0
"""Speed above which a vehicle goes somewhere by its fixes [m/s]: four σ of the velocity of a default one."""
STRAIGHT = 60.0
"""Shortest time without information on the heading that is remarked [s]. Level stretches of the shipped
flights last for up to a minute."""
UNCERTAIN = np.radians(3.0)
"""Smallest σ of the heading at its end that is remarked [rad]: by then, an error of the heading shows in the
plots, and a default gyro takes some 20 s to it."""
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")


class Manoeuvre(NamedTuple):
    """A stretch of a flight: its name, such as ``"first right turn"``, its kind, its start and end [s]."""

    name: str
    kind: str
    start: float
    end: float


def manoeuvres(truth: Truth) -> list[Manoeuvre]:
    """Return the manoeuvres of a flight from start to end.

    The order of precedence is: at rest, turning, accelerating or braking, climbing or descending, level. The
    limits are the constants of this file.

    Parameters
    ----------
    truth
        The flight, evenly sampled.
    """
    dt = float(truth.time[1] - truth.time[0])
    width = min(max(1, round(SMOOTHING / dt)), truth.time.size)
    north, east, down = truth.velocity_n.T
    speed = np.square(north, dtype=np.float64)
    speed += east**2
    speed += down**2
    np.sqrt(speed, out=speed)
    kinds = np.select(
        [
            _mean(speed, width) < AT_REST,
            # One after the other: each takes 23 MB in four hours.
            *_exceeds_limit(_mean(_heading_rate(truth, dt), width), TURNING),
            *_exceeds_limit(_mean(_slope(speed, dt), width), ACCELERATING),
            *_exceeds_limit(_mean(-down, width), CLIMBING),
        ],
        np.arange(len(KINDS) - 1, dtype=np.int8),
        default=np.int8(len(KINDS) - 1),
    )
    starts = np.flatnonzero(np.append(True, kinds[1:] != kinds[:-1]))
    return _name_stretches(
        _merge_stretches([KINDS[kinds[at]] for at in starts], truth.time[starts], float(truth.time[-1]))
    )


def _exceeds_limit(values: FloatArray, limit: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where values are above a limit, and where they are below its opposite."""
    return values > limit, values < -limit


def _heading_rate(truth: Truth, dt: float) -> FloatArray:
    """Return the rate of the heading (n,) [rad/s] from its differences about each sample."""
    samples = truth.time.size
    turned = np.empty(samples + 1)
    for first in range(0, samples - 1, AT_ONCE):
        last = min(first + AT_ONCE, samples - 1)
        heading = truth.taken(slice(first, last + 1)).euler[:, 2]
        turned[first + 1 : last + 1] = wrap(np.diff(heading))
    turned[0], turned[-1] = turned[1], turned[-2]  # at the ends, one side is known
    rate = turned[1:] + turned[:-1]
    rate /= 2 * dt
    return rate


def _slope(values: FloatArray, dt: float) -> FloatArray:
    """Return the derivative as `numpy.gradient` does, which takes three times the memory."""
    slope = np.empty_like(values)
    np.subtract(values[2:], values[:-2], out=slope[1:-1])
    slope[1:-1] /= 2 * dt
    slope[0], slope[-1] = (values[1] - values[0]) / dt, (values[-1] - values[-2]) / dt
    return slope


def _mean(values: FloatArray, width: int) -> FloatArray:
    """Return the moving mean over `width` samples, fewer at the ends."""
    size, before, after = values.size, width // 2, (width + 1) // 2
    sums = np.zeros(size + 1)
    np.cumsum(values, out=sums[1:])
    del values
    mean = np.empty(size)
    middle = mean[before : size - after + 1]
    np.subtract(sums[width:], sums[: size + 1 - width], out=middle)
    middle /= width
    for centre in (np.arange(before), np.arange(size - after + 1, size)):
        low, high = np.maximum(centre - before, 0), np.minimum(centre + after, size)
        mean[centre] = (sums[high] - sums[low]) / (high - low)
    return mean


def _merge_stretches(kinds: list[str], starts: FloatArray, end: float) -> list[Manoeuvre]:
    """Return the stretches, with too short ones merged."""
    found: list[Manoeuvre] = []
    for kind, start, until in zip(kinds, starts.tolist(), [*starts[1:].tolist(), end], strict=True):
        brief = until - start < SHORTEST and kind != REST
        if found and (brief or kind == found[-1].kind):
            found[-1] = found[-1]._replace(end=until)
        else:
            found.append(Manoeuvre(kind, kind, start, until))
    return found


def _name_stretches(stretches: list[Manoeuvre]) -> list[Manoeuvre]:
    """Return the stretches with their names, numbered if there are several of a kind."""
    kinds = [stretch.kind for stretch in stretches]
    for before, after in zip(range(len(kinds)), range(1, len(kinds)), strict=False):
        if kinds[before : after + 1] == ["acceleration", "climb"] and "climb" not in kinds[:before]:
            kinds[before] = TAKE_OFF
    several, seen = Counter(kinds), Counter[str]()
    named = []
    for stretch, kind in zip(stretches, kinds, strict=True):
        seen[kind] += 1
        number = seen[kind]
        ordinal = _ORDINALS[number - 1] if number <= len(_ORDINALS) else f"number {number},"
        named.append(stretch._replace(name=kind if several[kind] == 1 else f"{ordinal} {kind}", kind=kind))
    return named


def observability(run: Run) -> xr.Dataset:
    """Return the reduction of the filter's σ in a run.

    Parameters
    ----------
    run
        The run; its filter's covariance is used, its errors are not.

    Returns
    -------
    xr.Dataset
        ``sigma`` and ``free`` (time, quantity): σ according to the filter, and σ without any measurement, in
        the `unit` of the quantity. ``reduction`` (segment, quantity): natural logarithm of σ at the start of
        a manoeuvre over σ at its end, both after the last measurement; negative if σ grew. ``share``
        (segment, quantity): share of the sum of all reductions [%]. Coordinates `start` and `end` of the
        segments [s]. The times are those of the error budget.

    Raises
    ------
    SettingError
        If the solution is smoothed or from a user's algorithm.
    """
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    check_gains(run)
    units = quantities(run.blocks)
    epochs = choose_epochs(run)
    kept = epochs.sample[epochs.shown]
    found = manoeuvres(run.flown)
    edges = np.array([*(stretch.start for stretch in found), found[-1].end])
    at = np.append(0, epochs.sample[(epochs.fix >= 0) | (epochs.aid >= 0)])
    sigma = believed_sigma(run, kept)
    known = believed_sigma(run, at[np.searchsorted(run.time[at], edges, side="right") - 1])
    known = np.log(np.maximum(known, np.finfo(float).tiny))  # a certain quantity has no reduction
    reduction = known[:-1] - known[1:]
    gained = np.maximum(reduction, 0)
    total = gained.sum(axis=0)
    share = 100 * np.divide(gained, total, out=np.zeros_like(gained), where=total > LEAST_REDUCTION)
    dims = ("segment", "quantity")
    return xr.Dataset(
        {
            "sigma": (
                ("time", "quantity"),
                sigma,
                {"long_name": "σ according to the filter"},
            ),
            "free": (("time", "quantity"), _free_sigma(run, kept), {"long_name": "σ without fixes"}),
            "reduction": (dims, reduction, {"long_name": "logarithm of σ before over σ after"}),
            "share": (dims, share, {"units": "%", "long_name": "part of the reduction"}),
        },
        coords={
            "time": ("time", run.time[kept], {"units": "s", "long_name": "time"}),
            "quantity": list(units),
            "unit": ("quantity", list(units.values())),
            "segment": [stretch.name for stretch in found],
            "start": ("segment", edges[:-1], {"units": "s"}),
            "end": ("segment", edges[1:], {"units": "s"}),
        },
    )


def describe_straight_flight(run: Run) -> str:
    """Return a sentence about the longest time in which no fix shows the heading; empty if it matters little.

    The fixes are those that held it (`lab.navigation.filters.heading_observability`).
    """
    solution = run.solution_arrays
    used = np.flatnonzero(solution.fix_sample >= 0)
    moves = np.linalg.norm(solution.velocity_n[solution.fix_sample[used]], axis=1) > MOVING
    held = solution.fix_held[used].any(axis=1) & moves
    edges = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not edges.size:
        return ""
    at = solution.fix_sample[used]
    lasts = run.time[at[edges[:, 1] - 1]] - run.time[at[edges[:, 0]]]
    longest = int(np.argmax(lasts))
    sigma = float(np.sqrt(solution.variance[at[edges[longest, 1] - 1], ATT][2]))
    if lasts[longest] < STRAIGHT or sigma < UNCERTAIN:
        return ""
    return (
        f"The vehicle goes straight for {lasts[longest]:.0f} s: heading and vertical gyro bias are not "
        f"observable there, and σ of the heading reaches {np.degrees(sigma):.2g}°."
    )


def _free_sigma(run: Run, samples: NDArray[np.int64]) -> FloatArray:
    """Return σ of all quantities (m, states) at samples (m,) that the filter would have without any fix.

    A perfect IMU and start keep the navigator on the true flight, so that the covariance is propagated there.
    For a log, that flight is the estimated one, to which the navigator is reset at each fix.
    """
    flight, nothing = run.flown, np.zeros(3)
    start = Start.off(flight, nothing, nothing, nothing)
    model = with_blocks(linear_model("phi", run.experiment.navigator.mechanization), run.blocks)
    variance, covariance = np.empty((samples.size, model.states)), np.empty((samples.size, 2, 3))
    if run.ideal is None:
        led = _lead_along_fixes(run, start, model)
        variance[:], covariance[:] = led.variance[samples], led.covariance[samples]
    else:
        ideal = run.ideal
        for first, part in free_inertial(
            Imu(ideal.time, ideal.dtheta, ideal.dvelocity), start, run.belief, model=model
        ):
            here = (first <= samples) & (samples < first + part.variance.shape[0])
            variance[here] = part.variance[samples[here] - first]
            covariance[here] = part.covariance[samples[here] - first]
    return sigma_of_quantities(flight.taken(samples).euler, variance, covariance, run.blocks)


def _lead_along_fixes(run: Run, start: Start, model: ErrorModel) -> Solution:
    """Return the solution of a log without fixes, reset to the estimated one at the time of each fix."""
    imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
    none = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    out, led = Solution.empty(imu.time.size, 0, model.blocks), run.solution_arrays
    coasting = Filter.begin(start, run.belief._replace(R=np.eye(6)), imu.time[0], model)
    coasting.state[strapdown.GYRO_BIAS : strapdown.ACCEL_BIAS + 3] = led.bias[0]
    done = 0
    for end in [*np.unique(led.fix_sample[led.fix_sample > 0]).tolist(), imu.dtheta.shape[0]]:
        advance(
            coasting,
            Imu(imu.time[: end + 1], imu.dtheta[:end], imu.dvelocity[:end]),
            none,
            out,
            done,
            EVERY_FIX,
            model,
        )
        set_motion(coasting.state, led.position[end], led.velocity_n[end], led.q_nb[end])
        coasting.state[strapdown.GYRO_BIAS : strapdown.ACCEL_BIAS + 3] = led.bias[end]
        done = end
    return out


def observability_table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a table: σ of each quantity at start and end and without fixes, and the reducing manoeuvres.

    Parameters
    ----------
    dataset
        The result of `observability`.
    """
    import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

    rows = [
        (
            str(quantity),
            str(dataset.unit.values[index]),
            float(dataset.sigma[0, index]),
            float(dataset.sigma[-1, index]),
            float(dataset.free[-1, index]),
            _in_words(dataset, index),
        )
        for index, quantity in enumerate(dataset.quantity.values)
    ]
    return pd.DataFrame(
        rows, columns=["quantity", "unit", "σ at start", "σ at end", "without fixes", "brought by"]
    )


def _in_words(dataset: xr.Dataset, index: int) -> str:
    """Return the manoeuvres that reduced σ of a quantity, such as ``"68 % in the take-off run"``."""
    share = dataset.share.values[:, index]
    order = [segment for segment in np.argsort(-share, kind="stable") if share[segment] >= WORTH_A_WORD]
    if not order:
        return "nothing, σ never fell"
    names = dataset.segment.values
    return ", ".join(f"{share[segment]:.0f} % {_place(str(names[segment]))}" for segment in order)


def _place(name: str) -> str:
    return f"at {name}" if name == REST else f"in the {name}"
