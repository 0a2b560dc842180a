"""Typical: the assumed values of numbers that a card lacks, by the grade of the sensor.

The table is ``assumed.toml`` in this folder: every number with its unit and its source.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

from lab.base.parameters.settings import Settings
from lab.base.parameters.toml_file import read_toml
from lab.sensors.datum import Datum, read_sources, read_terms
from lab.sensors.imu_errors import AccelerometerErrors, GyroErrors

TABLE = Path(__file__).with_name("assumed.toml")
"""The table of typical values."""
GROUPS: dict[str, type[Settings]] = {"gyro": GyroErrors, "accelerometer": AccelerometerErrors}
"""The triads, and the classes that declare their settings."""

Terms = Mapping[str, Mapping[str, Datum]]


@functools.cache
def grades() -> Mapping[str, Terms]:
    """Return the typical values by grade, triad and name of the setting.

    Raises
    ------
    SettingError
        If the table is not accepted.
    """
    tables = read_toml(TABLE)
    return {grade: _terms(f"{TABLE}, {grade}", table) for grade, table in tables.items()}


def typical(grade: str) -> Terms:
    """Return the typical values of a grade; none for grades that the table lacks, such as own sensors."""
    return grades().get(grade, {})


def _terms(where: str, table: Mapping[str, Mapping[str, object]]) -> Terms:
    sources = read_sources(where, table)
    return {
        triad: read_terms(f"{where}, {triad}", declared(), table.get(triad, {}), sources)
        for triad, declared in GROUPS.items()
    }
