"""Ground track: the path of the flight on the map."""

from __future__ import annotations

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.experiment.result import Result
from lab.views.track import TrackFigure


class GroundTrack(Page):
    """True and estimated path and the GPS fixes, in metres from the start."""

    title = "Ground track"
    contents = "the track: true, estimated, and of the fixes"
    seen = ("track",)
    depends_on_window = False

    def make(self) -> pn.viewable.Viewable:
        """Return the one figure."""
        self._track = TrackFigure()
        return plot_grid([self._track.figure], 1, least=420)

    def draw(self, result: Result) -> None:
        """Draw a result."""
        self._track.show(result, self.axis.time, self.held())

    def release(self) -> None:
        """Refer to no result any more; the aircraft stays where it is."""
        super().release()
        self._track.release()

    def show_time(self, time: float) -> None:
        """Mark the aircraft."""
        self._track.show_time(time)
