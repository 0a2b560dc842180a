"""Exercises of notebook 11, live."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "11.1": Choice(
        "Why does the mapping of the clocks look at the least delay, and not at the mean?",
        "bytes are never early",
        "A delay has a lower limit and no upper one. The samples that came without delay show the clock; the "
        "mean moves with each busy moment of the computer.",
        {
            "it is faster": "The mean is as fast. What can the delay of a byte be, and what can it not be?",
            "the clock drifts": "It does, and both would follow it. What disturbs the mean?",
            "samples get lost": "A lost sample changes neither. What disturbs the mean?",
        },
    ),
    "11.2": Number(
        "The clock of a device runs 20 ppm fast. By how much is it wrong after an hour [ms]?",
        72.0,
        1.0,
        "20 · 10⁻⁶ · 3600 s = 72 ms. At 50 m/s, this is 3.6 m.",
        "1 ppm is a millionth of the time that has passed.",
        {
            0.072: "That is in seconds.",
            1.2: "That is after a minute.",
            20.0: "20 ppm of what?",
        },
    ),
}
"""Exercises by number."""
