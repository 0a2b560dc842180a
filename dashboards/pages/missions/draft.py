"""Draft: an imported flight that is not yet a mission: its report, preview and settings, and Add."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.notice import Notice
from dashboards.pages.missions.column_table import ColumnTable
from dashboards.pages.missions.entry_fields import fields_row
from dashboards.pages.missions.import_fields import ColumnField, SettingFields, UnitFields
from dashboards.pages.missions.job import Job
from dashboards.pages.missions.naming import Naming
from dashboards.session import Session
from dashboards.style import WHOLE, plain_column, whole_column, wide_html
from dashboards.upload import without_folder
from lab.base.arrays import FloatArray
from lab.base.progress import Progress
from lab.data.formats import may_be_table, read_raw
from lab.data.log.sensor_log import SensorLog
from lab.data.rebuild.import_settings import ImportSettings
from lab.data.rebuild.raw_flight import ColumnUnit, RawFlight
from lab.data.sheets.column_proposals import Proposal, column_proposals
from lab.data.streams.recorded_log import device_log
from lab.missions import Mission, MissionError, add_log
from lab.missions.flight_import import FlightImport, prepare_flight
from lab.sensors.suite import white_noise
from lab.views.import_preview import preview_figures
from lab.views.mission_card import REPORT_STYLE, read_log_html, rows_html

SEVERITY = {"plausible": "success", "questionable": "warning", "implausible": "error"}
GRID = """
:host { display: grid !important; gap: 12px; grid-template-columns: minmax(0, 5fr) minmax(260px, 2fr);
        max-height: none !important; }
@media (max-width: 1150px) { :host { grid-template-columns: minmax(0, 1fr); } }
"""
HIGH = 640
"""Height of the preview [px]."""
PREVIEW = """
:host { display: grid !important; gap: 6px; grid-template-columns: repeat(2, minmax(0, 1fr));
        height: auto !important; max-height: none !important; flex: none !important; }
