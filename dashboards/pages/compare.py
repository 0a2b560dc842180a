"""Compare: the held results and the shown one side by side; without any, the errors of the shown one."""

from __future__ import annotations

from typing import Self

import panel as pn

from dashboards.holding import LETTERS
from dashboards.pages.base import Page
from dashboards.pages.summary import TABLE_STYLE, summary_html
from dashboards.session import Session
from lab.experiment.result import Result
from lab.views.figures import TimeAxis
from lab.views.run_comparison import comparison_html, figures_of

_STYLE = """
.change { opacity: .7; font-size: 12px; }
@media (max-width: 600px) {
  td:not(.words):first-child { white-space: normal; }
  td.words { min-width: 120px; }
}
"""
_HINT = (
    "<p>Press the pin above, or H, to hold this result. Then change a setting or the sensors: both results "
    "stand here side by side, and the held one stays in all plots.</p>"
)


class Compare(Page):
    """Held results beside the shown one: errors, consistency and verdict, relative to the first held one."""

    title = "Compare"
    over_time = False
    depends_on_window = False

    def __init__(self, axis: TimeAxis, session: Session | None = None) -> None:
        self._session = session
        super().__init__(axis)

    @classmethod
    def of(cls, axis: TimeAxis, session: Session) -> Self:
        """Return the page for a session, whose held results it compares."""
        return cls(axis, session)

    def make(self) -> pn.viewable.Viewable:
        """Return an empty table."""
        self._table = pn.pane.HTML(
            "", sizing_mode="stretch_width", margin=(16, 16), stylesheets=[TABLE_STYLE, _STYLE]
        )
        return self._table

    def _runs(self, result: Result) -> list[tuple[str, Result]]:
        held = () if self._session is None else self._session.held
        runs = [(f"{LETTERS[slot]} · {one.name}", one.result) for slot, one in enumerate(held)]
        return runs if any(one is result for _, one in runs) else [*runs, ("Now", result)]

    def prepare(self, result: Result) -> None:
        """Compute the figures of the result, and of those that are held."""
        if self._session is None or not self._session.held:
            _ = result.whiteness if result.missing_reason("summary") else result.summary
            return
        for _name, run in self._runs(result):
            _ = figures_of(run), run.verdict

    def draw(self, result: Result) -> None:
        """Fill the table."""
        if self._session is None or not self._session.held:
            self._table.object = summary_html(result) + ("" if result.is_long else _HINT)
            return
        first = LETTERS[0]
        self._table.object = (
            comparison_html(self._runs(result))
            + f"<p>The best value of a row is bold. Percent are relative to {first}.</p>"
        )
