"""Consistency: whether the filter states its errors correctly: the verdict in words, and its evidence."""

from __future__ import annotations

from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import Outcome
from dashboards.ensembles import ensemble
from dashboards.identifying import Identifying
from dashboards.pages.base import plot_grid
from dashboards.pages.computed import ComputedPage
from dashboards.seen_names import as_seen
from dashboards.sending import together
from dashboards.session import RUNS, Session
from dashboards.style import choice_row, plain_column, wide_html
from dashboards.widgets import SETTING
from lab.analysis.verdicts.finding import Change, Finding
from lab.analysis.verdicts.suggestion import may_suggest, with_suggestions
from lab.analysis.verdicts.trial import apply_changes, can_be_tried, try_advice
from lab.analysis.verdicts.verdict import Verdict
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.ensemble_cards import describe_coverage, scroll_box
from lab.views.figures import TimeAxis
from lab.views.quantities import CONSISTENCY, ENSEMBLE_CONSISTENCY
from lab.views.time_figures import TimeFigures

if TYPE_CHECKING:
    import pandas as pd

_STYLE = Path(__file__).with_name("consistency.css").read_text("utf-8")

DOUBTFUL = 0.01
"""Probability of being white below which a channel is marked."""
ALMOST_ALL = 95.0
"""Percent within ±3σ below which an error is marked: one flight is only a few independent samples."""


TABLES = 530
"""Height of the tables, the verdict and the choice of runs [px]."""


