"""Exercises of notebook 04, the filter, written openly."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "04.1": Number(
        "A navigator at rest is tilted by 1°. Which horizontal acceleration does it compute [m/s²]?",
        0.171,
        0.003,
        "g sin 1° = 9.81 · 0.0175 = 0.171 m/s². This is the element v from φ of F, g, times φ.",
        "F has the specific force there, and at rest this is g. φ is in radians.",
        {
            9.81: "This is the element of F. Multiply it by φ, in radians.",
            0.0175: "This is φ in radians. Multiply it by g.",
            9.806: "This is the vertical part. The horizontal one goes with the sine.",
        },
    ),
    "04.2": Choice(
        "Which block of F makes a tilt visible to GPS?",
        "velocity from tilt",
        "A tilt resolves the specific force wrongly, and the velocity shows it. Without this block a tilt "
        "has no path to position or velocity.",
        {
            "position from velocity": "Without it, the velocity, which GPS measures, still shows the tilt.",
            "velocity from accelerometer": "That is how an accelerometer bias shows.",
            "tilt from gyro": "That is how a gyro bias becomes a tilt. Who shows the tilt to GPS?",
        },
    ),
}
"""Exercises by number."""
