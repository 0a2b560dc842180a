"""Library: the user's own missions: added, renamed, described and deleted, each as a whole.

A mission is its TOML file, which names the recording. The recording is written first, under an unused
name; the TOML file then takes its own name in one step. Deleting goes in the opposite order. Except for
writing recordings, one process at a time changes the folder. Files outside the folder are never written or
deleted, and links in it are never followed.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from lab.base.files.atomic_file import write_file
from lab.base.files.deleted_files import DeletedFiles, file_errors_reported
from lab.base.files.description_toml import file_in_same_folder, read_toml
from lab.base.files.locks import folder_lock
from lab.base.files.mission_error import MissionError
from lab.base.files.temporary_files import mark_unfinished, sweep, temporary_folder
from lab.base.parameters.toml_file import MAX_BYTES, TomlError, parse_toml, toml_text
from lab.data.files.log_toml import DESCRIPTION_FILE
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.log.sensor_log import SensorLog
from lab.flying.flight_plan import read_plan
from lab.missions.catalogue import mission, names_in_words, own_folder, places, shipped_folder
from lab.missions.log_mission import LogMission, is_log_folder, is_log_toml
from lab.missions.mission import Mission
from lab.missions.mission_name import MAX_LETTERS, accepted_name, suggested_name
from lab.missions.toml_edit import changed_text
from lab.motion.recordings.flight_csv import read_flight_csv, write_flight_csv
from lab.motion.recordings.recording import Recording

_LOG_FILES = (
    *("imu.csv", "gnss.csv", "ref.csv", "mag.csv"),
    *("baro.csv", "odo.csv", "air.csv", "heading.csv"),
)


def add_mission(
    recording: Recording,
    name: str,
    *,
    title: str,
    description: str = "",
    origin: str = "",
    aircraft: str = "",
    airport: str = "",
    tags: Sequence[str] = (),
    flight: Mapping[str, Any] | None = None,
    ending: str = "",
    folder: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Mission:
    """Add a flight to the library: its TOML file, and its recording beside it.

    Several processes may add at once: of one name the first to finish has it. A crash leaves no half of a
    mission.

    Parameters
    ----------
    recording
        The flight.
    name
        Name of the mission; see `accepted_name`.
    title, description, origin, aircraft, airport, tags
        As of `Mission`; a title is needed.
    flight
        Flight plan as the ``[flight]`` table has it, for a flight that can be flown again.
    ending
        Why the flight ended before its plan did.
    folder
        Target folder, by default the user's own. It is created if it does not exist.
    overwrite
        True replaces a flight of that name; the old recording goes once the new one is in its place.

    Returns
    -------
    Mission
        As it will be listed.

    Raises
    ------
    MissionError
        If the name is not accepted or taken, a text or the recording is not acceptable, or the folder cannot
        be written; there is no new mission then, and the old one is as it was.
    """
    where = own_folder() if folder is None else Path(folder)
    name = accepted_name(name)
    texts = {
        "description": description,
        "origin": origin,
        "aircraft": aircraft,
        "airport": airport,
        "ending": ending,
    }
    values: dict[str, Any] = {"title": _title(name, title)} | {
        key: text for key, text in texts.items() if text
    }
    values["tags"] = _tags(tags)
    toml = where / f"{name}.toml"
    if flight is not None:
        read_plan(flight, f"{name}, flight")
    with file_errors_reported(where):
        where.mkdir(parents=True, exist_ok=True)
        _check_free(where, name, overwrite)
        with new_recording(where / f"{name}.csv.gz", recording) as path, folder_lock(where):
            _check_free(where, name, overwrite)  # again: writing took a while
            sweep(where, is_named_by_others)
            values["recording"] = path.name
            content = toml_text(values | ({} if flight is None else {"flight": flight}))
            replace_toml(toml, encode_toml(content, toml))
    return mission(toml)


def add_log(
    log: SensorLog,
    name: str,
    *,
    title: str,
    description: str = "",
    tags: Sequence[str] = (),
    folder: str | os.PathLike[str] | None = None,
) -> Mission:
    """Add a sensor log to the library: a folder of its files, which appears whole or not at all.

    Parameters
    ----------
    log
        The log.
    name, title, description, tags, folder
        As for `add_mission`. Repairs of the log are added to the description.

    Returns
    -------
    Mission
        As it will be listed.

    Raises
    ------
    MissionError
        If the name is not accepted or taken, a text or the log is not acceptable, or the folder cannot be
        written.
    """
    where = own_folder() if folder is None else Path(folder)
    name = accepted_name(name)
    title, tags = _title(name, title), _tags(tags)
    with file_errors_reported(where):
        where.mkdir(parents=True, exist_ok=True)
        _check_free(where, name)
        with temporary_folder(where) as temporary:
            written = temporary / name
            write_sensor_log(written, log, title=title, description=description, tags=tags)
            with folder_lock(where):
                _check_free(where, name)  # again: writing took a while
                sweep(where, is_named_by_others)
                written.rename(where / name)
    return mission(where / name)


def sweep_user_folder() -> list[str]:
    """Remove what killed processes left in the user's own folder a day ago or earlier; return the names."""
    return sweep(own_folder(), is_named_by_others)


