"""Log columns: the columns of the csv files of a sensor log, with the numbers that they may hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.aid_table import AIDS
from lab.base.arrays import FloatArray
from lab.base.files.bounds import HEIGHTS, LATITUDES, LONGITUDES, MAX_SPEED, TIME_STAMPS
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import Column
from lab.data.log.sensor_log import SIGMAS

_MAX_IMU = 1e6
"""Largest number of an IMU, whatever its unit: damaged cells lie beyond it. `lab.data.checks.log_check`
judges units."""
_MAX_FIELD = 1e4
"""Largest component of a magnetic field [µT]: two hundred times the Earth's."""
_FULL_TURN = 360.0
"""Largest angle [°]."""
_MIN_HEADING_SIGMA = 1e-3
"""Smallest σ of a heading [°]: far below what two antennas a metre apart give (0.2°)."""
TIME = Column("t_s", *TIME_STAMPS)
"""Time stamps [s], of each file."""
GYRO = (("gx_rad_s", "gy_rad_s", "gz_rad_s"), ("gx_deg_s", "gy_deg_s", "gz_deg_s"))
"""Columns of angular rates, in either unit."""
FORCE = (("fx_m_s2", "fy_m_s2", "fz_m_s2"), ("fx_g", "fy_g", "fz_g"))
"""Columns of specific force, in either unit."""
INCREMENTS = (
    ("dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad"),
    ("dvelocity_x_m_s", "dvelocity_y_m_s", "dvelocity_z_m_s"),
)
"""Columns of angle increments, and of velocity increments."""
IMU = (
    TIME,
    *(
        Column(name, -_MAX_IMU, _MAX_IMU, required=False)
        for names in (*GYRO, *FORCE, *INCREMENTS)
        for name in names
    ),
)
"""All columns of ``imu.csv``."""
POSITION = (
    Column("lat_deg", *LATITUDES),
    Column("lon_deg", *LONGITUDES),
    Column("alt_m", *HEIGHTS),
)
"""Position of a fix."""
ESSENTIAL = {column.name for column in (*IMU[1:], *POSITION)}
"""Columns in which an empty cell drops the sample or the fix."""
VELOCITY = tuple(
    Column(name, -MAX_SPEED, MAX_SPEED, required=False, may_be_empty=True)
    for name in ("vn_m_s", "ve_m_s", "vd_m_s")
)
"""Velocity of a fix."""
SIGMA = tuple(
    Column(name, *SIGMAS, required=False, may_be_empty=True)
    for name in ("sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
)
"""σ of position and velocity of a fix."""
HEADING = (
    next(aid.column for aid in AIDS if aid.name == "heading"),
    Column("sd_heading_deg", _MIN_HEADING_SIGMA, _FULL_TURN, required=False, may_be_empty=True),
)
"""Heading of two antennas with its σ."""
ATTITUDE = tuple(
    Column(name, -_FULL_TURN, _FULL_TURN, required=False, may_be_empty=True)
    for name in ("roll_deg", "pitch_deg", "heading_deg")
)
"""Attitude of a reference, or of another estimator."""
PLACE_IF_KNOWN = tuple(replace(column, required=False, may_be_empty=True) for column in POSITION)
"""Position of such a solution, which may have gaps."""
FIELD = tuple(
    Column(name, -_MAX_FIELD, _MAX_FIELD, may_be_empty=True) for name in ("mx_uT", "my_uT", "mz_uT")
)
"""Magnetic field along the axes of the IMU."""


def choose_group(
    path: Path, table: dict[str, FloatArray], groups: tuple[tuple[str, str, str], ...]
) -> FloatArray:
    """Return the one group of three columns that is there."""
    started = [group for group in groups if any(name in table for name in group)]
    choices = " or ".join(", ".join(group) for group in groups)
    if len(started) > 1:
        raise MissionError(
            f"{path}: {started[0][0]} and {started[1][0]} are the same in two units; {choices}"
        )
    missing = [name for name in (started or groups)[0] if name not in table]
    if missing:
        raise MissionError(f"{path}: column {', '.join(missing)} missing in the header; accepted: {choices}")
    return np.stack([table[name] for name in started[0]], axis=-1)


def columns_or_nan(table: dict[str, FloatArray], columns: tuple[Column, ...], rows: int) -> FloatArray:
    """Return columns (n, 3), NaN for those that are not there."""
    return np.stack([table.get(column.name, np.full(rows, np.nan)) for column in columns], axis=-1)


def geodetic(table: dict[str, FloatArray], rows: int) -> FloatArray:
    """Return latitude, longitude [rad], height [m] (n, 3), NaN in rows that lack one of them."""
    place = columns_or_nan(table, POSITION, rows)
    place[np.isnan(place).any(axis=1)] = np.nan
    return np.column_stack((np.radians(place[:, :2]), place[:, 2]))
