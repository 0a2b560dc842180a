"""Parcel: all that some work needs of this computer, as plain data: settings, files of missions, sources.

It travels to each worker of a cluster once. Nothing in it was unpickled or made from a file: the bytes of a
mission are read and checked on arrival as any file is, and settings are accepted by their declarations.
"""

from __future__ import annotations

import functools
import hashlib
import threading
import zlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np

import lab
from lab.base.cache import digest
from lab.base.files.atomic_file import write_file
from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.data.files.log_toml import DESCRIPTION_FILE
from lab.experiment.experiment import Experiment
from lab.experiment.result import Runnable
from lab.missions import LogMission, mission
from lab.navigation.algorithm import Algorithm
from lab.navigation.algorithm_source import AlgorithmSource

T = TypeVar("T")


class VersionError(ValueError):
    """The lab or a package has another version than that which sent the work."""


class MissionFiles(NamedTuple):
    """The files of a mission.

    Attributes
    ----------
    contents : dict of bytes
        Their compressed contents by their names.
    entry : str
        The file that is the mission; empty if their folder is.
    content_hash : str
        Hash of the mission; see `Mission.content_hash`.
    """

    contents: dict[str, bytes]
    entry: str
    content_hash: str

    @classmethod
    def of(cls, name: str) -> MissionFiles:
        """Return the files of a mission; of a flight, its recording.

        Raises
        ------
        MissionError
            If the mission cannot be found, or a file cannot be read.
        """
        found = mission(name)
        content_hash, entry = found.content_hash, found.recording_path.name
        paths = [found.recording_path]
        if isinstance(found, LogMission):
            folder = found.files.path.is_dir()
            description = found.files.path / DESCRIPTION_FILE if folder else found.files.path
            entry = "" if folder else description.name
            paths = [*found.files.paths, *([description] if description.is_file() else [])]
        contents = {}
        for path in paths:
            try:
                contents[path.name] = zlib.compress(path.read_bytes(), zlib.Z_BEST_SPEED)
            except OSError as error:
                raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from error
        return cls(contents, entry, content_hash)

    def written(self, folder: Path) -> str:
        """Write the files into a folder of their own, and return the path of the mission.

        Raises
        ------
        MissionError
            If what arrived is not what was sent, or is no mission.
        OSError
            If they cannot be written.
        """
        own = folder / self.content_hash
        own.mkdir(parents=True, exist_ok=True)
        for name, content in self.contents.items():
            # The last part of a name alone: what came from elsewhere must not lead out of the folder.
            write_file(own / Path(name).name, zlib.decompress(content))
        place = str(own / self.entry) if self.entry else str(own)
        if mission(place).content_hash != self.content_hash:
            raise MissionError(f"{self.entry or 'log'}: its files changed while they were sent; run it again")
        return place


@dataclass(frozen=True, eq=False)
class Parcel:
    """What some work needs; equal parcels have equal digests.

    Attributes
    ----------
    settings : tuple of dict
        The settings of each experiment.
    missions : dict of MissionFiles
        The files of the missions, by the names in the settings.
    algorithm : AlgorithmSource or None
        The user's navigator.
    versions : dict of str
        The versions that made it; see `versions`.
    digest : str
        Digest of all this.
    """

    settings: tuple[dict[str, Any], ...]
    missions: dict[str, MissionFiles]
    algorithm: AlgorithmSource | None
    versions: dict[str, str]
    digest: str

    @classmethod
    def of(cls, experiments: Sequence[Experiment], algorithm: Algorithm | None = None) -> Parcel:
        """Return what experiments and the user's navigator consist of.

        Raises
        ------
        SettingError
            If an experiment cannot leave this process: with states of the user's own, or hidden settings.
        MissionError
            If a mission cannot be found or read.
        AlgorithmError
            If the source of the navigator cannot travel.
        """
        for one in experiments:
            if reason := why_not(one):
                raise SettingError(reason)
        settings = tuple(one.to_dict() for one in experiments)
        missions = {name: MissionFiles.of(name) for name in dict.fromkeys(one.mission for one in experiments)}
        source = None if algorithm is None else AlgorithmSource.of(algorithm)
        hashes = {name: files.content_hash for name, files in missions.items()}
        made = versions()
        key = digest(settings, hashes, None if source is None else source.digest, made)
        return cls(settings, missions, source, made, key)

    def unpack(self, folder: Path) -> Unpacked:
        """Return the experiments, whose missions are in a folder; the same for each piece of the work.

        Raises
        ------
        VersionError
            If the versions are not those of this process.
        ValueError
            If what arrived is not accepted.
        """
        check_versions(self.versions)
        # Pieces of one parcel begin in several threads at once: the first unpacks it for all.
        with _UNPACKING:
            if self.digest not in _UNPACKED:
                while len(_UNPACKED) >= KEPT:
                    del _UNPACKED[next(iter(_UNPACKED))]
                places = {name: files.written(folder) for name, files in self.missions.items()}
                experiments = [
                    Experiment().update({**values, "mission": places[values["mission"]]})
                    for values in self.settings
                ]
                _UNPACKED[self.digest] = Unpacked(experiments, self.algorithm)
            return _UNPACKED[self.digest]


