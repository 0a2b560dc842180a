"""Fields: what readers of flight recordings say alike: sources of units, heights, one file for a flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lab.base.files.mission_error import MissionError
from lab.data.rebuild.raw_flight import ColumnUnit

OF_THE_FORMAT = "of the format"
NAMED = "named in the file"
GIVEN = "given by you"
SEA_LEVEL = (
    "The file gives heights above sea level, which are used as heights above the ellipsoid: the flight is "
    "too low or too high by the height of the geoid there (at most 107 m)."
)
"""The remark for files that have no other height."""


def one_file(paths: Sequence[Path], reader: str, fixed: Mapping[str, str] | None = None) -> Path:
    """Return the one file of a format that has one for a flight.

    Parameters
    ----------
    paths
        The files of a flight.
    reader
        Name of the format.
    fixed
        Units that are given, by column, where the format fixes its units.

    Raises
    ------
    MissionError
        If there are more, or a unit is given that the format fixes.
    """
    if len(paths) != 1:
        raise MissionError(
            f"{paths[1]}: a flight of {reader} is one file, and {len(paths)} are given; give one at a time"
        )
    if fixed:
        raise MissionError(
            f"{paths[0]}: {reader} fixes its units, so that of {next(iter(fixed))} cannot be given another"
        )
    return paths[0]


def units_of_the_format(units: Mapping[str, str]) -> tuple[ColumnUnit, ...]:
    """Return the columns of a format that fixes its units, each with its unit."""
    return tuple(ColumnUnit(name, unit, OF_THE_FORMAT) for name, unit in units.items())
