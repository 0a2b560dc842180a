"""Faults: what is injected alone into a consistent run, and what a verdict may call it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from lab.analysis.verdicts.finding_table import ARM_OR_LATENCY
from lab.experiment.experiment import Experiment
from lab.navigation.belief import belief
from lab.sensors.cards import card

MISSIONS = ("montreal", "los_angeles", "pacific")
GRADES = ("consumer", "industrial", "tactical")

Change = Callable[[Experiment], None]


def experiment(mission: str, grade: str, seed: int) -> Experiment:
    """Return a run whose filter is matched to a sensor of a grade: a part after a calibration at rest."""
    found = Experiment(mission=mission, seed=seed)
    name = {"consumer": "MPU-6000", "industrial": "ADIS16470", "tactical": "STIM300"}[grade]
    found.update({"sensors": card(name).settings()})
    bias = {"consumer": (0.1, 5.0), "industrial": (0.05, 5.0), "tactical": (4 / 3600, 0.75)}[grade]
    found.set("sensors.gyro.bias_sigma", bias[0])
    found.set("sensors.accelerometer.bias_sigma", bias[1])
    for triad in ("gyro", "accelerometer"):
        # What a card has or assumes beyond the states of the filter would be a fault of its own.
        for term in (
            "scale_factor_sigma",
            "scale_factor",
            "misalignment",
            "bias_temperature",
            "scale_temperature",
        ):
            found.set(f"sensors.{triad}.{term}", 0.0)
        found.set(f"sensors.{triad}.bandwidth", 0.0)
        # Flicker has no exact model of one state; a Gauss-Markov bias of the same size has.
        found.set(f"sensors.{triad}.flicker", 0.0)
    found.set("sensors.gyro.g_sensitivity", 0.0)
    found.set("sensors.gyro.range", 2000)
    found.set("sensors.accelerometer.range", 40)
    return found


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes
    ----------
    names
        Quantities that name it rightly; a finding of another accuses what is innocent.
    change
        Injects it. Sensors are changed behind the back of the filter, which keeps what it assumed.
    source
        ``"GPS"``, ``"IMU"`` or ``"filter"``: whose fault it is.
    """

    names: tuple[str, ...]
    change: Change
    source: str
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def inject(self, run: Experiment) -> Experiment:
        """Return the run with the fault."""
        faulty = run.copy()
        if self.source != "filter":
            keep_belief(faulty)
            faulty.set("navigator.latency", 0.0)
            faulty.set("navigator.lever_arm", [0.0, 0.0, 0.0])
        self.change(faulty)
        return faulty


def keep_belief(run: Experiment) -> None:
    """Give the filter what it is matched to now, so that it is not told of what changes."""
    assumed = belief(run.sensors, run.navigator)
    run.set("navigator.p0", np.diag(assumed.P0).tolist())
    run.set("navigator.q", assumed.noise.tolist())
    run.set("navigator.r", np.diag(assumed.R).tolist())


def setting(path: str, value: Any) -> Change:
    """Return what sets a setting."""
    return lambda run: run.set(path, value)


def settings(**values: Any) -> Change:
    """Return what sets some settings; their dots are double underscores."""

    def change(run: Experiment) -> None:
        for name, value in values.items():
            run.set(name.replace("__", "."), value)

    return change


def scaled(matrix: str, rows: slice, factor: float) -> Change:
    """Return what multiplies some of the variances that the filter assumes."""

    def change(run: Experiment) -> None:
        keep_belief(run)
        values = list(getattr(run.navigator, matrix))
        values[rows] = [factor * value for value in values[rows]]
        run.set(f"navigator.{matrix}", values)

    return change


def drifting(triad: str, times: float) -> Change:
    """Return what lets the biases walk, by so many times the σ of the noise over the flight."""

    def change(run: Experiment) -> None:
        density = np.max(getattr(run.sensors, triad).noise_density)
        if triad == "gyro":  # °/s/√Hz over 100 s, in °/h/√h
            run.set("sensors.gyro.rate_random_walk", min(float(times * density * 3600 * 60 / 100), 36000))
        else:  # µg/√Hz, in mg/√h
            run.set(
                "sensors.accelerometer.rate_random_walk", min(float(times * density / 1000 * 60 / 100), 1000)
            )

    return change


def noisier(triad: str, factor: float) -> Change:
    """Return what raises the noise of a sensor behind the back of the filter."""

    def change(run: Experiment) -> None:
        density = getattr(run.sensors, triad).noise_density
        run.set(f"sensors.{triad}.noise_density", (np.array(density) * factor).tolist())

    return change


