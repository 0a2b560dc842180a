"""State verdict: whether the errors of the states are as large as the filter says, from the start on."""

from __future__ import annotations

from collections.abc import Collection

from lab.analysis.verdicts.agreement import Told, judge_agreement
from lab.analysis.verdicts.evidence import BLOCKS, Evidence
from lab.analysis.verdicts.finding import DOUBT, Weighed, is_right, judge_size, size_weight
from lab.analysis.verdicts.run_means import NEES
from lab.analysis.verdicts.selection import PRICE
from lab.analysis.verdicts.sums import Squares

_SETTINGS = {
    "position": "navigator.position_sigma",
    "velocity": "navigator.velocity_sigma",
    "attitude": "navigator.attitude_sigma",
    "gyro bias": "sensors.gyro.bias_sigma",
    "accelerometer bias": "sensors.accelerometer.bias_sigma",
    "gyro scale": "sensors.gyro.scale_factor_sigma",
    "accelerometer scale": "sensors.accelerometer.scale_factor_sigma",
}

_OF_SMALL_INNOVATIONS = (
    "R and the timing and place of the fixes are not wrong by enough to explain it. A Q or P₀ that is too "
    "large hardly shows in innovations: one of them may be."
)
_CHECK_NOISE = (
    "Compare Q with the noise of the sensor at rest (Allan deviation), and P₀ with what is known of it."
)


def judge_start(start: Squares, without: Collection[str] = ()) -> list[Weighed]:
    """Judge P0 by the initial error: in one group of states, or as a whole.

    Parameters
    ----------
    start
        As in `Evidence`.
    without
        Groups of states, by their names in `BLOCKS`, whose initial error has another cause.
    """
    explained = [at for at, name in enumerate(BLOCKS, start=1) if name in without]
    start = Squares(start.total.copy(), start.number.copy())
    for of in (start.total, start.number):
        of[0] -= of[explained].sum()
        of[explained] = 0.0
    whole = Squares(start.total[0], start.number[0])
    doubt = DOUBT / len(BLOCKS)
    found: dict[str, Weighed] = {}
    rest = Squares(whole.total.copy(), whole.number.copy())
    for at, name in enumerate(BLOCKS, start=1):
        part = Squares(start.total[at], start.number[at])
        judged = judge_size(
            part,
            f"P0 {name}",
            f"The error of the {name} at the start is {{root}} × its assumed σ: P₀ of the {name} is "
            "about {factor} × too {wrong}.",
            f"Set {_SETTINGS[name]} to the values that apply, or change the rows of the {name} in "
            "navigator.p0.",
            f"{name} at the start",
            doubt,
            ("navigator.p0", (BLOCKS[name].start, BLOCKS[name].stop)),
        )
        if judged:
            found[name] = judged[0]
            rest = Squares(rest.total - part.total, rest.number - part.number)
    together = size_weight(float(whole.total), float(whole.number)) if whole.number else 0.0
    alone = sum(entry.weight for entry in found.values()) - PRICE * (len(found) - 1)
    if found and alone > together and (not rest.number or is_right(float(rest.total), float(rest.number))):
        return list(found.values())
    return judge_size(
        whole,
        "P0",
        "The error at the start is {root} × its assumed σ: P₀ is about {factor} × too {wrong}.",
        "Multiply navigator.p0_scale by {multiply}, or set the initial σ to the values that apply.",
        "start",
        scales=("navigator.p0_scale", None),
    )


def judge_states(evidence: Evidence) -> list[Weighed]:
    """Judge the size of the errors if none of the other causes explains it."""
    judged = "Neither R, Q, P₀ nor the timing or place of the fixes"
    used = bool(evidence.usage.used)
    if not used or (evidence.start is not None and evidence.fixes is None):
        judged = "Neither Q nor P₀"  # without fixes, or as the filter estimates errors of the receiver
    told = Told(
        "the filter says",
        f"{judged} is wrong by enough to explain it.",
        "Look for errors that the filter does not model: scale factors, drifting biases, an error model that "
        "does not fit, or attitude errors of degrees, whose products a linear model neglects.",
    )
    small = told._replace(advice="Look for errors that the filter allows for and the sensors do not have.")
    if evidence.start is None:
        small = told._replace(excluded=_OF_SMALL_INNOVATIONS, advice=_CHECK_NOISE)
    if not used:
        told, small = (one._replace(between=(NEES, "errors of the position")) for one in (told, small))
    return judge_agreement(evidence.means, told, small)
