"""Recorder: records the watched source, and makes a mission of the recording."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.live.unfinished_part import UnfinishedPart, recording_name
from dashboards.pages.live.watched import PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import layout_width
from dashboards.pages.missions.job import Job
from dashboards.session import Session
from dashboards.style import plain_column, plain_row
from dashboards.visitors import may_edit
from lab.base.progress import Progress
from lab.data.streams.raw_recording import SUFFIX
from lab.data.streams.recorded_log import log_of_recording
from lab.data.streams.source_status import Status
from lab.data.streams.unfinished import hold_recording, mark, release, unmark
from lab.live.station import Station
from lab.missions import own_folder
from lab.missions.library import add_log, free_name
from lab.missions.mission_name import accepted_name


class _Stopped(NamedTuple):
    """A recording of which a mission is to be made, with the name and the title of the mission."""

    path: Path
    name: str
    title: str
    station: Station | None  # whose watchers learn what became of it
    warning: str = ""  # what was not written, as of a full disk


class Recorder(PartOfWatched):
    """Records; for visitors who may change missions.

    Parameters
    ----------
    session
        Session that opens the mission which was made.

    Attributes
    ----------
    widgets : list
        Its fields, for the row of the page; empty for visitors who may not record.
    offer : UnfinishedPart
        Recordings that were not finished.
    view : panel.viewable.Viewable
        Progress and outcome, and that offer.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._saved = ""  # the mission that was made last
        self._recorded_from: Station | None = None  # what this page records, also once it may not watch it
        self._path: Path | None = None
        self._own = False  # whether this page began the recording
        self._heard = ""  # what became of the last recording, as far as it is shown
        self._stopped: deque[_Stopped] = deque()
        self._job = Job()
        self.offer = UnfinishedPart(self._finish, self._job.say)
        self._open = pmui.Button(
            label="Open", icon="arrow_forward", visible=False, size="small", margin=(10, 4)
        )
        self._open.on_click(lambda _event: self._show_mission())
        self.view = plain_column(plain_row(self._job.view, self._open), self.offer.view)
        self._field = pmui.TextInput(
            label="Recording", value="recording", size="small", variant="outlined", margin=(8, 4),
            **layout_width(140),
        )  # fmt: skip
        # Two buttons: who presses Record while another page begins must not stop what that one records.
        self._record = pmui.Button(
            label="Record", icon="fiber_manual_record", color="error", disabled=True, margin=(10, 4)
        )
        self._record.on_click(lambda _event: self._begin())
        self._stop = pmui.Button(label="Stop", icon="stop", color="default", visible=False, margin=(10, 4))
        self._stop.on_click(lambda _event: self._end())
        fields = [self._field, self._record, self._stop]
        self.widgets: list[pn.viewable.Viewable] = fields if may_edit() else []

    def watch(self, watched: Watched | None) -> None:
        """Record from another station; a recording that this page began on the one before is ended."""
        if self._path is not None and self._own:
            self._end()
        self._path = None
        self._show_idle()
        self._watched = watched
        station = self._station
        self._heard = "" if station is None else station.recorded
        self._record.disabled = station is None
        self.offer.refresh()

    def tell(self, status: Status) -> None:
        """Show a recording that runs, whoever began it; make a mission of one that has ended by itself."""
        station = self._station
        if station is None:
            return
        running = station.source.recording
        if self._path is not None and running != self._path:
            if self._own:
                self._end()
            else:
                self._path = None
                self._show_idle()
                self._job.say("The recording has ended.", "info")
        if running is not None and self._path is None:
            self._show_foreign_recording(running)
        elif self._path is not None and status.warning:
            self._job.say(status.warning, "warning")
        if station.recorded != self._heard:
            self._heard = station.recorded
            if running is None and not self._job.busy:
                self._job.say(self._heard, "info")

    def clear(self) -> None:
        """Say nothing any more about a recording of another source that has become a mission."""
        if not self._job.busy:
            self._open.visible = False
            self._job.say("")

    def _show_mission(self) -> None:
        """Choose the mission that was made last, and show it."""
        self._open.visible = False
        self._job.say("")
        self._session.library_changed(self._saved)
        self._session.go("Overview", None)

    def close(self) -> None:
        """Leave a recording to those who still watch; it ends with the last, and is offered as unfinished."""
        self._job.close()
        self.offer.close()

    def _begin(self) -> None:
        station = self._station
        if station is None or self._path is not None or not may_edit():
            return
        try:
            name = accepted_name(str(self._field.value_input or self._field.value).strip())
            folder = own_folder()
            folder.mkdir(parents=True, exist_ok=True)
            path = _new_file(folder, f"{name} {time.strftime('%Y%m%d-%H%M%S')}")
            mark(path)
            try:
                station.source.record(path)
            except ValueError:
                unmark(path)
                raise
        except (ValueError, OSError) as error:
            running = station.source.recording
            if running is None:
                self._job.say(str(error))
            else:  # another page was faster
                self._show_foreign_recording(running)
            return
        self._recorded_from = station
        self._open.visible = False
        self._show_running(path, own=True)
        self._job.say(f"Recording into {path.name}.", "info")

    def _show_foreign_recording(self, running: Path) -> None:
        """Show a recording that another page began."""
        self._show_running(running, own=False)
        self._job.say(f"Another page records into {running.name}; Stop ends it for all.", "info")

    def _show_running(self, path: Path, *, own: bool) -> None:
        self._path, self._own = path, own
        self._record.visible, self._stop.visible = False, True

    def _show_idle(self) -> None:
        self._record.visible, self._stop.visible = True, False

    def _end(self) -> None:
        path, self._path = self._path, None
        station = self._recorded_from if self._own else self._station
        self._recorded_from = None
        self._show_idle()
        if path is None or station is None or not may_edit():
            return
        station.source.stop_recording(path)
        if not hold_recording(path):
            self._job.say("The recording was ended on another page.", "info")
            return
        warning = station.source.status.warning
        title = f"Recorded from {station.name}"
        self._stopped.append(_Stopped(path, recording_name(path), title, station, warning))
        self._job.start("Making a mission of the recording", self._make, self._made)

    def _finish(self, path: Path, name: str) -> None:
        """Make a mission of an unfinished recording; raises `ValueError` for a name that is not accepted."""
        name = accepted_name(name)
        if not hold_recording(path):
            raise ValueError(f"Another page works on {path.name}.")
        self._stopped.append(_Stopped(path, name, "Recorded, and finished later", None))
        self._job.start("Making a mission of the recording", self._make, self._made)

    def _make(self, _progress: Progress) -> tuple[list[str], list[str], list[str]]:
        """Make missions of all recordings that were stopped, also while it works; in a thread.

        Returns
        -------
        tuple
            The names of the missions, what of them was not written, and why others were not made.
        """
        made, warnings, problems = [], [], []
        while self._stopped:
            path, name, title, station, warning = self._stopped.popleft()
            try:
                made.append(add_log(log_of_recording(path), free_name(name), title=title).name)
                outcome = saved_words(made[-1:])
            except (ValueError, OSError) as error:
                outcome = f"No mission was made: {str(error).rstrip('.')}. The recording stays: {path}"
                problems.append(outcome)
            except BaseException:
                release(path)
                raise
            unmark(path)
            if warning:
                warnings.append(warning)
                outcome = f"{warning}\n{outcome}"
            if station is not None:
                station.recorded = outcome
        return made, warnings, problems

    def _made(self, outcome: tuple[list[str], list[str], list[str]]) -> None:
        made, warnings, problems = outcome
        known = [saved_words(made)] if made else []
        if made:
            self._saved, self._open.visible = made[-1], True
        if known or problems:  # else the job before made these missions too
            if self._station is not None:
                self._heard = self._station.recorded  # the last of them, told here with the others
            severity = "error" if problems else "warning" if warnings else "success"
            self._job.say("\n".join([*warnings, *known, *problems]), severity)


def saved_words(names: list[str]) -> str:
    """Return that missions are in the library now."""
    return f"Saved to the library as {', '.join(f'“{name}”' for name in names)}."


def _new_file(folder: Path, stem: str) -> Path:
    """Return the path of a raw recording that is not there yet: people may begin several in a second."""
    path, number = folder / f"{stem}{SUFFIX}", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{number}{SUFFIX}"
    return path
