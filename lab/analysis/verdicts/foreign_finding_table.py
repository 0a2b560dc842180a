"""Foreign finding table: what a verdict says of a filter that is not ours: names, sentences, advice."""

from __future__ import annotations

from lab.analysis.verdicts.finding import Wording

_FOLLOW = "The innovations of the fixes follow the motion: the fixes are some {size} s "
_LATE = _FOLLOW + "later than the filter assumes"
_EARLY = _FOLLOW + "earlier than the filter assumes, or its inertial data are as late or clip in turns"
_CHECK_DELAY = "Check the delay of the receiver that the filter assumes"
_CHECK_GYROS = ", the range of the gyros, and the filters before them."

FOREIGN_FINDINGS: dict[str, Wording] = {
    "size": Wording(
        "R {kind}",
        "The {kind} innovations are {root} times as large as the filter says and do not follow each other: "
        "R of the {kind} is about {factor} times too small.",
        "Multiply the variance of the {kind} by {multiply}.",
    ),
    "size and memory": Wording(
        "{kind}",
        "The {kind} innovations are {root} times as large as the filter says and follow each other: Q is too "
        "small, or errors of the {kind} last from one to the next, such as slow ones, or those of a delay.",
        "Check the delay of the measurement, before you raise Q or model its slow error.",
    ),
    "size, causes not compared": Wording(
        "{kind}",
        "The {kind} innovations are {root} times as large as the filter says. Their σ is logged too "
        "coarsely to tell R from Q.",
    ),
    "stretch": Wording(
        "{kind}",
        "From {begin:.1f} s to {end:.1f} s the {kind} innovations are {root} times as large as the filter "
        "says. Before and after, they are not too large.",
    ),
    "follows": Wording(
        "Q",
        "The innovations of the fixes follow each other: the filter corrects too little. Q is too small, or "
        "errors of the fixes last from one to the next, such as slow ones, or those of late fixes.",
        "Check the delay of the receiver, before you raise Q or model a slow error of the fixes.",
    ),
    "alternates": Wording(
        "Q",
        "The innovations of the fixes alternate: the filter corrects too much. Q is too large for the motion "
        "that was.",
        "Lower Q.",
    ),
    "bias": Wording(
        "{kind} bias",
        "The {kind} innovations {axis}have a mean of {size} σ: an error of the {kind} or of the states "
        "lasts over the log.",
    ),
    "jump": Wording(
        "GPS jump",
        "At {time:.1f} s the position of the receiver jumped by {size} m, which its own velocity does not "
        "show: the receiver explains {what}.",
        "Check the receiver in that time (satellites, multipath, interference).",
    ),
    "heading": Wording(
        "heading",
        "The {kind} innovations follow the acceleration, turned by 90°: the heading was off by some {size}° "
        "while the velocity changed.",
        "Check what the heading is from: the magnetometer, its declination, what disturbs it, or the start.",
    ),
    "late": Wording("delay", _LATE + ".", _CHECK_DELAY + "."),
    "late at one speed": Wording(
        "delay",
        _LATE + ", or the antenna is some {way} m farther back, which is the same at one speed.",
        _CHECK_DELAY + ", and the place of the antenna.",
    ),
    "early": Wording("delay", _EARLY + ".", _CHECK_DELAY + _CHECK_GYROS),
    "early at one speed": Wording(
        "delay",
        _EARLY + ", or the antenna is some {way} m farther ahead, which is the same at one speed.",
        _CHECK_DELAY + _CHECK_GYROS,
    ),
    "rejected": Wording(
        "gate",
        "The filter rejected {percent:.2g} % of the {kind} innovations, first at {begin:.1f} s, for up to "
        "{longest:.1f} s at a time.",
    ),
    "reset": Wording("reset", "{text}"),
    "lane": Wording("lane", "{text}"),
    "fault": Wording("fault", "{text}"),
    "timeout": Wording("timeout", "{text}"),
    "far": Wording(
        "position",
        "The position is {root} times as far from {what} as the σ of both together say.",
        "Compare R with the errors of the fixes, and Q with the noise of the inertial sensors.",
    ),
}
"""The findings, in whole sentences; what each rests on is its evidence."""
