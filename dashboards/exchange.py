"""Exchange: settings and results to and from files, and settings to and from the address of the page."""

from __future__ import annotations

import asyncio
import io
import json
import re
import tempfile
import time
import zipfile
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document

from dashboards.classroom import shelf
from dashboards.computing import POOL, LatestWins, Outcome, attempt
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.teaching.class_link import FIELD
from dashboards.titled import Card
from dashboards.upload import Upload
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import MatrixOrNone
from lab.base.parameters.toml_file import MAX_BYTES, TomlError, parse_toml
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.export import gpx, kml, tracks_of

MOST_FIELDS = 200
"""Most settings an address may hold; there are fewer than 100."""

MOST_PROBLEMS = 10
"""Most wrong settings of an address that are reported; the rest is ignored, because each message takes
time."""

HOMEWORK = "homework"
"""What names a homework of the server in an address."""

THEME = "theme"
"""What names the theme in an address, ``dark`` or ``default``; Panel itself takes it."""

SOON, PERIOD = 50, 500
"""Time until a change is in the address, so that a reload keeps it, and the same while a setting changes all
the time, as with a slider [ms]."""
AT_ONCE, OF_LATE = 8, 10.0
"""Most updates within a time [s] before they become rare: more changes are those of a slider, and a browser
accepts a hundred entries in its history in 30 s."""


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
            self._session.accept(outcome.result)
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


class Address:
    """Keeps the settings that differ from the defaults in the address of the page."""

    def __init__(self, session: Session, document: Document) -> None:
        self._session = session
        self._document = document
        self._location = pn.state.location
        self._waits = False  # for the next update
        self._updates: deque[float] = deque(maxlen=AT_ONCE)
        """When the last updates were [s]."""
        self._code, self._keeps_settings = "", True
        self._theme = ""
        session.param.watch(lambda _event: self.update(), "result")

    @property
    def query(self) -> str:
        """The query of the address."""
        return self._location.search.removeprefix("?") if self._location is not None else ""

    @property
    def href(self) -> str:
        """The address, as the browser has it; empty without a browser."""
        return str(self._location.href) if self._location is not None else ""

    def keep_class(self, code: str, keeps_settings: bool) -> None:
        """Keep the code of a class in the address, none if it is empty, and the settings beside it or not."""
        if (code, keeps_settings) != (self._code, self._keeps_settings):
            self._code, self._keeps_settings = code, keeps_settings
            self.update()

    def read(self) -> None:
        """Apply the settings in the address; report those that are not accepted."""
        theme = re.search(rf"(?:^|&){THEME}=(dark|default)(?:&|$)", self.query)
        self._theme = theme[1] if theme else ""
        name, rest = homework_of_query(self.query)
        trial, problems = experiment_of_query(rest)
        if name:
            self._session.homework = shelf().find(name)
            if self._session.homework is None:
                problems.append(f"There is no homework {name[:40]!r} on this server. Ask your teacher.")
            else:
                trial = self._session.homework.taking(trial)
                self._session.go("Lessons", None)
        try:
            self._session.accept(trial)
        except SettingError as error:
            problems.append(str(error))
            self._session.compute()
        self._session.problem = "\n\n".join(problems)

    def update(self) -> None:
        """Write the settings into the address, soon."""
        if not self._waits:
            self._waits = True
            of_late = [one for one in self._updates if time.monotonic() - one < OF_LATE]
            due = SOON if len(of_late) < AT_ONCE else PERIOD
            self._document.add_timeout_callback(self._write, due)

    def _write(self) -> None:
        self._waits = False
        self._updates.append(time.monotonic())
        settings = query(self._session.experiment) if self._keeps_settings else ""
        homework = self._session.homework
        is_on = homework is not None and self._session.experiment.hidden == homework.scenario.key
        others = {
            FIELD: self._code,
            HOMEWORK: homework.name if homework is not None and is_on else "",
            THEME: self._theme,
        }
        named = urlencode({name: value for name, value in others.items() if value})
        text = "&".join(part for part in (named, settings) if part)
        search = f"?{text}" if text else ""
        if self._location is not None and self._location.search != search:
            self._location.search = search


def homework_of_query(query: str) -> tuple[str, str]:
    """Return the name of a homework in an address query, empty without one, and the rest of the query."""
    parts = query.split("&")
    names = [part.partition("=")[2] for part in parts if part.startswith(f"{HOMEWORK}=")]
    return (names[-1] if names else ""), "&".join(
        part for part in parts if not part.startswith(f"{HOMEWORK}=")
    )


def experiment_of_query(query: str) -> tuple[Experiment, list[str]]:
    """Return the experiment of an address query, and messages about settings that were not accepted.

    The code of a class and the theme are no settings; see `dashboards.teaching.class_link` and `THEME`.
    """
    trial, problems = Experiment(), list[str]()
    try:
        fields = parse_qsl(query, max_num_fields=MOST_FIELDS)
    except ValueError:
        return trial, [f"The address has too many settings; accepted are up to {MOST_FIELDS}."]
    # Other forms come last, because they depend on the other settings.
    for path, text in sorted(fields, key=lambda item: item[0] in Experiment.OTHER_FORMS):
        if path in (FIELD, THEME):
            continue
        try:
            trial.set_text(path, text)
        except SettingError as error:
            problems.append(str(error))
        if len(problems) == MOST_PROBLEMS:
            problems.append("The rest of the address is ignored.")
            break
    return trial, problems


def query(experiment: Experiment) -> str:
    """Return the settings that differ from the defaults, as the query of an address."""
    default = Experiment()
    changed = []
    for path, owner, name in experiment.leaves():
        value = getattr(owner, name)
        if value != default.get(path):
            if not isinstance(owner.param[name], MatrixOrNone) and isinstance(value, tuple):
                value = value[0] if len(set(value)) == 1 else value
            changed.append((path, value if isinstance(value, str) else json.dumps(value)))
    return urlencode(changed, safe="[], ")


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
