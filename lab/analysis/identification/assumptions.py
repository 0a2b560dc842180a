"""Assumptions: the filter's assumptions about its sensors, as a few parameters and as settings.

The parameters are a factor for the noise of each triad, a factor for the drive of its biases, three factors
for a fix, latency, and lever arm. The search uses the logarithms of noise and σ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.identification.identification import Row
from lab.analysis.identification.likelihood import Parameter
from lab.analysis.verdicts.finding import Change
from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI, si
from lab.navigation.belief import assumed_lever_arm, belief
from lab.navigation.filters.blocks import IMU_DENSITIES
from lab.run.experiment_settings import ExperimentSettings
from lab.run.run import Run
from lab.sensors.suite import SensorSuite

NOISE, FIX, LATENCY, LEVER_ARM = slice(0, 4), slice(4, 7), 7, slice(8, 11)
"""Slices of the parameters: logarithms of noise and of σ of a fix, then latency [s] and lever arm [m]."""
LOGARITHMS = slice(0, 7)
"""Slice of the logarithms."""
PARAMETERS = 11
"""Number of parameters."""
TRIADS = ("gyro", "accelerometer")
NAMES = (
    "gyro noise density",
    "accelerometer noise density",
    "gyro bias drive",
    "accelerometer bias drive",
    "horizontal position variance",
    "vertical position variance",
    "velocity variance",
    "latency",
    "lever arm forward",
    "lever arm right",
    "lever arm down",
)

FACTOR = 3.5
"""Prior σ of a logarithm: noise is initially known within a factor of 1000."""
LATE = 1.0
"""Prior σ of the latency [s]; receivers have 0 to 0.5 s."""
ARM = 5.0
"""Prior σ of the lever arm [m]: for vehicles up to airliners."""
OBSERVABLE = 1 / 3
"""Fraction of the prior σ below which a parameter counts as observable."""
MEETING = 60.0
"""Time at which the start value of an unassumed drive reaches the white noise [s]: a smaller drive does not
show in a flight of minutes."""
LONGEST_LATENCY = 60.0
"""Largest latency [s], of either sign, that is written into the settings: `navigator.latency` accepts it."""
FARTHEST = 50.0
"""Largest logarithm of an end of an interval over its estimate: e⁵⁰ is finite, and beyond any use."""
FLOOR = 0.1
"""Smallest part of the variance of a fix that is believed, of the receiver's own or of that of the settings.
What neighbouring fixes share does not show in innovations, and the white rest of a stand-alone receiver may
be of centimetres: a third of its σ is left."""
NOTHING = 10.0
"""Logarithm at which noise counts as zero: 20,000 times less than the start value of the search."""


class Assumed(NamedTuple):
    """The assumptions of a filter.

    Attributes
    ----------
    noise : (12,) array
        Densities of the process noise, as in `Belief`.
    factors : (3,) array
        Factors on the variances of a fix: horizontal position, vertical position, velocity.
    latency : float
        [s].
    lever_arm : (3,) array
        [m].
    """

    noise: FloatArray
    factors: FloatArray
    latency: float
    lever_arm: FloatArray

    def moved(self, by: FloatArray) -> Assumed:
        """Return other assumptions from the parameters (11,); the logarithms are those of factors."""
        noise = self.noise.reshape(4, 3) * np.exp(2 * by[NOISE])[:, None]
        return Assumed(noise.ravel(), self.factors * np.exp(2 * by[FIX]), float(by[LATENCY]), by[LEVER_ARM])

    def on(self, experiment: ExperimentSettings) -> ExperimentSettings:
        """Return a copy of an experiment whose filter has these assumptions."""
        changed = experiment.copy()
        navigator = changed.navigator
        navigator.q = (self.noise / navigator.q_scale).tolist()
        navigator.r_factors = self.factors.tolist()
        navigator.latency = float(np.clip(self.latency, -LONGEST_LATENCY, LONGEST_LATENCY))
        navigator.lever_arm = self.lever_arm.tolist()
        return changed


def assumed(run: Run) -> Assumed:
    """Return the assumptions of a run's filter."""
    sensors, navigator = run.experiment.sensors, run.experiment.navigator
    return Assumed(
        belief(sensors, navigator).noise[:IMU_DENSITIES],
        np.array(navigator.r_factors),
        run.latency,
        assumed_lever_arm(navigator, run.own_lever_arm),
    )


