"""Sweep part: a sweep on the page Compare: what is chosen, its runs with more and more seeds, its figure."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any, NamedTuple

import panel as pn

from dashboards.computing import attempt
from dashboards.ensembles import who_runs
from dashboards.pages.summary import TABLE_STYLE
from dashboards.seen_names import as_seen
from dashboards.settings_panel import may_change
from dashboards.style import plain_column, wide_html
from dashboards.sweep_choice import Plan, SweepChoice, as_fields, present
from lab.base.cache import digest
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.sweep import Sweep
from lab.views.sweep_figure import is_known, sweep_figure

ABOUT_CURVE = (
    "Line: mean over the seeds. Band: 90 % of the runs. Dashed: what the filter expects. Dotted: the present "
    "value."
)
ABOUT_MAP = "Colour: mean over the seeds. Dotted: the present values."
_STYLE = "p { font: 14px/1.5 Roboto, sans-serif; }"


class Swept(NamedTuple):
    """A sweep as far as it is run, with what distinguishes it; without one, why there is none."""

    key: str
    sweep: Sweep | None
    is_complete: bool = True
    problem: str = ""


class SweepPart:
    """The choice of a sweep, what is run of it, and its figure.

    Parameters
    ----------
    key_of
        Returns what distinguishes the run of a result from others.
    begin
        Called when a sweep was chosen.
    draw
        Called when another figure of merit was chosen.
    """

    def __init__(
        self, key_of: Callable[[Result], str], begin: Callable[[], None], draw: Callable[[], None]
    ) -> None:
        self.choice = SweepChoice(self.run, draw)
        self.figure = plain_column(margin=(4, 8))
        self.plan: Plan | None = None
        self._key_of, self._begin = key_of, begin
        self._is_on = self._sigmas = False
        self._swept = Swept("", None)
        self._memo: tuple[Any, str] = (None, "")
        self._shows: tuple[Any, ...] = ()
        self._kept: dict[str, Any] = {}

    def suit(self, result: Result, *, is_on: bool, sigmas: bool) -> None:
        """Offer the settings of a result, with σ of variances or without, if the part is on."""
        experiment = result.experiment
        assert isinstance(experiment, Experiment)
        self._is_on, self._sigmas = is_on, sigmas
        if is_on:
            self.choice.suit(experiment, bool(result.recorded), sigmas)
            kept, self._kept = self._kept, {}
            if kept and self.choice.take_back(kept):
                self.run()
        if self.plan is not None and not all(may_change(experiment, path) for path in self.plan.values):
            self.plan = None  # it was made before a homework was opened

    def run(self) -> None:
        """Run what is chosen."""
        try:
            self.plan = self.choice.plan()
        except SettingError as error:
            self.plan, self._shows = None, ()
            self.figure[:] = [_words(str(error))]
            return
        self._begin()

    def kept(self) -> dict[str, Any]:
        """Return what was chosen for the sweep that was begun, as plain data; empty without one."""
        return self.choice.kept() if self.plan is not None else {}

    def take_back(self, kept: dict[str, Any]) -> None:
        """Begin the sweep that was kept, once its settings are offered."""
        self._kept = kept

    def key(self, result: Result) -> str:
        """Return what distinguishes the sweep; the present values of the swept settings do not matter."""
        plan = self.plan
        if plan is None or not self._is_on:
            return ""
        of = self._key_of(result), plan
        if self._memo[0] != of:
            point = result.experiment.copy()
            for path, values in plan.values.items():
                point.set(path, values[0])
            self._memo = of, digest(result.mission.content_hash, point.to_dict(), point.hidden, plan)
        return self._memo[1]

    def is_pending(self, result: Result) -> bool:
        """Return whether a sweep of a result is chosen and not complete."""
        key = self.key(result)
        return bool(key) and not (self._swept.key == key and self._swept.is_complete)

    def work_out(self, result: Result, progress: Progress, draw: Callable[[], None]) -> None:
        """Run the sweep with one seed, with two, and so on, so that it is soon seen."""
        plan, key, experiment = self.plan, self.key(result), result.experiment
        assert plan is not None
        assert isinstance(experiment, Experiment)
        seeds = 1
        while True:
            who = who_runs(experiment)
            outcome = attempt(partial(experiment.sweep, plan.values, seeds, progress, **who))
            if outcome.result is None:
                self._swept = Swept(key, None, problem=outcome.problem)
                return
            sweep: Sweep = outcome.result
            self._swept = Swept(key, sweep, is_complete=seeds == plan.seeds)
            if seeds == plan.seeds:
                return
            draw()
            seeds = min(2 * seeds, plan.seeds)

    def draw(self, result: Result, *, stopped: bool) -> None:
        """Draw the sweep, if it is of the present settings; otherwise say what there is."""
        key, (of, sweep, _complete, problem) = self.key(result), self._swept
        now = {} if self.plan is None else present(result.experiment, self.plan.values, self._sigmas)
        shows = (key, self._swept, self.choice.metric, stopped, self._sigmas, now)
        if shows == self._shows:
            return
        self._shows = shows
        if not key:
            self.figure[:] = []
        elif of != key:
            self.figure[:] = [_words("The sweep is stopped." if stopped else "Computing the sweep …")]
        elif sweep is None:
            self.figure[:] = [_words(as_seen(problem))]
        else:
            refused = (_words(as_seen(reason)) for reason in sweep.refused)
            self.figure[:] = [self._figure_of(sweep, result, now), *refused]

    def _figure_of(self, sweep: Sweep, result: Result, now: dict[str, float]) -> pn.viewable.Viewable:
        metric = self.choice.metric
        if not is_known(sweep, metric):
            return _words(f"{metric}: unknown. {result.missing_reason('errors')}")
        figure = sweep_figure(as_fields(sweep, self._sigmas), metric, now)
        figure.update(sizing_mode="stretch_width", height=420)
        plot = pn.pane.Bokeh(figure, sizing_mode="stretch_width", margin=0)
        about = ABOUT_CURVE if len(sweep.dims) == 1 else ABOUT_MAP
        return plain_column(plot, _words(about))

    def clear(self) -> None:
        """Show nothing."""
        self.figure[:], self._shows = [], ()

    def close(self) -> None:
        """Refer to no runs any more."""
        self._swept = Swept("", None)


def _words(text: str) -> pn.viewable.Viewable:
    return wide_html(f"<p>{escape(text)}</p>", margin=(2, 8), stylesheets=[TABLE_STYLE, _STYLE])
