"""Outages: the part of the page Compare that shows which sensors hold a wish without GPS."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from typing import NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.ensembles import who_runs
from dashboards.pages.summary import TABLE_STYLE
from dashboards.seen_names import as_seen
from dashboards.sending import together, turns_of_page
from dashboards.settings_panel import check_variant
from dashboards.style import plain_column, whole_column, wide_html
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.outage_table import OutageTable
from lab.sensors.cards import card, cards
from lab.views.outage_view import choose_curves, curve_words, drift_figure, table_html

PRESENT, EVERY = "Present settings", "All cards"
SEEDS, MOST_SEEDS = 100, 1000
LONGEST = 3600.0
"""Longest outage that the page offers [s]."""
OLD = "This table belongs to earlier settings. Press Run to compute it again."
PALE, PLAIN = {"opacity": "0.45"}, {"opacity": "1"}
"""Styles of what is of earlier settings, and of what is not; a browser keeps a style that is taken away."""
_STYLE = "p { font: 14px/1.5 Roboto, sans-serif; max-width: 900px; margin: 6px 0; opacity: .85; }"


class Plan(NamedTuple):
    """What is asked for: experiment, length of the outages [s], wish [m], cards and seeds."""

    experiment: Experiment
    seconds: float
    wish: float | None
    cards: list[str] | None
    seeds: int

    def compute(self, progress: Progress, show: Callable[[OutageTable], None]) -> OutageTable:
        """Return the table; `show` gets those of the runs that are done.

        Raises
        ------
        SettingError
            If the homework of the experiment does not allow it, or the lab refuses the settings.
        """
        self.experiment.check_change("sensors.gps.outages")
        for name in self.cards or []:
            variant = self.experiment.copy()
            card(name).load(variant)
            check_variant(self.experiment, variant)
        return self.experiment.outage(
            self.seconds,
            self.cards,
            self.seeds,
            self.wish,
            progress=progress,
            partial=show,
            **who_runs(self.experiment),
        )


class Outages:
    """The widgets, the table and the drift curves; what is asked for is computed in a thread.

    Attributes
    ----------
    view : Column
        The part, to place on a page.
    """

    def __init__(self) -> None:
        self._document = pn.state.curdoc
        self._later = turns_of_page()
        self._work: LatestWins[Plan] = LatestWins(
            self._attempt, self._arrive, LONG, at_once=True, turn=self._later
        )
        self._experiment: Experiment | None = None
        self._plan: Plan | None = None
        self._cards = pmui.Select(
            label="Which sensors",
            options=list(_choices()),
            value=PRESENT,
            size="small",
            width=220,
            margin=(6, 6),
        )
        self._seconds = pmui.FloatInput(
            label="Without GPS [s]", value=60.0, start=1, end=LONGEST, size="small", width=150, margin=(6, 6)
        )
        self._wish = pmui.FloatInput(
            label="Wish: 95 % within [m]", value=10.0, start=0, size="small", width=170, margin=(6, 6)
        )
        self._seeds = pmui.IntInput(
            label="Runs of each", value=SEEDS, start=1, end=MOST_SEEDS, size="small", width=120, margin=(6, 6)
        )
        run = pmui.Button(label="Run the outages", size="small", margin=(10, 6))
        run.on_click(lambda _event: self._run())
        self._stop = pmui.Button(
            label="Cancel", size="small", variant="outlined", margin=(10, 6), visible=False
        )
        self._stop.on_click(lambda _event: self._cancel())
        self._words = wide_html(margin=(2, 8), stylesheets=[_STYLE])
        self._table = wide_html(margin=(2, 8), stylesheets=[TABLE_STYLE, _STYLE])
        self._figure = plain_column()
        choices = self._cards, self._seconds, self._wish, self._seeds, run, self._stop
        self.view = whole_column(
            pn.FlexBox(*choices, margin=0, align_items="center"),
            self._words,
            self._table,
            self._figure,
            margin=(0, 10),
            visible=False,
        )

    @property
    def busy(self) -> bool:
        """Whether a table is being computed."""
        return self._work.busy

    def suit(self, experiment: Experiment, is_log: bool) -> None:
        """Take the experiment of which the next table is; one that is shown and not of it turns pale."""
        self._experiment, self._seeds.visible = experiment, not is_log
        is_old = self._plan is not None and not _are_alike(self._plan.experiment, experiment)
        self._age(is_old=is_old)
        if is_old:
            self._work.cancel()
            self._stop.visible = False
            self._say(OLD)

    def close(self) -> None:
        """Compute no more."""
        self._work.close()

    def _run(self) -> None:
        if self._experiment is None:
            return
        chosen = _choices().get(self._cards.value)  # a browser may send any name
        seeds = min(max(int(self._seeds.value or SEEDS), 1), MOST_SEEDS)
        seconds, wish = self._seconds.value or 0.0, self._wish.value or None
        plan = self._plan = Plan(self._experiment, seconds, wish, chosen, seeds)
        self._stop.visible = True
        self._age(is_old=True)
        self._say("Computing …")
        self._work.submit(plan)

    def _cancel(self) -> None:
        self._work.cancel()
        self._stop.visible = False
        self._say("Stopped. The table shows the runs that were done. Press Run to continue.")

    def _attempt(self, plan: Plan, progress: Progress) -> Outcome:
        def tell(stage: str, fraction: float) -> None:
            progress(stage, fraction)
            self._later(partial(self._report, plan, stage))

        def show(table: OutageTable) -> None:
            self._later(partial(self._draw, plan, table))

        return attempt(lambda: plan.compute(tell, show))

    def _report(self, plan: Plan, stage: str) -> None:
        if plan is self._plan and self._stop.visible:
            self._say(f"Computing: {stage}")

    def _arrive(self, plan: Plan, outcome: Outcome) -> None:
        if plan is not self._plan or not self._stop.visible:
            return
        self._stop.visible = False
        if outcome.result is None:
            self._say(as_seen(outcome.problem.replace("seconds: ", f"{self._seconds.label}: ", 1)))
            return
        self._say("")
        self._draw(plan, outcome.result)

    def _draw(self, plan: Plan, table: OutageTable) -> None:
        """Draw a table, whole or in part."""
        if plan is not self._plan or self._document is None:
            return
        with together(self._document):
            rows = choose_curves(table)
            self._table.object = table_html(table) + (f"<p>{escape(curve_words(table))}</p>" if rows else "")
            figure = drift_figure(table, rows)
            figure.update(sizing_mode="stretch_width", height=420)
            plot = pn.pane.Bokeh(figure, sizing_mode="stretch_width", margin=0)
            self._figure[:] = [plot] if rows else []
            self._age(is_old=False)

    def _age(self, *, is_old: bool) -> None:
        """Mark what is shown as that of earlier settings, or no longer."""
        self._table.styles = self._figure.styles = PALE if is_old else PLAIN

    def _say(self, text: str) -> None:
        self._words.object = f"<p>{escape(text)}</p>" if text else ""


def _choices() -> dict[str, list[str] | None]:
    """Return the cards of each choice: none for the present settings, all, or those of a grade."""
    found: dict[str, list[str] | None] = {PRESENT: None, EVERY: list(cards())}
    for name, one in cards().items():
        of_grade = found.setdefault(f"{one.grade.capitalize()} grade", [])
        assert of_grade is not None
        of_grade.append(name)
    return found


def _are_alike(one: Experiment, other: Experiment) -> bool:
    """Return whether two experiments have the same outages: their own outages and seeds do not matter."""
    return one.hidden == other.hidden and _apart(one) == _apart(other)


def _apart(one: Experiment) -> dict[str, object]:
    found = one.copy()
    found.sensors.gps.outages = []
    return found.to_dict()