def free_name(text: str) -> str:
    """Return an unused accepted name as close as possible to a text, such as a file's name."""
    name = plain = suggested_name(text)
    taken = {place.removeprefix("user:").casefold() for place in places()}
    number = 1
    while name.casefold() in taken:
        number += 1
        name = f"{plain[: MAX_LETTERS - 6]}_{number}"
    return name


def user_names() -> frozenset[str]:
    """Return the user's own missions, which may be changed, including those that cannot be listed."""
    own = _user_folder_unless_shipped()
    return frozenset(name for name, place in places().items() if place.parent == own)


def user_place(name: str) -> Path:
    """Return the place of one of the user's own missions: its TOML file, or the folder of its log.

    Raises
    ------
    MissionError
        If there is no such mission, or it ships with the lab and may not be changed.
    """
    found = places()
    if name not in found:
        own = names_in_words(sorted(user_names())) or "there is none yet"
        raise MissionError(f"there is no mission {name!r}. Accepted are your own: {own}")
    if found[name].parent != _user_folder_unless_shipped():
        raise MissionError(f"mission {name}: ships with the lab and cannot be changed; accepted are your own")
    return found[name]


def rename_mission(name: str, new: str) -> Mission:
    """Give a mission of the user's own another name; the file of its recording keeps its own.

    Raises
    ------
    MissionError
        If it is not the user's own, the new name is not accepted or taken, or the folder cannot be written.
    """
    path, new = user_place(name), accepted_name(new)
    target = path.parent / (new if path.is_dir() else f"{new}.toml")
    if target != path:
        with file_errors_reported(path.parent), folder_lock(path.parent):
            _check_free(path.parent, new)
            if os.path.lexists(target):
                raise MissionError(f"{target}: is there already; choose another name")
            path.rename(target)
    return mission(target)


def describe_mission(
    name: str, *, title: str | None = None, description: str | None = None, tags: Sequence[str] | None = None
) -> Mission:
    """Change the description of a user's own mission; the rest of its TOML file stays, comments too.

    Parameters
    ----------
    name
        Which mission.
    title, description, tags
        New ones; None leaves the old.

    Raises
    ------
    MissionError
        If it is not the user's own, a text is not acceptable, or the file cannot be read or written.
    """
    path = user_place(name)
    toml = path / DESCRIPTION_FILE if path.is_dir() else path
    new = {
        "title": None if title is None else _title(name, title),
        "description": description,
        "tags": None if tags is None else _tags(tags),
    }
    with file_errors_reported(path.parent), folder_lock(path.parent):
        old = read_toml(toml) if toml.exists() else {}  # checks its size too
        changed = {key: value for key, value in new.items() if value is not None and value != old.get(key)}
        if changed:
            text = toml.read_bytes().decode("utf-8-sig").replace("\r\n", "\n") if old else ""
            content = encode_toml(changed_text(toml, text, changed), toml)
            write_file(toml, content)
    return mission(path)


def take_mission_away(name: str) -> DeletedFiles:
    """Delete a mission of the user's own, and keep its files until they are forgotten or brought back.

    The files are its TOML file and its recording, or those of its log. A recording that another mission names
    stays, and so does whatever else is in a log's folder. Of a link only the link goes.

    Raises
    ------
    MissionError
        If it is not the user's own, or a file cannot be deleted.
    """
    path = user_place(name)
    with file_errors_reported(path.parent), folder_lock(path.parent):
        deleted = DeletedFiles.taken(f"mission {name}", path.parent, _files_of_mission(path))
        if path.is_dir() and not path.is_symlink() and not any(path.iterdir()):
            path.rmdir()
        return deleted


def delete_mission(name: str) -> None:
    """Delete a mission of the user's own for good; see `take_mission_away`.

    Raises
    ------
    MissionError
        If it is not the user's own, or a file cannot be deleted.
    """
    take_mission_away(name).forget()


