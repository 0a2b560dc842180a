"""Log mission: a sensor log of an IMU and a GPS receiver as a mission."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from lab.base.files.description_toml import read_toml
from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.checks.imu_axes import axes_matrix
from lab.data.files.log_toml import DESCRIPTION_FILE, KEYS
from lab.data.files.sensor_log_csv import LogFiles, log_files
from lab.data.log.calibration import read_calibration
from lab.data.log.sensor_log import SensorLog
from lab.missions.mission import Mission
from lab.motion.recordings.recording import Recording


@dataclass(frozen=True, eq=False, repr=False)
class LogMission(Mission):
    """A sensor log that can be navigated; nothing is simulated, and there is no true flight.

    Attributes
    ----------
    files : LogFiles
        The files of the log; `recording_path` is that of the IMU.
    """

    CARD = "log"

    files: LogFiles = None  # type: ignore[assignment]  # given always; the fields before it have defaults

    @classmethod
    def at(cls, path: Path, name: str | None = None) -> LogMission:
        """Return the mission that is a log; its csv files are not read yet.

        Parameters
        ----------
        path
            Folder of the log, or its TOML file.
        name
            Name of the mission; the path by default.

        Raises
        ------
        MissionError
            If the TOML cannot be read or has a key or value that is not accepted, or a file does not exist.
        """
        files = log_files(path)
        return cls(
            name=name or str(path),
            recording_path=files.imu,
            title=files.title,
            description=files.description,
            origin="sensor log",
            tags=files.tags,
            path=files.path,
            files=files,
        )

    @cached_property
    def log(self) -> SensorLog:
        """The log, repaired; read when first asked for.

        Raises
        ------
        MissionError
            If a csv file is not acceptable, or the numbers contradict the units, axes or clock they claim.
        """
        return _read(self.files)

    def log_of(self, vehicle: str = "") -> SensorLog:
        """Return the log with a given vehicle; an empty name keeps the vehicle of the files.

        Raises
        ------
        MissionError
            As of `log`.
        """
        return _read(replace(self.files, vehicle=vehicle)) if vehicle else self.log

    @property
    def recording(self) -> Recording:
        """A log is no flight recording: raises `MissionError`."""
        raise MissionError(
            f"{self.name}: is a sensor log, and its true flight is unknown; accepted here is a mission with "
            "a flight recording"
        )

    @property
    def duration(self) -> float:
        """Time from the first sample of the IMU to the last [s]; only these are read."""
        log = self.__dict__.get("log")
        if log is None and self.files.has_own_names:
            return self.files.duration
        return float(self.log.duration)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of all files of the log, a key for caches of results.

        Raises
        ------
        MissionError
            If a file cannot be read or is too large.
        """
        files = self.files
        whole = hashlib.sha256(repr(files.stated).encode())
        for path in files.paths:
            try:
                check_file(path, MAX_BYTES)
                with path.open("rb") as file:
                    whole.update(hashlib.file_digest(file, "sha256").digest())
            except OSError as error:
                raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from error
        return whole.hexdigest()


def _read(files: LogFiles) -> SensorLog:
    """Return the log of files with the lab's own columns, or with other headings."""
    if files.has_own_names:
        return files.read()
    from lab.data.sheets.sensor_csv import read_logs  # noqa: PLC0415 - imports scipy, which takes a while

    log = read_logs(
        [files.imu, files.gnss],
        dict(files.columns),
        files.axes if files.axes_stated else (),
        files.vehicle,
        lever_arm=files.lever_arm,
        latency=files.latency,
    )
    if files.calibration is not None:
        if not files.axes_stated:
            raise MissionError(
                f"{files.path}: calibration is in the axes of the IMU; accepted is axes = [...] beside "
                "it, which says "
                "which of them point forward, right and down"
            )
        log = read_calibration(files.calibration).applied(log, axes_matrix(files.axes))
    others = [path.name for path in files.paths if path not in (files.imu, files.gnss, files.calibration)]
    if not others:
        return log
    remark = f"Not read beside files with other headings than the lab's: {', '.join(others)}."
    return replace(log, repairs=(*log.repairs, remark))


def is_log_folder(path: Path) -> bool:
    """Return whether a folder holds a log: its TOML, or the csv files of an IMU and a receiver.

    A TOML that cannot be read, such as a pipe, counts: the log is then reported as broken.
    """
    try:
        return os.path.lexists(path / DESCRIPTION_FILE) or all(
            (path / name).is_file() for name in ("imu.csv", "gnss.csv")
        )
    except (OSError, ValueError):
        return False


def is_log_toml(path: Path) -> bool:
    """Return whether a TOML file describes a log and not a flight: by its name, or by its keys.

    Raises
    ------
    MissionError
        If the file cannot be read.
    """
    if path.name == DESCRIPTION_FILE:
        return True
    values: Mapping[str, Any] = read_toml(path)
    return not {"recording", "flight"} & set(values) and bool(
        (KEYS - {"title", "description", "tags"}) & set(values)
    )
