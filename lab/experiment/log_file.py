"""Log file: the file of a logger in place of a mission, for work that keeps nothing of it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.formats import reader_of
from lab.data.log.sensor_log import SensorLog
from lab.missions.catalogue import missions
from lab.missions.flight_import import any_log

PREFIX = "ins-lab-log-"
"""Prefix of the temporary folders."""
FLIGHT = "INS Lab flight csv"
"""Format of flights, which are missions as they are."""


def is_log_file(source: str | os.PathLike[str]) -> bool:
    """Return whether a source is the file of a logger, and no mission: no name, TOML file or flight csv."""
    path = Path(source)
    try:
        if not path.is_file() or path.suffix.lower() == ".toml" or os.fspath(source) in missions():
            return False
    except (OSError, ValueError):
        return False
    try:
        return reader_of(path).name != FLIGHT
    except MissionError:
        return True  # the bytes of a device, or nothing that is known: reading it says which


@contextmanager
def open_mission(source: str | os.PathLike[str]) -> Iterator[str]:
    """Yield the mission of a source: its name, or the folder of a log that was read from a file.

    The folder exists as long as this is open; `mission_name` returns the name of the file.

    Parameters
    ----------
    source
        A mission as `lab.missions.mission` takes it, or a file with an IMU and a GPS receiver of any format.

    Raises
    ------
    MissionError
        If the file cannot be read, or has not both.
    """
    if not is_log_file(source):
        yield os.fspath(source)
        return
    path = Path(source)
    with write_mission(any_log([path]), path.name) as folder:
        yield folder


@contextmanager
def write_mission(log: SensorLog, name: str) -> Iterator[str]:
    """Yield the mission of a log in a temporary folder; a message of it has its name in place of the folder.

    Raises
    ------
    MissionError
        As raised inside, with the name.
    """
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as outer:
        place = Path(outer) / name
        write_sensor_log(place, log, title=name)
        try:
            yield str(place)
        except MissionError as error:
            raise MissionError(str(error).replace(f"{outer}{os.sep}", "")) from error


def mission_name(mission: str) -> str:
    """Return the name of a mission for people: that of its file, if it is of a log in one."""
    return Path(mission).name if is_opened(mission) else mission


def is_opened(mission: str) -> bool:
    """Return whether a mission is one that `open_mission` or `write_mission` yields, which does not last."""
    return Path(mission).parent.name.startswith(PREFIX)