.scroll-button { display: none !important; }  /* Panel's own, which would take a cell */
@media (max-width: 1150px) {
  :host { grid-template-columns: minmax(0, 1fr); }
  .bk-Figure { height: 360px !important; }
}
"""
"""The track beside the quantities over time, or above them where it is narrow."""
NAVIGATE, SIMULATE = "Navigate its sensors", "Simulate sensors on its path"
"""What a file can be added for."""
LOG_ALONE = (
    "The file holds IMU samples and fixes of a device, and no flight path, so it is added as a sensor log."
)
"""What is told of the bytes of a device that no reader of flights knows."""


class _Read(NamedTuple):
    flight: FlightImport | None  # None for a log alone
    log: SensorLog | None
    log_refused: str
    refused: RawFlight | None = None  # has positions that the settings leave out; log_refused says so
    columns: Sequence[Proposal] = ()  # what the columns of a csv are taken for
    kept: Mapping[str, str] = {}  # what a profile of this page says of them


class Draft:
    """An imported flight, or a sensor log, to check and add.

    Parameters
    ----------
    session
        Session that then runs the mission.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._job = Job()
        self._paths: tuple[Path, ...] = ()
        self._as_log: dict[str, bool] = {}
        self._raw: RawFlight | None = None
        self._read: _Read | None = None
        self._settings = ImportSettings()
        self._verdict = Notice()
        self._preview = plain_column(height=HIGH, stylesheets=[PREVIEW])
        self._report = _report_pane()
        self._fields = SettingFields(self._settings, self._rebuild)
        self._units = UnitFields(self._reread)
        self._columns = ColumnField(self._reread, self._job.say)
        self._table = ColumnTable(self._columns.add, self._columns.undo)
        self._log_report = _report_pane()
        self._naming = Naming("flight", "")
        self._question = wide_html(margin=(14, 8, 0, 8))
        self._add = pmui.Button(label=SIMULATE, margin=(10, 4))
        self._add.on_click(lambda _event: self._start_adding(as_log=False))
        self._add_log = pmui.Button(label=NAVIGATE, margin=(10, 4))
        self._add_log.on_click(lambda _event: self._start_adding(as_log=True))
        self._body = self._layout()
        self.view = whole_column(self._job.view, self._table.view, self._columns.view, self._body)

    def _layout(self) -> pn.Column:
        """Return the verdict, the name, the preview, and the reports beside the fields; hidden at first."""
        naming = fields_row(self._naming.view, self._add, self._add_log)
        reports = whole_column(self._report, self._log_report)
        fields = pn.Column(self._fields.view, self._units.view, margin=0, stylesheets=[WHOLE])
        return whole_column(
            self._verdict.view,
            self._question,
            naming,
            self._preview,
            plain_column(reports, fields, stylesheets=[GRID]),
            visible=False,
        )

    def read(self, paths: Sequence[Path]) -> None:
        """Read files, and show the flight in them."""
        self._clear()
        self._paths = tuple(paths)
        self._columns.offer([path.name for path in paths])
        self._naming.suggest(paths[0].name, self._title(as_log=False))
        self._prepare(arrived=True)

    def accept(self, raw: RawFlight, name: str, title: str) -> None:
        """Show a flight that is already read, such as a live recording."""
        self._clear()
        self._raw = raw
        self._naming.suggest(name, title)
        self._prepare()

    def say(self, text: str) -> None:
        """Show an error."""
        self._job.say(text)

    def close(self) -> None:
        """End the work, and show no more."""
        self._job.close()

    def _clear(self) -> None:
        self._paths, self._raw, self._read = (), None, None
        self._units.clear()
        self._table.show((), undoable=False)
        self._columns.view.visible = False
        self._body.visible = False

    def _rebuild(self) -> None:
        if self._raw is not None:
            self._prepare()

    def _reread(self) -> None:
        self._raw = None
        self._prepare()

    def _prepare(self, *, arrived: bool = False) -> None:
        paths, raw = self._paths, self._raw
        before = None if raw is None else self._read  # other settings rebuild the flight, and not the log
        said, axes = {**self._units.chosen(), **self._columns.columns}, self._columns.axes
        offered = self._columns.view.visible and raw is None
        settings, sensors = self._settings.copy(), self._session.experiment.sensors.copy()

        def work(progress: Progress) -> _Read:
            flight = raw
            proposed = _proposals(paths, said) if offered else []
            kept = self._table.kept_for(proposed) if arrived else {}
            units = {**kept, **said}
            try:
                progress("Reading", 0.0)
                flight = read_raw(paths, units) if flight is None else flight
                progress("Rebuilding", 0.0)
                read = prepare_flight(
                    flight, settings, white_noise(sensors, "the chosen IMU"), paths, units, axes
                )
            except MissionError as error:
                alone = _log_alone(paths, axes) if raw is None else None
                if alone is not None:
                    return _Read(None, alone, "")
                text = self._fields.located(self._columns.located(without_folder(str(error))))
                if flight is not None and flight.unmeasured:
                    return _Read(None, None, text, flight)
                if proposed:
                    return _Read(None, None, text, columns=proposed, kept=kept)
                raise MissionError(text) from error
            known = None if before is None or before.refused is not None else before[1:3]
            log, why = known or _read_log(read, units)
            if offered and proposed:
                proposed = _proposals(paths, units, flight.units)
            return _Read(read, log, why, columns=proposed if before is None else before.columns, kept=kept)

        self._job.start("Reading", work, self._show)

    def _show(self, read: _Read) -> None:
        self._read = read
        self._show_columns(read)
        if read.flight is None and read.log is None and read.refused is None:
            self._job.say(read.log_refused)
            self._body.visible = False
            return
        for part in (self._add, self._preview, self._report):
            part.visible = read.flight is not None
        self._fields.view.visible = read.flight is not None or read.refused is not None
        if read.refused is not None:
            self._raw = read.refused  # other settings may make a flight of it
            self._verdict.say("Refused", "error", [read.log_refused])
        elif read.flight is None:
            self._verdict.say("A sensor log", "info", [LOG_ALONE])
        else:
            self._show_flight(read.flight)
        self._ask(read)
        refused = "" if read.refused is not None else self._columns.located(read.log_refused)
        self._log_report.object = read_log_html(read.log, refused)
        self._body.visible = True

    def _show_flight(self, flight: FlightImport) -> None:
        self._raw = flight.raw
        verdict = flight.report.verdict
        words = (
            describe_fine_samples(flight.flight.raw.time) if verdict == "plausible" else verdict.capitalize()
        )
        reasons = [self._fields.located(reason) for reason in flight.report.reasons]
        self._verdict.say(words, SEVERITY[verdict], reasons)
        self._add.label = f"{SIMULATE}, all the same" if verdict == "implausible" else SIMULATE
        self._report.object = self._fields.located(rows_html(flight.report))
        self._units.show(() if self._table.view.visible else flight.raw.units)
        self._preview[:] = list(_panes(flight))

    def _show_columns(self, read: _Read) -> None:
        """Show the columns of a csv if something is guessed, unknown or said by a person, or it is no log."""
        if read.kept:
            self._columns.add(read.kept, read=False)
        told = bool(self._columns.columns) or self._columns.undoable
        refused = read.log is None and bool(read.log_refused)
        shown = read.flight is None or told or refused or any(one.unsure for one in read.columns)
        self._table.show(read.columns if shown else (), undoable=self._columns.undoable)

    def _ask(self, read: _Read) -> None:
        """Ask what the file is, where it holds both; the last answer for its kind stands out."""
        log = read.log
        self._add_log.visible = log is not None
        as_log = log is not None and (read.flight is None or self._as_log.get(self._kind, True))
        self._retitle(as_log)
        for button, stands_out in ((self._add_log, as_log), (self._add, not as_log)):
            button.variant = "contained" if stands_out else "outlined"
        is_open = read.flight is not None and log is not None
        self._question.visible = is_open
        if is_open:
            assert log is not None
            rate, fixes = 1 / float(np.median(np.diff(log.time))), log.gnss.time.size / max(log.duration, 1.0)
            self._question.object = (
                f"<b>What is this file to you?</b> It holds the samples of an IMU at {rate:.3g} Hz and "
                f"{fixes:.2g} fixes a second, so its own sensors can be navigated; or other sensors are "
                "simulated on its path."
            )

    def _title(self, as_log: bool) -> str:
        return f"{'Log' if as_log else 'Flight'} of {self._paths[0].name}" if self._paths else ""

    def _retitle(self, as_log: bool) -> None:
        """Suggest the title of a log, or of a flight, unless a person gave another one."""
        if self._naming.title == self._title(not as_log):
            self._naming.retitle(self._title(as_log))

    @property
    def _kind(self) -> str:
        return self._paths[0].suffix.lower() if self._paths else ""

    def _start_adding(self, as_log: bool) -> None:
        read = self._read
        if read is None or self._job.busy:
            return
        self._retitle(as_log)
        try:
            name, title = self._naming.checked_name(), self._naming.title
        except MissionError as error:
            self._job.say(str(error))
            return

        def work(_progress: Progress) -> Mission:
            if not as_log and read.flight is not None:
                return read.flight.add(name, title)
            assert read.log is not None
            return add_log(read.log, name, title=title)

        if read.flight is not None and read.log is not None:
            self._as_log[self._kind] = as_log
        self._job.start("Adding", work, self._open_added)

    def _open_added(self, added: Mission) -> None:
        self._clear()
        self._session.library_changed(added.name)
        self._job.say(f"{added.name} was imported and opened.", "success")
        self._session.go("", None)


