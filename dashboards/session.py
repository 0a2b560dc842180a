"""Session: the state of one open page: its settings, its last good result, and its messages."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event
from typing import Any, NamedTuple

import param
from bokeh.document import Document
from bokeh.events import DocumentReady

from dashboards.computing import LatestWins, Outcome, run
from dashboards.notes import Note
from dashboards.sending import soon, together
from lab.base.files.deleted_files import DeletedFiles
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.classroom.homework.homework import Homework
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.live.owner import Visitor
from lab.missions import missions, names_in_words
from lab.missions.library import take_mission_away

OUTAGES = "sensors.gps.outages"
PATIENCE = 500
"""Time after which the page shows the progress of a run [ms]."""

RUNS = (1, 10, 30, 100, 300, 1000)
"""Numbers of runs that a page can judge together."""

AT_HAND = 0.2
"""Longest time for which a page that is being made waits for its result [s]: one in the cache takes 20 ms."""

REST = 1000
"""Quiet time before the settings count as settled [ms]; a change on ten pages takes less."""


class Wanted(NamedTuple):
    """Settings to run; and their result, if another page has it already."""

    experiment: Experiment
    ready: Result | None = None


MOST_HELD = 4
"""Most results that a page holds: more curves beside each other are not told apart."""


class Held(NamedTuple):
    """A result that is held, to be compared with others.

    Attributes
    ----------
    name : str
        What differs in its settings, in words.
    result : Result
        The result.
    """

    name: str
    result: Result


class Glide(NamedTuple):
    """A motion of a slider: all changes of it are one.

    Attributes
    ----------
    path : str
        Path of the setting.
    number : int
        How many times the slider was taken until now.
    """

    path: str
    number: int


class Session(param.Parameterized):
    """Settings of one page, computed in the background; the last good result stays until the next.

    Attributes
    ----------
    homework : Homework or None
        The homework of the server that is open, whose name is in the address.
    fills_gaps : bool
        Whether a card is loaded with typical values for what its datasheet lacks.
    prepare
        Called in a thread with each new result, before it is shown.
    go
        Opens a page at a time of the flight [s]: by its title; empty, the page that opens first; None, what
        is open in the tabs, without the missions over it.
    remind
        Shows a sentence above all pages; none if it is empty.
    acted
        Called when a person, or a lesson, has changed settings or the step of a lesson.
    record
        Called with each change of settings: its name, empty if they name it themselves, and the motion of a
        slider of which it is a part, or None.
    visitor
        Returns whose page it is.
    keep
        Called when what the browser stores of the page besides its address has changed.
    solved
        Called with a lesson, as origin and name, and the number from 0 of a step that is solved now.
    """

    result: Result | None = param.Parameter(None, doc="The last good result.")
    problem: str = param.String("", doc="Error of the last change; empty if there was none.")
    stage: str = param.String(
        "", doc="Description of the current computation, if it takes long enough to be shown."
    )
    fraction: float = param.Number(0.0, doc="Fraction of the computation that is done.")
    held: tuple[Held, ...] = param.Parameter((), doc="The results that are held, the oldest first.")
    shows_sigmas: bool = param.Boolean(True, doc="Whether the fields of variances show σ, their roots.")
    notes: tuple[Note, ...] = param.Parameter((), doc="What people wrote on stretches of flights.")
    runs: int = param.Selector(default=1, objects=RUNS, doc="Number of runs that are judged together.")

    def __init__(self, document: Document) -> None:
        super().__init__()
        self.experiment = Experiment()
        self._document = document
        self.homework: Homework | None = None
        self.fills_gaps = True
        self.prepare: Callable[[Result], None] = lambda _result: None
        self.go: Callable[[str | None, float | None], None] = lambda _page, _time: None
        self.remind: Callable[[str], None] = lambda _sentence: None
        self.acted: Callable[[], None] = lambda: None
        self.record: Callable[[str, Glide | None], None] = lambda _called, _glide: None
        self.visitor: Callable[[], Visitor] = Visitor
        self.keep: Callable[[], None] = lambda: None
        self.solved: Callable[[tuple[str, str], int], None] = lambda _lesson, _step: None
        self._runs = LatestWins(self._run, self._deliver)
        self._watching = self._run_failed = False
        self._on_settings: list[Callable[[], None]] = []
        self._on_rest: list[Callable[[], None]] = []
        self._on_library: list[Callable[[], None]] = []
        self._on_run: list[Callable[[], None]] = []
        self._deleted: dict[str, DeletedFiles] = {}
        self._changed, self._resting = 0.0, True
        self._closed = False
        self._arrived: tuple[Experiment, Outcome] | None = None
        self._has_arrived = Event()
        self._newest: Experiment | None = None
        self._released: Experiment | None = None
        self._restored: Experiment | None = None
        self._browser_ready = False
        # A browser ignores changes that arrive before the requested document.
        document.on_event(DocumentReady, lambda _event: self._open())

    def on_settings(self, callback: Callable[[], None]) -> None:
        """Register a callback for changes of the settings that do not come from a single widget."""
        self._on_settings.append(callback)

    def on_idle(self, callback: Callable[[], None]) -> None:
        """Register a callback for settled settings after changes by a widget.

        This is for updates that may come later than the plots: changing the text of a box takes the browser
        so long that a slider would visibly lag.
        """
        self._on_rest.append(callback)

    def on_library(self, callback: Callable[[], None]) -> None:
        """Register a callback for missions that this session added, renamed or deleted."""
        self._on_library.append(callback)

    def on_run(self, callback: Callable[[], None]) -> None:
        """Register a callback for each run that begins: the shown result is then that of older settings."""
        self._on_run.append(callback)

    @property
    def is_running(self) -> bool:
        """Whether a run is under way, or its outcome waits to be shown."""
        return self._runs.busy or self._arrived is not None

    def library_changed(self, chosen: str | None = None) -> None:
        """Report that the missions have changed, and choose another one if it is named."""
        if chosen is not None:
            self.change("mission", chosen)
        for callback in (*self._on_library, *self._on_settings):
            callback()

    def delete_mission(self, name: str) -> None:
        """Delete a mission of the user's own; this session can bring it back until it ends.

        Raises
        ------
        MissionError
            If it cannot be deleted.
        """
        deleted = take_mission_away(name)
        before, self._deleted[name] = self._deleted.get(name), deleted
        if before is not None:
            before.forget()

    def bring_back(self, name: str) -> bool:
        """Bring a mission back that this session has deleted; return whether it is there again.

        Raises
        ------
        MissionError
            If another one has taken its place, or the folder cannot be written.
        """
        deleted = self._deleted.get(name)
        if deleted is None:
            return False
        deleted.restore()
        del self._deleted[name]
        self.library_changed()
        return True

    def compute(self) -> None:
        """Run the current settings in the background."""
        if self._closed:
            return
        self.release()
        self._submit(Wanted(self.experiment.copy()))

    def release(self) -> None:
        """Drop the result of a long flight: two of them, or one and another run, take too much memory.

        The plots stay as they are. `restore` computes the result again.
        """
        if self.result is not None and self.result.is_long:
            self._released = self.result.experiment.copy()
            self.result = None

    def restore(self) -> None:
        """Compute a released result again, unless a run is under way."""
        if self.result is None and self._released is not None and not self._runs.busy:
            self._restored = self._released
            self._submit(Wanted(self._restored))

    def _submit(self, wanted: Wanted) -> None:
        self._newest = wanted.experiment
        for callback in self._on_run:
            callback()
        self._runs.submit(wanted)
        if not self._watching:
            self._watching = True
            self._document.add_timeout_callback(self._watch, PATIENCE)

    def change(self, path: str, value: Any) -> bool:
        """Change one setting and compute; return whether it was accepted."""
        try:
            self.set(path, value)
        except SettingError as error:
            self.problem = str(error)
            return False
        return True

    def set(self, path: str, value: Any, glide: Glide | None = None) -> None:
        """Change one setting and compute.

        Parameters
        ----------
        path, value
            The setting and its new value.
        glide
            The motion of a slider of which the change is a part.

        Raises
        ------
        SettingError
            If the setting does not accept the value, or must not be changed.
        """
        if path == "mission":
            _check_mission(value)
        self.experiment.check_change(path)
        self.experiment.set(path, value)
        self.problem = ""
        self.record("", glide)
        self.acted()
        self.compute()
        self._changed = time.monotonic()
        if self._resting:
            self._resting = False
            self._document.add_timeout_callback(self._rest, REST)

    def change_shown(self, path: str, value: Any) -> None:
        """Change one setting from elsewhere than its field, which then shows it."""
        changed = self.experiment.copy()
        try:
            changed.check_change(path)
            changed.set(path, value)
            self.accept(changed)
        except SettingError as error:
            self.problem = str(error)

    def take_gps_away(self, start: float, end: float) -> None:
        """Add a GPS outage [s], in the clock of the settings; outages that touch become one."""
        start, end = round(start, 1), round(end, 1)
        outages: list[tuple[float, float]] = []
        for stretch in sorted([*self.experiment.get(OUTAGES), (start, end)]):
            if outages and stretch[0] <= outages[-1][1]:
                outages[-1] = (outages[-1][0], max(outages[-1][1], stretch[1]))
            else:
                outages.append(stretch)
        self.change_shown(OUTAGES, outages)

    def accept(self, experiment: Experiment, ready: Result | None = None, *, called: str = "") -> None:
        """Take over all settings of an experiment, and run them.

        Parameters
        ----------
        experiment
            The settings.
        ready
            Their result, if another page has it: it is shown in place of another run. Results do not change.
        called
            Name of the change in the history; by default, the settings that differ name it.

        Raises
        ------
        SettingError
            If its mission is not in the catalogue; then nothing is changed.
        """
        _check_mission(experiment.mission)
        self.experiment = experiment
        self.problem = ""
        for callback in self._on_settings:
            callback()
        self.record(called, None)
        self.acted()
        if ready is None or self._closed:
            self.compute()
        else:
            self.release()
            self._submit(Wanted(ready.experiment, ready))

    def close(self) -> None:
        """End the session: deliver no more, and drop the result."""
        self._closed = True
        for deleted in self._deleted.values():
            deleted.forget()
        self._runs.close()
        self._arrived = None
        # The page is gone: nothing is drawn again for this.
        with param.parameterized.discard_events(self):
            self.result, self.held = None, ()
        self._on_settings.clear()
        self._on_rest.clear()
        self._on_library.clear()
        self._on_run.clear()

    def _run(self, wanted: Wanted, progress: Progress) -> Outcome:
        return run(wanted.experiment, progress, self.prepare, wanted.ready)

    def _deliver(self, wanted: Wanted, outcome: Outcome) -> None:
        experiment = wanted.experiment
        replaced = outcome.result is not None and outcome.result.is_long and experiment is not self._newest
        if not (self._closed or replaced):
            self._arrived = experiment, outcome
            self._has_arrived.set()
            soon(self._document, self._collect)

    def take_at_hand(self) -> None:
        """Take the first result now if it is there at once, for a page that is being made.

        The browser then gets its plots with their curves, and makes and lays them out once. The event loop
        waits meanwhile, so no other page may be open.
        """
        self._has_arrived.wait(AT_HAND)
        self._take()

    def _open(self) -> None:
        self._browser_ready = True
        self._collect()

    def _collect(self) -> None:
        """Take the arrived outcome; it waits until the browser has its document."""
        if self._browser_ready:
            self._take()

    def _take(self) -> None:
        if self._arrived is not None:
            (experiment, outcome), self._arrived = self._arrived, None
            self._receive(experiment, outcome)

    def _receive(self, experiment: Experiment, outcome: Outcome) -> None:
        if self._closed:
            return
        is_restored, self._restored = experiment is self._restored, None
        with together(self._document):
            if outcome.result is None:
                self._run_failed, self.problem = True, outcome.problem
                if experiment.mission not in missions():
                    self.problem = (
                        f"The mission {experiment.mission[:60]!r} is not there any more. "
                        "Choose another one. If it was deleted on another page, undo there brings it back."
                    )
                if is_restored:  # what was computed before can no longer be
                    self._released = None
                elif self.result is None and self._released is not None and experiment is self._newest:
                    self._restored = self._released
                    self._submit(Wanted(self._restored))
                return
            self._released = None
            self.result = outcome.result
            if self._run_failed and not is_restored:
                self._run_failed, self.problem = False, ""

    def _rest(self) -> None:
        left = REST - round(1000 * (time.monotonic() - self._changed))
        if left > 0 and not self._closed:
            self._document.add_timeout_callback(self._rest, left)
            return
        self._resting = True
        for callback in self._on_rest:
            callback()

    def _watch(self) -> None:
        self._watching = False
        if self._closed:
            return
        if not self._runs.busy:
            self.param.update(stage="", fraction=0.0)
            return
        if self._runs.busy_for >= PATIENCE / 1000:
            stage, fraction = self._runs.stage
            self.param.update(stage=stage, fraction=fraction)
        self._watching = True
        self._document.add_timeout_callback(self._watch, PATIENCE)


def _check_mission(name: str) -> None:
    """Refuse missions outside the catalogue: a page must not give access to files of the server."""
    known = missions()
    if name not in known:
        raise SettingError(
            f"{name[:60]!r}: there is no such mission, or it was deleted; accepted is one of "
            f"{names_in_words(known)}"
        )
