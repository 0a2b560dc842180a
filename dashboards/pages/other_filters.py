"""Other filters: the part of the page *Filter* that judges the filter of an autopilot's log, or of anyone."""

from __future__ import annotations

from html import escape
from pathlib import Path

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.pages.base import Page
from dashboards.pages.summary import TABLE_STYLE
from dashboards.sending import soon, together
from dashboards.upload import MAX_BYTES, Upload
from lab.base.progress import Progress
from lab.data.filter_logs import KINDS
from lab.experiment.judged_log import judge
from lab.experiment.result import Result
from lab.views.figures import TimeAxis
from lab.views.foreign_filter import ForeignFigure, foreign_html

_WORDS = (
    f"<p>What a filter that is not ours says of itself: {', '.join(kind.name for kind in KINDS)}. Up to "
    f"{MAX_BYTES // 2**20} MB. Each sentence is followed by what it rests on.</p>"
)


class OtherFilters(Page):
    """Takes a log, and judges the filter in it; it needs no result."""

    title = "Other filters"
    depends_on_window = False
    over_time = False

    def __init__(self, axis: TimeAxis) -> None:
        self._document = pn.state.curdoc
        self._work: LatestWins[Path] = LatestWins(self._judge, self._deliver, LONG, at_once=True)
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the button, the words and the place of the figure."""
        self._upload = Upload(
            self._arrived,
            self.say,
            most=1,
            label="Choose or drop a log",
            variant="outlined",
            margin=(8, 16),
            sizing_mode="stretch_width",
            sx={"borderStyle": "dashed", "padding": "22px"},
        )
        self._smoother = pmui.Checkbox(label="Compare with our smoother", size="small", margin=(0, 16))
        self.words = pn.pane.HTML(
            _WORDS, sizing_mode="stretch_width", margin=(4, 20), stylesheets=[TABLE_STYLE]
        )
        self._drawn_figure = ForeignFigure()
        self._plot = pn.pane.Bokeh(
            self._drawn_figure.figure, sizing_mode="stretch_width", height=300, margin=(4, 16), visible=False
        )
        return pn.Column(
            self._upload, self._smoother, self._plot, self.words, sizing_mode="stretch_width", margin=0
        )

    def draw(self, _result: Result) -> None:
        """Do nothing: the page does not depend on a result."""

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result: it needs none."""
        return True

    def say(self, text: str) -> None:
        """Show a sentence in place of a verdict."""
        self._plot.visible = False
        self.words.object = f"<p>{escape(text)}</p>"

    def close(self) -> None:
        """End the work, and delete the file."""
        self._work.close()
        self._upload.delete()

    def _arrived(self, paths: list[Path]) -> None:
        self.say("Judging the filter …")
        self._work.submit(paths[0])

    def _judge(self, path: Path, progress: Progress) -> Outcome:
        return attempt(lambda: judge(path, smoother=bool(self._smoother.value), progress=progress))

    def _deliver(self, path: Path, outcome: Outcome) -> None:
        assert self._document is not None
        soon(self._document, lambda: self._show(path, outcome))

    def _show(self, path: Path, outcome: Outcome) -> None:
        assert self._document is not None
        place = f"{path.parent}/"  # a visitor knows the file by its name, and not where it was put
        with together(self._document):
            if outcome.problem:
                self.say(outcome.problem.replace(place, ""))
                return
            self._plot.object = self._drawn_figure.show(outcome.result)
            self._plot.visible = True
            self.words.object = foreign_html(outcome.result).replace(place, "")
