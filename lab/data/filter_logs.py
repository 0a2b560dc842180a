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
    accepted = f"{', '.join(kind.name for kind in KINDS)} with headings such as {filter_csv.HEADINGS}"
    try:
        known = reader_of(path).name
    except MissionError as error:  # with advice on columns, which have no place here
        if not filter_csv.is_table(head):
            raise
        raise MissionError(
            f"{path}: no heading is that of an innovation's σ; accepted: {accepted}"
        ) from error
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
