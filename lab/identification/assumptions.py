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

from lab.analysis.identification import Row
from lab.analysis.likelihood import Estimate, Parameter
from lab.experiment_settings import ExperimentSettings
from lab.navigation.belief import assumed_lever_arm, belief
from lab.navigation.blocks import IMU_DENSITIES
from lab.parameters.units import TO_SI, si
from lab.run import Run
from lab.sensors.suite import SensorSuite

FloatArray = NDArray[np.float64]

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


def assumed(run: Run) -> tuple[Assumed, FloatArray]:
    """Return the assumptions of a run's filter, and the start values of a search, without zeros."""
    sensors, navigator = run.experiment.sensors, run.experiment.navigator
    noise = belief(sensors, navigator).noise[:IMU_DENSITIES]
    now = Assumed(
        noise,
        np.array(navigator.r_factors),
        run.latency,
        assumed_lever_arm(navigator, run.own_lever_arm),
    )
    begin = noise.reshape(4, 3).copy()
    usual = SensorSuite().groups()
    for row, triad in enumerate(TRIADS):
        if not begin[row].any():
            begin[row] = si(usual[triad], "noise_density") ** 2
        if not begin[2 + row].any():
            begin[2 + row] = 3 * begin[row].mean() / MEETING**2
    return now, begin.ravel()


def parameters(now: Assumed) -> list[Parameter]:
    """Return the parameters of the search with their bounds."""
    logarithms = [Parameter(name, 0.0, -12.0, 12.0, FACTOR, 1e-3, 2.0) for name in NAMES[LOGARITHMS]]
    arms = [
        Parameter(name, float(arm), -100.0, 100.0, ARM, 1e-2, 5.0)
        for name, arm in zip(NAMES[LEVER_ARM], now.lever_arm, strict=True)
    ]
    return [*logarithms, Parameter(NAMES[LATENCY], now.latency, -3.0, 3.0, LATE, 0.05, 0.3, both=True), *arms]


def rows_of(
    run: Run,
    now: Assumed,
    begun: Assumed,
    estimate: Estimate,
    intervals: Mapping[int, tuple[float, float]],
    bounded: NDArray[np.bool_],
) -> tuple[Row, ...]:
    """Return the table of the parameters.

    Parameters
    ----------
    run
        The run.
    now, begun
        The filter's assumptions, and the start values of the search.
    estimate
        The estimated parameters.
    intervals
        Ends of the 95 % interval of each parameter that the log shows.
    bounded : (11,) array
        Mask of the parameters for which the log only shows an upper bound.
    """
    found, rows = begun.moved(estimate.value), []
    before, after = _shown_values(run, now), _shown_values(run, found)
    for index, name in enumerate(NAMES):
        unit, old = before[index]
        _, new = after[index]
        if index not in intervals:
            rows.append(Row(name, unit, old, old, math.nan, math.nan, math.nan, False))
            continue
        low, high = intervals[index]
        sigma = float(estimate.sigma[index])
        if index < LOGARITHMS.stop:
            power = 2.0 if FIX.start <= index < FIX.stop else 1.0
            low, high = (
                new * math.exp(float(np.clip(power * (end - estimate.value[index]), -FARTHEST, FARTHEST)))
                for end in (low, high)
            )
            low, sigma = 0.0 if bounded[index] else low, new * power * sigma
        rows.append(Row(name, unit, old, new, sigma, low, high, True))
    return tuple(rows)


