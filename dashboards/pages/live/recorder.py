"""Recorder: records the watched source, and makes a mission of the recording."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import Progress
from dashboards.pages.missions.entry_fields import sized
from dashboards.pages.missions.job import Job
from dashboards.visitors import may_edit
from lab.live.raw_recording import SUFFIX
from lab.live.recorded_log import log_of_recording
from lab.live.source_status import Status
from lab.live.station import Station
from lab.missions import own_folder
from lab.missions.library import add_log, free_name
from lab.missions.mission_name import accepted_name


class _Stopped(NamedTuple):
    """A recording of which a mission is to be made, with the name and the title of the mission."""

    path: Path
    name: str
    title: str


class Recorder:
    """Records; for visitors who may change missions.

    Attributes
    ----------
    widgets : list
        Its fields, for the row of the page; empty for visitors who may not record.
    view : panel.viewable.Viewable
        Progress and outcome.
    """

    def __init__(self) -> None:
        self._station: Station | None = None
        self._path: Path | None = None
        self._name = ""
        self._stopped: deque[_Stopped] = deque()
        self._job = Job()
        self.view = self._job.view
        self._field = pmui.TextInput(
            label="Name of the recording", value="recording", size="small", variant="outlined", margin=(8, 4),
            **sized(190),
        )  # fmt: skip
        self._button = pmui.Button(
            label="Record", icon="fiber_manual_record", color="error", disabled=True, margin=(10, 4)
        )
        self._button.on_click(lambda _event: self._toggle())
        self.widgets: list[pn.viewable.Viewable] = [self._field, self._button] if may_edit() else []

    def watch(self, station: Station | None) -> None:
        """Record from another station; a recording of the one before is ended."""
        if self._path is not None:
            self._end()
        self._station = station
        self._button.disabled = station is None

    def tell(self, status: Status) -> None:
        """Say what is wrong with a recording that runs; make a mission of one that has ended by itself."""
        if self._path is None or self._station is None:
            return
        if self._station.source.recording != self._path:
            self._end()
        elif status.warning:
            self._job.say(status.warning, "warning")

    def close(self) -> None:
        """End the recording; its bytes stay."""
        if self._path is not None and self._station is not None:
            self._station.source.stop_recording(self._path)
        self._job.close()

    def _toggle(self) -> None:
        if self._path is not None:
            self._end()
            return
        if self._station is None or not may_edit():
            return
        try:
            name = accepted_name(str(self._field.value_input or self._field.value).strip())
            folder = own_folder()
            folder.mkdir(parents=True, exist_ok=True)
            path = _new_file(folder, f"{name} {time.strftime('%Y%m%d-%H%M%S')}")
            self._station.source.record(path)
        except (ValueError, OSError) as error:
            self._job.say(str(error))
            return
        self._name, self._path = name, path
        self._button.param.update(label="Stop", icon="stop", color="default")
        self._job.say(f"Recording into {path.name}.", "info")

    def _end(self) -> None:
        path, self._path = self._path, None
        self._button.param.update(label="Record", icon="fiber_manual_record", color="error")
        if path is None or self._station is None:
            return
        self._station.source.stop_recording(path)
        self._stopped.append(_Stopped(path, self._name, f"Recorded from {self._station.name}"))
        self._job.start("Making a mission of the recording", self._make, self._made)

    def _make(self, _progress: Progress) -> tuple[list[str], list[str]]:
        """Make missions of all recordings that were stopped, also while it works; in a thread.

        Returns
        -------
        tuple
            The names of the missions, and why others were not made.
        """
        made, problems = [], []
        while self._stopped:
            path, name, title = self._stopped.popleft()
            try:
                made.append(add_log(log_of_recording(path), free_name(name), title=title).name)
            except (ValueError, OSError) as error:
                problems.append(f"No mission was made: {str(error).rstrip('.')}. The recording stays: {path}")
        return made, problems

    def _made(self, outcome: tuple[list[str], list[str]]) -> None:
        made, problems = outcome
        are = "is" if len(made) == 1 else "are"
        known = [f"{', '.join(made)} {are} in the library now: choose under Missions."] if made else []
        if known or problems:  # else the job before made these missions too
            self._job.say("\n".join([*known, *problems]), "error" if problems else "success")


def _new_file(folder: Path, stem: str) -> Path:
    """Return the path of a raw recording that is not there yet: people may begin several in a second."""
    path, number = folder / f"{stem}{SUFFIX}", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{number}{SUFFIX}"
    return path