def apply_advice(now: Assumed, changes: Sequence[Change]) -> Assumed | None:
    """Return the assumptions with the one change that a verdict advises; None if it is of something else."""
    if len(changes) != 1:
        return None
    path, value, times, rows = changes[0]
    if not isinstance(value, float | int):
        return None
    if path == "navigator.latency":
        return now._replace(latency=float(value))
    if not times:
        return None
    noise, factors = now.noise.copy(), now.factors.copy()
    if path in ("navigator.q_scale", "navigator.q"):
        noise[slice(*(rows or (None,)))] *= value
    elif path == "navigator.r_scale" or (path == "navigator.r" and rows in _FIX_ROWS):
        factors[_FIX_ROWS[rows] if rows else slice(None)] *= value
    else:
        return None
    return now._replace(noise=noise, factors=factors)


_FIX_ROWS = {(0, 3): slice(0, 2), (2, 3): slice(1, 2), (3, 6): slice(2, 3)}
"""The factors of rows of R."""


def without_zeros(now: Assumed) -> Assumed:
    """Return assumptions as the start of a search, without zeros."""
    begin = now.noise.reshape(4, 3).copy()
    usual = SensorSuite().groups()
    for row, triad in enumerate(TRIADS):
        if not begin[row].any():
            begin[row] = si(usual[triad], "noise_density") ** 2
        if not begin[2 + row].any():
            begin[2 + row] = 3 * begin[row].mean() / MEETING**2
    return now._replace(noise=begin.ravel())


def least_factors(run: Run, now: Assumed) -> FloatArray:
    """Return the smallest factors (3,) on the variances of a fix: `FLOOR`, or what is assumed if smaller."""
    settings = run.experiment.copy()
    scale = settings.navigator.r_scale
    unscaled = _fix_variances(settings, {"r_factors": 1.0})
    matched = _fix_variances(settings, {"r_factors": 1.0, "r": None, "r_scale": 1.0})
    own = np.repeat(own_sigma(run), (2, 1))
    least = FLOOR * np.where(own, 1 / scale, matched / unscaled)
    return np.asarray(np.minimum(least, now.factors))


def parameters(now: Assumed, least: FloatArray) -> list[Parameter]:
    """Return the parameters of the search with their bounds; `least` are the `least_factors`."""
    lows = [*(-12.0,) * FIX.start, *(0.5 * np.log(least / now.factors))]
    logarithms = [
        Parameter(name, 0.0, min(float(low), 0.0), 12.0, FACTOR, 1e-3, 2.0)
        for name, low in zip(NAMES[LOGARITHMS], lows, strict=True)
    ]
    arms = [
        Parameter(name, float(arm), -100.0, 100.0, ARM, 1e-2, 5.0)
        for name, arm in zip(NAMES[LEVER_ARM], now.lever_arm, strict=True)
    ]
    return [*logarithms, Parameter(NAMES[LATENCY], now.latency, -3.0, 3.0, LATE, 0.05, 0.3, both=True), *arms]


class Known(NamedTuple):
    """What the log shows of a parameter, in the coordinate of the search.

    Attributes
    ----------
    value, sigma : float
        Estimate and its standard deviation.
    low, high : float
        95 % interval.
    bounded : bool
        Whether the log only shows an upper bound.
    """

    value: float
    sigma: float
    low: float
    high: float
    bounded: bool

    def excludes(self, value: float) -> bool:
        """Return whether the interval excludes a value."""
        return not (self.bounded or self.low <= value) or value > self.high


