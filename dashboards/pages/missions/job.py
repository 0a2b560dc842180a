"""Job: work in a thread with a progress bar, and a sentence about the outcome."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from html import escape
from typing import Any, NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.notice import Notice
from dashboards.pages.missions.entry_fields import layout_width
from dashboards.sending import together, turns_of_page
from dashboards.style import WRAP, plain_column, plain_row
from lab.base.progress import Progress

TELL = 0.25
"""Time between two progress messages [s]."""


class _Task(NamedTuple):
    work: Callable[[Progress], Any]
    done: Callable[[Any], None]


class Job:
    """Does one job at a time in a thread; of several waiting jobs, it does the newest.

    Parameters
    ----------
    cancel
        Called when a person cancels the job; None if it cannot be cancelled.
    pool
        Pool that does the work.
    closeable
        Whether a person can close an error or an outcome.

    Attributes
    ----------
    view : panel.Column
        Progress and outcome.
    """

    def __init__(
        self,
        cancel: Callable[[], None] | None = None,
        pool: ThreadPoolExecutor = LONG,
        *,
        closeable: bool = False,
    ) -> None:
        self._document = pn.state.curdoc
        self._later = turns_of_page()
        self._work: LatestWins[_Task] = LatestWins(self._attempt, self._arrive, pool, turn=self._later)
        self._told = 0.0
        self._bar = pmui.LinearProgress(value=0, max=100, sizing_mode="stretch_width", margin=(14, 8))
        self._words = pn.pane.HTML("", margin=(4, 4), **layout_width(210))
        self._row = plain_row(
            self._words, self._bar, visible=False, stylesheets=[WRAP] if cancel is None else []
        )
        if cancel is not None:
            button = pmui.Button(label="Cancel", size="small", variant="outlined", margin=(4, 4))
            button.on_click(lambda _event: cancel())
            self._row.append(button)
        self._after = Notice(closeable)
        self.view = plain_column(self._row, self._after.view)

    @property
    def busy(self) -> bool:
        """Whether a job is in progress."""
        return self._work.busy

    def start(self, words: str, work: Callable[[Progress], Any], done: Callable[[Any], None]) -> None:
        """Start a job.

        Parameters
        ----------
        words
            Text shown meanwhile.
        work
            Called in a thread, with a function that takes progress.
        done
            Called with the result, in the page's own thread, unless a newer job was started.
        """
        self.say("")
        self._show(words, 0.0)
        self._row.visible = True
        self._work.submit(_Task(work, done))

    def say(self, text: str, severity: str = "error") -> None:
        """Show an error or an outcome; an empty text shows nothing."""
        self._after.say(text, severity)

    def close(self) -> None:
        """Deliver no further results."""
        self._work.close()

    def _attempt(self, task: _Task, progress: Progress) -> Outcome:
        def tell(words: str, fraction: float) -> None:
            progress(words, fraction)
            if time.monotonic() - self._told > TELL:
                self._told = time.monotonic()
                self._later(partial(self._show, words, fraction))

        return attempt(lambda: task.work(tell))

    def _show(self, words: str, fraction: float) -> None:
        self._words.object = f"{escape(words)} …"
        self._bar.param.update(
            value=round(100 * fraction), variant="determinate" if fraction else "indeterminate"
        )

    def _arrive(self, task: _Task, outcome: Outcome) -> None:
        assert self._document is not None
        with together(self._document):
            self._row.visible = False
            if outcome.problem:
                self.say(outcome.problem)
            else:
                task.done(outcome.result)
