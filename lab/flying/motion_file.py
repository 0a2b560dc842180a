"""Motion file: the motion definition csv of gnss-ins-sim, read as a `MotionPlan`.

Two header lines, each followed by numbers: the start (latitude, longitude in degrees, height in m, velocity
along the body's axes in m/s, yaw, pitch, roll in degrees), then one command per row: type, yaw, pitch, roll,
velocity along the body's axes, longest time in s, GPS visibility. The last column is ignored where it is
headed "reserved", as in older files.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.flying.motion_commands import MAX_COMMANDS, MotionPlan

MAX_BYTES = 2**22
"""Largest file accepted [bytes]."""

_MIN_LINES = 4
"""Fewest lines: two headers, the start and a command."""
_START = (
    "latitude_deg", "longitude_deg", "height_m", "forward_m_s", "right_m_s", "down_m_s",
    "yaw_deg", "pitch_deg", "roll_deg",
)  # fmt: skip
_COMMAND = ("type", "yaw", "pitch", "roll", "forward", "right", "down", "seconds", "gps")


def is_motion_file(head: bytes) -> bool:
    """Return whether the beginning of a file is that of a motion definition; never raises."""
    lines = head.decode("utf-8", "replace").lstrip("\ufeff").splitlines()
    heads = [line.lower().replace(" ", "") for line in lines[:1] + lines[2:3]]
    return len(heads) == 2 and heads[0].startswith("inilat") and heads[1].startswith("commandtype")


def read_motion_file(path: Path) -> MotionPlan:
    """Read a motion definition.

    Raises
    ------
    MissionError
        Naming file, line and value: if the file cannot be read, or a number is missing or not accepted.
    """
    try:
        check_file(path, MAX_BYTES)
        text = path.read_bytes().decode("utf-8-sig")
        rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text))]
    except (OSError, ValueError, csv.Error) as error:
        if isinstance(error, MissionError):
            raise
        raise MissionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not is_motion_file(text.encode()) or len(rows) < _MIN_LINES:
        raise MissionError(
            f"{path}: is not a motion definition; accepted are a header line that begins with 'ini lat', a "
            "line of 9 numbers, a header line that begins with 'command type', and a line of 9 numbers per "
            "command"
        )
    start = _numbers(path, 2, rows[1], _START)
    has_gps = any("visib" in cell.lower() for cell in rows[2])
    commands: list[dict[str, Any]] = []
    for line, row in enumerate(rows[3:], 4):
        if not any(row):
            continue
        if len(commands) == MAX_COMMANDS:
            raise MissionError(f"{path}, line {line}: accepted are up to {MAX_COMMANDS} commands")
        command: dict[str, Any] = _numbers(path, line, row, _COMMAND)
        for key in ("type", "gps"):
            command[key] = int(command[key]) if command[key].is_integer() else command[key]
        commands.append(command if has_gps else {key: command[key] for key in _COMMAND[:-1]})
    return MotionPlan.from_dict({"start": start, "commands": commands}, str(path))


def _numbers(path: Path, line: int, row: list[str], names: tuple[str, ...]) -> dict[str, float]:
    cells = row[: len(names)]
    if len(cells) < len(names):
        raise MissionError(f"{path}, line {line}: {len(cells)} numbers; accepted are {len(names)}")
    values: dict[str, float] = {}
    for name, cell in zip(names, cells, strict=True):
        try:
            values[name] = float(cell)
        except ValueError:
            raise MissionError(f"{path}, line {line}: {name} = {cell!r}; accepted is a number") from None
    return values
