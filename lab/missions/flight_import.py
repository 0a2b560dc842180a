"""Flight import: from files of a simulator or logger to a mission, with a report to judge it before."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lab.importing.import_report import ImportReport, report
from lab.importing.import_settings import ImportSettings
from lab.importing.reconstruction import Reconstruction, reconstruct
from lab.importing.sensor_noise import SensorNoise
from lab.logs.auxiliary_data import Comparison
from lab.logs.sensor_log import SensorLog
from lab.missions.library import add_mission
from lab.missions.mission import Mission
from lab.readers import READERS, Reader, read_raw, reader_of
from lab.recordings.mission_error import MissionError
from lab.recordings.recording import Recording
from lab.repair.raw_flight import RawFlight
from lab.repair.time_repair import AS_RECORDED, RepairedFlight, repair

RECONSTRUCTED = "attitude reconstructed"
"""Tag of a mission whose attitude is not recorded."""
IMPORTED = "imported"
"""Tag of every mission that was imported."""


@dataclass(frozen=True, eq=False, repr=False)
class FlightImport:
    """A flight ready to be added, or not.

    Attributes
    ----------
    paths : tuple of Path
        The files; empty for a flight that was recorded live.
    raw : RawFlight
        The flight in the files.
    flight : RepairedFlight
        Its longest unbroken stretch, time stamps repaired.
    rebuilt : Reconstruction
        The flight rebuilt from that, and how.
    report : ImportReport
        Settings for the plausibility checks.
    settings : ImportSettings
        How it was rebuilt.
    """

    paths: tuple[Path, ...]
    raw: RawFlight
    flight: RepairedFlight
    rebuilt: Reconstruction
    report: ImportReport
    settings: ImportSettings

    @property
    def recording(self) -> Recording:
        """The flight on a regular grid."""
        return self.rebuilt.recording

    @cached_property
    def log(self) -> SensorLog | None:
        """The recorded IMU and GPS data, if the file has both; read at first use."""
        try:
            return read_log(self.paths)
        except MissionError:
            return None

    @property
    def origin(self) -> str:
        """The source of the flight and how it was rebuilt, in words."""
        names = ", ".join(path.name for path in self.paths)
        parts = [f"{self.raw.format}{f' {names}' if names else ''}"]
        parts.append("as recorded" if self.rebuilt.unchanged else f"rebuilt from {self.rebuilt.curve}")
        if self.flight.method != AS_RECORDED:
            parts.append("time stamps repaired")
        if self.rebuilt.attitude_reconstructed:
            parts.append(RECONSTRUCTED)
        return ", ".join(parts)

    def add(
        self,
        name: str,
        title: str = "",
        *,
        description: str = "",
        tags: Sequence[str] = (),
        folder: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
    ) -> Mission:
        """Add the flight to the user's own missions.

        Parameters
        ----------
        name
            Name of the mission.
        title, description, tags
            As of `Mission`; without a title it is that of the file.
        folder
            Where to write; the user's own folder by default.
        overwrite
            True replaces a mission of that name.

        Raises
        ------
        MissionError
            If the name is taken or not accepted, or the folder cannot be written.
        """
        file = self.paths[0].name if self.paths else self.raw.format
        own = (IMPORTED, RECONSTRUCTED) if self.rebuilt.attitude_reconstructed else (IMPORTED,)
        return add_mission(
            self.recording,
            name,
            title=title or f"Flight of {file}",
            description=description,
            origin=self.origin,
            aircraft=self.raw.vehicle,
            tags=(*tags, *(tag for tag in own if tag not in tags)),
            folder=folder,
            overwrite=overwrite,
        )

    def __repr__(self) -> str:
        return f"<FlightImport {self.raw.format}: {self.recording.duration:.1f} s, {self.report.verdict}>"


def prepare_import(
    paths: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    settings: ImportSettings | None = None,
    units: Mapping[str, str] | None = None,
    sensor: SensorNoise | None = None,
) -> FlightImport:
    """Read a flight of any format, repair and rebuild it, and report; nothing is added yet.

    Parameters
    ----------
    paths
        The file, or the files if a format uses several for one flight.
    settings
        How to rebuild it.
    units
        Units that overrule those of the file, by column.
    sensor
        An IMU, with whose noise that of the recording is compared.

    Raises
    ------
    MissionError
        If a file cannot be read, or no flight can be made of it.
    """
    files = (paths,) if isinstance(paths, str | os.PathLike) else tuple(paths)
    return prepare_flight(read_raw(files, units), settings, sensor, tuple(Path(file) for file in files))


def read_log(paths: Sequence[Path]) -> SensorLog:
    """Return the recorded IMU and GPS of a file that has both, with the recorder's own solution.

    Raises
    ------
    MissionError
        If it cannot be read, or has not both.
    """
    if len(paths) != 1:
        raise MissionError(f"{len(paths)} files; a log of an IMU and a GPS receiver is read from one")
    reader = reader_of(paths[0])
    if reader.read_log is None:
        logs = ", ".join(other.name for other in READERS if other.read_log is not None)
        raise MissionError(f"{paths[0]}: is {reader.name}, which has no IMU and GPS; accepted: {logs}")
    log = reader.read_log(paths[0])
    return replace(
        log, auxiliary=replace(log.auxiliary, comparisons=own_solution(reader, paths[0], log.epoch))
    )


def own_solution(reader: Reader, path: Path, epoch: float) -> tuple[Comparison, ...]:
    """Return the solution of an autopilot's estimator, if the file has it.

    Parameters
    ----------
    reader, path
        The reader and its file.
    epoch
        What time 0 of the log is in the clock of the file [s].
    """
    try:
        raw = reader.read((path,), {})
    except MissionError:
        return ()
    if raw.euler is None or raw.latitude is None or raw.longitude is None or raw.height is None:
        return ()  # without an attitude it is the receiver's and no estimator's
    rows = np.append(True, np.diff(raw.time) > 0)[: len(raw.time)]
    if rows.sum() < 2 or (np.diff(raw.time[rows]) <= 0).any():
        return ()
    place = np.column_stack((raw.latitude, raw.longitude, raw.height))
    velocity = np.full_like(place, np.nan) if raw.velocity_n is None else raw.velocity_n
    name = f"the autopilot's own solution ({reader.name})"
    return (Comparison(raw.time[rows] - epoch, place[rows], velocity[rows], raw.euler[rows], name),)


def prepare_flight(
    raw: RawFlight,
    settings: ImportSettings | None = None,
    sensor: SensorNoise | None = None,
    paths: Sequence[Path] = (),
) -> FlightImport:
    """Return the same for a flight that has been read, such as one recorded live.

    Parameters
    ----------
    raw
        The flight as read.
    settings, sensor
        As of `prepare_import`.
    paths
        The files it was read from.

    Raises
    ------
    MissionError
        If no flight can be made of it.
    """
    chosen = ImportSettings() if settings is None else settings.copy()
    where = f"{paths[0]}: " if paths else ""
    try:
        flight = repair(raw, str(chosen.time_stamps), float(chosen.longest_gap))
        rebuilt = reconstruct(flight, chosen)
    except MissionError as error:
        raise MissionError(f"{where}{error}") from error
    return FlightImport(tuple(paths), raw, flight, rebuilt, report(raw, flight, rebuilt, sensor), chosen)
