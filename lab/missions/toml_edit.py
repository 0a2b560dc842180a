"""TOML edit: the TOML file of a mission with some values changed and the rest kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import parse_toml


def changed_text(toml: Path, text: str, changes: Mapping[str, Any]) -> str:
    """Return the text of a TOML file with some values changed; all else stays, comments too.

    Parameters
    ----------
    toml
        The file, for messages.
    text
        Content of the file.
    changes
        New values by key. None removes a key; a mapping changes values in the table of that name.

    Raises
    ------
    MissionError
        If the text cannot be changed so that exactly these values change.
    """
    import tomlkit  # noqa: PLC0415 - rarely needed
    import tomlkit.exceptions  # noqa: PLC0415

    try:
        expected = parse_toml(text)
        _change(expected, changes)
        document = tomlkit.parse(text)
        _change(document, changes)
        new = tomlkit.dumps(document)
        if parse_toml(new) == expected:
            return new
    except (tomlkit.exceptions.TOMLKitError, ValueError, RecursionError) as error:
        raise MissionError(f"{toml}: cannot be changed: {error}") from error
    raise MissionError(f"{toml}: cannot be changed: {', '.join(changes)}; change it by hand")


def flown_text(toml: Path, text: str, *, recording: str, seed: int | None, ending: str) -> str:
    """Return the text of a mission's TOML file after a flight; the ending is its first line.

    Parameters
    ----------
    toml, text
        As of `changed_text`.
    recording
        Name of the file of the new recording.
    seed
        New seed of the plan; None keeps the old one.
    ending
        Why the flight ended before its plan did; empty when it did not.

    Raises
    ------
    MissionError
        As of `changed_text`.
    """
    old = parse_toml(text)
    changes: dict[str, Any] = {} if old.get("recording") == recording else {"recording": recording}
    if seed is not None and old["flight"].get("seed") != seed:
        changes["flight"] = {"seed": seed}
    if old.get("ending", "") == ending:
        return changed_text(toml, text, changes) if changes else text
    rest = changed_text(toml, text, changes | ({"ending": None} if "ending" in old else {}))
    return f"{changed_text(toml, '', {'ending': ending})}{rest}" if ending else rest


def _change(values: Any, changes: Mapping[str, Any]) -> None:
    for key, value in changes.items():
        if value is None:
            del values[key]
        elif isinstance(value, Mapping):
            _change(values[key], value)
        else:
            values[key] = value
