"""Exchange: settings and results to and from files."""

from __future__ import annotations

import asyncio
import io
import tempfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document

from dashboards.computing import POOL, LatestWins, Outcome, attempt
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.titled import Card
from dashboards.upload import Upload
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import MAX_BYTES, TomlError, parse_toml
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.export import gpx, kml, tracks_of


class Download(pmui.FileDownload):
    """A download button; if its callback returns None, there is no file."""

    def __init__(self, **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]

    def _sync_data(self, fileobj: io.BytesIO | None) -> None:
        if fileobj is not None:
            super()._sync_data(fileobj)  # type: ignore[no-untyped-call]


class Files:
    """Buttons for files: results as netCDF, csv, KML and GPX, settings as TOML, and settings from TOML."""

    def __init__(self, session: Session) -> None:
        self._session = session
        common = {"size": "small", "variant": "outlined", "sizing_mode": "stretch_width", "margin": (4, 2)}
        self._netcdf = Download(callback=self._to_netcdf, filename="result.nc", label="netCDF", **common)
        self._csv = Download(callback=self._to_csv, filename="result.zip", label="csv", **common)
        self._kml = Download(callback=self._to_kml, filename="result.kml", label="KML", **common)
        self._gpx = Download(callback=self._to_gpx, filename="result.gpx", label="GPX", **common)
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
            (self._netcdf, f"{name}.nc"),
            (self._csv, f"{name}.zip"),
            (self._kml, f"{name}.kml"),
            (self._gpx, f"{name}.gpx"),
            (self._toml, f"{name}.toml"),
        ):
            if widget.filename != filename:
                widget.filename = filename

    async def _to_netcdf(self) -> io.BytesIO | None:
        return await self._written(netcdf)

    async def _to_csv(self) -> io.BytesIO | None:
        return await self._written(zipped_csv)

    async def _to_kml(self) -> io.BytesIO | None:
        return await self._written(kml_file)

    async def _to_gpx(self) -> io.BytesIO | None:
        return await self._written(gpx_file)

    async def _written(self, write: Callable[[Result], bytes]) -> io.BytesIO | None:
        """Return the file of the result; None if there is no result yet, or no room on the disk."""
        result = self._session.result
        if result is None:
            return None
        try:
            return io.BytesIO(await asyncio.get_running_loop().run_in_executor(POOL, write, result))
        except OSError as error:
            reason = error.strerror or str(error)
            self._session.problem = f"The server could not write the file. The system says: {reason}."
            return None

    def _to_toml(self) -> io.BytesIO:
        return io.BytesIO(self._session.experiment.to_toml().encode())

    def close(self) -> None:
        """Delete the uploaded files, and read no more."""
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


def netcdf(result: Result) -> bytes:
    """Return a result as a netCDF file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.nc"
        result.to_netcdf(path)
        return path.read_bytes()


def kml_file(result: Result) -> bytes:
    """Return the paths of a result as KML, for Google Earth."""
    return kml.text(tracks_of(result)).encode()


def gpx_file(result: Result) -> bytes:
    """Return the paths of a result as GPX, for maps."""
    return gpx.text(tracks_of(result)).encode()


def zipped_csv(result: Result) -> bytes:
    """Return a result as csv files in a zip file."""
    buffer = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder:
        result.to_csv(Path(folder) / "result")
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
            for path in sorted((Path(folder) / "result").iterdir()):
                archive.write(path, path.name)
    return buffer.getvalue()
