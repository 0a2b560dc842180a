"""Ensemble card: many runs in Jupyter: the verdict, the averages in their intervals, and the errors."""

from __future__ import annotations

from html import escape

import numpy as np

from lab.experiment.ensembles.ensemble import Ensemble
from lab.views.mission_card import title_of
from lab.views.verdict_card import verdict_html

SETTLED = 20.0
"""Time after which the averages inside their intervals are counted [s]."""
BY_CHANCE = 0.05
"""Part of the averages of a matched filter that is outside a 95 % interval."""


def ensemble_html(ensemble: Ensemble) -> str:
    """Return many runs as HTML."""
    seeds = ensemble.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} runs, seeds {seeds[0]} to {seeds[-1]}"
    who = f", {ensemble.algorithm}" if ensemble.algorithm else ""
    shown = ensemble.coverage.copy()
    # A column for the units made the table wider than a notebook beside a side bar.
    shown["quantity"] += " [" + shown.pop("unit") + "]"
    table = shown.to_html(index=False, border=0, float_format=lambda value: f"{value:.3g}", na_rep="unknown")
    return (
        f"<h4>{escape(title_of(ensemble.experiment.mission))}, {which}{escape(who)}</h4>"
        f"{verdict_html(ensemble.verdict)}<p>{escape(ensemble.remark)} {inside(ensemble)}</p>{table}"
        "<p>The root mean square is that of the whole flights; the other columns are those of the errors "
        "after the fixes.</p>"
    )


def inside(ensemble: Ensemble) -> str:
    """Return how often the averages over the runs are in their 95 % intervals, and what chance explains."""
    parts = {
        name: part
        for name, part in zip(("NEES", "NIS"), ensemble.inside(SETTLED), strict=True)
        if np.isfinite(part)
    }
    if not parts:
        return "NEES and NIS are unknown."
    shares = " and ".join(f"{100 * part:.0f} % ({name})" for name, part in parts.items())
    explained = " and ".join(f"{_by_chance(part)} ({name})" for name, part in parts.items())
    return (
        f"After {SETTLED:g} s, the average over the runs is in its 95 % interval at {shares} of the fixes. "
        f"Of the fixes outside, chance explains {explained}: it puts 5 % of all there in the mean, but more "
        "or fewer in one flight, because neighbouring fixes share their errors."
    )


def _by_chance(part: float) -> str:
    """Return which part of the fixes outside chance explains, given the part inside."""
    outside = 1 - part
    return "all" if outside <= BY_CHANCE else f"{100 * BY_CHANCE / outside:.0f} %"
