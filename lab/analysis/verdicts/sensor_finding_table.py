"""Sensor finding table: what a verdict says of inertial sensors by their true errors.

These are rows of the table of findings (`finding_table`).
"""

from __future__ import annotations

from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.finding import Change, Wording

EARTH_RATE = "Earth rate"
"""What a finding is called if the rate of the Earth is left out."""

SENSOR_FINDINGS: dict[str, Wording] = {
    "scale factor": Wording(
        "{sensor} scale factor",
        "The scale factors of the {sensor}s are wrong by {size:.2g} %: their errors are proportional to the "
        "measured quantity.",
        "Set navigator.states to 21, and sensors.{sensor}.scale_factor_sigma to {size:.2g}: the filter then "
        "estimates the scale factors.",
        (Change("navigator.states", 21), Change("sensors.{sensor}.scale_factor_sigma", "{size}")),
    ),
    "misalignment": Wording(
        "{sensor} misalignment",
        "The {sensor}s are misaligned by {size:.2g}°: each also measures the other axes.",
        "Calibrate the {sensor}s, or set navigator.estimate_misalignments. More {sensor} noise in "
        "navigator.q covers a part of them.",
    ),
    "bandwidth": Wording(
        "{sensor} bandwidth",
        "The {sensor}s lag behind the motion by {size:.2g} ms: their bandwidth is limited.",
        "Shift the time stamps of the {sensor}s by −{size:.2g} ms, or use {sensor}s with a larger bandwidth "
        "(sensors.{sensor}.bandwidth).",
    ),
    "temperature": Wording(
        "{sensor} temperature",
        "The biases of the {sensor}s depend on the temperature, by {size:.2g} {unit} per K.",
        "Set sensors.temperature.compensation, or let the {sensor} biases walk: a larger bias drive in "
        "navigator.q.",
    ),
    "g-sensitivity": Wording(
        "{sensor} g-sensitivity",
        "The biases of the {sensor}s depend on the specific force, by {size:.2g} {unit} per g.",
        "Compensate the {sensor}s for the specific force, or set navigator.estimate_g_sensitivity. More "
        "{sensor} noise in navigator.q covers a part.",
    ),
    "bias drift": Wording(
        "{sensor} bias drift",
        "The biases of the {sensor}s drift steadily, by {size:.2g} {unit} per minute.",
        "Let the {sensor} biases walk: a larger {sensor} bias drive in navigator.q.",
    ),
    "Earth rate": Wording(
        EARTH_RATE,
        "The rate of the Earth is left out: the sensors seem to err by ω_ie in the axes of the body (gyros), "
        "and by 2 ω_ie × v (accelerometers), {part:.2g} times as much.",
        "Subtract C_bn ω_ie from the gyros, and 2 ω_ie × v from the acceleration.",
    ),
    "saturation": Wording(
        "{sensor} range",
        "The {sensor}s saturated in {windows:.0f} windows of 1 s: their errors there are {root} times as "
        "large as assumed.",
        "Use {sensor}s with a larger range (sensors.{sensor}.range).",
    ),
    "more wander": Wording(
        "Q {sensor} bias",
        "The biases of the {sensor}s wander more than assumed: their drive, and so Q, is about {factor} "
        "times too small.",
        "Multiply the {sensor} bias drive in navigator.q by {multiply}.",
        (Change("navigator.q", "{multiply}", True),),
    ),
    "less wander": Wording(
        "Q {sensor} bias",
        "The biases of the {sensor}s wander less than assumed: their drive, and so Q, is about {factor} "
        "times too large.",
        "Multiply the {sensor} bias drive in navigator.q by {multiply}.",
        (Change("navigator.q", "{multiply}", True),),
    ),
    "wander without a drive": Wording(
        "Q {sensor} bias",
        "The biases of the {sensor}s wander more than assumed: their drive, and so Q, is zero.",
        *ADVICE["a drive"],
    ),
    "Q": Wording(
        "Q",
        "Errors grow {root} times as fast as the filter claims: Q is {factor} times {direction}.",
        "Multiply navigator.q_scale by {multiply}.",
        (Change("navigator.q_scale", "{multiply}", True),),
    ),
    "Q of a sensor": Wording(
        "Q {sensor}",
        "Errors grow {root} times as fast as the filter claims: the {sensor} noise, and so Q, is {factor} "
        "times {direction}.",
        "Multiply the {sensor} noise in navigator.q by {multiply}.",
        (Change("navigator.q", "{multiply}", True),),
    ),
}
"""The findings by name."""
