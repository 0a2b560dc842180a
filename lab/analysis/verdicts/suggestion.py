"""Suggestion: a setting that a run may use besides, because its motion shows that it may.

Nothing is wrong without it, so it is no finding, and a consistent filter stays consistent. It is tried before
it is said: the errors across artificial outages have to become clearly smaller, and no figure worse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import NO_SLIP, NO_SLIP_AT, WHEELS
from lab.analysis.verdicts.aid_verdict import judge_aids
from lab.analysis.verdicts.finding import Suggestion, Verdict
from lab.analysis.verdicts.trial import (
    EVERY,
    Repeatable,
    apply_changes,
    describe_worsened,
    figures,
    held_out,
    measure_growth,
    metres,
)
from lab.analysis.verdicts.wheels import ahead_of_axle, rolls
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError

OUTAGE = 15.0
"""Length of the outages [s]: on a winding road with the default sensors, errors across 10 s are hardly above
those of the fixes to which they are compared; across 15 s they are four times as large."""
TURNS = 3
"""Number of sets of outages at different times: a drive of three minutes has seven outages then."""
MOST = 60_000
"""Most samples of a log on which it is tried, those in the middle: ten minutes at 100 Hz, and some five
seconds for all runs."""
NEAR, BEHIND, AHEAD = 0.3, -1.0, 3.0
"""Distances of the IMU ahead of the rear axle [m]: the least that matters, 0.1 m/s in a turn of 20°/s, and
those that a car has room for."""


def may_suggest(run: Repeatable) -> bool:
    """Return whether there is something to try on a run; this takes no further run."""
    if run.algorithm or not run.fixes.time.size:
        return False
    navigator = run.experiment.navigator
    too_long = run.is_long and run.recorded is None
    return not (navigator.no_slip or too_long) and rolls(run)


def with_suggestions(
    verdict: Verdict, run: Repeatable, progress: Callable[[str, float], None] | None = None
) -> Verdict:
    """Return a verdict on a run with the suggestions that help; see `may_suggest`.

    Parameters
    ----------
    verdict
        The verdict, with its advice tried.
    run
        The run.
    progress
        Called with a phrase and the fraction done, from 0 to 1.
    """
    if not may_suggest(run):
        return verdict
    if progress is not None:
        progress("Trying wheels that do not slip", 0.8)
    try:
        found = _no_slip(_section(run))
    except (SettingError, ValueError):  # a part that cannot be navigated, or a filter without this condition
        return verdict
    return verdict if found is None else replace(verdict, suggestions=(*verdict.suggestions, found))


def _no_slip(run: Repeatable) -> Suggestion | None:
    """Return the suggestion that the vehicle does not slip, if that helps."""
    place = _place_to_try(run)
    advice = NO_SLIP if place is None else NO_SLIP_AT
    changes = advice.filled(place=place, outage=OUTAGE, before="", after="").changes
    with_it = run.repeated(apply_changes(run, changes))
    if judge_aids(with_it.evidence.aids):
        return None  # it slips, or the axes of the IMU are not those of the vehicle
    before, after = (_outage_errors(one) for one in (run, with_it))
    growth = measure_growth(before, after)
    if (
        growth is None
        or before.size < limits.VERDICT.shown_outages
        or growth[0] + limits.VERDICT.likely_errors * growth[1] > -np.log(limits.VERDICT.closer_factor)
    ):
        return None
    if describe_worsened(figures(run), figures(with_it)):
        return None
    was, becomes = (metres(float(np.sqrt(np.nanmean(one**2)))) for one in (before, after))
    text = advice.filled(place=place, outage=OUTAGE, before=was, after=becomes).text
    return Suggestion(WHEELS, text, changes)


def _place_to_try(run: Repeatable) -> list[float] | None:
    """Return the place on the rear axle to try; None to leave the setting as it is.

    The speeds are zero at a place on the rear axle, and an IMU ahead of it moves sideways in turns. The place
    is a setting of the sensors, which stay as they are in a simulation.
    """
    odometer = run.experiment.sensors.odometer
    if run.recorded is None or odometer.fitted or np.any(odometer.lever_arm):
        return None
    ahead = round(ahead_of_axle(run), 1)
    if not BEHIND < ahead < AHEAD or abs(ahead) < NEAR:
        return None
    return [-ahead, 0.0, 0.0]


def _outage_errors(run: Repeatable) -> FloatArray:
    """Return the errors of the outages of all sets [m]; see `trial.held_out`."""
    sets = [held_out(run, EVERY * turn / TURNS, OUTAGE) for turn in range(TURNS)]
    return np.concatenate(sets)


def _section(run: Repeatable) -> Repeatable:
    """Return the run, or of a long log the run of the part in its middle."""
    samples = run.time.size
    if run.recorded is None or samples <= MOST:
        return run
    first = (samples - MOST) // 2
    experiment = run.experiment.copy()
    experiment.set("navigator.log_from", float(run.time[first]) + run.epoch)
    experiment.set("navigator.log_to", float(run.time[first + MOST - 1]) + run.epoch)
    return run.repeated(experiment)
