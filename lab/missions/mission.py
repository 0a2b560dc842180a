"""Mission: a named flight: its TOML file and its recording."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from lab.base.files.description_toml import check_keys, file_in_same_folder, read_toml
from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.notebook_card import NotebookCard
from lab.motion.recordings.flight_csv import flight_duration, read_flight_csv
from lab.motion.recordings.recording import Recording

if TYPE_CHECKING:
    from lab.flying.flight_plan import Plan

_TEXTS = ("title", "description", "origin", "aircraft", "airport", "recording", "ending")
_KEYS = (*_TEXTS, "tags", "flight")


@dataclass(frozen=True, eq=False, repr=False)
class Mission(NotebookCard):
    """A flight that can be navigated.

    Attributes
    ----------
    name : str
        Name in settings and on the command line.
    recording_path : Path
        The flight csv.
    title, description : str
        For people: a short title, and what the flight is.
    origin : str
        Where the recording comes from, and how it was made.
    aircraft, airport : str
        What flew, and where from.
    tags : tuple of str
        Words to find it by.
    path : Path or None
        The TOML file; None for a bare flight csv.
    flight : mapping or None
        The flight plan as the TOML file has it, for a flight that can be flown again; see `plan`.
    ending : str
        Why the flight ended before its plan did; empty when it did not.
    """

    CARD = "mission"

    name: str
    recording_path: Path
    title: str = ""
    description: str = ""
    origin: str = ""
    aircraft: str = ""
    airport: str = ""
    tags: tuple[str, ...] = ()
    path: Path | None = None
    flight: Mapping[str, Any] | None = None
    ending: str = ""

    @classmethod
    def from_toml(cls, path: Path, name: str | None = None) -> Mission:
        """Return the mission a TOML file describes; the recording is not read yet.

        Parameters
        ----------
        path
            The TOML file; the recording it names is in the same folder.
        name
            Name of the mission; the file's name without ``.toml`` by default.

        Raises
        ------
        MissionError
            If the file cannot be read, or has a key or value that is not accepted.
        """
        values = read_toml(path)
        _check(path, values)
        texts = {key: values[key] for key in _TEXTS if key in values and key != "recording"}
        recording = file_in_same_folder(path, "recording", values["recording"])
        tags, flight = tuple(values.get("tags", ())), values.get("flight")
        return cls(
            name=name or path.stem, recording_path=recording, tags=tags, path=path, flight=flight, **texts
        )

    @classmethod
    def from_csv(cls, path: Path) -> Mission:
        """Return the mission that is just a flight csv; the recording is not read yet."""
        return cls(name=str(path), recording_path=path, title=path.name, origin="flight csv")

    def named(self, name: str) -> Self:
        """Return the same mission by another name, without what was read from its files."""
        made = object.__new__(type(self))
        own = {field: value for field, value in vars(self).items() if field in self.__dataclass_fields__}
        vars(made).update(own, name=name)
        return made

    @cached_property
    def recording(self) -> Recording:
        """The flight as recorded; read when first asked for.

        Raises
        ------
        MissionError
            If the flight csv is not acceptable.
        """
        return read_flight_csv(self.recording_path)

    @property
    def duration(self) -> float:
        """Time from the first sample of the recording to the last [s]; only these are read."""
        recording = self.__dict__.get("recording")
        return flight_duration(self.recording_path) if recording is None else float(recording.duration)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of the recording's file, a key for caches of results.

        Raises
        ------
        MissionError
            If the file cannot be read or is too large.
        """
        try:
            check_file(self.recording_path, MAX_BYTES)
            with self.recording_path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise MissionError(f"{self.recording_path}: cannot be read: {error.strerror or error}") from error

    @property
    def plan(self) -> Plan:
        """The flight plan.

        Raises
        ------
        MissionError
            If the mission has none, or it is not acceptable.
        """
        from lab.flying.flight_plan import read_plan  # noqa: PLC0415 - a run needs no plan

        if self.flight is None:
            raise MissionError(f"mission {self.name}: has no [flight] table, so it cannot be flown again")
        return read_plan(self.flight, f"{self.path}, flight")

    def __repr__(self) -> str:
        facts = [text for text in (self.title, self.aircraft, self.airport) if text]
        return f"<Mission {self.name}: {', '.join(facts)}>"


def _check(path: Path, values: Mapping[str, Any]) -> None:
    check_keys(path, values, _KEYS, _TEXTS)
    for key in ("title", "recording"):
        if not values.get(key):
            raise MissionError(f"{path}: {key} is missing; a mission has at least a title and a recording")
    if not isinstance(values.get("flight", {}), dict):
        raise MissionError(f"{path}: flight is not a table; accepted is a [flight] section")
