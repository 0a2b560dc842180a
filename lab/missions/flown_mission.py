"""Flown mission: the plan of a mission and what was flown of it, added to the library."""

from __future__ import annotations

from pathlib import Path

from lab.missions.atomic_file import atomic_file
from lab.missions.catalogue import mission
from lab.missions.errors import MissionError
from lab.missions.folder_lock import folder_lock
from lab.missions.library import (
    encoded,
    file_errors_told,
    named_by_others,
    new_recording,
    recordings_named,
    remove_unused,
)
from lab.missions.mission import Mission, read_toml
from lab.missions.mission_text import flown_text
from lab.missions.recording import Recording


def add_flown(
    flown: Mission, recording: Recording, *, seed: int | None, ending: str, folder: Path, overwrite: bool
) -> Mission:
    """Add the flight of a mission's plan: its TOML file word by word, but for what the flight changed.

    The recording is written as by `add_mission`. It takes the place of the old one if nothing changes in the
    TOML file, so that there is never a recording beside words that are not true of it.

    Parameters
    ----------
    flown
        The mission whose plan was flown, of a TOML file.
    recording
        What was flown.
    seed, ending
        As of `flown_text`.
    folder
        Where to write; it is made where there is none.
    overwrite
        True replaces files of these names.

    Returns
    -------
    Mission
        As it will be listed.

    Raises
    ------
    MissionError
        As of `add_mission`, and if the plan was changed while it was flown.
    """
    source = _toml_of(flown)
    toml, old = folder / source.name, folder / flown.recording_path.name
    with file_errors_told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with new_recording(old, recording) as path, folder_lock(folder):
            _check_flown(flown, seed, folder, overwrite, written=path)  # again: flying took a while
            if read_toml(source).get("flight") != flown.flight:
                raise MissionError(f"{source}: the plan was changed while it was flown; fly it again")
            replaced = recordings_named(toml)
            if _holds(toml, _flown_content(flown, old.name, seed, ending)) and not named_by_others(old, toml):
                path.replace(old)
            else:
                content = _flown_content(flown, path.name, seed, ending)
                with atomic_file(toml) as file:
                    file.write(content)
                remove_unused(folder, replaced)
    return mission(toml)


def check_flown(flown: Mission, seed: int | None, folder: Path, overwrite: bool) -> None:
    """Refuse a flight that `add_flown` could not add, before it is flown.

    Raises
    ------
    MissionError
        If it would replace files and may not.
    """
    with file_errors_told(folder):
        _check_flown(flown, seed, folder, overwrite)


def _check_flown(
    flown: Mission, seed: int | None, folder: Path, overwrite: bool, written: Path | None = None
) -> None:
    toml, recording = folder / _toml_of(flown).name, folder / flown.recording_path.name
    same = _holds(toml, _flown_content(flown, recording.name, seed, flown.ending))
    paths = [path for path in ([recording] if same else [recording, toml]) if path != written]
    existing = [str(path) for path in paths if path.exists()]
    if existing and not overwrite:
        raise MissionError(
            f"{' and '.join(existing)} would be replaced: allow it with overwrite, or choose another folder"
        )


def _flown_content(flown: Mission, recording: str, seed: int | None, ending: str) -> bytes:
    """Return a mission's TOML file as it is after a flight."""
    source = _toml_of(flown)
    read_toml(source)  # checks its size too
    content = source.read_bytes()
    old = content.decode("utf-8-sig").replace("\r\n", "\n")
    new = flown_text(source, old, recording=recording, seed=seed, ending=ending)
    return content if new == old else encoded(new, source)


def _toml_of(flown: Mission) -> Path:
    assert flown.path is not None  # only a TOML file has a plan
    return flown.path


def _holds(path: Path, content: bytes) -> bool:
    return path.is_file() and path.read_bytes() == content
