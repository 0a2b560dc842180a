"""Calibration: the part of the page *Sensors* that finds constant errors in a log, and writes their file."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import NamedTuple, Self

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.exchange import Download
from dashboards.pages.base import Page
from dashboards.pages.summary import TABLE_STYLE
from dashboards.sending import soon, together
from dashboards.session import Session
from dashboards.upload import MAX_BYTES, Upload
from lab.analysis.calibration.imu_calibration import ImuCalibration
from lab.base.progress import Progress
from lab.experiment.calibration import (
    Found,
    calibrate_imu,
    calibrate_magnetometer,
    calibrate_mounting,
    card_of,
)
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.figures import TimeAxis

KINDS: dict[str, Callable[[list[Path]], Found]] = {
    "IMU": calibrate_imu,
    "Magnetometer": calibrate_magnetometer,
}
"""What is found in a file, by what is written on the button."""
_WORDS = (
    "<p>Constant errors of sensors, each judged on data that it did not see, and refused where it gains "
    "nothing. "
    "<b>IMU</b>: a log in which it rests for three seconds in each of the six faces of a box, each of "
    "them twice "
    "or more, and in some attitudes between, with turns between them. <b>Magnetometer</b>: a log in which it "
    "turns in all directions, or once round. <b>Mounting</b>: the drive of this page, a sensor log of a "
    "vehicle on "
    f"wheels. Up to {MAX_BYTES // 2**20} MB.</p>"
)


class _Task(NamedTuple):
    """What to find, and in which files or in which experiment."""

    kind: str
    files: list[Path]
    experiment: Experiment | None


class Calibrate(Page):
    """Takes a log, and finds constant errors in it; it needs no result."""

    title = "Calibration"
    depends_on_window = False
    over_time = False

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        self._document = pn.state.curdoc
        self._work: LatestWins[_Task] = LatestWins(self._find, self._deliver, LONG, at_once=True)
        self.found: Found | None = None
        super().__init__(axis)

    @classmethod
    def of(cls, axis: TimeAxis, session: Session) -> Self:
        """Return the page for a session, whose drive shows the mounting."""
        return cls(axis, session)

    def make(self) -> pn.viewable.Viewable:
        """Return the buttons, and the place of the outcome."""
        self._kind = pmui.RadioButtonGroup(
            options=list(KINDS), value="IMU", label="What the log is of", size="small", margin=(10, 8)
        )
        self._upload = Upload(
            self._arrived, self.say, label="Choose or drop a log", variant="outlined", margin=(10, 8)
        )
        self._mounting = pmui.Button(
            label="Mounting in the drive of this page",
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
        self.words = pn.pane.HTML(
            _WORDS, sizing_mode="stretch_width", margin=(4, 20), stylesheets=[TABLE_STYLE]
        )
        return pn.Column(
            pn.FlexBox(self._kind, self._upload, self._mounting, margin=(0, 12), align_items="center"),
            pn.FlexBox(self._file, self._card, margin=(0, 12)),
            self.words,
            sizing_mode="stretch_width",
            margin=0,
        )

    def draw(self, _result: Result) -> None:
        """Do nothing: the page does not depend on a result."""

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result: it needs none."""
        return True

    def say(self, text: str) -> None:
        """Show a sentence in place of a calibration."""
        self.found = None
        self._file.visible = self._card.visible = False
        self.words.object = f"<p>{escape(text)}</p>"

    def close(self) -> None:
        """End the work, and delete the files."""
        self._work.close()
        self._upload.delete()

    def _arrived(self, paths: list[Path]) -> None:
        self.say("Finding constant errors …")
        self._work.submit(_Task(str(self._kind.value), paths, None))

    def _of_drive(self) -> None:
        self.say("Finding the mounting …")
        self._work.submit(_Task("Mounting", [], self._session.experiment.copy()))

    def _find(self, task: _Task, progress: Progress) -> Outcome:
        if task.experiment is not None:
            experiment = task.experiment
            return attempt(lambda: calibrate_mounting(experiment, progress))
        return attempt(lambda: KINDS[task.kind](task.files))

    def _deliver(self, task: _Task, outcome: Outcome) -> None:
        assert self._document is not None
        soon(self._document, lambda: self._show(task, outcome))

    def _show(self, task: _Task, outcome: Outcome) -> None:
        assert self._document is not None
        # A visitor knows the file by its name, and not where it was put.
        place = f"{task.files[0].parent}/" if task.files else "\0"
        with together(self._document):
            if outcome.problem:
                self.say(outcome.problem.replace(place, ""))
                return
            found: Found = outcome.result
            self.found = found
            self.words.object = found_html(found).replace(place, "")
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
    table = f"<table><tr>{head}</tr>{rows}</table>" if rows else "<p><b>No number is stated.</b></p>"
    return f"<ul>{said}</ul>{table}"
