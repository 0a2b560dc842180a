"""Advice table: the advice of findings that have more than one, and how advice is told after a trial.

Names in braces are fields, as in the table of findings (`finding_table`).
"""

from __future__ import annotations

from lab.analysis.verdicts.finding import WITHHELD, Advice, Change

KEEP_R = "Do not lower R:"
"""Beginning of the advice on fixes of a receiver that filters them."""

ADVICE: dict[str, Advice] = {
    # of the slow error of a receiver: another R is no advice, because the R that gives a right σ makes the
    # innovations too small, which asks for less
    "estimate the slow error": Advice(
        "Set navigator.estimate_gps_drift, with the σ and the time of the slow error as "
        "sensors.gps.correlated_sigma and sensors.gps.correlation_time: the filter then estimates it."
    ),
    "use fewer fixes": Advice(
        f"{KEEP_R} the errors of the fixes last for about {{number}} fixes, as those of a receiver that "
        "filters its fixes do. Use one fix in {number}, or multiply the position variances of navigator.r by "
        "{number}; small innovations are then right."
    ),
    # of Q and P0
    "scale a matrix": Advice(
        "Multiply navigator.{matrix}_scale by {multiply}.",
        (Change("navigator.{matrix}_scale", "{multiply}", True),),
    ),
    "scale variances": Advice(
        "Multiply the {block} variances of navigator.{matrix} by {multiply}.",
        (Change("navigator.{matrix}", "{multiply}", True),),
    ),
    "identify": Advice(
        "It is better to identify the noise from the innovations, because several assumptions are wrong at "
        "once: the button on the page Verdict, ins-lab identify, or result.identify()."
    ),
    "compare": Advice(
        "Compare with a reference, or with another IMU or receiver. A flight with more turns shows the "
        "difference better."
    ),
    "lower R": Advice(
        "The assumed noise is too large. Most often it is R: multiply navigator.r_scale by {scale}. In a "
        "filter with a state of the GPS drift, its σ (sensors.gps.correlated_sigma) may be too large instead."
    ),
    # of errors of the inertial sensors, from the innovations
    "estimate scale factors": Advice(
        "Calibrate the {sensor}s, or set navigator.states to 21, and sensors.{sensor}.scale_factor_sigma to "
        "{percent}.",
        (Change("navigator.states", 21), Change("sensors.{sensor}.scale_factor_sigma", "{percent}")),
    ),
    "set P0 of scale factors": Advice(
        "Set navigator.states to 21, with the σ of the scale factors in navigator.p0: {sigmas}. The filter "
        "then estimates them.",
        (Change("navigator.states", 21), Change("navigator.p0", "{p0}")),
    ),
    "estimate": Advice(
        "Set {switch}: the filter then estimates {states}.",
        (Change("{switch}", True),),
    ),
    "estimate with settings": Advice(
        "Set {switch}, and also {settings}: the filter then estimates {states}.",
        (Change("{switch}", True),),
    ),
    "nonlinear model": Advice("Set navigator.model to nonlinear.", (Change("navigator.model", "nonlinear"),)),
    "a drive": Advice("Give the {sensor} biases a drive: sensors.{sensor}.rate_random_walk, or navigator.q."),
    # of noise of other measurements
    "set their noise": Advice(
        "Set sensors.{setting}.noise to the noise that applies, or multiply navigator.aiding_scale, first by "
        "{multiply}, if all other measurements are wrong alike. Check the times and the axes too."
    ),
    "raise the slip": Advice(
        "Raise navigator.slip_sigma. Check that the axes of the IMU point along the vehicle, and that it "
        "does not slip: aeroplanes and boats do."
    ),
    "raise the speed at rest": Advice(
        "Raise navigator.zero_velocity_sigma. Check that the vehicle stands still."
    ),
    # of errors without a cause
    "look for errors": Advice(
        "Look for errors that the filter does not model: scale factors, drifting biases, an error model that "
        "does not fit, or attitude errors of degrees, whose products a linear model neglects."
    ),
    "look for errors that are not there": Advice(
        "Look for errors that the filter allows for and the sensors do not have."
    ),
    "hold large errors": Advice(
        "Set navigator.model to invariant, or to nonlinear: they hold for larger attitude errors.",
        (Change("navigator.model", "invariant"),),
    ),
}
"""Advice of findings that have more than one, by name."""

TRIED: dict[str, str] = {
    "better": "{advice} Tried: {effect}.",
    "better together": "{advice} Tried, all advice together: {effect}.",
    "with less trust": "{advice} Tried, with less trust in them: {effect}.",
    "refused": "{advice} (Tried: the run cannot be navigated: {error})",
    "worse": f"{WITHHELD} the change that such a finding suggests was tried, and it makes worse {{worse}}. "
    "It was: {advice}",
    "useless": f"{WITHHELD} what such a finding suggests was tried, and neither NIS, the correlation of the "
    "innovations nor the errors across outages get better.",
}
"""Advice after it was tried, with its effect."""

WHEELS = (
    "The vehicle moves along the forward axis of the IMU, in turns too, and does not bank: as one on wheels "
    "or rails does."
)
"""What shows that a vehicle does not slip."""

NO_SLIP = Advice(
    "Set navigator.no_slip: the speeds to the right and down are then measured as zero, which helps where "
    "there is no fix. Tried: error across outages of {outage:.0f} s: {before}, then {after}.",
    (Change("navigator.no_slip", True),),
)
NO_SLIP_AT = Advice(
    "Set navigator.no_slip, and sensors.odometer.lever_arm to {place}: the speeds to the right and down are "
    "then measured as zero, which helps where there is no fix. Tried: error across outages of {outage:.0f} "
    "s: {before}, then {after}.",
    (Change("navigator.no_slip", True), Change("sensors.odometer.lever_arm", "{place}")),
)
"""Advice to measure the speeds of a vehicle that does not slip, and the same with the place where they "
"are."""
