"""Moment: what a page shows at one time: settings and result, tab, time cursor, and step of a lesson."""

from __future__ import annotations

from typing import NamedTuple
from weakref import ref

from dashboards.notes import Note
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

Key = tuple[str, str]
Place = tuple[Key, int]


class Moment(NamedTuple):
    """What a page shows; no page changes one that it has given away.

    Attributes
    ----------
    experiment : Experiment
        Its settings; whoever takes them over takes a copy.
    page : str
        Title of the tab.
    time : float
        The time cursor [s].
    place : tuple or None
        The open lesson and the number of its step, from 0; None without one.
    computed : weakref.ref or None
        The result of the settings, as long as some page shows it: another page need not compute it again.
    notes : tuple of Note
        The notes on its flight.
    """

    experiment: Experiment
    page: str
    time: float
    place: Place | None = None
    computed: ref[Result] | None = None
    notes: tuple[Note, ...] = ()

    @property
    def result(self) -> Result | None:
        """The result, while it is in use; None without one."""
        return None if self.computed is None else self.computed()

    def has_settings_of(self, experiment: Experiment) -> bool:
        """Return whether an experiment has the same settings, and the same hidden fault."""
        mine = self.experiment
        return mine.hidden == experiment.hidden and mine.to_dict() == experiment.to_dict()
