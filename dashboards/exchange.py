"""Exchange: settings and results to and from files."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document

from dashboards.computing import LatestWins, Outcome, attempt
from dashboards.pages.missions.job import Job
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.titled import Card
from dashboards.upload import Upload
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import MAX_BYTES, TomlError, parse_toml
from lab.base.progress import Progress
from lab.base.result_files import csv_blocks, table
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.export import gpx, kml, tracks_of

WRITTEN = 0.7
"""Part of the work for a zip file that is done before it is compressed."""


class Download(pmui.FileDownload):
    """A download button; if its callback returns None, a file may be given later."""

    def __init__(self, **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]

    def give(self, content: bytes) -> None:
        """Give the browser a file."""
        self._sync_data(io.BytesIO(content))

    def _sync_data(self, fileobj: io.BytesIO | None) -> None:
        if fileobj is not None:
            super()._sync_data(fileobj)  # type: ignore[no-untyped-call]


class Files:
    """Buttons for files: results as report, netCDF, csv, KML and GPX, settings as TOML, and from TOML.

    Parameters
    ----------
    session
        Session whose result and settings are written.
    seen
        Returns the datasets that the visible page shows, and the visible stretch of time [s].
    """

    def __init__(
        self, session: Session, seen: Callable[[], tuple[Sequence[str], tuple[float, float]]]
    ) -> None:
        self._session = session
        self._job = Job()
        common = {"size": "small", "variant": "outlined", "sizing_mode": "stretch_width", "margin": (4, 2)}
        self._seen: Download = Download(
            callback=lambda: self._begin(self._seen, partial(seen_csv, *seen())),
            filename="result.csv",
            label="csv as seen",
            **common,
        )
        self._report = self._download("Report", "report.html", report_file, common)
        self._netcdf = self._download("netCDF", "result.nc", netcdf, common)
        self._csv = self._download("csv of all", "result.zip", zipped_csv, common)
        self._kml = self._download("KML", "result.kml", kml_file, common)
        self._gpx = self._download("GPX", "result.gpx", gpx_file, common)
        self._toml = Download(callback=self._to_toml, filename="settings.toml", label="Settings", **common)
        self._upload = Upload(
            self._uploaded, self._refused, most=1, largest=MAX_BYTES, accept=".toml", label="Load", **common
        )
        document = pn.state.curdoc
        assert document is not None
        self._reading: LatestWins[bytes] = LatestWins(
            lambda content, _progress: attempt(lambda: experiment_of(content)),
            partial(self._arrive, document),
        )
        card = Card(
            self._job.view,
            pn.Row(self._report, self._seen, margin=0, sizing_mode="stretch_width"),
            pn.Row(self._netcdf, self._csv, margin=0, sizing_mode="stretch_width"),
            pn.Row(self._kml, self._gpx, margin=0, sizing_mode="stretch_width"),
            pn.Row(self._toml, self._upload, margin=0, sizing_mode="stretch_width"),
            title="Files",
            title_variant="subtitle2",
            margin=(0, 14, 24, 14),
            variant="outlined",
            sizing_mode="stretch_width",
        )
        self.view = card
        session.param.watch(lambda event: self._rename(event.new), "result")
        self._rename(session.result)

    def _rename(self, result: Result | None) -> None:
        if result is None:
            return
        name = f"{result.mission.name}_{result.experiment.seed}".replace(":", "_")
        for widget, filename in (
            (self._report, f"{name}.html"),
            (self._seen, f"{name}.csv"),
            (self._netcdf, f"{name}.nc"),
            (self._csv, f"{name}.zip"),
            (self._kml, f"{name}.kml"),
            (self._gpx, f"{name}.gpx"),
            (self._toml, f"{name}.toml"),
        ):
            if widget.filename != filename:
                widget.filename = filename

    def _download(
        self, label: str, filename: str, write: Callable[[Result, Progress], bytes], common: dict[str, Any]
    ) -> Download:
        """Return a button for a file of the result, which takes a while to write."""
        made: Download = Download(
            callback=lambda: self._begin(made, write), filename=filename, label=label, **common
        )
        return made

    def _begin(self, button: Download, write: Callable[[Result, Progress], bytes]) -> None:
        """Write a file of the result, unless one is being written: people click again when they wait."""
        result = self._session.result
        if result is None or self._job.busy:
            return

        def work(progress: Progress) -> bytes:
            try:
                return write(result, progress)
            except OSError as error:
                reason = error.strerror or str(error)
                raise ValueError(
                    f"The server could not write the file. The system says: {reason}."
                ) from error

        self._job.start(f"Writing {button.filename}", work, button.give)

    def _to_toml(self) -> io.BytesIO:
        return io.BytesIO(self._session.experiment.to_toml().encode())

    def close(self) -> None:
        """Delete the uploaded files, and read no more."""
        self._job.close()
        self._reading.close()
        self._upload.delete()

    def _refused(self, reason: str) -> None:
        self._session.problem = f"The settings file is not accepted. {reason}"

    def _uploaded(self, paths: list[Path]) -> None:
        """Parse a settings file in a thread, so that other pages do not wait."""
        # The content is read now, because the next upload deletes the file.
        self._reading.submit(paths[0].read_bytes())

    def _arrive(self, document: Document, _content: bytes, outcome: Outcome) -> None:
        soon(document, partial(self._read, outcome))

    def _read(self, outcome: Outcome) -> None:
        if outcome.problem:
            self._session.problem = outcome.problem
            return
        try:
            self._session.accept(outcome.result, called="Settings file")
        except SettingError as error:
            self._session.problem = str(error)


def experiment_of(content: bytes) -> Experiment:
    """Return the experiment described by the content of a settings file.

    Raises
    ------
    SettingError
        If it is not a settings file, or contains a setting that is not accepted.
    """
    if len(content) > MAX_BYTES:
        raise SettingError("The settings file is too large; accepted are TOML files up to 1 MB.")
    try:
        return Experiment().update(parse_toml(content.decode("utf-8-sig")))
    except UnicodeDecodeError as error:
        raise SettingError("The settings file is not text; accepted are TOML files in UTF-8.") from error
    except TomlError as error:
        raise SettingError(f"The settings file: {error}.") from error


def netcdf(result: Result, _progress: Progress) -> bytes:
    """Return a result as a netCDF file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.nc"
        result.to_netcdf(path)
        return path.read_bytes()


