"""Catalogue: the missions there are: those that ship with the lab, and the user's own beside them."""

from __future__ import annotations

import difflib
import os
import warnings
from pathlib import Path

from lab.missions.errors import MissionError
from lab.missions.mission import Mission

OWN_FOLDER_VARIABLE = "INS_LAB_MISSIONS"
"""Environment variable that names the folder of the user's own missions."""


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
        return _expanded(named)
    from platformdirs import user_data_path  # noqa: PLC0415 - only needed without the variable

    return user_data_path("ins-lab", appauthor=False) / "missions"


def missions() -> dict[str, Mission]:
    """Return all missions by name: the shipped ones, then the user's own.

    A mission is a TOML file and the recording beside it; its name is the TOML file's. A user's mission that
    has the name of a shipped one is called ``user:NAME``, so that neither hides the other. A mission that
    cannot be listed is left out with a warning; see `broken_missions`.
    """
    found, broken = _find()
    for reason in broken.values():
        warnings.warn(f"mission left out: {reason}", stacklevel=2)
    return found


def broken_missions() -> dict[str, str]:
    """Return, by name, why a mission in one of the folders cannot be listed."""
    return _find()[1]


def mission(name_or_path: str | os.PathLike[str]) -> Mission:
    """Return a mission by its name, or by the path of a mission's TOML file or of a flight csv.

    Parameters
    ----------
    name_or_path
        A name as `missions` lists it, or a path ending with ``.toml``, ``.csv`` or ``.csv.gz``.

    Raises
    ------
    MissionError
        If there is no such mission, listing those there are, or it cannot be read.
    """
    text = os.fspath(name_or_path)
    found, broken = _find()
    if text.lower().endswith(".toml"):
        path = _expanded(text)
        listed = [
            one for one in found.values() if one.path is not None and one.path.absolute() == path.absolute()
        ]
        return listed[0] if listed else Mission.from_toml(path, name=str(path))
    if text.lower().endswith((".csv", ".csv.gz")):
        return _from_csv(_expanded(text))
    if text in found:
        return found[text]
    if text in broken:
        raise MissionError(broken[text])
    close = difflib.get_close_matches(text, found, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    raise MissionError(
        f"there is no mission {text!r}.{hint} Accepted: {', '.join(found)}, or the path of a .toml, .csv or "
        ".csv.gz file"
    )


def _expanded(text: str) -> Path:
    try:
        return Path(text).expanduser()
    except RuntimeError:  # "~somebody" with no such user
        return Path(text)


def _from_csv(path: Path) -> Mission:
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        is_file = False
    if not is_file:
        raise MissionError(
            f"{path}: there is no such file; accepted is a flight csv or the name of a mission"
        )
    return Mission.from_csv(path)


def _find() -> tuple[dict[str, Mission], dict[str, str]]:
    found: dict[str, Mission] = {}
    broken: dict[str, str] = {}
    folders = [shipped_folder()]
    if own_folder().absolute() != folders[0].absolute():
        folders.append(own_folder())
    for folder in folders:
        try:
            paths = sorted(folder.glob("*.toml"))
        except OSError as error:
            broken[str(folder)] = f"{folder}: cannot be listed: {error.strerror or error}"
            continue
        for path in paths:
            name = f"user:{path.stem}" if path.stem in found or path.stem in broken else path.stem
            try:
                listed = Mission.from_toml(path, name)
            except MissionError as error:
                broken[name] = str(error)
                continue
            if listed.recording_path.is_file():
                found[name] = listed
            else:
                hint = "; fly it: ins-lab fly " + str(path) if listed.flight else ""
                broken[name] = f"{path}: its recording {listed.recording_path.name} does not exist{hint}"
    return found, broken
