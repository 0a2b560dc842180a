"""Flown mission: the plan of a mission is flown, and its recording is added to the library."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from lab.base.files.deleted_files import file_errors_reported
from lab.base.files.description_toml import read_toml
from lab.base.files.locks import folder_lock
from lab.base.files.mission_error import MissionError
from lab.flying.flight import fly, refuse_seed
from lab.flying.flight_plan import FlightPlan
from lab.missions.catalogue import mission, own_folder, shipped_folder
from lab.missions.library import (
    add_mission,
    encode_toml,
    is_named_by_others,
    new_recording,
    replace_toml,
)
from lab.missions.mission import Mission
from lab.missions.mission_name import suggested_name
from lab.missions.toml_edit import flown_text
from lab.motion.recordings.recording import Recording


def fly_mission(
    name_or_path: str | os.PathLike[str],
    *,
    seed: int | None = None,
    folder: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Mission:
    """Fly a mission's plan and write the mission: its TOML file and the new recording beside it.

    With the mission's own seed, the recording is the same, bit for bit. A flight that ended early is written
    as far as it went, and the mission's `ending` says why.

    Parameters
    ----------
    name_or_path
        As for `mission`; the TOML file has a ``[flight]`` table, its recording need not exist yet. Or a
        motion definition csv of gnss-ins-sim, which becomes a mission of the file's name in your own folder.
    seed
        Seed of the turbulence, written into the new TOML file; the plan's own by default.
    folder
        Where to write; by default the user's own folder for a shipped mission, or else the mission's folder.
    overwrite
        True replaces an existing recording and TOML file of that name. If the TOML file changes, the new
        recording has a file name of its own, and the old one goes afterwards: a crash leaves the one or the
        other mission whole.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.
    cancelled
        Asked at every sample whether to end the flight here.

    Returns
    -------
    Mission
        As written.

    Raises
    ------
    MissionError
        If files exist already and may not be replaced, or as for `fly`; nothing is written then.
    """
    if _is_motion(Path(name_or_path)):
        refuse_seed(seed)
        return _move_file(Path(name_or_path), folder, overwrite)
    flown = mission(name_or_path)
    plan = flown.plan
    assert flown.path is not None  # only a TOML file has a plan
    target = _target_folder(flown.path, folder)
    new_seed = None if not isinstance(plan, FlightPlan) or seed in {None, plan.seed} else seed
    check_flown(flown, new_seed, target, overwrite)
    flight = fly(plan, seed, progress, cancelled)
    return add_flown(
        flown, flight.recording, seed=new_seed, ending=flight.ending, folder=target, overwrite=overwrite
    )


def _is_motion(path: Path) -> bool:
    from lab.flying.motion_file import is_motion_file  # noqa: PLC0415 - SciPy, for those who need it

    try:
        with path.open("rb") as file:
            return is_motion_file(file.read(2**12))
    except (OSError, ValueError):
        return False


def _move_file(path: Path, folder: str | os.PathLike[str] | None, overwrite: bool) -> Mission:
    """Carry out a motion definition csv and add it as a mission."""
    from lab.flying.motion_commands import move  # noqa: PLC0415 - SciPy, for those who need it
    from lab.flying.motion_file import read_motion_file  # noqa: PLC0415

    plan = read_motion_file(path)
    motion = move(plan)
    hidden = ", ".join(f"{start:.6g} to {end:.6g} s" for start, end in motion.without_gps)
    return add_mission(
        motion.recording,
        suggested_name(path.stem),
        title=path.stem,
        description=f"The file says there is no GPS from {hidden}: sensors.gps.outages." if hidden else "",
        origin=f"Commands of {path.name}, a motion definition of gnss-ins-sim, carried out by the lab.",
        tags=("commands",),
        flight=plan.to_dict(),
        folder=folder,
        overwrite=overwrite,
    )


def _target_folder(source: Path, folder: str | os.PathLike[str] | None) -> Path:
    if folder is not None:
        return Path(folder)
    return own_folder() if source.parent.resolve() == shipped_folder().resolve() else source.parent


def add_flown(
    flown: Mission, recording: Recording, *, seed: int | None, ending: str, folder: Path, overwrite: bool
) -> Mission:
    """Add the flight of a mission's plan; its TOML file is kept except for the keys that the flight changes.

    The recording is written as by `add_mission`. It takes the place of the old one if nothing changes in the
    TOML file, so that there is never a recording with a wrong description.

    Parameters
    ----------
    flown
        The mission whose plan was flown, of a TOML file.
    recording
        The flown flight.
    seed, ending
        As of `flown_text`.
    folder
        Target folder; it is created if it does not exist.
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
    source = _toml_path(flown)
    toml, old = folder / source.name, folder / flown.recording_path.name
    with file_errors_reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with new_recording(old, recording) as path, folder_lock(folder):
            _check_flown(flown, seed, folder, overwrite, written=path)  # again: flying took a while
            if read_toml(source).get("flight") != flown.flight:
                raise MissionError(f"{source}: the plan was changed while it was flown; fly it again")
            if _has_content(toml, _flown_content(flown, old.name, seed, ending)) and not is_named_by_others(
                old, toml
            ):
                path.replace(old)
            else:
                replace_toml(toml, _flown_content(flown, path.name, seed, ending))
    return mission(toml)


def check_flown(flown: Mission, seed: int | None, folder: Path, overwrite: bool) -> None:
    """Refuse a flight that `add_flown` could not add, before it is flown.

    Raises
    ------
    MissionError
        If it would replace files and may not.
    """
    with file_errors_reported(folder):
        _check_flown(flown, seed, folder, overwrite)


def _check_flown(
    flown: Mission, seed: int | None, folder: Path, overwrite: bool, written: Path | None = None
) -> None:
    toml, recording = folder / _toml_path(flown).name, folder / flown.recording_path.name
    same = _has_content(toml, _flown_content(flown, recording.name, seed, flown.ending))
    paths = [path for path in ([recording] if same else [recording, toml]) if path != written]
    existing = [str(path) for path in paths if path.exists()]
    if existing and not overwrite:
        raise MissionError(
            f"{' and '.join(existing)} would be replaced: allow it with overwrite, or choose another folder"
        )


def _flown_content(flown: Mission, recording: str, seed: int | None, ending: str) -> bytes:
    """Return a mission's TOML file after a flight."""
    source = _toml_path(flown)
    read_toml(source)  # checks its size too
    content = source.read_bytes()
    old = content.decode("utf-8-sig").replace("\r\n", "\n")
    new = flown_text(source, old, recording=recording, seed=seed, ending=ending)
    return content if new == old else encode_toml(new, source)


def _toml_path(flown: Mission) -> Path:
    assert flown.path is not None  # only a TOML file has a plan
    return flown.path


def _has_content(path: Path, content: bytes) -> bool:
    return path.is_file() and path.read_bytes() == content
