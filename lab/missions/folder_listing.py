"""Folder listing: the missions in one folder, each read only if its files changed since the last listing."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lab.base.files.mission_error import MissionError
from lab.data.files.log_toml import DESCRIPTION_FILE
from lab.missions.log_mission import LogMission, is_log_folder, is_log_toml
from lab.missions.mission import Mission

_SETTLED = 2.0
"""Age above which a change of a file shows in its time stamp [s]: some file systems have a resolution of 2
s."""


class Listed(NamedTuple):
    """A mission of a folder, or why it cannot be listed.

    Attributes
    ----------
    name : str
        Its name, which a mission of another folder may have too.
    path : Path
        Its TOML file, or the folder of its log.
    mission : Mission or None
        The mission. All listings share it; do not read its recording.
    problem : str
        Why it cannot be listed; empty if it can.
    """

    name: str
    path: Path
    mission: Mission | None
    problem: str = ""


class _Known(NamedTuple):
    """What was read.

    Attributes
    ----------
    stamp : tuple of int
        When the files were last changed [ns], then their time stamps, sizes and numbers at that time.
    listed : Listed or None
        None for a folder without a log.
    beside : str
        Name of the recording, if it is in the listed folder itself.
    """

    stamp: tuple[int, ...]
    listed: Listed | None
    beside: str = ""


_KNOWN: dict[Path, dict[str, _Known]] = {}
"""Cache of the entries of each folder, so that thousands of files are not read again at every change."""


def list_folder(folder: Path) -> list[Listed]:
    """Return the missions of a folder: those with a TOML file by name, then folders with logs by name.

    Raises
    ------
    OSError
        If the folder does not exist or cannot be listed.
    """
    with os.scandir(folder) as entries:
        inside = {entry.name: entry for entry in entries}
    around = _stamp(os.fspath(folder))
    before, now = _KNOWN.get(folder, {}), dict[str, _Known]()
    settled = time.time_ns() - round(1e9 * _SETTLED)
    tomls, logs = list[Listed](), list[Listed]()
    for name in sorted(inside):
        entry = inside[name]
        is_folder = check_holds(entry.is_dir)
        if not is_folder and not name.endswith(".toml"):
            continue
        stamp = _stamp(entry.path)
        if is_folder:
            stamp = _combine_keys(stamp, _stamp(os.path.join(entry.path, DESCRIPTION_FILE)))  # noqa: PTH118 - faster
        known = before.get(name)
        if known is None or known.stamp not in (stamp, _combine_keys(stamp, around)):
            known = _read(folder / name, is_folder, stamp, around)
        # A file written just now may be written again within the same tick of the clock.
        if 0 < known.stamp[0] < settled:
            now[name] = known
        if known.listed is not None:
            listed = _with_recording(known, known.listed, inside)
            (logs if is_folder and listed.name == name else tomls).append(listed)
    _KNOWN[folder] = now
    return tomls + logs


def _read(path: Path, is_folder: bool, stamp: tuple[int, ...], around: tuple[int, ...]) -> _Known:
    """Read a TOML file, or the folder of a log."""
    is_log = is_folder and is_log_folder(path)
    if is_folder and not is_log and path.suffix != ".toml":
        return _Known(stamp, None)
    name = path.name if is_log else path.stem
    try:
        mission = LogMission.at(path, name) if is_log else describe_mission(path, name)
    except MissionError as error:
        # What is missing may be a file beside it.
        return _Known(_combine_keys(stamp, around), Listed(name, path, None, str(error)))
    recording = mission.recording_path
    return _Known(
        stamp, Listed(name, path, mission), recording.name if recording.parent == path.parent else ""
    )


def describe_mission(path: Path, name: str) -> Mission:
    """Return the mission that a TOML file describes: a flight or a log.

    Raises
    ------
    MissionError
        If it cannot be read.
    """
    return LogMission.at(path, name) if is_log_toml(path) else Mission.from_toml(path, name)


def _with_recording(known: _Known, listed: Listed, inside: dict[str, os.DirEntry[str]]) -> Listed:
    """Return what is listed, which is broken while its recording does not exist."""
    if listed.mission is None:
        return listed
    recording = listed.mission.recording_path
    there = inside.get(known.beside)
    if check_holds(recording.is_file if there is None else there.is_file):
        return listed
    hint = f"; fly it: ins-lab fly {listed.path}" if listed.mission.flight else ""
    problem = f"{listed.path}: its recording {recording.name} does not exist{hint}"
    return listed._replace(mission=None, problem=problem)


def _stamp(path: str) -> tuple[int, ...]:
    """Return when a file was changed [ns], then what tells its versions apart; zeros if there is none."""
    try:
        facts = os.stat(path)  # noqa: PTH116 - faster, for thousands of files
    except OSError:
        return (0, 0, 0, 0, 0)
    changes = facts.st_mtime_ns, facts.st_ctime_ns
    return (max(changes), *changes, facts.st_size, facts.st_ino)


def _combine_keys(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return (max(one[0], other[0]), *one[1:], *other[1:])


def check_holds(check: Callable[[], bool]) -> bool:
    """Return the answer of a check of a file; False if there is none, as for a link to itself."""
    try:
        return check()
    except (OSError, ValueError):
        return False
