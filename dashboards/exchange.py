"""Exchange: settings and results to and from files."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document

from dashboards.computing import LatestWins, Outcome, attempt
from dashboards.held_links import HeldLinks
from dashboards.notes import Note
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.upload import Upload
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import MAX_BYTES, TomlError, parse_toml
from lab.base.progress import Progress
from lab.base.result_files import csv_blocks, table
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.run.provenance import facts_block
from lab.views.export import gpx, kml, make_tracks

if TYPE_CHECKING:
    import pandas as pd

    from dashboards.pages.base import Page

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
    """A button that takes settings from a file, with the held results that it has.

    Parameters
    ----------
    session
        Session that takes them.
    held
        Its held results as settings.
    """

    def __init__(self, session: Session, held: HeldLinks) -> None:
        self._session, self._held = session, held
        self._upload = Upload(
            self._uploaded,
            self._report_refusal,
            most=1,
            largest=MAX_BYTES,
            accept=".toml",
            label="Load settings",
            size="small",
            variant="outlined",
            sizing_mode="stretch_width",
            margin=(4, 14, 24, 14),
        )
        document = pn.state.curdoc
        assert document is not None
        self._reading: LatestWins[bytes] = LatestWins(
            lambda content, _progress: attempt(lambda: experiment_of(content)),
            partial(self._arrive, document),
        )
        self.view = self._upload

    def close(self) -> None:
        """Delete the uploaded files, and read no more."""
        self._reading.close()
        self._upload.delete()

    def _report_refusal(self, reason: str) -> None:
        self._session.problem = f"The settings file is not accepted. {reason}"

    def _uploaded(self, paths: list[Path]) -> None:
        """Parse a settings file in a thread, so that other pages do not wait."""
        # The content is read now, because the next upload deletes the file.
        self._reading.submit(paths[0].read_bytes())

    def _arrive(self, document: Document, content: bytes, outcome: Outcome) -> None:
        soon(document, partial(self._read, content, outcome))

    def _read(self, content: bytes, outcome: Outcome) -> None:
        if outcome.problem:
            self._session.problem = outcome.problem
            return
        problems = self._held.take_file(content.decode("utf-8-sig"))
        try:
            self._session.accept(outcome.result, called="Settings file")
        except SettingError as error:
            problems.append(str(error))
        self._session.problem = "\n\n".join(problems)


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


def report_file(result: Result, progress: Progress, notes: Sequence[Note] = ()) -> bytes:
    """Return a result, with the notes on its flight, as one HTML file that opens without a network."""
    from lab.views.report import report_html  # noqa: PLC0415 - an opening page needs none of it

    progress("Trying the advice of the verdict", 0.0)
    own = [(one.start, one.end, one.text) for one in notes if one.mission == result.experiment.mission]
    return report_html(result, own).encode()


def figures_file(result: Result, progress: Progress) -> bytes:
    """Return the plots of a result as figures for print, each on a page of a PDF."""
    from lab.views.paper_figure import pages  # noqa: PLC0415 - an opening page needs no matplotlib

    return pages(result, progress)


def json_file(result: Result, progress: Progress) -> bytes:
    """Return a result as JSON."""
    progress("Trying the advice of the verdict", 0.0)
    return result.to_json().encode()


def kml_file(result: Result, _progress: Progress) -> bytes:
    """Return the paths of a result as KML, for Google Earth."""
    return kml.text(make_tracks(result)).encode()


def gpx_file(result: Result, _progress: Progress) -> bytes:
    """Return the paths of a result as GPX, for maps."""
    return gpx.text(make_tracks(result)).encode()


def seen_csv(page: Page, window: tuple[float, float], result: Result, _progress: Progress) -> bytes:
    """Return the table of a page, or its datasets in a stretch of time [s], as one csv file.

    What made the result stands before it in comments.
    """
    shown = page.table(result)
    shown = _datasets_as_table(page.seen, window, result) if shown is None else shown
    return f"{facts_block(result.facts, '# ', short=True)}{''.join(csv_blocks(shown))}".encode()


def _datasets_as_table(names: Sequence[str], window: tuple[float, float], result: Result) -> pd.DataFrame:
    """Return some datasets of a result in a stretch of time [s].

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
    return first.assign(**together)[list(together)][inside]


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
