"""Exercises of notebook 03, sensor errors."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "03.1": Number(
        "Another sheet says: angle random walk 0.3 °/√h. What is the setting noise_density [°/s/√Hz]?",
        0.005,
        0.0001,
        "0.3/60 = 0.005 °/s/√Hz. A random walk is two-sided already, so there is no √2.",
        "An hour has 3600 s, and so √h is 60 √s.",
        {
            0.00354: "A random walk has no √2: that is for a noise density from a sheet.",
            8.33e-5: "There are 3600 s in an hour, but the unit has the root of the hour.",
            18.0: "The other way round: the walk in one second is smaller than that in one hour.",
        },
    ),
    "03.2": Number(
        "A gyro has a noise density of 0.05 °/s/√Hz and no other error. What is the σ of its angle after "
        "100 s [°]?",
        0.5,
        0.02,
        "N √t = 0.05 · 10 = 0.5°.",
        "White noise makes the angle walk: σ = N √t.",
        {
            5.0: "That would be a constant error of 0.05 °/s. Noise walks with √t.",
            0.05: "That is after one second.",
            0.005: "The noise is not averaged, but added up.",
        },
    ),
    "03.3": Choice(
        "At long averaging times, the Allan deviation of a gyro rises with the slope +1/2. What is it?",
        "random walk of the bias",
        "The bias walks, and means that are further apart differ more: K √(τ/3).",
        {
            "white noise": "White noise falls, with the slope −1/2.",
            "flicker": "Flicker is flat.",
            "turn-on bias": "A constant cancels in the difference of two means.",
            "quantisation": "Quantisation falls, with the slope −1.",
        },
    ),
    "03.4": Choice(
        "Which error does a record at rest not show, however long it is?",
        "scale factor",
        "At rest there is no rate to scale, and the scale of gravity looks like a bias.",
        {
            "white noise": "It is the first one to show: some minutes are enough.",
            "flicker": "It takes hours, but the floor shows it.",
            "random walk of the bias": "It takes hours or days, but then the deviation rises.",
        },
    ),
}
"""Exercises by number."""
