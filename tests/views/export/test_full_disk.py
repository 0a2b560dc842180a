"""A full disk: an export says so in one sentence, and leaves no half of a file."""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import panel as pn
import pytest
from bokeh.document import Document
from panel.io.state import set_curdoc
from typer.testing import CliRunner

from dashboards.exchange import Files
from dashboards.session import Session
from lab import Experiment, Result, export_track
from lab.cli import app
from lab.missions import MissionError


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let the system refuse what goes beyond a size, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def result() -> Result:
    return Experiment(mission="montreal").run()


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("run.nc", lambda result, path: result.to_netcdf(path)),
        ("run", lambda result, path: result.to_csv(path)),
        ("run.kml", export_track),
        ("run.gpx", export_track),
        ("run.csv", export_track),
    ],
)
def test_nothing_is_left(
    tmp_path: Path, result: Result, name: str, write: Callable[[Result, Path], None]
) -> None:
    path = tmp_path / name
    with files_up_to(100_000), pytest.raises((OSError, MissionError), match=name):
        write(result, path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "reason"), [("_netcdf", "netCDF library could not write"), ("_csv", "File too large")]
)
def test_the_page_says_so_and_hands_nothing_over(result: Result, name: str, reason: str) -> None:
    pn.extension()
    document = Document()
    with set_curdoc(document):
        session = Session(document)
        files = Files(session)
        session.result = result
    button = getattr(files, name)
    with ThreadPoolExecutor(1) as thread:  # a browser of other tests may leave a loop in this one
        with files_up_to(10_000):
            thread.submit(lambda: asyncio.run(button._async_sync_data())).result()
        assert "The server could not write the file" in session.problem
        assert reason in session.problem
        assert button._transfers == 0
        thread.submit(lambda: asyncio.run(button._async_sync_data())).result()
    assert button._transfers == 1
    files.close()
    session.close()


def test_the_command_line_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with files_up_to(100_000):
        answer = CliRunner().invoke(app, ["run", "montreal", "--out", str(path)])
    assert answer.exit_code == 2
    assert "cannot be written" in answer.stderr
    assert list(tmp_path.iterdir()) == []