class Unpacked:
    """The experiments of a parcel.

    Parameters
    ----------
    experiments
        The experiments.
    source
        The user's navigator.
    """

    def __init__(self, experiments: list[Experiment], source: AlgorithmSource | None = None) -> None:
        self.experiments = experiments
        self._source = source
        self._kept: dict[Hashable, Any] = {}
        self._lock = threading.Lock()

    def algorithm(self) -> Algorithm | None:
        """Return the user's navigator, made anew, so that pieces of work share no objects."""
        return None if self._source is None else self._source.made()

    def kept(self, make: Callable[[Experiment], T], experiment: Experiment) -> T:
        """Return what is made of an experiment, made once for all pieces of work."""
        # By identity, which stays unique: this object keeps its experiments alive.
        key = make, id(experiment)
        with self._lock:
            if key not in self._kept:
                self._kept[key] = make(experiment)
            found: T = self._kept[key]
        return found


KEPT = 4
"""Number of parcels whose experiments a worker keeps: of several pages that share a cluster."""
_UNPACKED: dict[str, Unpacked] = {}
_UNPACKING = threading.Lock()


def why_not(experiment: Runnable) -> str:
    """Return why an experiment cannot leave this process; empty if it can."""
    if type(experiment) is not Experiment:
        return (
            "client: something is hidden in this experiment, and does not leave this computer; accepted is "
            "no client"
        )
    for path in ("navigator.own_states", "sensors.own_errors"):
        if experiment.get(path):
            return (
                f"{path} = {experiment.get(path)!r}: states that are declared in this process do not travel "
                "to a cluster; accepted is no client"
            )
    return ""


def versions() -> dict[str, str]:
    """Return the versions that a result depends on, and the digest of the lab's source."""
    return {
        "lab": lab.__version__,
        "numba": numba.__version__,
        "numpy": np.__version__,
        "source of the lab": _source_digest(),
    }


def describe_differences(wanted: Mapping[str, str | None], found: Mapping[str, str | None]) -> str:
    """Return in words how versions differ from those that are wanted; empty if they do not."""
    return ", ".join(
        f"{name} {found.get(name) or 'missing'} in place of {version}"
        for name, version in wanted.items()
        if found.get(name) != version
    )


def check_versions(wanted: Mapping[str, str]) -> None:
    """Raise `VersionError` if the versions of this process are not those that are wanted."""
    wrong = describe_differences(wanted, versions())
    if wrong:
        raise VersionError(wrong)


@functools.cache
def _source_digest() -> str:
    folder = Path(lab.__file__).parent
    whole = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        if "notebooks" in path.parts:  # of the installed lab only
            continue
        whole.update(path.relative_to(folder).as_posix().encode())
        # The same source may have other line ends on another system.
        whole.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return whole.hexdigest()[:12]
