"""Flight import: from files of a simulator or logger to a mission, with a report to judge it before."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lab.base.files.mission_error import MissionError, QuestionError
from lab.data.checks.imu_axes import axes_matrix
from lab.data.clock.two_clocks import clock_rate
from lab.data.formats import READERS, Reader, log_reader_of, read_log_of, read_raw, reader_of, start_of
from lab.data.log.auxiliary_data import Comparison
from lab.data.log.calibration import read_calibration
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import SensorLog
from lab.data.rebuild.import_report import ImportReport, report
from lab.data.rebuild.import_settings import ALL, ImportSettings
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.rebuild.reconstruction import Reconstruction, reconstruct
from lab.data.rebuild.time_repair import AS_RECORDED, RepairedFlight, repair
from lab.data.sheets.sensor_csv import missing_time_reason
from lab.missions.library import add_mission
from lab.missions.mission import Mission
from lab.motion.recordings.recording import Recording
from lab.sensors.imu_errors import SensorNoise

RECONSTRUCTED = "attitude reconstructed"
"""Tag of a mission whose attitude is not recorded."""
_MAX_IN_FOLDER = 200
"""Most files of a folder that are looked at: exports of phones have some twenty."""
_KITTI_STAMPS = "timestamps.txt"
"""File of a drive of KITTI that stands for all its samples."""
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
    units : Mapping
        Units that overrule those of the files, by column.
    axes : sequence of str
        The axes of the IMU that point forward, right and down, if a person gives them.
    """

    paths: tuple[Path, ...]
    raw: RawFlight
    flight: RepairedFlight
    rebuilt: Reconstruction
    report: ImportReport
    settings: ImportSettings
    units: Mapping[str, str] = field(default_factory=dict)
    axes: Sequence[str] = ()

    @property
    def recording(self) -> Recording:
        """The flight on a regular grid."""
        return self.rebuilt.recording

    @property
    def log(self) -> SensorLog | None:
        """The recorded IMU and GPS data, if the file has both; read at first use."""
        return self._read_log[0]

    @property
    def log_refused(self) -> str:
        """Why a table with named columns is no sensor log; empty for other formats."""
        return self._read_log[1]

    @cached_property
    def _read_log(self) -> tuple[SensorLog | None, str]:
        try:
            return read_log(self.paths, self.units, self.axes), ""
        except MissionError as error:
            text = str(error).replace(f"{self.paths[0].parent}/" if self.paths else "\0", "")
            return None, text if self.raw.format == READERS[-1].name else ""

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
    named = (paths,) if isinstance(paths, str | os.PathLike) else tuple(paths)
    files = tuple(_files([Path(path) for path in named]))
    return prepare_flight(read_raw(files, units), settings, sensor, files, units)


def read_log(
    paths: Sequence[Path],
    units: Mapping[str, str] | None = None,
    axes: Sequence[str] = (),
    vehicle: str = "",
) -> SensorLog:
    """Return the recorded IMU and GPS of files that have both, with the recorder's own solution.

    Parameters
    ----------
    paths
        The file; for tables with named columns also several, or a folder with them.
    units
        For such tables, corrections by column: a unit, or a quantity with its unit.
    axes
        For such tables, the axes of the IMU that point forward, right and down; empty: found in the data.
    vehicle
        For such tables, the kind of vehicle.

    Raises
    ------
    MissionError
        If it cannot be read, or has not both.
    """
    files = _files(paths)
    if not files:
        raise MissionError("the flight was not read from a file; a log of an IMU and a GPS receiver is")
    find = log_reader_of if len(files) > 1 else reader_of
    readers = [find(file, units) for file in files]
    reader = next((one for one in readers if one.read_logs is None), readers[0])
    if reader.read_logs is not None:
        try:
            return _with_clock_rate(reader.read_logs(files, units or {}, axes, vehicle))
        except QuestionError:
            raise
        except MissionError as error:
            raise MissionError(f"{error}{_without_columns(paths, files)}") from error
    if len(files) != 1:
        raise MissionError(
            f"{len(files)} files, and {files[readers.index(reader)]} is {reader.name}; a log of an IMU and a "
            "GPS receiver is read from one file, or from several tables with named columns"
        )
    if axes or vehicle:
        raise MissionError(f"{files[0]}: {reader.name} states its axes and its vehicle; they are not given")
    log = read_log_of(reader, files[0])
    own = own_solution(reader, files[0], log.epoch)
    return _with_clock_rate(replace(log, auxiliary=replace(log.auxiliary, comparisons=own)))


