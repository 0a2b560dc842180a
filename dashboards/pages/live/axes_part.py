"""Axes part: the guided check of the axes of a device, with what it found."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.notice import Notice
from dashboards.pages.live.field_part import FieldPart
from dashboards.pages.live.watched import PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import WRAP, fields_row, layout_width
from dashboards.style import plain_row, whole_column, wide_html
from dashboards.upload import Upload, without_folder
from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import MAX_BYTES
from lab.data.log.calibration import read_calibration
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.source_status import STREAMING
from lab.live.bench.axis_check import (
    LAST,
    TURN_TIME,
    TURNS,
    AxisCheck,
    AxisObservation,
    CheckedAxes,
    in_device_axes,
)
from lab.live.bench.static_interval import AxisCheckError
from lab.motion.frames import earth
from lab.views.bench_figures import axis_picture

PLACED = 5e-4
"""σ of normal gravity at a known place [m/s²]: 50 mGal of anomaly, which mountains have."""
OTHERS_AXES = (
    "In a class, only the person who opened a source and the teacher may set its axes and its calibration. "
    "You may still check them."
)
"""Said to others who watch."""
_SMALL: dict[str, Any] = {"size": "small", "variant": "outlined", "margin": (3, 4)}
_INTRODUCTION = (
    f"<p>Turn the device as the vehicle would turn it, hold it still for {LAST:g} s, and press Capture "
    "beside the position while you hold it. Two perpendicular positions give the axes, three check them, and "
    "all six also give bias and scale factor of the accelerometers. Two turns check the gyros: begin level, "
    "turn by 90° within "
    f"{TURN_TIME:g} s, then press.</p>"
)
_WORDS = {
    "level": "Level",
    "nose up": "Nose up",
    "right side down": "Right side down",
    "nose down": "Nose down",
    "left side down": "Left side down",
    "upside down": "Upside down",
    "turn right": "Turn right, seen from above",
    "turn nose up": "Turn the nose up",
    "turn right side down": "Turn the right side down",
}


class AxesPart(PartOfWatched):
    """The positions and turns with their buttons, and the outcome.

    Attributes
    ----------
    view : panel.Column
        All of it.
    check : AxisCheck
        What was taken so far.
    """

    def __init__(self) -> None:
        self.check = AxisCheck()
        self._found: CheckedAxes | None = None
        self._shown: dict[str, pn.pane.HTML] = {}
        self._buttons: list[Any] = []
        rows = [self._row(name) for name in _WORDS]
        self._notice = Notice()
        self._picture = wide_html(margin=(4, 10))
        self._words = wide_html(margin=(4, 10))
        self._use = pmui.Button(label="Use these axes", icon="check", color="primary", margin=(6, 8))
        self._use.on_click(lambda _event: self._apply())
        self._rights = wide_html(f"<p>{OTHERS_AXES}</p>", visible=False, margin=(4, 10))
        self._anew = pmui.Button(label="Start over", icon="restart_alt", **_SMALL)
        self._anew.on_click(lambda _event: self._forget())
        self._calibration = Upload(
            self._calibrate, self._notice.say, most=1, largest=MAX_BYTES, label="Calibration file",
            accept=".toml", **_SMALL,
        )  # fmt: skip
        self._field = FieldPart()
        self.view = whole_column(
            wide_html(_INTRODUCTION, margin=(4, 10)),
            self._notice.view,
            fields_row(
                pn.Column(*rows, margin=0, **_share(380)),
                pn.Column(
                    self._words,
                    pn.Row(self._use, self._anew, self._calibration, margin=0, stylesheets=[WRAP]),
                    self._rights,
                    self._picture,
                    margin=0,
                    **_share(380),
                ),
            ),
            self._field.view,
        )
        self.watch(None)

    def watch(self, watched: Watched | None) -> None:
        """Check another device, or none; what was taken of the one before is forgotten."""
        self._watched = watched
        self._field.watch(watched)
        for button in self._buttons:
            button.disabled = watched is None
        self._forget()

    def tell(self) -> None:
        """Renew the points of the magnetometer."""
        self._field.tell()

    def close(self) -> None:
        """Deliver no further results, and delete the file."""
        self._calibration.delete()
        self._field.close()

    def tell_rights(self) -> None:
        """Show whether this page may set the axes."""
        watched = self._watched
        may = watched is None or watched.may_change
        self._rights.visible = not may
        self._use.disabled = self._found is None or watched is None or not may
        self._calibration.disabled = watched is None or not may

    def _row(self, name: str) -> pn.Row:
        button = pmui.Button(label="Capture", **_SMALL, **layout_width(100))
        button.on_click(lambda _event: self._accept(name))
        shown = wide_html(margin=(8, 6))
        self._shown[name] = shown
        self._buttons.append(button)
        return plain_row(button, shown)

    def _accept(self, name: str) -> None:
        if self._station is None:
            return
        source = self._station.source
        status = source.status
        if status.state != STREAMING:
            self._notice.say(
                f"{_WORDS[name]}: the source sends no samples now ({status.state}). Press again "
                "when it streams."
            )
            return
        rows = source.last(TURN_TIME if name in TURNS else LAST).imu
        try:
            self.check.take(name, in_device_axes(rows, source.axes))
        except AxisCheckError as error:
            self._notice.say(str(error))
            return
        self._notice.say("")
        self._report()

    def _forget(self) -> None:
        self.check.forget()
        self._notice.say("")
        self._report()

    def _report(self) -> None:
        """Show what was taken and what follows from it."""
        for name, pane in self._shown.items():
            seen = self.check.positions.get(name) or self.check.turns.get(name)
            pane.object = f"<b>{_WORDS[name]}</b>{'' if seen is None else escape(_outcome(seen))}"
        self._found = None
        said = [self.check.missing]
        if not self.check.missing:
            try:
                self._found = self.check.result(*self._gravity())
            except AxisCheckError as error:
                said = []
                self._notice.say(str(error))
        found = self._found
        if found is not None:
            said = [found.sentence, "" if found.accelerometer is None else str(found.accelerometer)]
        if self.check.still:
            said.append(list(self.check.still.values())[-1].gyro_sentence)
        self._words.object = "".join(f"<p>{escape(one)}</p>" for one in said if one)
        self._picture.object = (
            axis_picture(None)
            if found is None
            else axis_picture(found.axes.axes, inverted=found.axes.inverted_force)
        )
        self.tell_rights()

    def _gravity(self) -> tuple[float, ...]:
        """Return gravity where the navigator is, and its σ; nothing where that is unknown."""
        position = np.full(3, np.nan) if self._station is None else self._station.state.position
        if not np.isfinite(position).all():
            return ()
        return float(earth.gravity(np.sin(position[0]), position[2])), PLACED

    def _apply(self) -> None:
        """Set the axes of the source, for all who watch it."""
        watched, station = self._watched, self._station
        if self._found is None or watched is None or station is None:
            return
        if not watched.may_change:  # the button is disabled, a message may come all the same
            self._notice.say(OTHERS_AXES)
            return
        axes: AxisMap = self._found.axes
        station.source.axes = axes
        self._notice.say(f"The axes of this source are {axes} now, for all who watch it.", "success")

    def _calibrate(self, files: list[Path]) -> None:
        """Give the source the calibration of a file, for all who watch it."""
        watched, station = self._watched, self._station
        if watched is None or station is None:
            return
        if not watched.may_change:  # the button is disabled, a message may come all the same
            self._notice.say(OTHERS_AXES)
            return
        try:
            known = read_calibration(files[0])
        except MissionError as error:
            self._notice.say(without_folder(str(error)))
            return
        station.source.calibration = known
        self._notice.say(
            f"The calibration of this source is now, for all who watch it: {known.words}.", "success"
        )


def _outcome(seen: AxisObservation) -> str:
    which = "turned about" if seen.name in TURNS else "upwards"
    axis = f"{'−' if min(seen.shown) < 0 else ''}{'xyz'[int(np.abs(seen.shown).argmax())]}"
    off = f"{np.degrees(seen.tilt):.0f}° off"
    return f": {which} {axis}, {off}" if seen.name in TURNS else f": {axis} {which}, {off}"


def _share(least: int) -> dict[str, Any]:
    """Return layout options for a column that takes half a row, or all of a narrow one [px]."""
    return {
        "sizing_mode": "stretch_width",
        "stylesheets": [f":host {{ flex: 1 1 min({least}px, 100%) !important; min-width: 0 !important; }}"],
    }
