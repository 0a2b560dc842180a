"""Compare: results side by side: held ones, error models, cards, seeds; sweeps; and outages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import panel as pn
import panel_material_ui as pmui

from dashboards.algorithms import served_algorithm, served_names
from dashboards.card_chooser import CardChoice
from dashboards.computing import attempt
from dashboards.ensembles import ensemble
from dashboards.history import change_in_words
from dashboards.pages.computed import ComputedPage
from dashboards.pages.outages import PALE, PLAIN, Outages
from dashboards.pages.summary import TABLE_STYLE, summary_html, summary_table
from dashboards.pages.sweep_part import SweepPart
from dashboards.query import query
from dashboards.seen_names import as_seen
from dashboards.sending import together
from dashboards.session import Session
from dashboards.settings_panel import check_variant
from dashboards.style import whole_column, wide_html
from lab.base.cache import digest
from lab.base.progress import Progress
from lab.experiment.ensembles.comparison import models
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.sensors.cards import card
from lab.views.figures import TimeAxis
from lab.views.quantities import LETTERS
from lab.views.run_comparison import Assessment, Row, assess, assess_seeds, comparison_frame, comparison_html

if TYPE_CHECKING:
    import pandas as pd

_STYLE = """
.change { opacity: .7; font-size: 12px; }
th { white-space: normal; vertical-align: bottom; min-width: 64px; }
tr.group th { text-align: left; padding-top: 12px; }
th, td { padding: 5px 8px; }
th.words, td.words { min-width: 190px; }
td:first-child, th:first-child { white-space: normal; min-width: 110px; }
tr:not(.group) > :first-child { position: sticky; left: 0; background: var(--mui-palette-background-paper); }
td { vertical-align: top; }
p { font: 14px/1.5 Roboto, sans-serif; }
@media (max-width: 600px) { td.words { min-width: 180px; } th { min-width: 0; } }
"""
_TOGGLE = {"padding": "4px 10px"}
_HINT = (
    "<p>Press the pin above, or H, to hold this result. Then change a setting or the sensors: both results "
    "stand here side by side, and the held one stays in all plots. The buttons above add others.</p>"
)
NOW = "Now"
MEAN = "Mean of"
SEEDS = 20
MOST_SEEDS = 1000
OLD = "These rows belong to earlier settings."
STOPPED = Assessment(verdict="Stopped.")


class Item(NamedTuple):
    """What a row is computed of: its content by a key, its name, its heading, and how it is computed."""

    key: str
    name: str
    group: str
    compute: Callable[[Progress, Callable[[Ensemble], None]], Assessment]


class Compare(ComputedPage):
    """Held results beside the shown one, and beside what is added: a row each; sweeps above them.

    The rows of the present settings are computed again when these change. What is computed stays known while
    it is in the table.
    """

    title = "Compare"
    contents = "the table of the results side by side"
    over_time = False

    def __init__(self, axis: TimeAxis, session: Session | None = None) -> None:
        self._session = session
        self._keys: WeakKeyDictionary[Result, str] = WeakKeyDictionary()
        self._known: dict[str, Assessment] = {}
        self._some: dict[str, Assessment] = {}
        self._doing: tuple[str, ...] = ()
        self._stopped = False
        self._summary = ""
        self._rows: list[Row] = []
        super().__init__(axis)
        if session is not None:
            session.on_run(self._end_outdated_work)
            session.param.watch(lambda _event: self._draw_again(), "shows_sigmas")

    def make(self) -> pn.viewable.Viewable:
        """Return what can be added, the places of a sweep and of outages, and the table."""
        self._add = {
            name: pmui.Toggle(label=name, size="small", variant="outlined", margin=(8, 4), sx=_TOGGLE)
            for name in ("All error models", "Sensor cards", "Seeds", "A sweep", "Outages")
        }
        for toggle in self._add.values():
            toggle.param.watch(lambda _event: self._changed(), "value")
        self._cards = CardChoice(self._changed)
        self._seeds = pmui.IntInput(
            label="Number of seeds",
            value=SEEDS,
            start=2,
            end=MOST_SEEDS,
            size="small",
            width=160,
            margin=(6, 16),
            visible=False,
        )
        self._seeds.param.watch(lambda _event: self._changed(), "value")
        self._sweep = SweepPart(self._key, self._changed, self._draw_sweep)
        self._outages = Outages()
        self._baseline = pmui.Select(
            label="Percent relative to", options=[NOW], value=NOW, size="small", width=220, margin=(6, 12)
        )
        self._baseline.param.watch(lambda _event: self._write(self._wanted), "value")
        self._stop = pmui.Button(
            label="Cancel", size="small", variant="outlined", margin=(8, 12), visible=False
        )
        self._stop.on_click(lambda _event: self._stop_or_go_on())
        self._table = wide_html(margin=(4, 16), stylesheets=[TABLE_STYLE, _STYLE])
        said = pn.pane.HTML("Add:", margin=(14, 4, 0, 4))
        bar = pn.FlexBox(
            said, *self._add.values(), self._stop, self._baseline, margin=(0, 12), align_items="center"
        )
        # What a person asked for stands above the table, which may be longer than a window.
        asked = self._sweep.choice.view, self._sweep.figure, self._outages.view
        return whole_column(bar, self._cards.view, self._seeds, self.words, *asked, self._table)

    def kept(self) -> dict[str, Any]:
        """Return what is added to the table, as plain data; empty without anything."""
        on = [name for name in self._add if self._is_chosen(name)]
        parts = {"on": on, "cards": [*self._cards.chosen], "seeds": self._count, "sweep": self._sweep.kept()}
        return parts if on else {}

    def take_back(self, kept: Mapping[str, Any]) -> None:
        """Add what was kept of a page that was cut off, and compute it again; it may be anything."""
        names = {name: one for name, one in kept.items() if isinstance(one, list)}
        seeds, sweep = kept.get("seeds"), kept.get("sweep")
        if isinstance(seeds, int) and 2 <= seeds <= MOST_SEEDS:
            self._seeds.value = seeds
        if isinstance(sweep, dict):
            self._sweep.take_back(sweep)
        self._cards.choose(str(name) for name in names.get("cards", []))
        for name in names.get("on", []):
            if name in self._add:
                self._add[name].value = True

    def _is_chosen(self, name: str) -> bool:
        return bool(self._add[name].value)

    def prepare(self, result: Result) -> None:
        """Compute the row of a result, or its summary if nothing is compared with it."""
        if self._is_alone or result.is_long:
            _ = result.whiteness if result.missing_reason("summary") else result.summary
        if not self._is_alone and (key := self._key(result)) not in self._known:
            self._known[key] = _without_hidden(assess(result))

    @property
    def _is_alone(self) -> bool:
        held = () if self._session is None else self._session.held
        return not (
            held or self._is_chosen("All error models") or self._is_chosen("Seeds") or self._chosen_cards
        )

    @property
    def _chosen_cards(self) -> tuple[str, ...]:
        return self._cards.chosen if self._is_chosen("Sensor cards") else ()

    @property
    def _count(self) -> int:
        """Number of seeds; a browser may send any number."""
        return min(max(int(self._seeds.value or SEEDS), 2), MOST_SEEDS)

    def _key(self, result: Result) -> str:
        """Return what distinguishes the run of a result from others."""
        if result not in self._keys:
            experiment = result.experiment
            self._keys[result] = digest(result.mission.content_hash, experiment.to_dict(), experiment.hidden)
        return self._keys[result]

    def _runs(self, result: Result) -> dict[str, tuple[str, Result]]:
        """Return the held results and the shown one with their names, by what distinguishes their runs."""
        held = () if self._session is None else self._session.held
        runs = {
            self._key(one.result): (f"{LETTERS[slot]} · {one.name}", one.result)
            for slot, one in enumerate(held)
        }
        runs.setdefault(self._key(result), (NOW, result))
        return runs

    def _differing(self, result: Result) -> dict[str, str]:
        """Return in which settings each run differs from the one that others are relative to, by its name."""
        sigmas = self._session is not None and self._session.shows_sigmas
        settings = {name: query(run.experiment) for name, run in self._runs(result).values()}
        base = settings.get(str(self._baseline.value), settings.get(NOW))
        return {
            name: change_in_words(base, own, sigmas)
            for name, own in settings.items()
            if base is not None and own != base
        }

    def _items(self, result: Result) -> list[Item]:
        """Return what the rows of the table are computed of, from top to bottom."""
        key, experiment = self._key(result), result.experiment
        assert isinstance(experiment, Experiment)
        runs = self._runs(result)
        items = [Item(at, name, "", lambda *_told, run=run: assess(run)) for at, (name, run) in runs.items()]
        if self._is_chosen("All error models"):
            group = "Error models, with the present settings"
            items += [
                Item(f"{key} {name}", name, group, partial(_of_model, experiment, name)) for name in models()
            ]
            items += [
                Item(f"{key} {name}", name, group, partial(_of_algorithm, experiment, name))
                for name in served_names()
            ]
        group = "Sensor cards, with the present settings"
        items += [
            Item(f"{key} card {name}", name, group, partial(_of_card, experiment, name))
            for name in self._chosen_cards
        ]
        if self._is_chosen("Seeds"):
            count = self._count
            group = f"{MEAN} {count} seeds ± standard deviation from run to run"
            items += [
                Item(f"{at} seeds {count}", name, group, partial(_of_seeds, run, count))
                for at, (name, run) in runs.items()
            ]
        return items

    def draw(self, result: Result) -> None:
        """Draw what is known of a result, and start to compute what is not.

        Another run takes the memory of the result of a long flight, which gives way.
        """
        experiment = result.experiment
        assert isinstance(experiment, Experiment)
        sigmas = self._session is not None and self._session.shows_sigmas
        self._sweep.suit(result, is_on=self._is_chosen("A sweep"), sigmas=sigmas)
        self._outages.suit(experiment, bool(result.recorded))
        is_long = result.is_long
        if is_long:
            self._summary = summary_html(result)
            self.prepare(result)
            result = result.bare()
        self._wanted = result
        self._age(old=self._session is not None and not _has_settings(result, self._session.experiment))
        wanted = [] if self._is_alone else [item.key for item in self._items(result)]
        for kept in (self._known, self._some):
            for key in set(kept) - set(wanted):
                kept.pop(key, None)
        doing = (*wanted, self._sweep.key(result))
        if self._stopped or not self._is_pending(result):
            self._doing = ()
            self._work.cancel()
            self._paint(result, None)
            return
        self._content = result, None
        self._draw_some(result)
        if doing != self._doing or not self._work.busy:
            self._doing = doing
            self._stop.param.update(visible=True, label="Cancel")
            self.say(self.working)
            self._work.submit(result)
            if is_long and self._session is not None:
                self._session.release()

    def work_out(self, result: Result, progress: Progress) -> None:
        """Compute the rows that are not known, one after the other, then the sweep."""
        todo = [] if self._is_alone else [one for one in self._items(result) if one.key not in self._known]
        for number, item in enumerate(todo):

            def tell(stage: str, fraction: float, number: int = number, item: Item = item) -> None:
                progress(
                    f"{item.name}, {number + 1} of {len(todo)}. {stage}", (number + fraction) / len(todo)
                )

            def show(done: Ensemble, item: Item = item) -> None:
                self._some[item.key] = _without_hidden(assess_seeds(done, self._count))
                self._later(partial(self._draw_some, result))

            tell("", 0.0)
            found = attempt(partial(item.compute, tell, show))
            self._known[item.key] = _without_hidden(found.result or Assessment(verdict=found.problem))
            self._later(partial(self._draw_some, result))
        if self._sweep.is_pending(result):
            self._sweep.work_out(result, progress, lambda: self._later(partial(self._draw_some, result)))

    def _report(self, result: Result, stage: str) -> None:
        """Show the progress, unless it comes after the computation was cancelled."""
        if not self._stopped:
            super()._report(result, stage)

    def _draw_some(self, result: Result) -> None:
        """Draw what is computed so far; with the last of it goes what cancels the rest."""
        if result is self._wanted and self._document is not None:
            with together(self._document):
                if not self._is_pending(result):
                    self._paint(result, None)
                    return
                self._write(result)
                self._sweep.draw(result, stopped=self._stopped)

    def _is_pending(self, result: Result) -> bool:
        """Return whether a row, or a part of the sweep, is not computed yet."""
        rows = () if self._is_alone else self._items(result)
        return any(one.key not in self._known for one in rows) or self._sweep.is_pending(result)

    def paint(self, result: Result, _content: None) -> str:
        """Draw what is computed, and say what the percent are relative to."""
        self._write(result)
        self._sweep.draw(result, stopped=self._stopped)
        self._stop.param.update(visible=self._stopped, label="Go on")
        if self._table.styles == PALE:
            return OLD
        relative = f"Percentages are relative to {escape(str(self._baseline.value))}."
        return "" if self._is_alone else f"The best value of a column is bold. {relative}"

    def _write(self, result: Result | None) -> None:
        """Write the table: the summary of the result if nothing is compared with it."""
        if result is None:
            return
        self._baseline.visible = not self._is_alone
        if self._is_alone:
            is_bare = result.time.size <= 1
            self._table.object = self._summary if is_bare else summary_html(result) + _HINT
            return
        none = STOPPED if self._stopped else None
        items = self._items(result)
        rows = [
            Row(
                item.name,
                item.group,
                self._known.get(item.key, self._some.get(item.key, none)),
                is_many=item.group.startswith(MEAN),
            )
            for item in items
        ]
        names = list(dict.fromkeys(row.name for row in rows if not row.is_many))
        if self._baseline.options != names:
            kept = self._baseline.value if self._baseline.value in names else names[0]
            self._baseline.param.update(options=names, value=kept)
        differing = self._differing(result)
        rows = [row if row.group else replace(row, differs=differing.get(row.name, "")) for row in rows]
        self._rows = rows
        self._table.object = comparison_html(rows, str(self._baseline.value))

    def table(self, result: Result) -> pd.DataFrame:
        """Return the table that is seen."""
        return summary_table(result) if self._is_alone else comparison_frame(self._rows)

    def _draw_sweep(self) -> None:
        if self._wanted is not None:
            self._sweep.draw(self._wanted, stopped=self._stopped)

    def _changed(self) -> None:
        """Add or remove what was chosen."""
        self._cards.view.visible = self._is_chosen("Sensor cards")
        self._seeds.visible = self._is_chosen("Seeds")
        self._sweep.choice.view.visible = self._is_chosen("A sweep")
        self._outages.view.visible = self._is_chosen("Outages")
        self._stopped = False
        if self._session is not None:
            self._session.keep()
        self._draw_again()

    def _draw_again(self) -> None:
        """Draw the choices; a long flight has given its result up, and is there without its histories."""
        is_given_up = self.is_complete and self._session is not None and self._session.result is None
        if is_given_up and self._wanted is not None:
            self.draw(self._wanted)
        else:
            self.draw_again()

    def _stop_or_go_on(self) -> None:
        self._stopped = not self._stopped
        self._draw_again()

    def _end_outdated_work(self) -> None:
        """End the work for settings that are no longer the present ones, and mark what is shown of them."""
        if self._wanted is not None:
            self._work.cancel()
            self._doing = ()
            self._age(old=True)

    def _age(self, *, old: bool) -> None:
        """Mark what is shown as that of earlier settings, or no longer."""
        styles = PALE if old else PLAIN
        if self._table.styles != styles:
            self._table.styles = self._sweep.figure.styles = styles
            if old:
                self.say(OLD)

    @property
    def is_complete(self) -> bool:
        """Whether all is there or under way without a result, which a long flight gave up."""
        return self._wanted is not None and self._wanted.time.size <= 1

    def release(self) -> None:
        """Refer to no result with histories any more."""
        if not self.is_complete:
            super().release()

    def close(self) -> None:
        """Compute no more."""
        self._known.clear()
        self._sweep.close()
        self._outages.close()
        super().close()

    def clear(self) -> None:
        """Show nothing."""
        self._table.object = ""
        self._sweep.clear()


def _of_model(experiment: Experiment, name: str, progress: Progress, _show: Any) -> Assessment:
    """Run an experiment with another error model."""
    variant = experiment.copy()
    variant.set("navigator.model", name)
    return assess(_run_if_allowed(experiment, variant, progress))


def _of_algorithm(experiment: Experiment, name: str, progress: Progress, _show: Any) -> Assessment:
    """Run an experiment with an algorithm of the operator."""
    return assess(experiment.run(progress, algorithm=served_algorithm(name)))


def _of_card(experiment: Experiment, name: str, progress: Progress, _show: Any) -> Assessment:
    """Run an experiment with the sensors of a card, and the filter that suits them."""
    variant = experiment.copy()
    card(name).load(variant)
    return assess(_run_if_allowed(experiment, variant, progress))


def _of_seeds(result: Result, count: int, progress: Progress, show: Callable[[Ensemble], None]) -> Assessment:
    """Run the experiment of a result with many seeds."""
    return assess_seeds(ensemble(result, count, progress, show), count)


def _run_if_allowed(experiment: Experiment, variant: Experiment, progress: Progress) -> Result:
    """Run a variant of an experiment whose settings a person may change as the variant does.

    Raises
    ------
    SettingError
        If the homework of the experiment does not allow it.
    """
    check_variant(experiment, variant)
    return variant.run(progress)


def _has_settings(result: Result, experiment: Experiment) -> bool:
    """Return whether a result has the settings of an experiment."""
    mine = result.experiment
    return mine.hidden == experiment.hidden and mine.to_dict() == experiment.to_dict()


def _without_hidden(found: Assessment) -> Assessment:
    return replace(found, verdict=as_seen(found.verdict))
