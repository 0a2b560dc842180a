"""Unfinished part: recordings that a reload or a crash left without a mission, to name or to discard."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.devices import STATIONS
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.style import plain_column, wide_html
from dashboards.visitors import may_edit
from lab.base.files.deleted_files import DeletedFiles
from lab.base.files.mission_error import MissionError
from lab.data.streams.raw_recording import SUFFIX
from lab.data.streams.unfinished import UnfinishedRecordings, discard, restore_recording
from lab.missions import own_folder

LOOK = 2000
"""Time between two looks at the folder [ms]."""
_STAMP = "%Y%m%d-%H%M%S"
"""What the recorder writes behind the name."""


class UnfinishedPart:
    """Offers unfinished recordings to visitors who may record.

    Parameters
    ----------
    make
        Makes a mission of a recording, with this name.
    say
        Shows a sentence, as an error or with another severity.

    Attributes
    ----------
    view : panel.Column
        The offer, which is invisible while there is none, and a button that undoes the last discard.
    """

    def __init__(self, make: Callable[[Path, str], None], say: Callable[..., None]) -> None:
        self._make, self._say = make, say
        self._kept = UnfinishedRecordings()
        self._document = pn.state.curdoc
        self._periodic: Any = None
        small: dict[str, Any] = {"size": "small", "margin": (10, 4)}
        self._choice = pmui.Select(
            label="Unfinished recording", size="small", margin=(8, 4), **layout_width(330)
        )
        self._name = pmui.TextInput(
            label="Name",
            value="recording",
            size="small",
            variant="outlined",
            margin=(8, 4),
            **layout_width(190),
        )
        self._add = pmui.Button(label="Make a mission", icon="add", color="primary", **small)
        self._drop = pmui.Button(label="Discard", icon="delete", variant="outlined", **small)
        self._back = pmui.Button(
            label="Undo: bring it back", icon="undo", variant="outlined", visible=False, **small
        )
        self._gone: tuple[DeletedFiles, Path] | None = None
        self._back.on_click(lambda _event: self._bring_back())
        self._choice.param.watch(lambda _event: self._chosen(), "value")
        self._add.on_click(lambda _event: self._finish())
        self._drop.on_click(lambda _event: self._discard())
        words = wide_html(
            "<p style='margin:2px 0'>A recording was not finished, because its page or the server ended. "
            "Its bytes are kept: name it, or discard it.</p>",
            margin=(4, 10),
        )
        row = fields_row(self._choice, self._name, self._add, self._drop)
        self._offer = plain_column(words, row, visible=False)
        self.view = plain_column(self._offer, self._back)

    def follow(self) -> None:
        """Look at the folder, now and then, until `rest`."""
        self.refresh()
        if may_edit() and self._periodic is None and self._document is not None:
            self._periodic = self._document.add_periodic_callback(self.refresh, LOOK)

    def rest(self) -> None:
        """Look no more."""
        if self._periodic is not None and self._document is not None:
            self._document.remove_periodic_callback(self._periodic)
        self._periodic = None

    def refresh(self) -> None:
        """Offer what is there now."""
        if not may_edit():
            return
        found = {
            _describe_recording(path): path for path in self._kept.found(own_folder(), STATIONS.recordings())
        }
        if found != self._choice.options:
            self._choice.options = found
            if self._choice.value not in found.values():
                self._choice.value = next(iter(found.values()), None)
        self._offer.visible = bool(found)

    def close(self) -> None:
        """Delete for good what was discarded."""
        if self._gone is not None:
            self._gone[0].forget()

    def _chosen(self) -> None:
        path = self._choice.value
        if isinstance(path, Path):
            self._name.value = recording_name(path)

    def _path(self) -> Path | None:
        """Return the chosen recording, if it is among those that are offered."""
        return self._choice.value if self._choice.value in self._choice.options.values() else None

    def _finish(self) -> None:
        path = self._path()
        if path is None or not may_edit():
            return
        try:
            self._make(path, str(self._name.value_input or self._name.value).strip())
        except ValueError as error:
            self._say(str(error))
        self.refresh()

    def _discard(self) -> None:
        path = self._path()
        if path is None or not may_edit():
            return
        try:
            deleted = discard(path)
        except OSError as error:
            self._say(f"{path.name} cannot be deleted: {error.strerror or error}.")
        else:
            self.close()
            self._gone, self._back.visible = (deleted, path), True
            self._say(f"{path.name} was discarded.", "info")
        self.refresh()

    def _bring_back(self) -> None:
        gone, self._gone, self._back.visible = self._gone, None, False
        if gone is None or not may_edit():
            return
        try:
            restore_recording(*gone)
        except (MissionError, OSError) as error:
            self._say(str(error))
        else:
            self._say(f"{gone[1].name} is there again.", "info")
        self.refresh()


def recording_name(path: Path) -> str:
    """Return the name that a person gave to a recording: that of its file without the time."""
    stem = path.name.removesuffix(SUFFIX)
    name, _, stamp = stem.rpartition(" ")
    try:
        time.strptime(stamp.partition("_")[0], _STAMP)
    except ValueError:
        return stem
    return name or stem


def _describe_recording(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError:
        size = 0
    return f"{path.name.removesuffix(SUFFIX)} ({size / 1e6:.2f} MB)"