def tabulate_parameters(
    run: Run,
    now: Assumed,
    begun: Assumed,
    found: Assumed,
    known: Mapping[int, Known],
    intervals: Mapping[int, tuple[float, float]],
) -> tuple[Row, ...]:
    """Return the table of the parameters.

    Parameters
    ----------
    run
        The run.
    now, begun, found
        The filter's assumptions, the start values of the search, and the new assumptions.
    known
        What the log shows of each parameter.
    intervals
        95 % intervals of the logarithms, whatever the other noises are.
    """
    rows, changed = [], differing_parameters(now, found)
    before, after, start = (_shown_values(run, of) for of in (now, found, begun))
    for index, name in enumerate(NAMES):
        unit, old = before[index]
        new = after[index][1] if changed[index] else old
        one, low, high, sigma = known.get(index), math.nan, math.nan, math.nan
        if one is not None:
            sigma, low, high = one.sigma, one.low, one.high
        if index in intervals:
            power = 2.0 if FIX.start <= index < FIX.stop else 1.0
            low, high = (start[index][1] * _factor(power * by) for by in intervals[index])
            if one is not None:
                sigma *= start[index][1] * _factor(power * one.value) * power
        rows.append(Row(name, unit, old, new, sigma, low, high, one is not None, bool(changed[index])))
    return tuple(rows)


def _factor(logarithm: float) -> float:
    """Return a factor that is finite, from its logarithm."""
    return 0.0 if logarithm == -math.inf else math.exp(float(np.clip(logarithm, -FARTHEST, FARTHEST)))


def differing_parameters(now: Assumed, found: Assumed) -> NDArray[np.bool_]:
    """Return the mask (11,) of the parameters that differ."""
    noise = (now.noise != found.noise).reshape(4, 3).any(axis=1)
    others = now.latency != found.latency, *(now.lever_arm != found.lever_arm)
    return np.array([*noise, *(now.factors != found.factors), *others])


def mix_assumptions(now: Assumed, found: Assumed, chosen: NDArray[np.bool_]) -> Assumed:
    """Return the new assumptions for chosen parameters (11,), and the old ones for the others."""
    return Assumed(
        np.where(np.repeat(chosen[NOISE], 3), found.noise, now.noise),
        np.where(chosen[FIX], found.factors, now.factors),
        found.latency if chosen[LATENCY] else now.latency,
        np.where(chosen[LEVER_ARM], found.lever_arm, now.lever_arm),
    )


def scaled_rows(run: Run, now: Assumed, found: Assumed) -> tuple[Row, ...]:
    """Return the table of the parameters of a filter whose R and Q are multiplied.

    Parameters
    ----------
    run
        The run.
    now, found
        The filter's assumptions, and those with the factors.
    """
    both = zip(NAMES, _shown_values(run, now), _shown_values(run, found), strict=True)
    return tuple(
        Row(name, unit, before, after, *(math.nan,) * 3, False, before != after)
        for name, (unit, before), (_, after) in both
    )


def _shown_values(run: Run, of: Assumed) -> list[tuple[str, float]]:
    """Return unit and value of each parameter for display; rms over the axes."""
    units = ("°/s/√Hz", "µg/√Hz", "°/h/√h", "mg/√h")
    amplitude = np.sqrt(of.noise.reshape(4, 3).mean(axis=1))
    values = [(unit, float(value / TO_SI[unit])) for unit, value in zip(units, amplitude, strict=True)]
    variances = _variances(run)
    for part, factor in enumerate(of.factors):
        kind = "m²" if part < 2 else "(m/s)²"
        known = variances[part]
        values.append(("× own", float(factor)) if known is None else (kind, float(known * factor)))
    values.append(("s", float(of.latency)))
    return values + [("m", float(arm)) for arm in of.lever_arm]


def own_sigma(run: Run) -> tuple[bool, bool]:
    """Return whether the σ of the fixes of a log is used, for position and for velocity."""
    if not run.recorded or run.experiment.navigator.r is not None:
        return False, False
    gnss = run.recorded.log.gnss
    return bool(np.isfinite(gnss.position_sigma).any()), bool(np.isfinite(gnss.velocity_sigma).any())


def _variances(run: Run) -> tuple[float | None, ...]:
    """Return the variances to which the factors apply; None if each fix has its own."""
    known = _fix_variances(run.experiment.copy(), {"r_factors": 1.0})
    own = np.repeat(own_sigma(run), (2, 1))
    return tuple(None if of_fixes else float(value) for of_fixes, value in zip(own, known, strict=True))


def _fix_variances(settings: ExperimentSettings, navigator: dict[str, Any]) -> FloatArray:
    """Return the assumed variances (3,) of a fix with some settings of the filter changed."""
    settings.navigator.update(navigator)
    R = np.diag(belief(settings.sensors, settings.navigator).R)
    return np.array([R[:2].mean(), R[2], R[3:].mean()])
