"""Log TOML: the keys of ``log.toml`` and their checks; `lab.data.files.sensor_log_csv` shows an example."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.base.aid_table import SERIES
from lab.base.files.description_toml import check_keys
from lab.base.files.mission_error import MissionError
from lab.data.log.sensor_log import MAX_LEVER_ARM
from lab.data.log.vehicle import VEHICLES

DESCRIPTION_FILE = "log.toml"
"""Name of the TOML file in the folder of a log."""

_FILES = ("imu", "gnss", "reference", "magnetometer", *(aid.name for aid in SERIES), "heading", "calibration")
_TEXTS = ("title", "description", *_FILES, "vehicle")
_KEYS = (
    *_TEXTS, "tags", "axes", "mounting_deg", "lever_arm_m", "latency_s", "declination_deg", "comparisons",
    "columns", "forward_assumed", "check_sensors",
)  # fmt: skip
KEYS = frozenset(_KEYS)
"""Keys of the TOML."""

_MAX_COMPARISONS = 8
"""Most other solutions: each is a curve of its own in the plots."""
MAX_LATENCY = 5.0
"""Largest latency of the fixes that may be stated [s]: more than the clock offsets that the check finds (3
s)."""


def check_values(path: Path, values: Mapping[str, Any]) -> None:
    """Refuse a key or a value that is not accepted.

    Parameters
    ----------
    path
        The TOML file, for messages.
    values
        Content of the file.

    Raises
    ------
    MissionError
        Naming the key, and what is accepted.
    """
    check_keys(path, values, _KEYS, _TEXTS)
    vehicle = values.get("vehicle", "")
    if vehicle not in ("", *VEHICLES):
        raise MissionError(f"{path}: vehicle = {vehicle!r}; accepted are {', '.join(VEHICLES)}")
    for key in ("forward_assumed", "check_sensors"):
        if not isinstance(values.get(key, False), bool):
            raise MissionError(f"{path}: {key} = {values[key]!r}; accepted are true and false")
    _check_axes(path, values.get("axes", ["x", "y", "z"]))
    for key, limit in (("mounting_deg", 360.0), ("lever_arm_m", MAX_LEVER_ARM)):
        _check_three(path, key, values.get(key, [0, 0, 0]), limit)
    for key, limit in (("latency_s", MAX_LATENCY), ("declination_deg", 180.0)):
        if not _is_within(values.get(key, 0), limit):
            raise MissionError(
                f"{path}: {key} = {values[key]!r}; accepted is a number from {-limit:g} to {limit:g}"
            )
    _check_comparisons(path, values.get("comparisons", {}))
    columns = values.get("columns", {})
    if not isinstance(columns, Mapping) or not all(isinstance(text, str) for text in columns.values()):
        raise MissionError(
            f"{path}: columns = {columns!r}; accepted is a table of headings, each with what the column "
            'is, such as A1 = "force_x[g]"'
        )


def _check_axes(path: Path, axes: Any) -> None:
    known = {"x", "y", "z", "-x", "-y", "-z"}
    if not (
        isinstance(axes, list) and len(axes) == 3 and all(isinstance(a, str) and a in known for a in axes)
    ):
        raise MissionError(f'{path}: axes = {axes!r}; accepted are three of "x", "-x", "y", "-y", "z", "-z"')


def _check_three(path: Path, key: str, numbers: Any, limit: float) -> None:
    if not (isinstance(numbers, list) and len(numbers) == 3 and all(_is_within(a, limit) for a in numbers)):
        raise MissionError(
            f"{path}: {key} = {numbers!r}; accepted are three numbers from {-limit:g} to {limit:g}"
        )


def _check_comparisons(path: Path, table: Any) -> None:
    fine = isinstance(table, Mapping) and all(isinstance(name, str) for name in table.values())
    if not fine or len(table) > _MAX_COMPARISONS or not all(name.strip() for name in table):
        raise MissionError(
            f"{path}: comparisons = {table!r}; accepted is a table of up to {_MAX_COMPARISONS} names, each "
            'with a file, such as "PX4 EKF2" = "ekf.csv"'
        )


def _is_within(value: Any, limit: float) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value) and abs(value) <= limit
