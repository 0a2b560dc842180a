"""Calibration: the part of the page *Sensors* that finds constant errors in a log, and writes their file."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path

import panel as pn
import panel_material_ui as pmui

from dashboards.exchange import Download
from dashboards.pages.base import OwnPage
from dashboards.pages.missions.job import Job
from dashboards.pages.summary import TABLE_STYLE
from dashboards.session import Session
from dashboards.style import plain_column, wide_html
from dashboards.upload import MAX_BYTES, Upload, without_folder
from lab.analysis.calibration.imu_calibration import ImuCalibration
from lab.base.progress import Progress
from lab.experiment.calibration import (
    Found,
    calibrate_imu,
    calibrate_magnetometer,
    calibrate_mounting,
    card_of,
)
from lab.views.ensemble_cards import scroll_box
from lab.views.figures import TimeAxis

KINDS: dict[str, Callable[[list[Path]], Found]] = {
    "IMU": calibrate_imu,
    "Magnetometer": calibrate_magnetometer,
}
"""What is found in a file, by what is written on the button."""
_WORDS = (
    "<p>This page finds the constant errors of a sensor. Each is tested on data that were not used to find "
    "it, and dropped if it does not help.</p>"
    "<p><b>IMU</b>: record a log in which the IMU rests three seconds on each of the six faces of a box, "
    "twice or more, and in some attitudes between. Turn it by hand between the rests.<br>"
    "<b>Magnetometer</b>: record a log in which it turns in all directions, or once round.<br>"
    "<b>Mounting</b>: open the sensor log of a drive on wheels as the mission, then press the button "
    f"above.</p><p>A log may have up to {MAX_BYTES // 2**20} MB.</p>"
)


class Calibrate(OwnPage):
    """Takes a log, and finds constant errors in it."""

    title = "Calibration"
    contents = "the form for a log to calibrate from"

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        self.found: Found | None = None
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the buttons, and the place of the outcome."""
        self._kind = pmui.RadioButtonGroup(
            options=list(KINDS), value="IMU", label="The log is of", size="small", margin=(10, 8)
        )
        self.job = Job(closeable=True)
        self._upload = Upload(
            self._arrived, self.job.say, label="Choose or drop a log", variant="outlined", margin=(10, 8)
        )
        self._mounting = pmui.Button(
            label="Find the mounting in this mission",
            icon="directions_car",
            variant="outlined",
            margin=(10, 8),
        )
        self._mounting.on_click(lambda _event: self._of_drive())
        self._file = Download(
            callback=self._calibration,
            filename="calibration.toml",
            label="Download calibration.toml",
            visible=False,
            variant="outlined",
            margin=(10, 8),
        )
        self._card = Download(
            callback=self._card_file,
            filename="calibrated.toml",
            label="Download a card of the sensor",
            visible=False,
            variant="outlined",
            margin=(10, 8),
        )
        self.words = wide_html(_WORDS, margin=(4, 20), stylesheets=[TABLE_STYLE])
        return plain_column(
            pn.FlexBox(self._kind, self._upload, self._mounting, margin=(0, 12), align_items="center"),
            plain_column(self.job.view, margin=(0, 16)),
            pn.FlexBox(self._file, self._card, margin=(0, 12)),
            self.words,
        )

    def close(self) -> None:
        """End the work, and delete the files."""
        self.job.close()
        self._upload.delete()

    def _arrived(self, paths: list[Path]) -> None:
        find = KINDS[str(self._kind.value)]
        self._start("Finding constant errors", lambda _progress: find(paths))

    def _of_drive(self) -> None:
        experiment = self._session.experiment.copy()
        self._start("Finding the mounting", lambda progress: calibrate_mounting(experiment, progress))

    def _start(self, words: str, work: Callable[[Progress], Found]) -> None:
        self.found = None
        self._file.visible = self._card.visible = False
        self.words.object = _WORDS
        self.job.start(words, work, self._show_calibration)

    def _show_calibration(self, found: Found) -> None:
        self.found = found
        self.words.object = without_folder(found_html(found))
        self._file.visible = not found.calibration.is_empty
        self._card.visible = isinstance(found, ImuCalibration) and bool(found.stated)

    def _calibration(self) -> io.BytesIO:
        known = self.found
        if known is None:
            return io.BytesIO()
        name = Path(known.calibration.source).name  # not where a visitor's file was put
        return io.BytesIO(replace(known.calibration, source=name).to_toml().encode())

    def _card_file(self) -> io.BytesIO:
        known = self.found
        if not isinstance(known, ImuCalibration):
            return io.BytesIO()
        name = Path(known.calibration.source).name
        own = replace(known, calibration=replace(known.calibration, source=name))
        return io.BytesIO(card_of(own, "calibrated").to_toml().encode())


def found_html(found: Found) -> str:
    """Return the sentences with what they rest on, and the table of the stated terms."""
    rows = "".join(
        f"<tr><td>{escape(one.group)}</td><td>{escape(one.name)} {escape(one.axis)}</td>"
        + f"<td>{one.value:+.4g}</td><td>{one.sigma:.2g}</td>".replace("-", "−")
        + f"<td>{one.interval[0]:+.4g} to {one.interval[1]:+.4g}</td>".replace("-", "−")
        + f"<td>{escape(one.unit)}</td></tr>"
        for one in found.stated
    )
    head = "".join(f"<th>{name}</th>" for name in ("sensor", "term", "value", "σ", "95 % interval", "unit"))
    said = "".join(f"<li>{escape(sentence)}</li>" for sentence in found.sentences)
    table = f"<table><tr>{head}</tr>{rows}</table>"
    table = scroll_box(table, "Calibration") if rows else "<p><b>No number is stated.</b></p>"
    return f"<ul>{said}</ul>{table}"
