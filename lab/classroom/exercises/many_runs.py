"""Exercises of notebook 10, many runs."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "10.1": Number(
        "A filter has 15 states and is right. Where is the upper end of the two-sided 95 % interval of NEES, "
        "averaged over 20 runs?",
        17.5,
        0.15,
        "20 times the average has χ² with 300 degrees of freedom. Its 97.5 % quantile, 349.9, by 20 is 17.5.",
        "Use scipy.stats.chi2.ppf with 20 · 15 degrees of freedom, and divide by 20.",
        {
            27.5: "That is for a single run. The average of 20 runs scatters less.",
            17.1: "This is the 95 % quantile. A two-sided interval leaves 2.5 % on each side.",
            350.0: "That is the interval of the sum. Divide by the number of runs.",
            15.0: "That is the expected value.",
        },
    ),
    "10.2": Number(
        "20 runs give a heading error of 1.55° ± 0.15° (1σ of the mean). How many runs give ± 0.05°?",
        180.0,
        3.0,
        "The error bar falls with √N: three times smaller takes nine times as many runs.",
        "The standard error of the mean is s/√N.",
        {
            60.0: "The error bar falls with the root of the number of runs.",
            35.0: "The other way round: N grows with the square of what the error bar shall fall by.",
            9.0: "That is the factor. You have 20 runs already.",
        },
    ),
    "10.3": Choice(
        "Why is the difference of two filters better known from runs with the same seeds?",
        "the luck cancels",
        "Both filters see the same noise, so most of the scatter is the same in both and cancels.",
        {
            "more runs": "The number of runs is the same.",
            "less noise": "The noise is as large as before. It is the same for both filters.",
            "NEES is smaller": "The seeds do not change NEES on average.",
        },
    ),
}
"""Exercises by number."""
