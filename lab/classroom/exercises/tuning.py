"""Exercises of notebook 05, tuning."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "05.1": Number(
        "A fix measures position and velocity, three components each. Which NIS do you expect on average of "
        "a filter that is right about its innovations?",
        6.0,
        0.1,
        "NIS is a sum of squares of as many independent normal numbers of variance 1 as there are "
        "measurements: χ² with 6 degrees of freedom, whose mean is 6.",
        "NIS counts measurements, and is 1 on average for each of them.",
        {
            15.0: "That is the mean of NEES, which counts the states.",
            3.0: "A fix measures the velocity too.",
            1.0: "That is the mean for each measurement. How many has a fix?",
        },
    ),
    "05.2": Number(
        "The innovations are 3.2 times as large as the filter expects, and R dominates their covariance. By "
        "which factor do you multiply R?",
        10.0,
        0.5,
        "R is a variance: 3.2² = 10. The verdict says so too.",
        "R is the square of a standard deviation.",
        {
            3.2: "This is the factor on the standard deviation. R is a variance.",
            1.79: "You took the root. R is the square of a standard deviation.",
            0.1: "The innovations are too large, so the filter expects too little noise.",
        },
    ),
    "05.3": Choice(
        "In a flight without a known truth, Q is 100 times too small. What shows it?",
        "correlation",
        "P becomes too small, so the gain does. Errors stay for many fixes, and each innovation predicts the "
        "next: the innovations are correlated.",
        {
            "NEES": "NEES shows it best, but it needs the truth.",
            "NIS": "Look at the table: NIS changes from 6 to 8 only.",
            "nothing": "That is so for a Q that is too large. Look at the column of lag 1.",
        },
    ),
    "05.4": Number(
        "P₀, Q and R are all four times too large. What is the average NIS of a fix with six measurements?",
        1.5,
        0.1,
        "The innovations are the same, and their assumed covariance is four times as large: 6/4 = 1.5.",
        "The innovations do not change. Their assumed covariance does.",
        {
            6.0: "The estimates are the same, but the assumed covariance of the innovations is not.",
            24.0: "The covariance stands in the denominator.",
            3.0: "The covariance is that of squares: no root is taken.",
            0.375: "Each of P, Q and R has the factor 4, so their sum has the factor 4, not 16.",
        },
    ),
}
"""Exercises by number."""
