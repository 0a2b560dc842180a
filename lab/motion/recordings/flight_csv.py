"""Flight csv: our own file of a flight, one named column per quantity, the unit in its name.

One header line, then one row per sample, cells separated by commas, ``.csv`` or ``.csv.gz``. The columns may
stand in any order; columns with other names are ignored. Lines starting with ``#`` may precede the header.
UTF-8, with or without byte order mark; line ends LF or CRLF. Cells are not quoted.
"""

from __future__ import annotations

import contextlib
import gzip
import os
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.atomic_file import atomic_file
from lab.base.files.bounds import (
    HEIGHTS,
    LATITUDES,
    LONGITUDES,
    MAX_DURATION,
    MAX_SPEED,
    MIN_SAMPLES,
    TIME_STAMPS,
)
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import Column, read_columns, read_duration
from lab.motion.recordings.recording import Recording
from lab.motion.recordings.units_check import check_units

COLUMNS = (
    Column("time_s", *TIME_STAMPS, 9),
    Column("latitude_deg", *LATITUDES, 12),
    Column("longitude_deg", *LONGITUDES, 12),
    Column("height_m", *HEIGHTS, 7),
    Column("velocity_north_m_s", -MAX_SPEED, MAX_SPEED, 8),
    Column("velocity_east_m_s", -MAX_SPEED, MAX_SPEED, 8),
    Column("velocity_down_m_s", -MAX_SPEED, MAX_SPEED, 8),
    Column("roll_deg", -360, 360, 9),
    Column("pitch_deg", -90, 90, 9),
    Column("yaw_deg", -360, 360, 9),
    Column("airspeed_m_s", -MAX_SPEED, MAX_SPEED, 6, required=False),
    Column("alpha_deg", -180, 180, 7, required=False),
    Column("beta_deg", -180, 180, 7, required=False),
)
"""All columns, in the order written."""


def read_flight_csv(path: str | os.PathLike[str]) -> Recording:
    """Read a flight csv.

    Parameters
    ----------
    path
        A ``.csv`` file, or a gzip-compressed ``.csv.gz``.

    Returns
    -------
    Recording
        The whole flight; a file with anything wrong in it is refused as a whole.

    Raises
    ------
    MissionError
        Naming file, row (the line number an editor shows) and column: if the file cannot be read or is too
        large, a column is missing, a cell is not a finite number within its limits, time does not increase,
        or numbers look like another unit (radians, knots).
    """
    path = Path(path)
    columns, table, first_line, _ = read_columns(path, COLUMNS)
    _check_time(path, table[:, 0], first_line)
    check_units(str(path), table)
    return _recording(columns, table)


def flight_duration(path: Path) -> float:
    """Return the time from the first sample of a flight csv to the last [s]; those between are not checked.

    Raises
    ------
    MissionError
        As of `read_flight_csv`, for the header and the times of these two samples.
    """
    return read_duration(path, COLUMNS, MIN_SAMPLES)


def write_flight_csv(path: str | os.PathLike[str], recording: Recording, head: str = "") -> None:
    """Write a flight csv, compressed if the name ends with ``.gz``; the file appears whole or not at all.

    The same recording and `head`, lines that begin with ``#``, give the same bytes. Precision: 1e-12° of
    position (0.1 µm), 0.1 µm of height, 10 nm/s of velocity, 1e-9° of attitude.

    Raises
    ------
    MissionError
        If the recording holds numbers that are not finite, or the file cannot be written.
    """
    path = Path(path)
    columns, table = _table(recording)
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise MissionError(
            f"{path}: not written: {columns[column].name} of sample {row} is {table[row, column]}; accepted "
            "are finite numbers"
        )
    try:
        with atomic_file(path) as file:
            compressed = path.suffix.lower() == ".gz"
            # No name and no time of day in the gzip header: the same flight gives the same bytes.
            out = gzip.GzipFile("", "wb", 9, file, mtime=0) if compressed else contextlib.nullcontext(file)
            with out as stream:
                stream.write(head.encode())
                _write_rows(cast(BinaryIO, stream), columns, table)
    except (OSError, ValueError) as error:
        raise MissionError(
            f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}"
        ) from error


def _table(recording: Recording) -> tuple[list[Column], FloatArray]:
    values: list[FloatArray | None] = [
        recording.time,
        np.degrees(recording.latitude),
        np.degrees(recording.longitude),
        recording.height,
        *recording.velocity_n.T,
        *np.degrees(recording.euler).T,
        recording.airspeed,
        None if recording.alpha is None else np.degrees(recording.alpha),
        None if recording.beta is None else np.degrees(recording.beta),
    ]
    present = [(column, value) for column, value in zip(COLUMNS, values, strict=True) if value is not None]
    return [column for column, _ in present], np.column_stack([value for _, value in present])


def _write_rows(out: BinaryIO, columns: list[Column], table: FloatArray) -> None:
    out.write((",".join(column.name for column in columns) + "\n").encode())
    form = ",".join(f"%.{column.decimals}f" for column in columns) + "\n"
    for start in range(0, len(table), 10_000):
        out.write("".join(form % tuple(row) for row in table[start : start + 10_000].tolist()).encode())


def _check_time(path: Path, time: FloatArray, first_line: int) -> None:
    if len(time) < MIN_SAMPLES:
        raise MissionError(
            f"{path}: the file ends after {len(time)} rows of samples; accepted are at least {MIN_SAMPLES}, "
            "for a smooth curve through them"
        )
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        row = int(back[0]) + 1
        word = "repeats" if time[row] == time[row - 1] else "runs backwards"
        raise MissionError(
            f"{path}, row {first_line + row}, column time_s: time {word}, from {time[row - 1]:.12g} to "
            f"{time[row]:.12g}; accepted is time that increases from row to row"
        )
    if time[-1] - time[0] > MAX_DURATION:
        row = int(np.argmax(time - time[0] > MAX_DURATION))
        raise MissionError(
            f"{path}, row {first_line + row}, column time_s: {time[row] - time[0]:.9g} s after the first "
            f"sample; accepted are flights up to {MAX_DURATION:g} s, with time in seconds"
        )


def _recording(columns: list[Column], table: FloatArray) -> Recording:
    optional = {column.name: table[:, i] for i, column in enumerate(columns) if not column.required}
    airspeed, alpha, beta = (optional.get(name) for name in ("airspeed_m_s", "alpha_deg", "beta_deg"))
    return Recording(
        time=table[:, 0],
        latitude=np.radians(table[:, 1]),
        longitude=np.radians(table[:, 2]),
        height=table[:, 3],
        velocity_n=table[:, 4:7],
        euler=np.radians(table[:, 7:10]),
        airspeed=airspeed,
        alpha=None if alpha is None else np.radians(alpha),
        beta=None if beta is None else np.radians(beta),
    )
