"""Identifying: a button that identifies sensor parameters from the innovations, and one that applies them."""

from __future__ import annotations

import time
from functools import partial
from html import escape

import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.seen_names import as_seen
from dashboards.sending import turns_of_page
from dashboards.session import Session
from dashboards.style import choice_row, plain_column, wide_html
from dashboards.widgets import SETTING
from lab.analysis.identification.identification import Identification
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.result import Result

TELL = 0.25
"""Time between two progress messages [s]."""

_STYLE = """
:host { font: 14px/1.5 Roboto, sans-serif; overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 6px 0; }
th { text-align: right; font-weight: 500; opacity: .72; padding: 3px 10px;
     border-bottom: 2px solid rgba(128,128,128,.35); }
td { text-align: right; padding: 3px 10px; border-bottom: 1px solid rgba(128,128,128,.18); }
th:first-child, td:first-child, th.unit, td.unit { text-align: left; }
th, td { white-space: nowrap; }
p { max-width: 1100px; margin: 2px 0; }
.quiet { opacity: .72; }
"""


class Identifying:
    """The identification of the sensors from the innovations of the shown result, on request.

    Parameters
    ----------
    session
        Session whose settings are changed.

    Attributes
    ----------
    view : viewable
        The buttons and the table.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._result: Result | None = None
        self._found: Identification | None = None
        self._told = 0.0
        self._later = turns_of_page()
        self._work = LatestWins(self._attempt, self._arrive, LONG, at_once=True, turn=self._later)
        self._ask = pmui.Button(
            label="Identify noise from the innovations", size="small", variant="outlined", margin=(8, 8)
        )
        self._ask.on_click(lambda _event: self._asked())
        self._apply = pmui.Button(label="Apply", size="small", margin=(8, 8), visible=False, tags=[SETTING])
        self._apply.on_click(lambda _event: self._applied())
        self._chosen = pmui.CheckBoxGroup(
            label="Parameters that Apply changes", inline=True, margin=(0, 12), visible=False
        )
        self._chosen.param.watch(lambda _event: self._offer(), "value")
        self._text = wide_html(margin=(4, 12), stylesheets=[_STYLE])
        buttons = choice_row(self._ask, self._apply)
        self.view = plain_column(buttons, self._chosen, self._text)

    def show(self, result: Result) -> None:
        """Take a new result: clear the table of the previous one, and end the work on it."""
        if result is self._result:
            return
        self._work.cancel()
        self._result, self._found = result, None
        self._show_text("")
        self._ask.disabled = bool(result.algorithm)
        self._choose(())

    def release(self) -> None:
        """Refer to no result any more, and end the work."""
        self._work.cancel()
        self._result = None

    def close(self) -> None:
        """End the work."""
        self._work.close()
        self._result = self._found = None

    def _asked(self) -> None:
        if self._result is not None:
            self._choose(())
            self._show_text("Identifying …")
            self._work.submit(self._result)

    def _applied(self) -> None:
        """Apply the identified settings to the session."""
        if self._found is None:
            return
        trial = self._session.experiment.copy()
        try:
            self._session.accept(trial.update(self._found.settings(self._chosen.value)))
        except SettingError as error:
            self._show_text(str(error))

    def _attempt(self, result: Result, progress: Progress) -> Outcome:
        def tell(stage: str, fraction: float) -> None:
            progress(stage, fraction)
            if time.monotonic() - self._told > TELL:
                self._told = time.monotonic()
                words = f"Identifying: {stage}, {100 * fraction:.0f} %"
                self._later(partial(self._report, result, words))

        return attempt(lambda: result.identify(tell))

    def _report(self, result: Result, words: str) -> None:
        if result is self._result and self._found is None:
            self._show_text(words)

    def _arrive(self, result: Result, outcome: Outcome) -> None:
        if result is not self._result:
            return
        if outcome.problem:
            self._show_text(outcome.problem)
            return
        self._found = outcome.result
        self._text.object = identification_html(outcome.result)
        self._apply.variant = "contained" if outcome.result.recommended else "outlined"
        self._choose(outcome.result.applied)

    def _choose(self, parameters: tuple[str, ...]) -> None:
        """Offer parameters, all of them ticked, whose new values are applied; none hides the choice."""
        self._chosen.param.update(options=list(parameters), value=list(parameters), visible=bool(parameters))
        self._offer()

    def _offer(self) -> None:
        """Show the button while any parameter is ticked."""
        self._apply.visible = bool(self._chosen.value)

    def _show_text(self, text: str) -> None:
        self._text.object = f"<p>{escape(text)}</p>" if text else ""


def identification_html(found: Identification) -> str:
    """Return HTML: the table of parameters, whether they predict better, and the remarks."""
    heads = ("parameter", "unit", "before", "after", "σ", "95 % interval")
    rows = []
    for row in found.rows:
        sigma = f"{row.sigma:.2g}" if row.observable else ""
        cells = (f"{row.before:.4g}", f"{row.after:.4g}", sigma, row.words)
        rows.append(
            f'<tr><td>{escape(row.parameter)}</td><td class="unit">{escape(row.unit)}</td>'
            f"{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
        )
    head = "".join(f'<th class="{"unit" if name == "unit" else ""}">{name}</th>' for name in heads)
    remarks = "".join(f'<p class="quiet">{escape(as_seen(remark))}</p>' for remark in found.remarks)
    return f"<p>{escape(as_seen(found.sentence))}</p><table><tr>{head}</tr>{''.join(rows)}</table>{remarks}"
