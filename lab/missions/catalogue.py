"""Catalogue: all missions: those that ship with the lab, the user's own, and logs."""

from __future__ import annotations

import difflib
import os
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.missions.folder_listing import check_holds, describe_mission, list_folder
from lab.missions.log_mission import LogMission, is_log_folder
from lab.missions.mission import Mission

OWN_FOLDER_VARIABLE = "INS_LAB_MISSIONS"
"""Environment variable that names the folder of the user's own missions."""

_NAMED = 20
"""Most missions that a message names, some two lines."""


def shipped_folder() -> Path:
    """Return the folder of the missions that ship with the lab."""
    installed = Path(__file__).parent / "shipped"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "missions"


def own_folder() -> Path:
    """Return the folder of the user's own missions, which need not exist.

    It is what the environment variable ``INS_LAB_MISSIONS`` names, or else ``missions`` in the user's data
    folder of ``ins-lab`` (on Linux ``~/.local/share/ins-lab/missions``).
    """
    named = os.environ.get(OWN_FOLDER_VARIABLE)
    if named:
        return _expand_path(named)
    from platformdirs import user_data_path  # noqa: PLC0415 - only needed without the variable

    return user_data_path("ins-lab", appauthor=False) / "missions"


def missions() -> dict[str, Mission]:
    """Return all missions by name: the shipped ones, then the user's own.

    A mission is a TOML file and the recording beside it; its name is the TOML file's. A folder with the log
    of an IMU and a GPS receiver (``log.toml``, or ``imu.csv`` and ``gnss.csv``) is one too, of the folder's
    name. A user's mission that has the name of another one is called ``user:NAME``, so that neither hides
    the other. A mission that cannot be listed is left out with a warning; see `broken_missions`.
    """
    found, broken, _ = _find()
    for reason in broken.values():
        warnings.warn(f"mission left out: {reason}", stacklevel=2)
    return found


def broken_missions() -> dict[str, str]:
    """Return, by name, why a mission in one of the folders cannot be listed."""
    return _find()[1]


def places() -> dict[str, Path]:
    """Return, by name, where every mission is, listed or broken: its TOML file, or the folder of its log."""
    return _find()[2]


def mission(name_or_path: str | os.PathLike[str]) -> Mission:
    """Return a mission by its name, or by the path of its TOML file, of a flight csv or of a log's folder.

    Parameters
    ----------
    name_or_path
        A name as `missions` lists it, a path ending with ``.toml``, ``.csv`` or ``.csv.gz``, or a folder with
        the log of an IMU and a GPS receiver.

    Raises
    ------
    MissionError
        If there is no such mission, listing those there are, or it cannot be read.
    """
    text = os.fspath(name_or_path)
    found, broken, _ = _find()
    if text and text not in found and text not in broken and check_holds(_expand_path(text).is_dir):
        return _from_folder(_expand_path(text), found)  # also one that is called like a file
    if text.lower().endswith(".toml"):
        path = _expand_path(text)
        return _find_listed(path, found) or describe_mission(path, str(path))
    if text.lower().endswith((".csv", ".csv.gz")):
        return _from_csv(_expand_path(text))
    if text in found:
        return found[text]
    if text in broken:
        raise MissionError(broken[text])
    if text and check_holds(_expand_path(text).is_file):
        raise MissionError(
            f"{text}: is a file, and no mission yet; ins-lab import {text} adds it, with --as log if it has "
            "an IMU"
        )
    close = difflib.get_close_matches(text, found, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    raise MissionError(
        f"there is no mission {text!r}.{hint} Accepted: {names_in_words(found)}, or the path of a .toml, "
        ".csv or .csv.gz file or of a folder with a log"
    )


def names_in_words(names: Collection[str]) -> str:
    """Return the first names of missions as the words of a message: a folder may have thousands."""
    first, more = list(names)[:_NAMED], len(names) - _NAMED
    return ", ".join(first) + (f" and {more:,} more" if more > 0 else "")


def _expand_path(text: str) -> Path:
    try:
        return Path(text).expanduser()
    except RuntimeError:  # "~name" of an unknown user
        return Path(text)


def _from_csv(path: Path) -> Mission:
    if not check_holds(path.is_file):
        raise MissionError(
            f"{path}: there is no such file; accepted is a flight csv or the name of a mission"
        )
    return Mission.from_csv(path)


def _from_folder(path: Path, found: dict[str, Mission]) -> Mission:
    """Return the log in a folder."""
    if not is_log_folder(path):
        raise MissionError(
            f"{path}: is a folder without a log; accepted is one with log.toml, or with imu.csv and gnss.csv"
        )
    return _find_listed(path, found) or LogMission.at(path)


def _find_listed(path: Path, found: Mapping[str, Mission]) -> Mission | None:
    """Return the mission of a path among those found; None if there is none."""
    same = (one for one in found.values() if one.path is not None and one.path.absolute() == path.absolute())
    return next(same, None)


def _find() -> tuple[dict[str, Mission], dict[str, str], dict[str, Path]]:
    found: dict[str, Mission] = {}
    broken: dict[str, str] = {}
    places: dict[str, Path] = {}
    folders = [shipped_folder()]
    if own_folder().absolute() != folders[0].absolute():
        folders.append(own_folder())
    for folder in folders:
        try:
            listed = list_folder(folder)
        except FileNotFoundError:
            continue
        except OSError as error:
            broken[str(folder)] = f"{folder}: cannot be listed: {error.strerror or error}"
            continue
        for plain, path, mission, problem in listed:
            name = f"user:{plain}" if plain in places else plain
            places[name] = path
            if mission is None:
                broken[name] = problem
            else:
                # Each listing has its own missions, so that recordings read through them are freed.
                found[name] = mission.named(name)
    return found, broken, places
