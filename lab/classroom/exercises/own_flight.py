"""Exercises of notebook 08, a flight of one's own."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "08.1": Choice(
        "How does the lab know that the velocity of a file is in knots and not in m/s?",
        "position",
        "The position changes 0.514 times as fast as the velocity says: 1 kt is 0.514 m/s.",
        {
            "its size": "An aeroplane may well fly at 80 m/s as at 80 kt. What else is in the file?",
            "its name": "The name said m_s, and lied.",
            "attitude": "The attitude shows a wrong sign of the roll, but not a unit of the velocity.",
        },
    ),
    "08.2": Number(
        "An aeroplane flies at 45 m/s in a coordinated turn of 6°/s. By which angle does it bank [°]?",
        25.7,
        0.5,
        "tan φ = v ω/g = 45 · 0.105/9.81 = 0.480, so φ = 25.7°.",
        "Use tan φ = v ω/g, with ω in rad/s.",
        {
            27.5: "tan φ is 0.48, but φ is not: take the arc tangent.",
            87.9: "ω is in rad/s in this formula.",
            64.3: "You have divided the wrong way round.",
        },
    ),
}
"""Exercises by number."""
