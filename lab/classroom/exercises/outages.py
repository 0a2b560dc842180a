"""Exercises of notebook 07, outages."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "07.1": Number(
        "When the fixes stop, the roll angle is wrong by 0.15°, and nothing else is. How far off is the "
        "position after 60 s [m]?",
        46.2,
        1.0,
        "½ g φ t² = ½ · 9.81 m/s² · 0.0026 · (60 s)² = 46 m: a tenth of a degree is a lot.",
        "The tilt takes a part of gravity, g φ, for an acceleration. φ is in radians.",
        {
            92.5: "The integral of t is t²/2.",
            2648.0: "φ is in radians in g φ.",
            1.54: "That is the velocity error. Integrate once more.",
        },
    ),
    "07.2": Number(
        "The white noise of the gyros is the only error. By which factor does the σ of the position grow if "
        "the outage lasts twice as long?",
        5.66,
        0.1,
        "The tilt walks with √t, and two more integrals make it t^2.5: 2^2.5 = 5.66.",
        "White noise of a rate makes the angle walk, σ ∝ √t. Then there are two more integrals.",
        {
            4.0: "That is for a constant tilt, t².",
            8.0: "That is for a constant gyro bias, t³.",
            1.41: "That is the tilt. The position is two integrals later.",
            2.0: "That is for a wrong velocity.",
        },
    ),
    "07.3": Choice(
        "You may improve one part of this system. Which one reduces the horizontal error after 60 s most?",
        "gyros",
        "The noise of the gyros has the largest share by far, before and during the outage.",
        {
            "accelerometers": "Their bias has a small share: it looks like a tilt, and is levelled away.",
            "GPS receiver": "It only makes the start of the outage better. See its share.",
            "IMU rate": "The rate matters where something shakes (notebook 02).",
        },
    ),
    "07.4": Choice(
        "The σ of the heading is 3°. What do you fly to reduce it before the tunnel?",
        "a turn",
        "A heading error shows only through horizontal acceleration, and a turn has the most of it.",
        {
            "straight and level": "Without acceleration, a wrong heading shows nowhere.",
            "a climb": "A steady climb has no horizontal acceleration. See the table.",
            "a stop": "At rest a cheap gyro shows its bias, but not the heading.",
        },
    ),
}
"""Exercises by number."""
