"""Exercises of notebook 01, the tour."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "01.1": Choice(
        "The aircraft flies straight, at constant speed. Which of its errors does GPS not show?",
        "heading",
        "A heading error acts on the velocity only through horizontal acceleration, and there is none.",
        {
            "velocity": "GPS measures it.",
            "roll": "A wrong roll takes a part of gravity for an acceleration, which GPS sees.",
            "pitch": "A wrong pitch takes a part of gravity for an acceleration, which GPS sees.",
        },
    ),
    "01.2": Number(
        "A constant error of the acceleration is all that is wrong. An outage lasts twice as long: by which "
        "factor does the position error grow?",
        4.0,
        0.05,
        "The error is ½ a t²: twice the time, four times the error.",
        "The acceleration is integrated twice.",
        {
            2.0: "That is the velocity.",
            8.0: "That is for a constant gyro bias, whose tilt grows with time.",
            1.41: "An error that is constant does not walk like noise.",
        },
    ),
}
"""Exercises by number."""