def calibrate_log(
    log: SensorLog, files: Sequence[Path], calibration: Path, axes: Sequence[str] = ()
) -> SensorLog:
    """Return a log that was read from files without the constant errors of its device.

    Parameters
    ----------
    log
        The log.
    files
        Its files.
    calibration
        The file of the calibration, in the axes of the device.
    axes
        The axes of the device that point forward, right and down; empty if the format of the files states
        them.

    Raises
    ------
    MissionError
        If the calibration cannot be read, or nothing states the axes of the device.
    """
    known = read_calibration(calibration)
    if axes:
        return known.applied(log, axes_matrix(axes))
    try:
        states_axes = log_reader_of(_files(files)[0]).read_logs is None
    except MissionError:
        states_axes = False
    if not states_axes:
        raise MissionError(
            f"{calibration}: is in the axes of the device; accepted beside it are the axes that point "
            "forward, right and "
            "down, such as --axes x,y,z"
        )
    return known.applied(log)


def any_log(
    paths: Sequence[Path],
    units: Mapping[str, str] | None = None,
    axes: Sequence[str] = (),
    vehicle: str = "",
) -> SensorLog:
    """Return the log in files as `read_log`, or in one file with the bytes of a device.

    Raises
    ------
    MissionError
        If it cannot be read, or has not both an IMU and fixes.
    """
    from lab.data.streams.raw_recording import RecordingError  # noqa: PLC0415 - rarely needed
    from lab.data.streams.recorded_log import device_log  # noqa: PLC0415 - rarely needed

    try:
        return read_log(paths, units, axes, vehicle)
    except MissionError as refusal:
        try:
            log = device_log(paths[0], vehicle, axes) if len(paths) == 1 and not units else None
        except RecordingError as error:
            if (reason := missing_time_reason(start_of(paths[0]))) and reason in str(refusal):
                raise refusal from None
            raise MissionError(str(error)) from error
        if log is None:
            raise
        return log


def _with_clock_rate(log: SensorLog) -> SensorLog:
    """Return a log with a remark if the clocks of its IMU and its receiver run at different rates."""
    whole = cut_section(log)
    gnss = whole.gnss
    found = clock_rate(whole.time, whole.dtheta, gnss.time - gnss.latency, gnss.position, gnss.velocity_n)
    return log if found is None else replace(log, repairs=(*log.repairs, found.remark))


def _without_columns(paths: Sequence[Path], files: Sequence[Path]) -> str:
    """Return a sentence on csv files in folders of which nothing is read; empty if there are none."""
    inside = [one for path in paths if path.is_dir() for one in sorted(path.glob("*.csv"))[:_MAX_IN_FOLDER]]
    found = [
        f"{one.name} {'has no header with known columns' if one.stat().st_size else 'is empty'}"
        for one in inside
        if one not in files
    ]
    return f". Not read: {', '.join(found)}" if found else ""


def _files(paths: Sequence[Path]) -> list[Path]:
    """Return files; of a folder, the tables with named columns in it."""
    files: list[Path] = []
    for path in paths:
        if not path.is_dir():
            files.append(path)
            continue
        drives = [one / _KITTI_STAMPS for one in (path / "oxts", path) if (one / "data").is_dir()]
        if drives and drives[0].is_file():
            files.append(drives[0])
            continue
        tables = []
        for inside in sorted(path.iterdir())[:_MAX_IN_FOLDER]:
            with contextlib.suppress(MissionError):
                if inside.is_file() and log_reader_of(inside).read_logs is not None:
                    tables.append(inside)
        if not tables:
            raise MissionError(
                f"{path}: the folder holds no table with named columns; accepted are csv files"
            )
        files += tables
    return files


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
    place = raw.position
    if raw.euler is None or place is None or raw.height is None:
        return ()  # without an attitude it is the receiver's and no estimator's
    rows = np.append(True, np.diff(raw.time) > 0)[: len(raw.time)]
    if rows.sum() < 2 or (np.diff(raw.time[rows]) <= 0).any():
        return ()
    velocity = np.full_like(place, np.nan) if raw.velocity_n is None else raw.velocity_n
    name = f"the autopilot's own solution ({reader.name})"
    return (Comparison(raw.time[rows] - epoch, place[rows], velocity[rows], raw.euler[rows], name),)


def prepare_flight(
    raw: RawFlight,
    settings: ImportSettings | None = None,
    sensor: SensorNoise | None = None,
    paths: Sequence[Path] = (),
    units: Mapping[str, str] | None = None,
    axes: Sequence[str] = (),
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
    units
        Units that were given for their columns.
    axes
        Axes of the IMU that were given.

    Raises
    ------
    MissionError
        If no flight can be made of it.
    """
    chosen = ImportSettings() if settings is None else settings.copy()
    where = f"{paths[0]}: " if paths else ""
    try:
        used = raw.with_all_positions() if chosen.positions == ALL else raw.measured()
        flight = repair(used, str(chosen.time_stamps), float(chosen.longest_gap))
        rebuilt = reconstruct(flight, chosen)
    except MissionError as error:
        raise MissionError(f"{where}{error}") from error
    judged = report(used, flight, rebuilt, sensor)
    return FlightImport(tuple(paths), raw, flight, rebuilt, judged, chosen, dict(units or {}), axes)
