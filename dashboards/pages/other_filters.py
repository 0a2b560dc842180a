"""Other filters: the part of the page *Filter* that judges the filter of an autopilot's log, or of anyone."""

from __future__ import annotations

from pathlib import Path

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.base import OwnPage, make_hideable
from dashboards.pages.missions.job import Job
from dashboards.pages.summary import TABLE_STYLE
from dashboards.style import plain_column, wide_html
from dashboards.upload import MAX_BYTES, Upload, without_folder
from lab.analysis.verdicts.foreign_verdict import ForeignVerdict
from lab.data.filter_logs import KINDS
from lab.experiment.judged_log import judge
from lab.views.foreign_filter import ForeignFigure, foreign_html

_WORDS = (
    "<p>This page judges the filter of an autopilot, or any other, by the innovations in its log. It reads "
    f"{', '.join(kind.name for kind in KINDS)}, up to {MAX_BYTES // 2**20} MB. Each sentence names its "
    "evidence.</p>"
)


class OtherFilters(OwnPage):
    """Takes a log, and judges the filter in it."""

    title = "Other filters"
    contents = "the form for the log of another filter"

    def make(self) -> pn.viewable.Viewable:
        """Return the button, the words and the place of the figure."""
        self.job = Job(closeable=True)
        self._upload = Upload(
            self._arrived,
            self.job.say,
            most=1,
            label="Choose or drop a log",
            variant="outlined",
            margin=(8, 16),
            sizing_mode="stretch_width",
            sx={"borderStyle": "dashed", "padding": "22px"},
        )
        self._smoother = pmui.Checkbox(label="Compare with our smoother", size="small", margin=(0, 16))
        self.words = wide_html(_WORDS, margin=(4, 20), stylesheets=[TABLE_STYLE])
        self._drawn_figure = ForeignFigure()
        self._pane = pn.pane.Bokeh(self._drawn_figure.figure, sizing_mode="stretch_width", margin=(4, 16))
        self._plot = make_hideable(self._pane)
        return plain_column(
            self._upload, self._smoother, plain_column(self.job.view, margin=(0, 16)), self._plot, self.words
        )

    def close(self) -> None:
        """End the work, and delete the file."""
        self.job.close()
        self._upload.delete()

    def _arrived(self, paths: list[Path]) -> None:
        smoother = bool(self._smoother.value)
        self._plot.visible = False
        self.words.object = _WORDS
        self.job.start(
            "Judging the filter",
            lambda progress: judge(paths[0], smoother=smoother, progress=progress),
            self._show,
        )

    def _show(self, found: ForeignVerdict) -> None:
        self._pane.object = self._drawn_figure.show(found)
        self._plot.visible = True
        self.words.object = without_folder(foreign_html(found))
