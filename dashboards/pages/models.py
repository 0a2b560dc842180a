"""Models: all error models on the same flight, the same sensors and the same draws."""

from __future__ import annotations

from html import escape
from typing import Self

import panel as pn

from dashboards.algorithms import served_algorithms
from dashboards.pages.computed import ComputedPage
from dashboards.pages.summary import TABLE_STYLE
from dashboards.session import Session
from lab.base.progress import Progress
from lab.experiment.ensembles.comparison import Compared, compare
from lab.experiment.result import Result
from lab.views.ensemble_cards import models_html
from lab.views.figures import TimeAxis


class Models(ComputedPage):
    """The error models side by side: errors, consistency, time, and the verdict on each."""

    title = "Models"
    working = "Running every error model on this flight (the first time, their code is compiled) …"

    def __init__(self, axis: TimeAxis, session: Session | None = None) -> None:
        self._session = session
        super().__init__(axis)

    @classmethod
    def of(cls, axis: TimeAxis, session: Session) -> Self:
        """Return the page for a session, whose result gives way to the runs of a long flight."""
        return cls(axis, session)

    def make(self) -> pn.viewable.Viewable:
        """Return an empty table."""
        self._table = pn.pane.HTML("", sizing_mode="stretch_width", margin=(8, 20), stylesheets=[TABLE_STYLE])
        return pn.Column(self.words, self._table, sizing_mode="stretch_width", margin=0)

    def draw(self, result: Result) -> None:
        """Start the comparison; that of a long flight takes the memory of the result."""
        if not result.is_long:
            super().draw(result)
            return
        same = self._wanted is not None and _are_of_one_run(self._wanted, result)
        if not same:
            super().draw(result.bare())
        elif self._content is not None:
            self._paint(*self._content)
        if self._work.busy and self._session is not None:
            self._session.release()

    def release(self) -> None:
        """Refer to no result with histories any more."""
        if self._wanted is not None and self._wanted.time.size > 1:
            super().release()

    @property
    def is_complete(self) -> bool:
        """Whether the comparison is there, or under way: neither needs a result."""
        return self._content is not None or self._work.busy

    def work_out(self, result: Result, progress: Progress) -> tuple[Compared, ...]:
        """Run every model, and the operator's algorithms, with the settings of the result."""
        return compare(result.experiment, progress=progress, algorithms=served_algorithms())

    def clear(self) -> None:
        """Clear the table."""
        self._table.object = ""

    def paint(self, result: Result, content: tuple[Compared, ...]) -> str:
        """Fill the table."""
        self._table.object = models_html(content, str(result.experiment.navigator.model))
        mission = escape(result.mission.title or result.mission.name)
        if result.recorded:
            against = (
                "unknown without a reference" if result.missing_reason("errors") else "against the reference"
            )
            return (
                f"{mission}, a sensor log: rms errors are {against}. NIS is the mean over the fixes, beside "
                "its expected value."
            )
        return (
            f"{mission}, seed {result.experiment.seed}: rms errors over the flight. NEES and NIS are means "
            "over the fixes, beside their expected values."
        )


def _are_of_one_run(one: Result, other: Result) -> bool:
    """Return whether two results have the same flight and the same settings."""
    return (
        one.mission.content_hash == other.mission.content_hash
        and one.experiment.to_dict() == other.experiment.to_dict()
        and one.experiment.hidden == other.experiment.hidden
    )
