"""What all tests share."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

# Before numpy is imported. The threads of one small product wait for each other in a loop: beside a second
# process, fits of an Allan deviation took seven to twenty times the CPU time that one thread needs.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

from lab.data.files.profile import FOLDER_VARIABLE
from lab.missions.catalogue import OWN_FOLDER_VARIABLE

# Build machines are slow and shared: what a property costs in time is no property of it.
settings.register_profile("lab", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("lab")


# Several test processes each have the width of the terminal; what a command writes to a file has none.
os.environ.pop("COLUMNS", None)

ROOT = Path(__file__).parent.parent

LONGEST_FIRST = ("browser", "security", "navigation", "dashboards", ".", "analysis", "sensors", "cli")
"""Folders of tests with files that take minutes, or tests that take one: begun last, such a file is still
running when the other processes have nothing left to do."""
PROCESSES = {"browser": 2, "security": 1}
"""In how many processes at most the files of a folder run: they share servers, and a browser with a page,
which each process starts for itself, 10 to 20 s of a processor."""


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Search for no garbage while tests are collected, and later not among what the collection has made.

    It makes nearly a million objects, and all stay: searches through them were a third of its time, and
    searches of all objects in later tests, also those that a test asks for, passed over them again.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return what gives the processes whole files, and of some folders all files of a process at once."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        """Gives a process a file, or its part of the files of a folder."""

        def __init__(self) -> None:
            super().__init__(config, log)
            self.files: dict[str, list[str]] = {folder: [] for folder in PROCESSES}

        def _split_scope(self, nodeid: str) -> str:
            file: str = super()._split_scope(nodeid)
            folder = Path(file).parent.name
            if folder not in PROCESSES:
                return file
            files = self.files[folder]
            if file not in files:
                files.append(file)
            return f"{folder} {files.index(file) % PROCESSES[folder]}"

    return Scheduling() if config.getvalue("dist") == "loadfile" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take long first; the tests of a file keep their order."""
    rank = {folder: place for place, folder in enumerate(LONGEST_FIRST)}

    def place(item: pytest.Item) -> int:
        folder = item.path.relative_to(Path(__file__).parent).parts[:-1]
        return rank.get(folder[0] if folder else ".", len(rank))

    items.sort(key=place)


@pytest.fixture(scope="session", autouse=True)
def own_missions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the folder that is that of the user's own missions while tests run: theirs is left alone."""
    folder = tmp_path_factory.mktemp("missions")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(OWN_FOLDER_VARIABLE, str(folder))
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("profiles")))
        yield folder


@pytest.fixture(autouse=True)
def undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have each test begin in a process where no server has decided what visitors may do."""
    monkeypatch.setattr("dashboards.visitors._decided", {})


@pytest.fixture
def make_pipe() -> Callable[[Path], None]:
    """Return what makes a named pipe; where there are none, as on Windows, the test is skipped."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    return os.mkfifo


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Return the folder of real sensor recordings, which are too large to ship."""
    named = os.environ.get("INS_LAB_RECORDINGS")
    folder = Path(named) if named else ROOT.parent / "shared" / "recordings"
    if named and not folder.is_dir():
        pytest.fail(f"INS_LAB_RECORDINGS names {named}, which is not a folder")
    if not folder.is_dir():
        pytest.skip("no real recordings here: name their folder in INS_LAB_RECORDINGS")
    return folder
