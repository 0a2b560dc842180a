"""Exercises of notebook 06, error models."""

from __future__ import annotations

from lab.classroom.exercises.exercise import Choice, Exercise, Number

EXERCISES: dict[str, Exercise] = {
    "06.1": Choice(
        "Which two models give the same solution, but for a millionth?",
        "phi and psi",
        "They differ by the angle between the true and the computed position, which is tiny as long as the "
        "position is known.",
        {
            "phi and invariant": "Close, but look at NEES.",
            "psi and nonlinear": "Close, but look at NEES.",
            "invariant and nonlinear": "Both are made for large errors, but they differ. Look at NEES.",
        },
    ),
    "06.2": Number(
        "The heading is 60° wrong. How large is the error of the computed horizontal specific force, as a "
        "fraction of it?",
        1.0,
        0.02,
        "A vector and the same vector turned by 60° are two sides of an equilateral triangle: the "
        "difference, 2 sin 30°, is as long as they are. F is wrong by 100 %.",
        "Draw the true and the computed vector, 60° apart. How long is their difference?",
        {
            0.5: "That is by how much the part along the true direction is too small: 1 − cos 60°.",
            0.866: "That is the part across the true direction: sin 60°. There is one along it, too.",
            1.047: "That is 60° in radians. For such an angle, the chord is not the arc.",
        },
    ),
    "06.3": Choice(
        "Which kind of correction suits a navigator with cheap gyros?",
        "feedback",
        "The free navigator drifts by tens of degrees in a minute or two, where no linear model holds. "
        "Feedback keeps its error small.",
        {
            "feedforward": "See the remark: how far does the navigator drift?",
            "either": "They agree only for small errors. Compare the last two rows.",
            "none": "Without any correction the errors are those of notebook 02.",
        },
    ),
}
"""Exercises by number."""
