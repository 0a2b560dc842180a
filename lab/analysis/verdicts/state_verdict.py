"""State verdict: whether the errors of the states are as large as the filter says, from the start on."""

from __future__ import annotations

from collections.abc import Collection

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.agreement import FigureWording, judge_agreement
from lab.analysis.verdicts.evidence import BLOCKS, Evidence
from lab.analysis.verdicts.finding import Weighed, is_right, judge_size, size_weight
from lab.analysis.verdicts.finding_table import FINDINGS, VALUES
from lab.analysis.verdicts.run_means import NEES
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
    doubt = limits.VERDICT.doubt / len(BLOCKS)
    found: dict[str, Weighed] = {}
    rest = Squares(whole.total.copy(), whole.number.copy())
    for at, name in enumerate(BLOCKS, start=1):
        part = Squares(start.total[at], start.number[at])
        judged = judge_size(
            part,
            FINDINGS["P0 of a group"],
            f"{name} at the start",
            doubt,
            (BLOCKS[name].start, BLOCKS[name].stop),
            group=name,
            setting=_SETTINGS[name],
        )
        if judged:
            found[name] = judged[0]
            rest = Squares(rest.total - part.total, rest.number - part.number)
    together = size_weight(float(whole.total), float(whole.number)) if whole.number else 0.0
    alone = sum(entry.weight for entry in found.values()) - limits.VERDICT.price * (len(found) - 1)
    if found and alone > together and (not rest.number or is_right(float(rest.total), float(rest.number))):
        return list(found.values())
    return judge_size(whole, FINDINGS["P0"], "start")


def judge_states(evidence: Evidence) -> list[Weighed]:
    """Judge the size of the errors if none of the other causes explains it."""
    used = bool(evidence.usage.used)
    # Fixes are not judged where there are none, or as the filter estimates errors of the receiver.
    judged = used and not (evidence.start is not None and evidence.fixes is None)
    wording = FINDINGS["unexplained" if judged else "unexplained, fixes not judged"]
    worded = FigureWording(
        wording.with_advice(ADVICE["look for errors"]),
        wording.with_advice(ADVICE["look for errors that are not there"]),
    )
    if evidence.start is None:
        worded = worded._replace(small=FINDINGS["small innovations"])
    if not used:
        worded = worded._replace(between=(NEES, VALUES[f"{NEES} of a group"].format(group="position")))
    return judge_agreement(evidence.means, worded)