def scaled_rows(run: Run, now: Assumed, r: float, q: float) -> tuple[Row, ...]:
    """Return the table of the parameters of a filter whose R and Q are multiplied.

    Parameters
    ----------
    run
        The run.
    now
        The filter's assumptions.
    r, q
        The factors on R and on Q.
    """
    found = now._replace(noise=q * now.noise, factors=r * now.factors)
    both = zip(NAMES, _shown_values(run, now), _shown_values(run, found), strict=True)
    return tuple(
        Row(name, unit, before, after, math.nan, math.nan, math.nan, False)
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
    settings = run.experiment.copy()
    settings.navigator.r_factors = 1.0
    R = np.diag(belief(settings.sensors, settings.navigator).R)
    position, velocity = own_sigma(run)
    horizontal, vertical = float(R[:2].mean()), float(R[2])
    return (
        None if position else horizontal,
        None if position else vertical,
        None if velocity else float(R[3:].mean()),
    )


def changes_of(run: Run, rows: Sequence[Row], found: Assumed) -> dict[str, Any]:
    """Return the settings, nested by group, with which a run's filter assumes the identified parameters.

    For a simulated run, these are settings of the filter; for a log, those of the sensors, which its filter
    assumes.

    Parameters
    ----------
    run
        The run.
    rows
        The table of the parameters; unobservable ones do not change.
    found
        The new assumptions, including those that do not change.
    """
    seen = np.array([row.observable for row in rows])
    navigator: dict[str, Any] = {}
    if seen[LATENCY]:
        navigator["latency"] = _digits(found.latency)
    if seen[LEVER_ARM].any():
        navigator["lever_arm"] = [_digits(arm) for arm in found.lever_arm]
    if not run.recorded:
        if seen[NOISE].any():
            scale = float(run.experiment.navigator.q_scale)
            navigator["q"] = [_digits(density / scale) for density in found.noise]
        if seen[FIX].any():
            navigator["r_factors"] = [_digits(factor) for factor in found.factors]
        return {"navigator": navigator}
    sensors = _noise_settings(run, found, seen)
    gps, factors = _fix_settings(run, found, seen)
    if gps:
        sensors["gps"] = gps
    if factors:
        navigator["r_factors"] = factors
    if seen[NOISE].any() and run.experiment.navigator.q is not None:
        navigator["q"] = None
    if seen[NOISE].any() and run.experiment.navigator.q_scale != 1:
        navigator["q_scale"] = 1.0
    return {name: group for name, group in (("sensors", sensors), ("navigator", navigator)) if group}


def _noise_settings(run: Run, found: Assumed, seen: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the settings of the triads whose matched process noise equals the identified one.

    If Q is given or scaled, all of it becomes part of the sensor settings.
    """
    settings, noise = run.experiment, found.noise.reshape(4, 3)
    every = settings.navigator.q is not None or settings.navigator.q_scale != 1
    sensors: dict[str, Any] = {}
    for row, triad in enumerate(TRIADS):
        group, terms = settings.sensors.groups()[triad], {}
        if seen[row] or (every and seen[NOISE].any()):
            unit = group.param["noise_density"].unit
            bound = float(group.param["noise_density"].bounds[1])
            wanted = np.sqrt(noise[row]) / TO_SI[unit]
            terms["noise_density"] = [_digits(value) for value in np.minimum(wanted, bound)]
            if triad == "accelerometer":
                rest = np.sqrt(np.maximum(wanted**2 - bound**2, 0))
                terms["vibration_density"] = [_digits(value) for value in rest]
        if seen[2 + row] or (every and seen[NOISE].any()):
            unit = group.param["rate_random_walk"].unit
            low, high = group.param["rate_random_walk"].bounds
            walk = np.clip(np.sqrt(noise[2 + row]) / TO_SI[unit], low, high)
            # Other bias processes become random walks; they stay part of the initial uncertainty.
            start = np.hypot(si(group, "bias_sigma"), si(group, "instability"))
            unit = group.param["bias_sigma"].unit
            terms |= {
                "rate_random_walk": [_digits(value) for value in walk],
                "bias_sigma": [_digits(value) for value in start / TO_SI[unit]],
                "instability": [0.0] * 3,
                "flicker": [0.0] * 3,
            }
        if terms:
            sensors[triad] = terms
    return sensors


def _fix_settings(
    run: Run, found: Assumed, seen: NDArray[np.bool_]
) -> tuple[dict[str, Any], list[float] | None]:
    """Return settings of the receiver, or factors if its fixes have their own σ or R is given."""
    gps: dict[str, Any] = {}
    if not seen[FIX].any():
        return gps, None
    navigator = run.experiment.navigator
    old, factors = np.array(navigator.r_factors), found.factors.copy()
    if navigator.r is None and not any(own_sigma(run)):
        sensors = run.experiment.sensors.gps
        ratio = factors / old
        position = np.array(sensors.position_variance) * (ratio[0], ratio[0], ratio[1])
        for name, values in (
            ("position_variance", position),
            ("velocity_variance", np.array(sensors.velocity_variance) * ratio[2]),
        ):
            low, high = sensors.param[name].bounds
            gps[name] = [_digits(value) for value in np.clip(values, low, high)]
        return gps, None
    return gps, [_digits(factor) for factor in factors]


def _digits(value: float) -> float:
    """Return a number with the digits of a setting."""
    return float(f"{value:.6g}")
