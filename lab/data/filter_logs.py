"""Filter logs: what a filter that is not ours says of itself, of any format that holds it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lab.base.files.mission_error import MissionError
from lab.data.files import ardupilot, ardupilot_estimator, filter_csv, px4_estimator, ulog
from lab.data.formats import read_log_of, reader_of, start_of
from lab.data.log.filter_log import FilterLog
from lab.data.log.sensor_log import SensorLog


class _Kind(NamedTuple):
    """A format that holds a filter's innovations."""

    name: str
    recognises: Callable[[bytes], bool]
    read: Callable[[Path], FilterLog]


KINDS = (
    _Kind(f"{ulog.NAME} ({px4_estimator.NAME})", ulog.recognises, px4_estimator.read),
    _Kind(f"{ardupilot.NAME} (EKF2, EKF3)", ardupilot.recognises, ardupilot_estimator.read),
    _Kind(filter_csv.NAME, filter_csv.recognises, filter_csv.read),
)
"""The formats; at most one recognises a file."""


def read_filter_log(path: Path) -> FilterLog:
    """Return what the filter in a file says of itself.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    MissionError
        If the file cannot be read, or its format holds no innovations.
    """
    head = start_of(path)
    for kind in KINDS:
        if kind.recognises(head):
            return kind.read(path)
    known = reader_of(path).name  # which refuses a file of an unknown format, with advice
    accepted = ", ".join(kind.name for kind in KINDS)
    raise MissionError(
        f"{path}: is {known}, which holds no innovations of a filter, so that no filter can be judged; "
        f"accepted: {accepted}"
    )


def sensors_beside(path: Path) -> SensorLog | str:
    """Return the IMU and the fixes in the same file; why there are none, if so."""
    try:
        return read_log_of(reader_of(path), path)
    except MissionError as error:
        return str(error)
