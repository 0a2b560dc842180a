"""Sensor log files: a folder with the csv files of an IMU and a GPS receiver, and a small TOML about them.

``imu.csv``: ``t_s``, then angular rate ``gx_rad_s, gy_rad_s, gz_rad_s`` (or ``gx_deg_s …``) and specific
force ``fx_m_s2, fy_m_s2, fz_m_s2`` (or ``fx_g …``), mean over the interval that ends with the stamp; or
their integrals over it, ``dtheta_x_rad …`` and ``dvelocity_x_m_s …``. ``gnss.csv``: ``t_s, lat_deg, lon_deg,
alt_m``, and what the receiver has of ``vn_m_s, ve_m_s, vd_m_s`` and of its σ ``sd_n_m, sd_e_m, sd_d_m,
sd_vn_m_s, sd_ve_m_s, sd_vd_m_s``. ``ref.csv``, where there is one: ``t_s, lat_deg, lon_deg, alt_m``, and what
is known of ``vn_m_s …`` and ``roll_deg, pitch_deg, heading_deg``. Of what need not be there, an empty cell is
not known. All three are stamped by one clock. Heights
are above the ellipsoid, or all above the same other surface. The TOML, ``log.toml`` in the folder, may
leave out every key; a folder without it is read with these defaults::

    title = "Drive to work"
    description = "..."
    tags = ["car", "city"]
    imu = "imu.csv"               # files in the same folder
    gnss = "gnss.csv"
    reference = "ref.csv"         # taken where it exists
    axes = ["x", "y", "z"]        # which axes of the IMU point forward, right, down; "-y" for its opposite
    lever_arm_m = [0, 0, 0]       # from the IMU to the antenna: forward, right, down
    latency_s = 0                 # by how much the stamps of the fixes are late
"""

from __future__ import annotations

import difflib
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.earth import STANDARD_GRAVITY
from lab.missions.errors import MissionError
from lab.missions.log_check import check_log
from lab.missions.mission import check_tags, file_beside, read_toml
from lab.missions.named_columns import Column, read_columns
from lab.missions.sensor_log import GnssLog, Reference, SensorLog, repaired

FloatArray = NDArray[np.float64]

DESCRIPTION_FILE = "log.toml"
"""Name of the TOML file in the folder of a log."""
MAX_DURATION = 86_400.0
"""Longest log accepted [s]."""
MIN_ROWS = 10
"""Fewest rows of the IMU accepted."""