def gps(factor: float, position: bool) -> Change:
    """Return what multiplies the variances of the receiver behind the back of the filter."""
    name = f"sensors.gps.{'position' if position else 'velocity'}_variance"
    return lambda run: run.set(name, (factor * np.array(run.get(name)) * np.ones(3)).tolist())


def warm(triad: str, value: float) -> Change:
    """Return what makes biases follow the temperature of an IMU that warms up."""
    return settings(
        sensors__temperature__profile="warm_up",
        sensors__temperature__warm_up_time=60.0,
        **{f"sensors__{triad}__bias_temperature": value},
    )


POSITION, VELOCITY = slice(0, 3), slice(3, 6)
GYRO, ACCEL = slice(0, 3), slice(3, 6)
_ARM, _LATENCY = ("GPS lever arm", ARM_OR_LATENCY), ("GPS latency", ARM_OR_LATENCY)
_Q = ("Q", "Q gyro", "Q accelerometer")
_GYRO_DRIFT = ("Q gyro bias", "gyro bias drift", "gyro temperature")
_ACCEL_DRIFT = ("Q accelerometer bias", "accelerometer bias drift", "accelerometer temperature")

FAULTS: dict[str, Fault] = {
    "R position × 10": Fault(("R position",), scaled("r", POSITION, 10), "filter"),
    "R position ÷ 10": Fault(("R position",), scaled("r", POSITION, 0.1), "filter"),
    "R velocity × 10": Fault(("R velocity",), scaled("r", VELOCITY, 10), "filter"),
    "R velocity ÷ 10": Fault(("R velocity",), scaled("r", VELOCITY, 0.1), "filter"),
    "R × 10": Fault(("R", "R position", "R velocity"), setting("navigator.r_scale", 10), "filter"),
    "R ÷ 10": Fault(("R", "R position", "R velocity"), setting("navigator.r_scale", 0.1), "filter"),
    "R × 3": Fault(("R", "R position", "R velocity"), setting("navigator.r_scale", 3), "filter"),
    "R ÷ 3": Fault(("R", "R position", "R velocity"), setting("navigator.r_scale", 1 / 3), "filter"),
    "R position down ÷ 10": Fault(("R position down",), scaled("r", slice(2, 3), 0.1), "filter"),
    "R velocity north × 10": Fault(("R velocity north",), scaled("r", slice(3, 4), 10), "filter"),
    "Q × 10": Fault(("Q",), setting("navigator.q_scale", 10), "filter"),
    "Q ÷ 10": Fault(("Q",), setting("navigator.q_scale", 0.1), "filter"),
    "Q gyro × 10": Fault(("Q gyro",), scaled("q", GYRO, 10), "filter"),
    "Q gyro ÷ 10": Fault(("Q gyro",), scaled("q", GYRO, 0.1), "filter"),
    "Q accelerometer × 10": Fault(("Q accelerometer",), scaled("q", ACCEL, 10), "filter"),
    "Q accelerometer ÷ 10": Fault(("Q accelerometer",), scaled("q", ACCEL, 0.1), "filter"),
    "P0 × 10": Fault(("P0",), setting("navigator.p0_scale", 10), "filter"),
    "P0 ÷ 10": Fault(("P0",), setting("navigator.p0_scale", 0.1), "filter"),
    "P0 position ÷ 1000": Fault(("P0 position",), scaled("p0", slice(0, 3), 1e-3), "filter"),
    "P0 velocity ÷ 1000": Fault(("P0 velocity",), scaled("p0", slice(3, 6), 1e-3), "filter"),
    "P0 attitude ÷ 1000": Fault(("P0 attitude",), scaled("p0", slice(6, 9), 1e-3), "filter"),
    "P0 gyro bias ÷ 1000": Fault(("P0 gyro bias",), scaled("p0", slice(9, 12), 1e-3), "filter"),
    "P0 accelerometer bias ÷ 1000": Fault(
        ("P0 accelerometer bias",), scaled("p0", slice(12, 15), 1e-3), "filter"
    ),
    "P0 attitude × 1e6": Fault(("P0 attitude",), scaled("p0", slice(6, 9), 1e6), "filter"),
    "gyro noise × 3": Fault(("Q gyro",), noisier("gyro", 3), "IMU"),
    "accelerometer noise × 3": Fault(("Q accelerometer",), noisier("accelerometer", 3), "IMU"),
    "gyro noise ÷ 3": Fault(("Q gyro",), noisier("gyro", 1 / 3), "IMU"),
    "accelerometer noise × 10": Fault(("Q accelerometer",), noisier("accelerometer", 10), "IMU"),
    "vibration": Fault(("Q accelerometer",), setting("sensors.accelerometer.vibration_density", 2000), "IMU"),
    "gyro walk": Fault(_GYRO_DRIFT, drifting("gyro", 10), "IMU"),
    "accelerometer walk": Fault(_ACCEL_DRIFT, drifting("accelerometer", 10), "IMU"),
    "gyro warming": Fault(_GYRO_DRIFT, warm("gyro", 0.02), "IMU"),
    "accelerometer warming": Fault(_ACCEL_DRIFT, warm("accelerometer", 2.0), "IMU"),
    "gyro scale 2 %": Fault(("gyro scale factor",), setting("sensors.gyro.scale_factor", 2.0), "IMU"),
    "gyro scale 5 %": Fault(("gyro scale factor",), setting("sensors.gyro.scale_factor", 5.0), "IMU"),
    "accelerometer scale 2 %": Fault(
        ("accelerometer scale factor",), setting("sensors.accelerometer.scale_factor", 2.0), "IMU"
    ),
    "accelerometer scale -5 %": Fault(
        ("accelerometer scale factor",), setting("sensors.accelerometer.scale_factor", -5.0), "IMU"
    ),
    "gyro misalignment 2°": Fault(
        ("gyro misalignment",), setting("sensors.gyro.misalignment", [2.0, -2.0] * 3), "IMU"
    ),
    "accelerometer misalignment 2°": Fault(
        ("accelerometer misalignment",), setting("sensors.accelerometer.misalignment", [2.0, -2.0] * 3), "IMU"
    ),
    "g-sensitivity": Fault(
        ("gyro g-sensitivity", "P0 gyro bias"), setting("sensors.gyro.g_sensitivity", 0.5), "IMU"
    ),
    "gyro bandwidth 3 Hz": Fault(("gyro bandwidth",), setting("sensors.gyro.bandwidth", 3), "IMU"),
    "accelerometer bandwidth 2 Hz": Fault(
        ("accelerometer bandwidth",), setting("sensors.accelerometer.bandwidth", 2), "IMU"
    ),
    "gyro range": Fault(("gyro range",), setting("sensors.gyro.range", 4), "IMU"),
    "accelerometer range": Fault(("accelerometer range",), setting("sensors.accelerometer.range", 1), "IMU"),
    "gyro quantisation": Fault(("Q gyro",), setting("sensors.gyro.quantisation", 2.0), "IMU"),
    "GPS position variance × 10": Fault(("R position",), gps(10, True), "GPS"),
    "GPS position variance ÷ 10": Fault(("R position",), gps(0.1, True), "GPS"),
    "GPS velocity variance × 10": Fault(("R velocity",), gps(10, False), "GPS"),
    "GPS velocity variance ÷ 10": Fault(("R velocity",), gps(0.1, False), "GPS"),
    "correlation 3 m, 60 s": Fault(("GPS correlation",), settings(sensors__gps__correlated_sigma=3.0), "GPS"),
    "correlation 2 m, 10 s": Fault(
        ("GPS correlation",),
        settings(sensors__gps__correlated_sigma=2.0, sensors__gps__correlation_time=10.0),
        "GPS",
    ),
    "latency 0.2 s": Fault(_LATENCY, settings(sensors__gps__latency=0.2), "GPS"),
    "latency 0.5 s": Fault(_LATENCY, settings(sensors__gps__latency=0.5), "GPS"),
    "lever arm 2 m forward": Fault(_ARM, settings(sensors__gps__lever_arm=[2, 0, 0]), "GPS"),
    "lever arm 3 m up": Fault(_ARM, settings(sensors__gps__lever_arm=[0, 0, -3]), "GPS"),
    "outliers 7 %": Fault(("GPS outliers",), settings(sensors__gps__outlier_rate=0.07), "GPS"),
    "outliers 5 %": Fault(("GPS outliers",), settings(sensors__gps__outlier_rate=0.05), "GPS"),
    "outliers 10 %": Fault(("GPS outliers",), settings(sensors__gps__outlier_rate=0.10), "GPS"),
    "outliers of 100 m, 5 %": Fault(
        ("GPS outliers",), settings(sensors__gps__outlier_rate=0.05, sensors__gps__outlier_size=100), "GPS"
    ),
    "bad constellation 30 s": Fault(
        ("R position", "R velocity"), settings(sensors__gps__quality_steps=[[30, 60]]), "GPS"
    ),
    "bad constellation × 5, 20 s": Fault(
        ("R position", "R velocity"),
        settings(sensors__gps__quality_steps=[[60, 80]], sensors__gps__quality_factor=5),
        "GPS",
    ),
}