def _files_of_mission(path: Path) -> list[Path]:
    """Return the files that go with a mission; its description, by which it is found, is the first."""
    if path.is_symlink():
        return [path]
    if path.is_dir():
        found = [path / DESCRIPTION_FILE, *_recordings_named(path), *(path / name for name in _LOG_FILES)]
    else:
        found = [path, *(one for one in _recordings_named(path) if not is_named_by_others(one, path))]
    return [one for one in dict.fromkeys(found) if one.exists() or one.is_symlink()]


def _user_folder_unless_shipped() -> Path | None:
    """Return the folder with the missions that may be changed; None if it is that of those that ship."""
    own = own_folder()
    return None if own.resolve() == shipped_folder().resolve() else own


def _check_free(folder: Path, name: str, overwrite: bool = False) -> None:
    toml, shipped = folder / f"{name}.toml", shipped_folder() / f"{name}.toml"
    if folder.absolute() == own_folder().absolute() and shipped.exists():
        raise MissionError(f"name {name!r}: ships with the lab; choose another name")
    if is_log_folder(folder / name) or (toml.is_file() and is_log_toml(toml)):
        raise MissionError(f"name {name!r}: a log has it; choose another name, or delete the log first")
    if os.path.lexists(toml) and not overwrite:
        raise MissionError(
            f"name {name!r}: a mission has it in {folder}; choose another name, or overwrite it"
        )


@contextlib.contextmanager
def new_recording(wanted: Path, recording: Recording) -> Iterator[Path]:
    """Write a recording under an unused file name and check it; remove it if it is not used."""
    for path in _numbered_paths(wanted):
        with contextlib.suppress(FileExistsError):
            path.open("xb").close()
            break
    with mark_unfinished(path):
        try:
            write_flight_csv(path, recording)
            read_flight_csv(path)
            yield path
        except BaseException:
            path.unlink(missing_ok=True)
            raise


def _numbered_paths(wanted: Path) -> Iterator[Path]:
    """Yield a path, and then the same with numbers before its ending."""
    yield wanted
    stem = re.sub(r"(?i)(\.csv)?(\.gz)?$", "", wanted.name)
    ending, plain = wanted.name.removeprefix(stem), re.sub(r"\.[0-9]{1,3}$", "", stem)
    yield wanted.with_name(f"{plain}{ending}")
    for number in itertools.count(2):
        yield wanted.with_name(f"{plain}.{number}{ending}")


def replace_toml(toml: Path, content: bytes) -> None:
    """Write the TOML file of a mission; recordings that only the old file of this name named are removed."""
    replaced = _recordings_named(toml)
    write_file(toml, content)
    _remove_unused(replaced)


def encode_toml(text: str, toml: Path) -> bytes:
    """Return the bytes of a TOML file, if it could be read again.

    Raises
    ------
    MissionError
        If a character cannot be written, or the file would be too large.
    """
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        raise MissionError(
            f"{toml}: not written: {error.object[error.start]!r} is not a valid character"
        ) from error
    if len(content) > MAX_BYTES:
        raise MissionError(f"{toml}: not written: its texts are too long; accepted are 1 MB in all")
    try:
        parse_toml(text)
    except TomlError as error:
        raise MissionError(f"{toml}: not written, since it could not be read again: {error}") from error
    return content


def _recordings_named(place: Path) -> list[Path]:
    """Return the csv files in its folder that a mission names; none if the mission cannot be read."""
    if not place.exists() or place.is_symlink():
        return []
    try:
        if place.is_dir() or is_log_toml(place):
            named = LogMission.at(place).files.paths
        else:
            named = [file_in_same_folder(place, "recording", str(read_toml(place).get("recording")))]
    except MissionError:
        return []
    return [path for path in named if path.name.lower().endswith((".csv", ".csv.gz"))]


def _remove_unused(recordings: Sequence[Path]) -> None:
    """Remove recordings that no TOML file in their folder names."""
    for path in set(recordings):
        if not is_named_by_others(path):
            path.unlink(missing_ok=True)


def is_named_by_others(recording: Path, toml: Path | None = None) -> bool:
    """Return whether a TOML file of the folder, another than that given, names a recording."""
    return any(recording in _recordings_named(one) for one in recording.parent.glob("*.toml") if one != toml)


def _title(name: str, title: str) -> str:
    if not isinstance(title, str) or not title.strip():
        raise MissionError(f"mission {name}: title = {title!r}; accepted is a text that is not empty")
    return title.strip()


def _tags(tags: Sequence[str]) -> list[str]:
    """Return tags, each once."""
    if isinstance(tags, str) or not all(isinstance(tag, str) for tag in tags):
        raise MissionError(f'tags = {tags!r}; accepted is a list of texts, such as ["turns", "wind"]')
    return list(dict.fromkeys(filter(None, (tag.strip() for tag in tags))))
