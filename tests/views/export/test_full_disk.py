"""A full disk: an export says so in one sentence, and leaves no half of a file."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

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
        ("run.tum", export_track),
        ("run.sbet", export_track),
    ],
)
def test_nothing_is_left(
    tmp_path: Path, result: Result, name: str, write: Callable[[Result, Path], None]
) -> None:
    path = tmp_path / name
    with files_up_to(100_000), pytest.raises((OSError, MissionError), match=name):
        write(result, path)
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with files_up_to(100_000):
        answer = CliRunner().invoke(app, ["run", "montreal", "--out", str(path)])
    assert answer.exit_code == 2
    assert "cannot be written" in answer.stderr
    assert list(tmp_path.iterdir()) == []
