"""State statistics: NEES and NIS over seeds for each further state and measurement, alone and all together.

Run it with ``python -m tests.benchmarks.state_statistics [seeds] [model] [words in names of cases ...]``.
Each line has the mean NEES per state of all states and of those of the case, the NIS of the fixes and of the
other measurements, each with half of its 99.8 % interval from the scatter of the runs, and whether all are
inside. Then follow outages of 60 s: the error at the end without and with a measurement, and its ratio to σ.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lab
from lab.analysis.consistency import find_uncertain_states, normalised_squares
from lab.analysis.errors import error_state
from lab.experiment.result import Result
from lab.navigation.filters import blocks
from lab.navigation.settings import NavigatorSettings

sys.path.insert(0, str(Path(__file__).parent.parent))
from aided_flights import flight, standing, winding_road

RATE: dict[str, Any] = {"trajectory.imu_rate": 50.0}
"""A low IMU rate [Hz]: the statistics are those of the filter. The chosen model is added."""
BOUND = 3.1
"""Half of the 99.8 % interval of a mean, in its σ."""
CLOSE = 0.05
"""What a filter that is linearised about its estimate may be off beside chance."""
ROAD, STANDING, AIR = "winding road", "standing", "los_angeles"

_DRIFT = {"sensors.gyro.instability": 60.0, "sensors.gyro.correlation_time": 30.0}
_DRIFT |= {"sensors.accelerometer.instability": 1.0, "sensors.accelerometer.correlation_time": 30.0}
_RECEIVER = {"sensors.gps.correlated_sigma": 2.0}
_ALL = {
    "navigator.states": 21,
    "sensors.gyro.scale_factor_sigma": 0.3,
    "sensors.accelerometer.scale_factor_sigma": 0.3,
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.heading.drift_sigma": 0.5,
    "sensors.odometer.fitted": True,
    "sensors.airspeed.fitted": True,
    **_RECEIVER,
    **_DRIFT,
    **{
        f"navigator.estimate_{what}": True
        for what in ("misalignments", "g_sensitivity", "bias_drift", "gps_drift", "lever_arm", "latency")
    },
}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "fifteen states": (AIR, {}),
    "misalignments": (AIR, {"navigator.estimate_misalignments": True}),
    "g-sensitivity": (AIR, {"navigator.estimate_g_sensitivity": True}),
    "bias drift": (AIR, {"navigator.estimate_bias_drift": True} | _DRIFT),
    "GPS drift": (AIR, {"navigator.estimate_gps_drift": True} | _RECEIVER),
    "lever arm": (AIR, {"navigator.estimate_lever_arm": True}),
    "latency": (AIR, {"navigator.estimate_latency": True}),
    "own states": (AIR, {"navigator.own_states": "g-sensitivity", "sensors.own_errors": "g-sensitivity"}),
    "barometer": (AIR, {"sensors.barometer.fitted": True}),
    "heading": (AIR, {"sensors.heading.fitted": True, "sensors.heading.drift_sigma": 1.0}),
    "magnetometer": (AIR, {"sensors.heading.fitted": True, "sensors.heading.source": "magnetometer"}),
    "odometer": (ROAD, {"sensors.odometer.fitted": True}),
    "airspeed": (AIR, {"sensors.airspeed.fitted": True}),
    "no slip": (ROAD, {"navigator.no_slip": True, "navigator.slip_sigma": (0.01, 0.01)}),
    "zero velocity": (STANDING, {"navigator.zero_velocity": True, "navigator.zero_velocity_sigma": 0.002}),
    "all together": (AIR, _ALL),
}
"""Missions and settings."""
CONDITIONS = ("no slip", "zero velocity")
"""Cases without a sensor: the simulated vehicles fulfil them exactly, so that σ is too large."""
_WHEELS = {"sensors.odometer.fitted": True, "navigator.no_slip": True, "navigator.slip_sigma": (0.05, 0.05)}
OUTAGES: dict[str, tuple[str, list[int], dict[str, Any]]] = {
    "barometer, down": ("montreal", [2], {"sensors.barometer.fitted": True}),
    "airspeed, level": ("montreal", [0, 1], {"sensors.airspeed.fitted": True}),
    "odometer and no slip, level": (ROAD, [0, 1], _WHEELS),
    "zero velocity, level": (STANDING, [0, 1], CASES["zero velocity"][1]),
}
"""Missions, states whose error counts, and settings."""


def g_sensitivity(rate: Any, force: Any, E: Any) -> None:
    """Write gyros that feel the specific force along their own axis."""
    for i in range(3):
        E[i, i] = force[i]


def states_at(result: Result, used: NDArray[Any]) -> NDArray[np.float64]:
    """Return the errors of all states (m, n) at some fixes, given by their numbers or a mask."""
    solution = result.solution_arrays
    return error_state(
        solution,
        solution.fix_sample[used],
        result.known_truth("errors"),
        result.true_bias,
        result.true_scale if solution.scale.size else None,
        result.true_further() if solution.further.size else None,
    )


def squares(result: Result) -> tuple[float, float, float, float]:
    """Return NEES per state, of all and of the further states, and NIS of fixes and other measurements."""
    solution = result.solution_arrays
    used = solution.fix_sample >= 0
    x = states_at(result, used)
    P = solution.fix_covariance[used]
    further = slice(blocks.CORE, None)
    own = np.nan
    if result.blocks:
        own = (
            normalised_squares(x[:, further], P[:, further, further]).mean()
            / find_uncertain_states(P[:, further, further]).size
        )
    aids = np.nan
    if result.aids.time.size:
        aids = float(np.nanmean(solution.aid_innovation**2 / solution.aid_variance))
    nees = normalised_squares(x, P).mean() / find_uncertain_states(P).size
    return float(nees), float(own), float(result.innovations["nis"].mean()) / 6, aids


def judged(mean: NDArray[np.float64], half: NDArray[np.float64], *, condition: bool) -> str:
    """Return whether mean squares are one within half an interval; a condition may hold better."""
    known = np.isfinite(mean)
    off = (mean - 1)[known] / (half + CLOSE)[known]
    if (np.abs(off) < 1).all():
        return "inside"
    return "conservative" if condition and (off < 1).all() else "OUTSIDE"


def at_the_end(
    mission: Path | str, states: list[int], seeds: int, settings: dict[str, Any]
) -> tuple[float, float]:
    """Return the rms error at the end of an outage of 60 s [m], and the rms of error / σ."""
    errors, ratios = [], []
    for seed in range(seeds):
        result = flight(mission, seed, RATE | settings | {"sensors.gps.outages": [(100.0, 160.0)]}).run()
        at = np.array([np.searchsorted(result.time, 159.9)])
        further = result.true_further() if result.solution_arrays.further.size else None
        x = error_state(
            result.solution_arrays, at, result.known_truth("errors"), result.true_bias, further=further
        )[0, states]
        errors.append(x)
        ratios.append(x / np.sqrt(result.solution_arrays.variance[at[0], states]))
    return float(np.sqrt(np.mean(np.square(errors)))), float(np.sqrt(np.mean(np.square(ratios))))


def main(arguments: list[str]) -> None:
    """Print both tables."""
    seeds = int(arguments[0]) if arguments and arguments[0].isdigit() else 100
    models = NavigatorSettings.param["model"].objects
    words = [word for word in arguments if not word.isdigit() and word not in models]
    for word in arguments:
        if word in models:
            RATE["navigator.model"] = word
    lab.declare_states(
        "g-sensitivity", ["gyro g x", "gyro g y", "gyro g z"], g_sensitivity, sigma=3e-4, unit="rad/s/(m/s²)"
    )
    with tempfile.TemporaryDirectory() as name:
        places = {ROAD: winding_road(Path(name)), STANDING: standing(Path(name))}
        print(f"{'case':16} {'NEES':>12} {'its states':>12} {'NIS':>12} {'NIS, others':>12}")
        for case, (mission, settings) in CASES.items():
            if words and not any(word in case for word in words):
                continue
            if "navigator.own_states" in settings and RATE.get("navigator.model") == "nonlinear":
                continue  # refused
            runs = [
                squares(flight(places.get(mission, mission), seed, RATE | settings).run())
                for seed in range(seeds)
            ]
            mean = np.mean(runs, axis=0)
            half = BOUND * np.std(runs, axis=0, ddof=1) / np.sqrt(seeds)
            cells = [
                f"{m:5.2f} ± {h:4.2f}" if np.isfinite(m) else "" for m, h in zip(mean, half, strict=True)
            ]
            word = judged(mean, half, condition=case in CONDITIONS)
            print(
                f"{case:16} " + " ".join(f"{text:>12}" for text in cells) + f" {word}",
                flush=True,
            )
        for case, (mission, states, settings) in OUTAGES.items():
            if words and not any(word in case for word in words):
                continue
            place = places.get(mission, mission)
            alone, aided = (at_the_end(place, states, seeds, given) for given in ({}, settings))
            print(
                f"outage, {case:28} {alone[0]:7.3g} m becomes {aided[0]:7.3g} m, "
                f"error / σ {alone[1]:.2f} and "
                f"{aided[1]:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