_TIME = Column("t_s", -1e10, 1e10)
_GYRO = (("gx_rad_s", "gy_rad_s", "gz_rad_s"), ("gx_deg_s", "gy_deg_s", "gz_deg_s"))
_FORCE = (("fx_m_s2", "fy_m_s2", "fz_m_s2"), ("fx_g", "fy_g", "fz_g"))
_INCREMENTS = (
    ("dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad"),
    ("dvelocity_x_m_s", "dvelocity_y_m_s", "dvelocity_z_m_s"),
)
_IMU = (
    _TIME,
    *(Column(name, -1e6, 1e6, required=False) for names in (*_GYRO, *_FORCE, *_INCREMENTS) for name in names),
)
_POSITION = (
    _TIME,
    Column("lat_deg", -90, 90),
    Column("lon_deg", -360, 360),
    Column("alt_m", -1000, 100_000),
)
_VELOCITY = tuple(
    Column(name, -1000, 1000, required=False, may_be_empty=True) for name in ("vn_m_s", "ve_m_s", "vd_m_s")
)
_SIGMA = tuple(
    Column(name, 1e-6, 1e6, required=False, may_be_empty=True)
    for name in ("sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
)
_ATTITUDE = tuple(
    Column(name, -360, 360, required=False, may_be_empty=True)
    for name in ("roll_deg", "pitch_deg", "heading_deg")
)
_TEXTS = ("title", "description", "imu", "gnss", "reference")
_KEYS = (*_TEXTS, "tags", "axes", "lever_arm_m", "latency_s")
KEYS = frozenset(_KEYS)
"""Keys of the TOML."""


@dataclass(frozen=True)
class LogFiles:
    """The files of a log, and what its TOML says about them; nothing is read yet.

    Attributes
    ----------
    path : Path
        The folder, or the TOML file.
    imu, gnss : Path
        The csv files.
    reference : Path or None
        Csv file of the reference, where there is one.
    title, description : str
        For people.
    tags : tuple of str
        Words to find it by.
    axes : tuple of str
        Which axes of the IMU point forward, right, down.
    lever_arm : tuple of float
        From the IMU to the antenna, in b [m].
    latency : float
        By how much the stamps of the fixes are late [s].
    """

    path: Path
    imu: Path
    gnss: Path
    reference: Path | None
    title: str
    description: str
    tags: tuple[str, ...]
    axes: tuple[str, str, str]
    lever_arm: tuple[float, float, float]
    latency: float

    @property
    def paths(self) -> list[Path]:
        """All files there are."""
        return [path for path in (self.imu, self.gnss, self.reference) if path is not None]

    def read(self) -> SensorLog:
        """Read the log.

        Raises
        ------
        MissionError
            Naming file, row and column where there is one: if a file cannot be read, a column is missing or
            there in two units, a cell is not a finite number within its limits, time runs backwards, the
            files do not overlap in time, the IMU has a gap that is too long, or the numbers contradict the
            units, axes or clock they claim.
        """
        time, samples, increments = self._read_imu()
        reference = None if self.reference is None else self._read_reference(self.reference)
        log = repaired(str(self.path), time, samples, self._read_gnss(), reference, increments=increments)
        check_log(log)
        return log

    def _read_imu(self) -> tuple[FloatArray, FloatArray, bool]:
        table, _ = _read(self.imu, _IMU)
        if len(table["t_s"]) < MIN_ROWS:
            raise MissionError(f"{self.imu}: {len(table['t_s'])} rows; accepted are at least {MIN_ROWS}")
        present = [name for name in (*_INCREMENTS[0], *_INCREMENTS[1]) if name in table]
        rates = [name for group in (*_GYRO, *_FORCE) for name in group if name in table]
        if present and rates:
            raise MissionError(
                f"{self.imu}: has both increments ({present[0]}) and rates ({rates[0]}); accepted are either"
            )
        if present:
            gyro, force = _one_of(self.imu, table, _INCREMENTS[:1]), _one_of(self.imu, table, _INCREMENTS[1:])
        else:
            gyro, force = _one_of(self.imu, table, _GYRO), _one_of(self.imu, table, _FORCE)
            if "gx_deg_s" in table:
                gyro = np.radians(gyro)
            if "fx_g" in table:
                force = force * STANDARD_GRAVITY
        C = _axes_matrix(self.path, self.axes)
        return table["t_s"], np.concatenate((gyro @ C.T, force @ C.T), axis=1), bool(present)

    def _read_gnss(self) -> GnssLog:
        table, rows = _read(self.gnss, (*_POSITION, *_VELOCITY, *_SIGMA))
        return GnssLog(
            time=table["t_s"],
            position=_geodetic(table),
            velocity_n=_columns(table, _VELOCITY, rows),
            position_sigma=_columns(table, _SIGMA[:3], rows),
            velocity_sigma=_columns(table, _SIGMA[3:], rows),
            lever_arm=np.array(self.lever_arm, dtype=np.float64),
            latency=self.latency,
        )

    @staticmethod
    def _read_reference(path: Path) -> Reference:
        table, rows = _read(path, (*_POSITION, *_VELOCITY, *_ATTITUDE))
        time = table["t_s"]
        if rows < 2 or (np.diff(time) <= 0).any():
            raise MissionError(f"{path}, column t_s: accepted are at least two rows and time that increases")
        velocity_n, euler = _columns(table, _VELOCITY, rows), _columns(table, _ATTITUDE, rows)
        return Reference(time, _geodetic(table), velocity_n, np.radians(euler))


def log_files(path: str | os.PathLike[str]) -> LogFiles:
    """Return the files of a log.

    Parameters
    ----------
    path
        A folder, with or without ``log.toml`` in it, or a TOML file of any name beside the csv files.

    Raises
    ------
    MissionError
        If the TOML cannot be read or has a key or value that is not accepted, or a file does not exist.
    """
    path = Path(path)
    described = path / DESCRIPTION_FILE if path.is_dir() else path
    values = read_toml(described) if described.is_file() or not path.is_dir() else {}
    _check(described, values)
    imu, gnss = (file_beside(described, key, values.get(key, f"{key}.csv")) for key in ("imu", "gnss"))
    reference = file_beside(described, "reference", values.get("reference", "ref.csv"))
    wanted = [imu, gnss] + ([reference] if "reference" in values else [])
    for file in wanted:
        if not file.is_file():
            raise MissionError(
                f"{file}: there is no such file; a log is a folder with imu.csv and gnss.csv, or a TOML that "
                "names them"
            )
    return LogFiles(
        path=path,
        imu=imu,
        gnss=gnss,
        reference=reference if reference.is_file() else None,
        title=values.get("title", described.parent.name if described.stem == "log" else described.stem),
        description=values.get("description", ""),
        tags=tuple(values.get("tags", ())),
        axes=tuple(values.get("axes", ("x", "y", "z"))),
        lever_arm=tuple(values.get("lever_arm_m", (0.0, 0.0, 0.0))),
        latency=float(values.get("latency_s", 0.0)),
    )


def read_sensor_log(path: str | os.PathLike[str]) -> SensorLog:
    """Read a log from its folder or its TOML file; see `log_files` and `LogFiles.read`."""
    return log_files(path).read()


def _read(path: Path, accepted: tuple[Column, ...]) -> tuple[dict[str, FloatArray], int]:
    columns, table, first_line = read_columns(path, accepted)
    if len(table) and table[:, 0].max() - table[:, 0].min() > MAX_DURATION:
        raise MissionError(
            f"{path}, from row {first_line}, column t_s: more than {MAX_DURATION:g} s from the first to the "
            "last row; accepted are shorter logs, with time in seconds"
        )
    return {column.name: table[:, i] for i, column in enumerate(columns)}, len(table)


def _one_of(path: Path, table: dict[str, FloatArray], groups: tuple[tuple[str, str, str], ...]) -> FloatArray:
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


def _columns(table: dict[str, FloatArray], columns: tuple[Column, ...], rows: int) -> FloatArray:
    """Return columns (n, 3), NaN for those that are not there."""
    return np.stack([table.get(column.name, np.full(rows, np.nan)) for column in columns], axis=-1)


def _geodetic(table: dict[str, FloatArray]) -> FloatArray:
    return np.stack((np.radians(table["lat_deg"]), np.radians(table["lon_deg"]), table["alt_m"]), axis=-1)


def _axes_matrix(path: Path, axes: tuple[str, ...]) -> FloatArray:
    """Return the matrix that takes vectors in the axes of the IMU to forward, right, down."""
    C = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        C[row, "xyz".index(axis[-1])] = -1 if axis.startswith("-") else 1
    if np.linalg.det(C) < 0.5:
        raise MissionError(
            f"{path}: axes = {list(axes)} are not a right-handed set; accepted are three different axes such "
            'as ["y", "x", "-z"] for an IMU with x right, y forward, z up'
        )
    return C


def _check(path: Path, values: dict[str, Any]) -> None:
    for key in values:
        if key not in _KEYS:
            close = difflib.get_close_matches(key, _KEYS, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise MissionError(f"{path}: there is no key {key!r}.{hint} Accepted: {', '.join(_KEYS)}")
    for key in _TEXTS:
        if not isinstance(values.get(key, ""), str):
            raise MissionError(f"{path}: {key} = {values[key]!r}; accepted is text in quotes")
    check_tags(path, values)
    axes = values.get("axes", ["x", "y", "z"])
    known = {"x", "y", "z", "-x", "-y", "-z"}
    if not (
        isinstance(axes, list) and len(axes) == 3 and all(isinstance(a, str) and a in known for a in axes)
    ):
        raise MissionError(f'{path}: axes = {axes!r}; accepted are three of "x", "-x", "y", "-y", "z", "-z"')
    arm = values.get("lever_arm_m", [0, 0, 0])
    if not (isinstance(arm, list) and len(arm) == 3 and all(_within(a, 100) for a in arm)):
        raise MissionError(f"{path}: lever_arm_m = {arm!r}; accepted are three numbers from -100 to 100")
    latency = values.get("latency_s", 0)
    if not _within(latency, 5):
        raise MissionError(f"{path}: latency_s = {latency!r}; accepted is a number from -5 to 5")


def _within(value: Any, limit: float) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value) and abs(value) <= limit
