"""The offer of unfinished recordings: a folder of many missions is read only when it changed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lab.base.files.mission_error import MissionError
from lab.data.streams.raw_recording import SUFFIX
from lab.data.streams.unfinished import (
    RUNS,
    UnfinishedRecordings,
    discard,
    hold_recording,
    mark,
    release,
    restore_recording,
    unmark,
)

LONG_AGO = time.time() - 3600
"""[s]."""


def begun(folder: Path, name: str) -> Path:
    """Return a marked recording whose last bytes are an hour old."""
    path = folder / f"{name}{SUFFIX}"
    path.write_bytes(b"bytes")
    mark(path)
    os.utime(path, (LONG_AGO, LONG_AGO))
    return path


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the folders that are read from now on."""
    seen: list[Path] = []
    glob = Path.glob

    def counted(self: Path, pattern: str):
        seen.append(self)
        return glob(self, pattern)

    monkeypatch.setattr(Path, "glob", counted)
    return seen


def test_a_folder_is_read_again_only_when_it_changed(tmp_path: Path, reads: list[Path]) -> None:
    kept, first = UnfinishedRecordings(), begun(tmp_path, "first")
    os.utime(tmp_path, (LONG_AGO, LONG_AGO))
    for _ in range(5):
        assert kept.found(tmp_path) == [first]
    assert reads == [tmp_path]
    second = begun(tmp_path, "second")
    assert set(kept.found(tmp_path)) == {first, second}
    before = first.read_bytes()
    deleted = discard(first)
    assert kept.found(tmp_path) == [second]
    restore_recording(deleted, first)
    assert set(kept.found(tmp_path)) == {first, second}
    assert first.read_bytes() == before
    with pytest.raises(MissionError, match="gone"):
        restore_recording(deleted, first)


def test_a_recording_is_offered_when_its_last_bytes_are_old_without_a_change_of_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now)
    kept, path = UnfinishedRecordings(), begun(tmp_path, "drive")
    os.utime(path, (now, now))
    os.utime(tmp_path, (LONG_AGO, LONG_AGO))
    assert not kept.found(tmp_path)
    now += RUNS + 1
    assert kept.found(tmp_path) == [path]
    assert not kept.found(tmp_path, {path})


def test_two_changes_within_a_tick_of_the_file_system_are_both_seen(tmp_path: Path) -> None:
    kept, first = UnfinishedRecordings(), begun(tmp_path, "first")
    now = time.time_ns()
    os.utime(tmp_path, ns=(now, now))
    assert kept.found(tmp_path) == [first]
    second = begun(tmp_path, "second")
    os.utime(tmp_path, ns=(now, now))
    assert set(kept.found(tmp_path)) == {first, second}


def test_a_folder_that_is_not_there_has_none(tmp_path: Path) -> None:
    kept = UnfinishedRecordings()
    assert not kept.found(tmp_path / "later")
    (tmp_path / "later").mkdir()
    path = begun(tmp_path / "later", "drive")
    assert kept.found(tmp_path / "later") == [path]


def test_a_recording_of_which_a_mission_is_made_is_neither_offered_nor_discarded(tmp_path: Path) -> None:
    kept, path = UnfinishedRecordings(), begun(tmp_path, "drive")
    assert hold_recording(path)
    assert not hold_recording(path)  # another page
    assert not kept.found(tmp_path)
    with pytest.raises(OSError, match="mission"):
        discard(path)
    assert path.exists()
    release(path)  # its maker failed
    assert kept.found(tmp_path) == [path]
    assert hold_recording(path)
    unmark(path)
    assert not hold_recording(path)  # a mission was made of it: nobody makes a second one
    with pytest.raises(OSError, match="mission"):
        discard(path)
    assert path.exists()


def test_another_program_does_not_discard_a_recording_in_work(tmp_path: Path) -> None:
    kept, path = UnfinishedRecordings(), begun(tmp_path, "drive")
    lines = "import sys; from lab.data.streams.unfinished import *; from pathlib import Path; "
    lines += "print(hold_recording(Path(sys.argv[1])), flush=True); input()"
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"{lines}; print(hold_recording(Path(sys.argv[1])), flush=True); input()",
            str(path),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "True\n"
    assert not kept.found(tmp_path)
    with pytest.raises(OSError, match="mission"):
        discard(path)
    holder.kill()  # the lock ends with its holder
    holder.communicate()
    assert kept.found(tmp_path) == [path]
