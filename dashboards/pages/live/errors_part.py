"""Errors part: the errors of the live navigator against the truth, as they happen."""

from __future__ import annotations

from collections import deque
from html import escape

import numpy as np

from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.watched import ABOVE, RollingPart, Watched
from dashboards.seen_names import as_seen
from dashboards.style import whole_column, wide_html
from lab.live.live_errors import LiveErrors, errors_of, join_errors, normalised_rms
from lab.live.live_state import HistoryCursor
from lab.motion.truth.growing_truth import TrueMotion
from lab.views.rolling_figures import LiveErrorFigures

_NO_TRUTH = (
    "Only a simulated device and X-Plane know the true motion: connect one of them to see the errors of the "
    "navigator."
)
_RECENT = 60.0
"""Time over which errors are compared with their σ in the sentence [s]: a few correlation times of errors."""


class ErrorsPart(RollingPart):
    """Errors of position, velocity and attitude between their ±3σ.

    Parameters
    ----------
    window
        Length of time that is shown [s].

    Attributes
    ----------
    view : panel.Column
        All of it.
    """

    def __init__(self, window: float) -> None:
        self._truth: TrueMotion | None = None
        self._cursor = HistoryCursor()
        self._recent: deque[LiveErrors] = deque()
        self._figures: LiveErrorFigures = LiveErrorFigures(window)
        self._words = wide_html(margin=(4, 10))
        figures = self._figures.figures
        self._of_position = make_hideable(plot_grid(figures[:6], 3, 205, beside=ABOVE))
        self._of_attitude = make_hideable(plot_grid(figures[6:], 3, 205, beside=ABOVE))
        self.view = whole_column(self._words, self._of_position, self._of_attitude)
        self.watch(None)

    def watch(self, watched: Watched | None) -> None:
        """Show the errors of another source, or of none."""
        self._watched = watched
        station = self._station
        self._truth = None if station is None else station.source.truth
        self.begin_anew()
        self.tell()

    def close(self) -> None:
        """Refer to no source any more: its truth takes 100 MB at 1 kHz."""
        self._watched = self._truth = None
        self._recent.clear()

    def begin_anew(self) -> None:
        """Forget what is drawn: the next `advance` draws all that the station still has."""
        self._cursor = HistoryCursor()
        self._recent.clear()
        self._of_position.visible = self._of_attitude.visible = False
        self._figures.clear()

    def advance(self) -> None:
        """Append what came since the last time."""
        station, truth = self._station, self._truth
        if station is None or truth is None:
            return
        told = station.history(self._cursor)
        if told is not None:
            self._cursor, history = told
            self._add(errors_of(history, truth), station.zero)
        self._figures.move(station.newest - station.zero)

    def _add(self, errors: LiveErrors, zero: float) -> None:
        if not errors.time.size:
            return
        self._figures.add(errors, zero)
        # Plots without curves are hidden; the words say what they wait for.
        self._of_attitude.visible = True
        self._of_position.visible |= bool(np.isfinite(errors.position).any())
        self._recent.append(errors)
        while self._recent[0].time[-1] < errors.time[-1] - _RECENT:
            self._recent.popleft()

    def tell(self) -> None:
        """Say how large the errors are beside their σ."""
        station, truth = self._station, self._truth
        if station is None or truth is None:
            self._words.object = f"<p>{escape(_NO_TRUTH)}</p>"
            return
        state = station.state
        if not self._recent:
            waits = f"No errors yet: the navigator has no attitude. {as_seen(state.reason)}"
            self._words.object = f"<p>{escape(waits)}</p>"
            return
        rms = normalised_rms(join_errors(self._recent))
        parts = [f"{name} {value:.2f} σ" for name, value in rms.items() if np.isfinite(value)]
        sentence = (
            f"Errors are estimate minus truth. Their rms over the last {_RECENT:g} s, in σ: "
            f"{', '.join(parts)}. A filter whose σ is right has 1 on average over many runs."
        )
        if not self._of_position.visible:
            sentence += " Errors of position and velocity follow with the first position."
        self._words.object = f"<p>{escape(sentence)}</p>"
