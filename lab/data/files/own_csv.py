"""Own csv: the lab's flight csv as one of the formats, read as strictly as elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.data.files.fields import NAMED, one_file
from lab.data.rebuild.raw_flight import ColumnUnit, RawFlight
from lab.motion.recordings.flight_csv import COLUMNS, read_flight_csv

NAME = "INS Lab flight csv"

_NAMES = frozenset(column.name for column in COLUMNS if column.required)
_UNITS = {"s": "s", "deg": "°", "m": "m", "m_s": "m/s"}


def recognises(head: bytes) -> bool:
    """Return whether a file begins with remarks and a header with all columns that ours must have.

    Other programs use some of the names: such a file is a csv with named columns.
    """
    for line in head.decode("utf-8", "replace").splitlines():
        if line.strip() and not line.lstrip("\ufeff").startswith("#"):
            return _NAMES.issubset(map(str.strip, line.lstrip("\ufeff").replace(";", ",").split(",")))
    return False


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a flight csv.

    Raises
    ------
    MissionError
        For whatever is wrong with the file, or if units are given: the columns name theirs.
    """
    path = one_file(paths, NAME)
    if units:
        raise MissionError(
            f"{path}: a unit is given for {next(iter(units))}; the columns of {NAME} have the units in their "
            "names, and no others are accepted"
        )
    recording = read_flight_csv(path)
    return RawFlight(
        format=NAME,
        **{one.name: getattr(recording, one.name) for one in fields(recording)},
        rows_read=len(recording.time),
        units=tuple(
            ColumnUnit(column.name, _unit(column.name), NAMED)
            for column in COLUMNS
            if column.required or getattr(recording, column.name.split("_")[0]) is not None
        ),
    )


def _unit(column: str) -> str:
    return _UNITS["m_s" if column.endswith("_m_s") else column.rpartition("_")[2]]
