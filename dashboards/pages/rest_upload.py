"""Rest upload: the recording of an IMU at rest that a person gives, and a card made of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.card_maker import CardMaker
from dashboards.pages.missions.job import Job
from dashboards.style import whole_column
from dashboards.upload import Upload
from lab.analysis import rest
from lab.base.progress import Progress


class RestRecording(NamedTuple):
    """Records of the triads, and the name of their file."""

    records: rest.RestRecords
    name: str


class RestUpload:
    """Takes a recording, and says when it is read.

    Parameters
    ----------
    changed
        Called when `recording` is another one, or none.

    Attributes
    ----------
    recording : RestRecording or None
        The recording; None if there is none.
    view : panel.Column
        The button, the card's fields, progress and errors.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self.recording: RestRecording | None = None
        self._job = Job(closeable=True)
        self._upload = Upload(
            self._read,
            self._job.say,
            label="Recording at rest",
            size="small",
            variant="outlined",
            margin=(8, 4),
        )
        self._back = pmui.Button(
            label="Show the settings' sensors",
            size="small",
            variant="outlined",
            margin=(10, 4),
            visible=False,
        )
        self._back.on_click(lambda _event: self._take(None))
        self._maker = CardMaker(lambda: self.recording, lambda recording: recording)
        self._maker.view.visible = False
        row = pn.FlexBox(self._upload, self._back, self._maker.view, margin=(0, 16), align_items="center")
        self.view = whole_column(row, self._job.view, self._maker.job.view)

    def _read(self, files: list[Path]) -> None:
        self._job.start("Reading the recording", partial(_recording, files), self._take)

    def _take(self, recording: RestRecording | None) -> None:
        self.recording = recording
        self._maker.forget()
        self._maker.view.visible = self._back.visible = recording is not None
        self._maker.button.disabled = recording is None
        self._changed()

    def close(self) -> None:
        """Delete the files, and deliver nothing more."""
        self._upload.delete()
        self._job.close()
        self._maker.close()


def _recording(files: list[Path], _progress: Progress) -> RestRecording:
    name = files[0].name if len(files) == 1 else f"{files[0].name} and {len(files) - 1} more"
    return RestRecording(rest.read_log(files), name)
