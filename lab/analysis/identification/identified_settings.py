"""Identified settings: the settings with which a filter assumes identified parameters."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.analysis.identification.assumptions import (
    FIX,
    LATENCY,
    LEVER_ARM,
    NAMES,
    NOISE,
    TRIADS,
    Assumed,
    differing_parameters,
    mix_assumptions,
    own_sigma,
)
from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI, si
from lab.navigation.belief import belief
from lab.navigation.filters.blocks import IMU_DENSITIES
from lab.run.run import Run

REACHED = 0.01
"""Relative difference from which a setting is said not to reach the identified value."""
SAME = 1e-9
"""Relative difference of factors that rounding explains."""


def list_changes(run: Run, now: Assumed, found: Assumed, names: Collection[str] = NAMES) -> dict[str, Any]:
    """Return the settings, nested by group, with which a run's filter assumes the identified parameters.

    For a simulated run, these are settings of the filter; for a log, those of the sensors, which its filter
    assumes.

    Parameters
    ----------
    run
        The run.
    now, found
        The filter's assumptions, and the new ones.
    names
        Names of the parameters that may change.
    """
    seen = differing_parameters(now, found) & np.array([name in names for name in NAMES])
    found = mix_assumptions(now, found, seen)
    navigator: dict[str, Any] = {}
    if seen[LATENCY]:
        navigator["latency"] = _digits(found.latency)
    if seen[LEVER_ARM].any():
        navigator["lever_arm"] = [_digits(arm) for arm in found.lever_arm]
    if not run.recorded:
        if seen[NOISE].any():
            navigator |= _noise_of_filter(run, now, found)
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


def _noise_of_filter(run: Run, now: Assumed, found: Assumed) -> dict[str, Any]:
    """Return settings of the filter for its process noise: the scale alone if all of it changes alike."""
    known = now.noise > 0
    ratio = found.noise[known] / now.noise[known]
    if ratio.size and np.ptp(ratio) < SAME * ratio[0] and not found.noise[~known].any():
        return {"q_scale": _digits(float(run.experiment.navigator.q_scale) * float(ratio[0]))}
    return {"q": [_digits(density) for density in found.noise], "q_scale": 1.0}


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


def at_bounds(
    run: Run, now: Assumed, found: Assumed, changes: dict[str, Any], least: FloatArray
) -> tuple[str, ...]:
    """Return the names of the parameters whose settings do not reach the identified value, or of the least R.

    Parameters
    ----------
    run
        The run.
    now, found
        The filter's assumptions, and the new ones.
    changes
        The settings with them.
    least : (3,) array
        The `least_factors`.
    """
    changed = run.experiment.copy().update(changes)
    noise = belief(changed.sensors, changed.navigator).noise[:IMU_DENSITIES].reshape(4, 3)
    wanted = found.noise.reshape(4, 3)
    short = (np.abs(noise - wanted) > REACHED * wanted).any(axis=1)
    least_of_all = (found.factors < (1 + REACHED) * least) & (found.factors < now.factors)
    return tuple(name for name, at in zip(NAMES, np.concatenate((short, least_of_all)), strict=False) if at)
