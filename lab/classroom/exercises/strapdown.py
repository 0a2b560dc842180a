"""Exercises of notebook 02, strapdown."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "02.1": Number(
        "An accelerometer is wrong by 1 mg. How far off is the position after one minute without GPS [m]?",
        17.7,
        0.5,
        "½ b t² = ½ · 0.0098 m/s² · (60 s)² = 17.7 m. A minute without GPS is long, even for a good sensor.",
        "A constant wrong acceleration is integrated twice: once to velocity, once to position.",
        {
            35.3: "Nearly. The integral of t is t²/2.",
            0.588: "This is the error of the velocity, in m/s. Integrate once more.",
            1.8: "1 mg is a thousandth of 9.8 m/s², which is 0.0098 m/s².",
            17_652.0: "This is for a whole g. 1 mg is a thousandth of it.",
        },
    ),
    "02.2": Number(
        "A level navigator has a wrong accelerometer. When is its horizontal error close to zero again for "
        "the first time [min]?",
        84.4,
        1.0,
        "2π √(R/g) with R = 6.37 · 10⁶ m and g = 9.81 m/s² is 5,060 s, 84.4 minutes: the period of Schuler.",
        "Set the slider of the accelerometer alone, and find the first minimum of the curve after the start. "
        "A pendulum of length R swings with 2π √(R/g).",
        {
            42.2: "There the error is largest: this is half of the period.",
            13.4: "This is √(R/g). A period is 2π of it.",
            5064.0: "The answer is in minutes.",
        },
    ),
    "02.3": Choice(
        "The height error of a navigator without a barometer or GPS, after hours: how does it grow?",
        "exponentially",
        "A height that is too large makes the computed gravity too weak, and this pushes further up: the "
        "error grows e-fold every 9.5 minutes.",
        {
            "it oscillates": "That is the horizontal error, which gravity pulls back. Look at the table.",
            "linearly": "A wrong initial velocity does that at first. Look at the table after 30 minutes.",
            "quadratically": "At first, yes. Compare the last two columns of the table.",
        },
    ),
    "02.4": Number(
        "A body cones by 1° at 10 Hz and is sampled 20 times a second. How fast does an attitude drift that "
        "takes each sample by itself [°/s, without sign]?",
        0.548,
        0.01,
        "With two samples in a period, x = π and sin(x)/x = 0: the drift is the whole ½ sin²a Ω, 0.55 °/s or "
        "2,000 °/h. The samples swing along a line and do not show that the axis goes round.",
        "Use the formula with a = 1°, Ω = 2π · 10 rad/s and x = Ω/20, and turn rad/s into °/s. Or call "
        "coning_drift.",
        {
            1974.0: "The answer is in °/s, this is in °/h.",
            0.00957: "The answer is in °/s, this is in rad/s.",
            1.097: "There is a factor ½ in front.",
        },
    ),
}
"""Exercises by number."""