class Consistency(ComputedPage):
    """Verdict, NEES and NIS with their 95 % intervals, innovations and coverage: of one run or of many.

    One run is drawn at once. Many runs are computed in the background; the old ones stay visible meanwhile.
    """

    title = "Verdict"
    contents = "whether the errors match the filter's own σ"
    seen = ("consistency",)
    depends_on_window = True

    def __init__(self, axis: TimeAxis, session: Session | None = None) -> None:
        self._session = session
        self._identifying = None if session is None else Identifying(session)
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the selection of runs, the verdict, the plots and the tables, one below the other."""
        self._result: Result | None = None
        self._choice = pmui.Select(
            label="Runs",
            options={f"{runs:,} seeds" if runs > 1 else "1 seed": runs for runs in RUNS},
            value=1 if self._session is None else self._session.runs,
            size="small",
            width=140,
            margin=(10, 8),
        )
        self._choice.param.watch(lambda _event: self._chosen(), "value")
        self._one = TimeFigures(CONSISTENCY, self.axis)
        self._many = TimeFigures(ENSEMBLE_CONSISTENCY, self.axis)
        self._verdict = _html()
        self._changes: tuple[Change, ...] = ()
        self._follow = pmui.Button(
            label="Apply the advice", size="small", margin=(4, 12), visible=False, tags=[SETTING]
        )
        self._follow.on_click(lambda _event: self._follow_advice())
        self._tables = _html()
        self._plots_of_one = plot_grid(self._one.figures, 2, 210, beside=TABLES)
        self._plots_of_many = plot_grid(self._many.figures, 2, 300, beside=TABLES)
        self._choice_and_words = choice_row(self._choice, self.words)
        return plain_column(*self._parts(self._plots_of_one))

    def _parts(self, *plots: pn.viewable.Viewable) -> list[pn.viewable.Viewable]:
        """Return the parts of the page from top to bottom."""
        identifying = [] if self._identifying is None or self.runs > 1 else [self._identifying.view]
        return [self._choice_and_words, self._verdict, self._follow, *identifying, *plots, self._tables]

    @property
    def runs(self) -> int:
        """Number of runs to judge."""
        return int(self._choice.value)

    def prepare(self, result: Result) -> None:
        """Compute the verdict of the result, if it is judged alone."""
        if self.runs == 1:
            self._one.prepare(result)
            _ = result.verdict, result.innovation_verdict, result.whiteness
            if not result.missing_reason("coverage"):
                _ = result.coverage

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time, or start runs of its experiment with many seeds."""
        self._result = result
        if self._identifying is not None:
            self._identifying.show(result)
        alone = not result.realisation  # nothing is drawn that another seed would draw anew
        self._choice.param.update(visible=not alone, **({"value": 1} if alone else {}))
        if self.runs > 1:
            self.working = f"Running {self.runs:,} seeds:"
            super().draw(result)
            return
        if result is not self._wanted:
            self._work.cancel()
            self._wanted = self._content = None
        self.say(_describe_judged(result))
        self._one.show(result, self.held())
        self._lay_out(self._plots_of_one)
        if not can_be_tried(result.verdict, result.algorithm) and not may_suggest(result):
            self._write(result, result.verdict)
            return
        if self._content is None:
            self._write(result)
        self.working = _describe_judged(result)
        super().draw(result)

    def work_out(self, result: Result, progress: Progress) -> Ensemble | Verdict:
        """Try the advice on one run, or run the selected number of seeds and judge them together."""
        if self.runs == 1:
            return with_suggestions(try_advice(result.verdict, [result], progress), result, progress)
        found = ensemble(result, self.runs, progress, partial(self._of_some, result))
        _ = found.consistency, found.innovation_verdict, found.whiteness, found.coverage, found.tried_verdict
        return found

    def _of_some(self, result: Result, done: Ensemble) -> None:
        """Show the runs that are done so far; called in a thread."""
        _ = done.consistency, done.verdict, done.innovation_verdict, done.whiteness, done.coverage
        self._later(partial(self._draw_some, result, done))

    def _draw_some(self, result: Result, done: Ensemble) -> None:
        complete = self._content is not None and self._content[0] is result
        if result is self._wanted and self.runs > len(done.seeds) + len(done.diverged) and not complete:
            assert self._document is not None
            with together(self._document):
                self._draw_runs(done)

    def _draw_runs(self, runs: Ensemble, verdict: Verdict | None = None) -> None:
        """Draw averages over runs in the visible stretch of time, and write the verdict on them."""
        self._many.show(runs)
        self._write(runs, verdict)
        self._lay_out(self._plots_of_many)

    def _arrive(self, result: Result, outcome: Outcome) -> None:
        """Draw the computed content, unless another number of runs was selected meanwhile."""
        of_one = isinstance(outcome.result, Verdict)
        if outcome.problem or of_one == (self.runs == 1):
            super()._arrive(result, outcome)

    def release(self) -> None:
        """Refer to no result any more; what is drawn stays."""
        super().release()
        self._result = None
        if self._identifying is not None:
            self._identifying.release()

    def close(self) -> None:
        """Draw nothing more."""
        if self._identifying is not None:
            self._identifying.close()
        super().close()

    def clear(self) -> None:
        """Show neither verdict nor plots."""
        self._verdict.object = self._tables.object = ""
        self._follow.visible = False
        self.view[:] = self._parts()

    def paint(self, result: Result, content: Ensemble | Verdict) -> str:
        """Draw averages over the runs in the visible stretch of time, and write the verdict on all runs.

        For one run, write the effect of the advice.
        """
        if isinstance(content, Verdict):
            self._write(result, content)
            return escape(_describe_judged(result))
        self._draw_runs(content, content.tried_verdict)
        return escape(over_seeds(content))

    def _write(self, judged: Result | Ensemble, verdict: Verdict | None = None) -> None:
        """Write verdict and tables for the whole flight; without a `verdict`, the advice is not yet tried."""
        self._verdict.object = verdict_html(
            verdict or judged.verdict, judged.innovation_verdict, tried=verdict is not None
        )
        self._changes = () if verdict is None else verdict.changes
        self._follow.visible = bool(self._changes) and self._session is not None
        tables = [whiteness_html(judged.whiteness)]
        if isinstance(judged, Ensemble) or not judged.missing_reason("coverage"):
            tables.append(coverage_html(judged))
        self._tables.object = (
            f'<div class="tables">{"".join(scroll_box(table, "Statistics") for table in tables)}</div>'
        )

    def _follow_advice(self) -> None:
        """Change the settings of the session as the first advice says that was tried."""
        if self._session is None or self._result is None or not self._changes:
            return
        changed = apply_changes(self._result, self._changes)
        assert isinstance(changed, Experiment)
        try:
            self._session.accept(changed)
        except SettingError as error:
            self.say(escape(str(error)))

    def _lay_out(self, plots: pn.viewable.Viewable) -> None:
        """Lay out plots that are already drawn, so that they arrive complete."""
        if plots not in self.view.objects:
            self.view[:] = self._parts(plots)

    def _chosen(self) -> None:
        """Judge the newest result again."""
        if self._session is not None:
            self._session.runs = self.runs
        self._wanted = self._content = None
        self.draw_again()


_COLOUR = {True: "fine", False: "wrong", None: "unknown"}


def _html() -> pn.pane.HTML:
    return wide_html(margin=(4, 12), stylesheets=[_STYLE])


def _describe_judged(result: Result) -> str:
    if not result.realisation:
        return "A sensor log has no random draws, so this one run is judged, by its innovations."
    return f"The flight shown, {result.realisation}."


