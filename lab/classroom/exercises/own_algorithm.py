"""Exercises of notebook 09, an algorithm of one's own."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "09.1": Number(
        "An aircraft flies at 45 m/s and has a perfect fix each second. What is the rms position error of a "
        "navigator that holds the last fix [m]?",
        26.0,
        0.6,
        "The error grows from 0 to 45 m and starts again: its mean square is 45²/3, and the root is 26 m.",
        "The error at an age t of the fix is v t. Take the mean of its square over one second.",
        {
            22.5: "That is the mean of the error. The mean of the square is larger.",
            45.0: "That is the largest error, just before the next fix.",
            31.8: "That is for a sine. The error is a sawtooth.",
        },
    ),
    "09.2": Choice(
        "What must an algorithm return besides its solution and σ, so that the lab can compute NEES?",
        "covariance",
        "NEES weighs the errors with the inverse of their covariance, which has the correlations that σ does "
        "not have.",
        {
            "innovation": "The innovations, with their covariance, give NIS.",
            "truth": "The lab knows the truth. The algorithm never sees it.",
            "nothing": "σ is only the diagonal.",
        },
    ),
}
"""Exercises by number."""
