"""Desk: what a class needs of a page: what it shows, and ways to make it show something else."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from weakref import ref

from bokeh.document import Document

from dashboards.notes import Note
from dashboards.session import Session
from dashboards.teaching.moment import Moment, Place
from lab.experiment.experiment import Experiment


@dataclass(frozen=True)
class Desk:
    """One page in front of a teacher or a student.

    Attributes
    ----------
    session : Session
        Its session.
    document : Document
        Its document.
    page : callable
        Returns the title of the open tab.
    time : callable
        Returns the time of the cursor [s].
    place : callable
        Returns the open step of a lesson; None without one.
    show : callable
        Makes the page show a moment.
    keep : callable
        Keeps the code of a class in the address of the page, and whether its settings are kept beside it.
    href : callable
        Returns the address of the page, as its browser has it.
    enlarge : callable
        Turns large type for a projector on or off.
    flash : callable
        Makes the fields of some settings flash.
    """

    session: Session
    document: Document
    page: Callable[[], str]
    time: Callable[[], float]
    place: Callable[[], Place | None]
    show: Callable[[Moment], None]
    keep: Callable[[str, bool], None]
    href: Callable[[], str]
    enlarge: Callable[[bool], None]
    flash: Callable[[Iterable[str]], None]

    def own(self) -> Moment:
        """Return what the page shows, with the settings of its fields."""
        own = self.session.experiment.copy()
        return Moment(own, self.page(), self.time(), self.place(), notes=self._notes(own))

    def settled(self, before: Moment | None) -> Moment | None:
        """Return what the page shows, with the settings of its result; a moment from before if it has none.

        Settings are shown to a class once their result is there: those that fail reach nobody.
        """
        result = self.session.result
        place = self.place()
        if result is None:
            return before
        if place is None and result.experiment.hidden:  # the fault of a lesson that is closed just now
            return before
        notes = self._notes(result.experiment)
        if before is not None and before.result is result:
            return before._replace(page=self.page(), time=self.time(), place=place, notes=notes)
        return Moment(result.experiment, self.page(), self.time(), place, ref(result), notes)

    def _notes(self, experiment: Experiment) -> tuple[Note, ...]:
        return tuple(one for one in self.session.notes if one.mission == experiment.mission)

    def is_present(self) -> bool:
        """Return whether a browser is connected to the page, or the page is about to open."""
        session = getattr(self.document.session_context, "session", None)
        return session is None or session.connection_count > 0