def _report_pane() -> pn.pane.HTML:
    return wide_html(margin=(4, 4), stylesheets=[REPORT_STYLE])


def _read_log(read: FlightImport, units: Mapping[str, str]) -> tuple[SensorLog | None, str]:
    """Return the log that is in the files as well, and why they have none if they should."""
    if read.log is not None or len(read.paths) != 1 or units:
        return read.log, read.log_refused
    try:
        return device_log(read.paths[0], axes=read.axes), read.log_refused
    except (ValueError, OSError) as error:  # of the log, the device or the recording
        return None, without_folder(str(error))


def _proposals(
    paths: Sequence[Path], units: Mapping[str, str], read: Sequence[ColumnUnit] = ()
) -> list[Proposal]:
    """Return what the columns of files are taken for, if they are tables of no format with a reader."""
    try:
        if all(may_be_table(path) for path in paths):
            return column_proposals(paths, units, read)
    except MissionError:
        pass
    return []


def _log_alone(paths: Sequence[Path], axes: Sequence[str]) -> SensorLog | None:
    """Return the log of a file with the bytes of a device; None for other files.

    Raises
    ------
    MissionError
        If the samples of the device make no log.
    """
    if len(paths) != 1:
        return None
    try:
        return device_log(paths[0], axes=axes)
    except (ValueError, OSError) as error:  # of the log, the device or the recording
        raise MissionError(str(error)) from error


def _panes(flight: FlightImport) -> Iterator[pn.viewable.Viewable]:
    """Yield the figures of the preview: the track, and those of the quantities over time."""
    track, times = preview_figures(flight)
    yield pn.pane.Bokeh(track, height=HIGH, sizing_mode="stretch_width", margin=0)
    panes = [pn.pane.Bokeh(one, height=HIGH // 5, sizing_mode="stretch_width", margin=0) for one in times]
    yield whole_column(*panes)


def describe_fine_samples(time: FloatArray) -> str:
    """Return what is said of the samples of a file in which nothing is suspicious, at times [s]."""
    duration = float(time[-1] - time[0])
    rate = (len(time) - 1) / duration
    return f"The file looks fine: {len(time):,} samples at {rate:.3g} Hz, {duration:,.0f} s."
