"""Description TOML: the TOML file that describes a mission or a log, read and checked key by key."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lab.base.files.mission_error import MissionError
from lab.base.parameters import toml_file


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file, as `lab.base.parameters.toml_file.read_toml`.

    Raises
    ------
    MissionError
        If it cannot be read, or is not accepted.
    """
    try:
        return toml_file.read_toml(path)
    except toml_file.TomlError as error:
        raise MissionError(f"{path}: {error}") from error


def check_keys(path: Path, values: Mapping[str, Any], accepted: Sequence[str], texts: Sequence[str]) -> None:
    """Refuse a key that is not accepted, and a value that is not text where text is required.

    Parameters
    ----------
    path
        The TOML file, for messages.
    values
        Content of the file.
    accepted
        All keys that are accepted, in the order in which a message lists them; ``tags`` is a list of texts.
    texts
        Keys whose values are texts.

    Raises
    ------
    MissionError
        Naming the key, and what is accepted.
    """
    for key in values:
        if key not in accepted:
            close = difflib.get_close_matches(key, accepted, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise MissionError(f"{path}: there is no key {key!r}.{hint} Accepted: {', '.join(accepted)}")
    for key in texts:
        if not isinstance(values.get(key, ""), str):
            raise MissionError(f"{path}: {key} = {values[key]!r}; accepted is text in quotes")
    tags = values.get("tags", [])
    if not isinstance(tags, list) or not all(isinstance(tag, str) for tag in tags):
        raise MissionError(f'{path}: tags = {tags!r}; accepted is a list of texts, such as ["turns", "wind"]')


def file_in_same_folder(path: Path, key: str, name: str) -> Path:
    """Return the path of a file in the folder of a TOML file; refuse names that lead elsewhere.

    Parameters
    ----------
    path
        The TOML file.
    key, name
        The key in it, and the name it gives.

    Raises
    ------
    MissionError
        If the name is not that of a file in the same folder.
    """
    where = path.parent / name
    plain = not set("/\\:\0") & set(name) and name not in {"", ".", ".."}
    if not plain or _leads_out(where):
        raise MissionError(
            f"{path}: {key} = {name!r}; accepted is the plain name of a file in the same folder, "
            f'such as "{path.stem}.csv.gz"'
        )
    return where


def _leads_out(path: Path) -> bool:
    """Return whether a plain name in a folder is a link to somewhere else."""
    if not path.is_symlink():
        return False
    try:
        target = path.resolve()
        # From Python 3.13 on, a loop of links is left as it is.
        return target.parent != path.parent.resolve() or target.is_symlink()
    except (OSError, RuntimeError):  # a loop of links
        return True
