"""Microscope: one update of the filter at the time cursor, as P, K, H, S and equations with numbers."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import panel as pn

from dashboards.computing import Outcome
from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.computed import ComputedPage
from dashboards.style import plain_column, wide_html
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.views.microscope import EllipseFigures, number, sentence, update_html

if TYPE_CHECKING:
    import xarray as xr

LATE = 1.5
"""Intervals of the fixes after a fix from which it is said that there was none since."""
_STYLE = Path(__file__).with_name("microscope.css").read_text("utf-8")


class Microscope(ComputedPage):
    """The update of the filter by the fix at the time cursor, or the last one before it.

    The numbers are those of `Result.update_at`, computed in a thread for the newest place of the cursor.
    """

    title = "Microscope"
    contents = "the filter's update by the fix at the cursor"
    seen = ("innovations",)
    working = "Running the filter up to this fix …"

    def make(self) -> pn.viewable.Viewable:
        """Return the sentence, the ellipses of the innovation, and the numbers."""
        self._fix = 0
        self._ellipses = EllipseFigures()
        self._plots = make_hideable(plot_grid(self._ellipses.figures, 2, least=320, beside=inf))
        self._html = wide_html(margin=(4, 20), stylesheets=[_STYLE])
        return plain_column(self.words, self._plots, self._html)

    @classmethod
    def missing_reason(cls, result: Result) -> str:
        """Return why the updates cannot be shown."""
        from lab.analysis.fix_update import reason_without_updates  # noqa: PLC0415 - needed with the first result

        return reason_without_updates(result)

    def draw(self, result: Result) -> None:
        """Begin with the fix at the time cursor."""
        self._fix = self._find_update(result, self.axis.time)
        if self._content is not None and self._content[1].attrs["fix"] == self._fix:
            super().draw(result)
            return
        self._content = None
        if result is not self._wanted:
            self._wanted = result
            self.say(self.working)
        self._work.submit(result)

    def show_time(self, time: float) -> None:
        """Follow the time cursor to another fix; the words follow it between the fixes too."""
        result = self._wanted
        if result is None:
            return
        fix = self._find_update(result, time)
        if fix != self._fix:
            self._fix, self._content = fix, None
            if result.is_long:
                self.say(self.working)
            self._work.submit(result)
        elif self._content is not None:
            self.words.object = f"<p>{self._sentence(*self._content)}</p>"

    def work_out(self, result: Result, _progress: Progress) -> xr.Dataset:
        """Return the update by the fix at which the time cursor is now."""
        return result.update_at(float(result.fixes.time[self._fix]))

    def paint(self, result: Result, content: xr.Dataset) -> str:
        """Draw an update."""
        self._ellipses.show(content)
        self._plots.visible = True
        self._html.object = f'<div class="update">{update_html(content)}</div>'
        return self._sentence(result, content)

    def clear(self) -> None:
        """Show no update."""
        self._plots.visible = False
        self._html.object = ""

    def _arrive(self, result: Result, outcome: Outcome) -> None:
        """Draw an update, unless the cursor is at another fix by now, whose update is computed next."""
        if outcome.problem or outcome.result.attrs["fix"] == self._fix:
            super()._arrive(result, outcome)

    @staticmethod
    def _find_update(result: Result, time: float) -> int:
        from lab.analysis.fix_update import find_last_fix  # noqa: PLC0415 - needed with the first result

        return max(find_last_fix(result, time), 0)

    def _sentence(self, result: Result, content: xr.Dataset) -> str:
        """Return what was done with the fix, and what there was since."""
        times, now = result.fixes.time, self.axis.time
        said, since = sentence(content, times.size), now - content.attrs["time"]
        if self._find_update(result, now) == 0 and since < 0:
            said = f"The filter has not updated yet; this is its first fix. {said}"
        elif times.size > 1 and since > LATE * float(np.median(np.diff(times))):
            said += f" No fix came in the {since:.3g} s since: the filter only predicts, and updates nothing."
        return said + _others_at(result, content.attrs["time"])


def _others_at(result: Result, time: float) -> str:
    """Return in a sentence which other sensors were used together with a fix."""
    if not result.aids.time.size:
        return ""
    data = result.aiding
    near = np.flatnonzero(np.abs(result.aids.time - time) < float(np.diff(result.time[:2])[0]))
    parts = [
        f"{data.kind.values[at]} {number(data.innovation.values[at])} {data.unit.values[at]} "
        f"(σ {number(data.sigma.values[at])}{'' if data.used.values[at] else ', rejected'})"
        for at in near
        if np.isfinite(data.innovation.values[at])
    ]
    return f" Innovations of other sensors at this time: {', '.join(parts)}." if parts else ""