def verdict_html(verdict: Verdict, by_innovations: Verdict, *, tried: bool = True) -> str:
    """Return a verdict with its findings, and the verdict by the innovations alone, as HTML.

    Advice is tried before it is given; until then, a note says that it is being tried.
    """
    findings = "".join(
        f"<p>{f'{escape(as_seen(finding.sentence))} ' if number else ''}{_advice(finding, tried=tried)} "
        f'<span class="quiet">Evidence: {escape(finding.evidence)}.</span></p>'
        for number, finding in enumerate(verdict.findings)
    )
    findings += "".join(
        f"<p>{escape(as_seen(one.sentence))} {_format_counsel(one.counsel)}</p>"
        for one in verdict.suggestions
    )
    alone = ""
    if verdict.basis != by_innovations.basis:  # they are the same for a sensor log
        said = f"say: {as_seen(by_innovations.headline)}"
        if by_innovations.consistent:
            said = "would not show this." if verdict.findings else "say so too."
        alone = f" Without knowing the truth, the innovations alone {said}"
    return (
        f'<div class="verdict {_COLOUR[verdict.consistent]}">'
        f"<h2>{escape(as_seen(verdict.headline))}</h2>{findings}"
        f'<p class="quiet">Judged by {escape(verdict.basis)}.{escape(alone)}</p></div>'
    )


def _advice(finding: Finding, *, tried: bool) -> str:
    if finding.changes and not tried:
        return "Trying the advice …"
    return _format_counsel(finding.counsel)


def _format_counsel(counsel: str) -> str:
    return escape(as_seen(counsel)).replace("Try:", "<b>Try:</b>", 1)


def over_seeds(ensemble: Ensemble) -> str:
    """Return which runs are judged, and how often their averages lie in their intervals."""
    return (
        f"{len(ensemble.seeds)} flights, seeds {ensemble.seeds[0]} to {ensemble.seeds[-1]}. "
        f"{ensemble.remark} {describe_coverage(ensemble)}"
    )


def whiteness_html(table: pd.DataFrame) -> str:
    """Return mean, variance and whiteness of each channel's innovations as an HTML table."""
    if table["mean"].isna().all():
        return '<p class="quiet">Innovations: unknown.</p>'
    limits = table.iloc[0]
    digits = 2 if limits["mean ±"] > 0.1 else 3
    heads = (
        "Innovations [σ]",
        f"mean, ±{limits['mean ±']:.{digits}f}",
        f"variance, {limits['variance from']:.{digits}f} to {limits['variance to']:.{digits}f}",
        f"Ljung-Box, {limits['lags']:.0f} lags",
        "p-value",
    )
    rows = []
    for row in table.to_dict("records"):
        cells = (
            (f"{row['mean']:z.{digits}f}", abs(row["mean"]) > row["mean ±"]),
            (
                f"{row['variance']:.{digits}f}",
                not row["variance from"] <= row["variance"] <= row["variance to"],
            ),
            (f"{row['Q']:.1f}", False),
            (f"{row['p white']:.3f}", row["p white"] < DOUBTFUL),
        )
        rows.append(_row(str(row["innovation"]), cells))
    note = (
        "A matched filter is within each limit in 95 % of the cases; values outside are marked. The p-value "
        "is the probability of a larger Ljung-Box value if the innovations are white. The page Innovations "
        "shows the autocorrelation."
    )
    return _table(heads, rows, note)


def coverage_html(judged: Result | Ensemble) -> str:
    """Return bias and coverage of the errors of one run or many as an HTML table."""
    table = judged.coverage
    many = isinstance(judged, Ensemble)
    if table["mean [σ]"].isna().all():
        return '<p class="quiet">Errors in their σ: unknown, because there are no fixes.</p>'
    limit = f", ±{table['mean ±'].iloc[0]:.2f}" if many else ""
    heads = ("Errors", f"mean [σ]{limit}", "in ±1σ, 68 %", "in ±3σ, 99.7 %")
    rows = [
        _row(
            str(row["quantity"]),
            (
                (f"{row['mean [σ]']:z.2f}", many and abs(row["mean [σ]"]) > row["mean ±"]),
                (f"{row['within ±1σ [%]']:.0f} %", False),
                (f"{row['within ±3σ [%]']:.1f} %", row["within ±3σ [%]"] < ALMOST_ALL),
            ),
        )
        for row in table.to_dict("records")
    ]
    note = "Errors change slowly: in one flight, a mean of half a σ is normal. Suspicious values are marked."
    if many:
        note = (
            "Errors after the fixes. The limit of the mean holds for independent flights; values beyond it "
            "are marked."
        )
    return _table(heads, rows, note)


def _row(name: str, cells: tuple[tuple[str, bool], ...]) -> str:
    marked = "".join(f'<td class="{"off" if off else "fine"}">{text}</td>' for text, off in cells)
    return f"<tr><td>{escape(name)}</td>{marked}</tr>"


def _table(heads: tuple[str, ...], rows: list[str], note: str) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    return f'<table><tr>{head}</tr>{"".join(rows)}</table><p class="quiet">{escape(note)}</p>'