def report_file(result: Result, progress: Progress) -> bytes:
    """Return a result as one HTML file that opens without a network."""
    from lab.views.report import report_html  # noqa: PLC0415 - an opening page needs none of it

    progress("Trying the advice of the verdict", 0.0)
    return report_html(result).encode()


def kml_file(result: Result, _progress: Progress) -> bytes:
    """Return the paths of a result as KML, for Google Earth."""
    return kml.text(tracks_of(result)).encode()


def gpx_file(result: Result, _progress: Progress) -> bytes:
    """Return the paths of a result as GPX, for maps."""
    return gpx.text(tracks_of(result)).encode()


def seen_csv(names: Sequence[str], window: tuple[float, float], result: Result, _progress: Progress) -> bytes:
    """Return some datasets of a result in a stretch of time [s], as one csv file.

    Those with the time axis of the first known one are in it; the innovations, if none is known.
    """
    known = [name for name in names if not result.missing_reason(name)] or ["innovations"]
    tables = {name: table(getattr(result, name)) for name in known}
    first = tables[known[0]]
    together = {
        f"{name} {column}" if len(known) > 1 else column: values
        for name, one in tables.items()
        if one.index.equals(first.index)
        for column, values in one.items()
    }
    inside = (first.index >= window[0]) & (first.index <= window[1])
    return "".join(csv_blocks(first.assign(**together)[list(together)][inside])).encode()


def zipped_csv(result: Result, progress: Progress) -> bytes:
    """Return a result as csv files in a zip file."""
    buffer = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder:
        result.to_csv(Path(folder) / "result", progress=lambda words, part: progress(words, WRITTEN * part))
        progress("Compressing", WRITTEN)
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=2) as archive:
            for path in sorted((Path(folder) / "result").iterdir()):
                archive.write(path, path.name)
    return buffer.getvalue()
