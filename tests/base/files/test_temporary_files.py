"""Leftovers: what a killed process left in the folder of missions is swept, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from flights import circle

from lab.base.files.atomic_file import atomic_file
from lab.base.files.temporary_files import NOTE, OLD, TEMPORARY, mark_unfinished, note_path, temporary_folder
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.library import add_mission, sweep_user_folder

LEFT = (".mine.toml.k3j_9x0a", ".mine.csv.gz.abcdefgh", "lost.csv.gz", f".lost.csv.gz{NOTE}")
STAYS = ("own_flight.csv.gz", ".mine.toml", ".hidden", "notes.txt.abcdefgh", f".listed.csv.gz{NOTE}")


@pytest.fixture
def own(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(folder))
    return folder


def aged(path: Path) -> None:
    """Make a file, or what is in a folder, as old as what is swept."""
    for one in (*path.rglob("*"), path):
        os.utime(one, (time.time() - OLD - 60,) * 2)


def test_what_is_old_and_the_labs_own_is_swept(own):
    add_mission(circle(), "listed", title="Listed")
    for name in (*LEFT, *STAYS):
        (own / name).write_text("left")
    half = own / f"{TEMPORARY}12345678" / "log"
    half.mkdir(parents=True)
    (half / "imu.csv").write_text("half")
    before = {path.name for path in own.iterdir()}
    assert sweep_user_folder() == []  # somebody may be writing them still
    for path in own.iterdir():
        aged(path)
    sweep_user_folder()
    gone = before - {path.name for path in own.iterdir()}
    # The note beside a recording that is named goes, the recording does not.
    assert gone == {*LEFT, half.parent.name, f".listed.csv.gz{NOTE}"}
    assert (own / "listed.csv.gz").is_file()


def test_what_somebody_still_writes_stays_however_old_it_is(own):
    recording, toml = own / "slow.csv.gz", own / "slow.toml"
    with mark_unfinished(recording), temporary_folder(own) as half, atomic_file(toml) as file:
        file.write(b"title = ")
        recording.touch()
        (half / "imu.csv").touch()
        for path in own.iterdir():
            aged(path)
        assert sweep_user_folder() == []
        assert {note_path(recording), recording, half} < set(own.iterdir())
        file.write(b"'Slow'")
    assert {path.name for path in own.iterdir()} == {"slow.csv.gz", "slow.toml"}


def test_a_killed_import_is_swept_by_the_next_one(own):
    code = (
        "import os, signal; from flights import circle; from lab.missions import add_mission, library\n"
        "library.read_flight_csv = lambda path: os.kill(os.getpid(), signal.SIGKILL)\n"
        "add_mission(circle(), 'killed', title='Killed')"
    )
    path = os.pathsep.join(sys.path)
    made = subprocess.run([sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": path}, check=False)
    assert made.returncode < 0
    assert (own / "killed.csv.gz").is_file()
    for left in own.iterdir():
        aged(left)
    add_mission(circle(), "next", title="Next")
    assert sorted(one.name for one in own.iterdir() if one.name != ".lock") == ["next.csv.gz", "next.toml"]


KILLED = """
import os, signal, sys
from pathlib import Path
from lab.base.files.atomic_file import atomic_file
from lab.base.files.temporary_files import temporary_folder
folder = Path(sys.argv[1])
with atomic_file(folder / "path.kml") as file, temporary_folder(folder) as half:
    file.write(b"half")
    (half / "errors.csv").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_a_killed_export_is_swept_by_the_next_one_of_the_same_file(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    left = list(tmp_path.iterdir())
    assert len(left) == 2
    stays = tmp_path / ".path.kml.backup"
    other = tmp_path / ".other.kml.ins-lab-abcdefgh"
    users = tmp_path / ".path.kml.original"  # a copy that a person has made
    for path in (stays, other, users):
        path.write_text("not of this file")
    for path in tmp_path.iterdir():
        aged(path)
    with atomic_file(tmp_path / "path.kml") as slow, temporary_folder(tmp_path) as half:
        slow.write(b"whole")
        for path in tmp_path.iterdir():
            aged(path)
        with atomic_file(tmp_path / "path.kml") as file, temporary_folder(tmp_path):
            file.write(b"meanwhile")
        assert half.is_dir()  # the one that is still at work keeps its own
    assert (tmp_path / "path.kml").read_bytes() == b"whole"
    assert {path.name for path in tmp_path.iterdir()} == {"path.kml", stays.name, other.name, users.name}
