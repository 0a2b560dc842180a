"""Sensor log csv: a folder with the csv files of an IMU and a GPS receiver, and a TOML that describes them.

``imu.csv``: ``t_s``, then angular rate ``gx_rad_s, gy_rad_s, gz_rad_s`` (or ``gx_deg_s …``) and specific
force ``fx_m_s2, fy_m_s2, fz_m_s2`` (or ``fx_g …``), mean over the interval that ends with the stamp; or
their integrals over it, ``dtheta_x_rad …`` and ``dvelocity_x_m_s …``. ``gnss.csv``: ``t_s, lat_deg,
lon_deg, alt_m``, and those that the receiver has of ``vn_m_s, ve_m_s, vd_m_s`` and of its σ ``sd_n_m,
sd_e_m, sd_d_m, sd_vn_m_s, sd_ve_m_s, sd_vd_m_s``; with two antennas also ``heading_deg, sd_heading_deg``.
``ref.csv``, where there is one: ``t_s`` and those of the columns ``lat_deg, lon_deg, alt_m``, ``vn_m_s
…`` and ``roll_deg, pitch_deg, heading_deg``. ``mag.csv``, where there is one: ``t_s, mx_uT, my_uT,
mz_uT``, in the axes of the IMU. ``baro.csv``, where there is one: ``t_s, height_m``, by pressure;
``odo.csv``: ``t_s, speed_m_s``, forward; ``air.csv``: ``t_s, airspeed_m_s``, true airspeed;
``heading.csv``: ``t_s, heading_deg``, true, and ``sd_heading_deg`` where it is known, in place of the
headings in ``gnss.csv``. An empty cell of an optional column is unknown; one of a sample of the IMU or of
a position drops the sample or the fix. All files are stamped by one clock, which ``--from``, ``--to`` and
outages refer to as well. Heights are above the ellipsoid, or all above the same other surface. The TOML,
``log.toml`` in the folder, may leave out every key; the defaults are as here, unless noted::

    title = "Drive to work"
    description = "..."
    tags = ["car", "city"]
    imu = "imu.csv"               # files in the same folder
    gnss = "gnss.csv"
    reference = "ref.csv"         # taken where it exists
    magnetometer = "mag.csv"      # taken where it exists
    barometer = "baro.csv"        # taken where it exists
    odometer = "odo.csv"          # taken where it exists
    airspeed = "air.csv"          # taken where it exists
    heading = "heading.csv"       # taken where it exists
    vehicle = "car"               # left out: unknown; aeroplane, car, boat, copter, pedestrian, ...
    axes = ["x", "y", "z"]        # which axes of the IMU point forward, right, down; "-y" for its opposite
    forward_assumed = false       # true: which one points forward is only assumed (docs/logs.md)
    check_sensors = true          # false: readings of other sensors that contradict GPS or gyros are kept
    mounting_deg = [0, 0, 0]      # roll, pitch, yaw of these axes in the vehicle
    calibration = "cal.toml"      # left out: none; a file of ins-lab calibrate, in the axes of the IMU
    lever_arm_m = [0, 0, 0]       # from the IMU to the antenna: forward, right, down
    latency_s = 0                 # by how much the stamps of the fixes are late
    declination_deg = 11.5        # of the magnetic field, east; left out: of the World Magnetic Model
    [columns]                     # of files with other headings (docs/logs.md): what a column is
    A1 = "force_x[g]"
    [comparisons]                 # solutions of other estimators, to compare with: as ref.csv
    "PX4 EKF2" = "ekf.csv"
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lab.base.aid_table import AIDS, SERIES
from lab.base.arrays import FloatArray
from lab.base.files.bounds import MAX_DURATION
from lab.base.files.description_toml import file_in_same_folder, read_toml
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES, MAX_HEADER_LINE, Column, read_columns, read_duration
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.auxiliary_check import check_auxiliary
from lab.data.checks.imu_axes import axes_matrix
from lab.data.files.log_columns import (
    ATTITUDE,
    ESSENTIAL,
    FIELD,
    FORCE,
    GYRO,
    HEADING,
    IMU,
    INCREMENTS,
    PLACE_IF_KNOWN,
    POSITION,
    SIGMA,
    TIME,
    VELOCITY,
    choose_group,
    columns_or_nan,
    geodetic,
)
from lab.data.files.log_toml import DESCRIPTION_FILE, check_values
from lab.data.log.auxiliary_data import (
    AuxiliaryData,
    Comparison,
    Headings,
    Magnetometer,
    Reference,
    Series,
)
from lab.data.log.calibration import read_calibration
from lab.data.log.sensor_log import MIN_IMU_SAMPLES, GnssLog, SensorLog, repair_log
from lab.motion.frames.rotation import C_nb_from_euler

_MAX_EMPTY_IMU = 0.1
"""Largest share of rows of the IMU with empty cells: loggers lose less than a percent; in files in which rows
of gyros and accelerometers alternate, all rows have some."""
_MAX_EMPTY_FIXES = 0.5
"""Largest share of rows without a position in ``gnss.csv``: a receiver may need half of a short log for its
first fix."""


@dataclass(frozen=True)
class LogFiles:
    """The files of a log and the keys of its TOML; no csv file is read yet.

    Attributes
    ----------
    path : Path
        The folder, or the TOML file.
    imu, gnss : Path
        The csv files.
    reference, magnetometer, heading : Path or None
        Csv files of the reference and of these sensors, if there are any.
    series : dict of Path
        Csv files of the other sensors, by the names of the aid table.
    comparisons : tuple of (str, Path)
        Names and csv files of other solutions.
    title, description : str
        For people.
    tags : tuple of str
        Words to find it by.
    vehicle : str
        The vehicle; empty if the TOML does not state it.
    axes : tuple of str
        Which axes of the IMU point forward, right, down.
    mounting : tuple of float
        Roll, pitch, yaw of these axes in the vehicle [°].
    lever_arm : tuple of float
        From the IMU to the antenna, in b [m].
    latency : float
        By how much the stamps of the fixes are late [s].
    declination : float
        Of the magnetic field, positive east [°]; NaN if the TOML does not state it.
    columns : tuple of (str, str)
        Headings of columns with other names, and what the TOML says of them.
    axes_stated : bool
        Whether the TOML states the axes.
    forward_assumed : bool
        Whether it is only assumed which axis points forward.
    check_sensors : bool
        Whether readings of sensors besides IMU and GPS that contradict these are refused.
    calibration : Path or None
        The file with the constant errors of the device, which are removed.
    """

    path: Path
    imu: Path
    gnss: Path
    reference: Path | None
    magnetometer: Path | None
    heading: Path | None
    series: Mapping[str, Path]
    comparisons: tuple[tuple[str, Path], ...]
    title: str
    description: str
    tags: tuple[str, ...]
    vehicle: str
    axes: tuple[str, str, str]
    mounting: tuple[float, float, float]
    lever_arm: tuple[float, float, float]
    latency: float
    declination: float
    columns: tuple[tuple[str, str], ...] = ()
    axes_stated: bool = False
    forward_assumed: bool = False
    check_sensors: bool = True
    calibration: Path | None = None

    @property
    def has_own_names(self) -> bool:
        """Whether each of the two files has a column of the lab's own; files that cannot be read count."""
        for path, names in ((self.imu, IMU[1:]), (self.gnss, POSITION)):
            try:
                with TextBlocks(path, MAX_BYTES, strict=False) as text:
                    lines = itertools.islice(text.lines(), MAX_HEADER_LINE)
                    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
            except MissionError:
                continue
            others = set(header.replace(" ", "").split(",")) - {TIME.name, ""}
            if others and not {column.name for column in names} & others:
                return False
        return True

    @property
    def paths(self) -> list[Path]:
        """All files there are."""
        named = [self.imu, self.gnss, self.reference, self.magnetometer, *self.series.values()]
        named += [self.heading, self.calibration, *(path for _, path in self.comparisons)]
        return [path for path in named if path is not None]

    @property
    def stated(self) -> tuple[object, ...]:
        """The keys of the TOML that change how the files are read."""
        names = tuple(name for name, _ in self.comparisons)
        kept = self.axes, self.mounting, self.lever_arm, self.latency, self.vehicle, self.declination, names
        unchecked = () if self.check_sensors else ("check_sensors", False)
        seldom = self.columns, self.forward_assumed, unchecked
        return (*kept, *(one for one in seldom if one))

    @property
    def duration(self) -> float:
        """Time from the first sample of the IMU to the last [s], as stamped; only these are read."""
        return read_duration(self.imu, IMU, MIN_IMU_SAMPLES, may_be_cut=True)

    def read(self) -> SensorLog:
        """Read the log.

        Raises
        ------
        MissionError
            Naming file, row and column where there is one: if a file cannot be read, a column is missing or
            there in two units, a cell is not a finite number within its limits, time runs backwards, the
            files do not overlap in time, or the numbers contradict the units, axes or clock they claim.
        """
        repairs: list[str] = []
        time, samples, increments = self._read_imu(repairs)
        gnss, headings = self._read_gnss(repairs)
        if self.heading is not None:
            if headings is not None:
                raise MissionError(
                    f"{self.heading}: {self.gnss.name} has headings too (heading_deg); accepted are those of "
                    "one file"
                )
            headings = _read_headings(self.heading, repairs)
        auxiliary = AuxiliaryData.of_series(
            {name: _read_series(path, name, repairs) for name, path in self.series.items()},
            vehicle=self.vehicle,
            forward_assumed=self.forward_assumed,
            magnetometer=None if self.magnetometer is None else self._read_field(self.magnetometer, repairs),
            headings=headings,
            comparisons=tuple(
                Comparison(*_read_solution(path, repairs), name=name) for name, path in self.comparisons
            ),
        )
        reference = None if self.reference is None else Reference(*_read_solution(self.reference, repairs))
        log = repair_log(
            str(self.path), time, samples, gnss, reference, increments=increments, auxiliary=auxiliary
        )
        log = replace(log, repairs=(*repairs, *log.repairs))
        from lab.data.checks.log_check import check_log  # noqa: PLC0415 - imports scipy, which takes a while

        check_log(log)
        if self.check_sensors:
            check_auxiliary(log, {**self.series, "heading": self.heading or self.gnss})
        return log

    def of_device(self) -> LogFiles:
        """Return the same files in the axes of the device: neither turned nor calibrated."""
        return replace(self, axes=("x", "y", "z"), mounting=(0.0, 0.0, 0.0), calibration=None)

    def read_imu(self) -> tuple[FloatArray, FloatArray]:
        """Return times (n,) [s] and samples (n, 6) of the IMU: rates [rad/s], specific forces [m/s²].

        Raises
        ------
        MissionError
            As of `read`.
        """
        time, samples, increments = self._read_imu([])
        if increments:
            dt = np.diff(time)
            time, samples = time[1:][dt > 0], samples[1:][dt > 0] / dt[dt > 0, None]
        return time, samples

    def read_field(self) -> Magnetometer | None:
        """Return the readings of the magnetometer; None if there is none. It raises as `read` does."""
        return None if self.magnetometer is None else self._read_field(self.magnetometer, [])

    def _read_imu(self, repairs: list[str]) -> tuple[FloatArray, FloatArray, bool]:
        cells = (TIME, *(replace(column, may_be_empty=True) for column in IMU[1:]))
        table, _ = _read(self.imu, cells, repairs, _MAX_EMPTY_IMU)
        if len(table["t_s"]) < MIN_IMU_SAMPLES:
            raise MissionError(
                f"{self.imu}: {len(table['t_s'])} rows; accepted are at least {MIN_IMU_SAMPLES}"
            )
        present = [name for name in (*INCREMENTS[0], *INCREMENTS[1]) if name in table]
        rates = [name for group in (*GYRO, *FORCE) for name in group if name in table]
        if present and rates:
            raise MissionError(
                f"{self.imu}: has both increments ({present[0]}) and rates ({rates[0]}); accepted are either"
            )
        if present:
            gyro, force = (
                choose_group(self.imu, table, INCREMENTS[:1]),
                choose_group(self.imu, table, INCREMENTS[1:]),
            )
        else:
            gyro, force = choose_group(self.imu, table, GYRO), choose_group(self.imu, table, FORCE)
            if "gx_deg_s" in table:
                gyro = np.radians(gyro)
            if "fx_g" in table:
                force = force * STANDARD_GRAVITY
        time = table["t_s"]
        if self.calibration is not None:
            known = read_calibration(self.calibration)
            dt = np.diff(time, prepend=2 * time[0] - time[1]) if present else None
            gyro = gyro if known.gyro is None else known.gyro.removed(gyro, dt=dt)
            force = force if known.accelerometer is None else known.accelerometer.removed(force, dt=dt)
            repairs.append(f"A calibration was applied ({self.calibration.name}): {known.words}.")
        C = self._axes()
        return time, np.concatenate((gyro @ C.T, force @ C.T), axis=1), bool(present)

    def _read_gnss(self, repairs: list[str]) -> tuple[GnssLog, Headings | None]:
        place = tuple(replace(column, may_be_empty=True) for column in POSITION)
        cells = (TIME, *place, *VELOCITY, *SIGMA, *HEADING)
        table, rows = _read(self.gnss, cells, repairs, _MAX_EMPTY_FIXES)
        gnss = GnssLog(
            time=table["t_s"],
            position=geodetic(table, rows),
            velocity_n=columns_or_nan(table, VELOCITY, rows),
            position_sigma=columns_or_nan(table, SIGMA[:3], rows),
            velocity_sigma=columns_or_nan(table, SIGMA[3:], rows),
            lever_arm=np.array(self.lever_arm, dtype=np.float64),
            latency=self.latency,
        )
        heading, sigma = np.radians(columns_or_nan(table, HEADING, rows)).T
        known = np.isfinite(heading)
        if not known.any():
            return gnss, None
        # Of the same clock as the fixes, and late by as much.
        return gnss, Headings(table["t_s"][known] - self.latency, heading[known], sigma[known])

    def _read_field(self, path: Path, repairs: list[str]) -> Magnetometer:
        table, _ = _read(path, (TIME, *FIELD), repairs)
        time, field = _keep_known(
            path, table["t_s"], np.stack([table[column.name] for column in FIELD], axis=-1)
        )
        known = None if self.calibration is None else read_calibration(self.calibration).magnetometer
        field = field if known is None else known.removed(field)
        return Magnetometer(time, field @ self._axes().T, float(np.radians(self.declination)))

    def _axes(self) -> FloatArray:
        """Return the matrix that takes vectors in the axes of the IMU to b."""
        C = C_nb_from_euler(np.radians(self.mounting)) @ axes_matrix(self.axes, f"{self.path}: ")
        return np.asarray(C if self.calibration is None else read_calibration(self.calibration).turn @ C)


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
    values = read_toml(described) if os.path.lexists(described) or not path.is_dir() else {}
    check_values(described, values)
    imu, gnss = (
        file_in_same_folder(described, key, values.get(key, f"{key}.csv")) for key in ("imu", "gnss")
    )
    usual = {"reference": "ref.csv", "magnetometer": "mag.csv"} | {aid.name: aid.file for aid in AIDS}
    others = {key: file_in_same_folder(described, key, values.get(key, name)) for key, name in usual.items()}
    comparisons = tuple(
        (name, file_in_same_folder(described, "comparisons", file))
        for name, file in values.get("comparisons", {}).items()
    )
    calibration = None
    if "calibration" in values:
        calibration = file_in_same_folder(described, "calibration", values["calibration"])
    wanted = [imu, gnss, *(file for _, file in comparisons), *((calibration,) if calibration else ())]
    wanted += [file for key, file in others.items() if key in values]
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
        **{
            key: others[key] if others[key].is_file() else None
            for key in ("reference", "magnetometer", "heading")
        },
        series={aid.name: others[aid.name] for aid in SERIES if others[aid.name].is_file()},
        comparisons=comparisons,
        title=values.get("title", described.parent.name if described.stem == "log" else described.stem),
        description=values.get("description", ""),
        tags=tuple(values.get("tags", ())),
        vehicle=values.get("vehicle", ""),
        axes=tuple(values.get("axes", ("x", "y", "z"))),
        mounting=tuple(values.get("mounting_deg", (0.0, 0.0, 0.0))),
        lever_arm=tuple(values.get("lever_arm_m", (0.0, 0.0, 0.0))),
        latency=float(values.get("latency_s", 0.0)),
        declination=float(values.get("declination_deg", "nan")),
        columns=tuple(values.get("columns", {}).items()),
        axes_stated="axes" in values,
        forward_assumed=values.get("forward_assumed", False),
        check_sensors=values.get("check_sensors", True),
        calibration=calibration,
    )


def read_sensor_log(path: str | os.PathLike[str]) -> SensorLog:
    """Read a log from its folder or its TOML file; see `log_files` and `LogFiles.read`."""
    return log_files(path).read()


def _read(
    path: Path, accepted: tuple[Column, ...], repairs: list[str], max_empty: float | None = None
) -> tuple[dict[str, FloatArray], int]:
    """Return columns by their names, and the number of rows.

    `max_empty` is the largest share of rows in which cells may be empty that a sample or fix needs.
    """
    columns, table, first_line, cut_line = read_columns(path, accepted, may_be_cut=True)
    if cut_line:
        repairs.append(f"The last line of {path.name}, row {cut_line}, is cut and was dropped.")
    if len(table) and table[:, 0].max() - table[:, 0].min() > MAX_DURATION:
        raise MissionError(
            f"{path}, from row {first_line}, column t_s: more than {MAX_DURATION:g} s from the first to the "
            "last row; accepted are shorter logs, with time in seconds"
        )
    if max_empty is not None:
        _check_empty(path, columns, table, first_line, max_empty)
    return {column.name: table[:, i] for i, column in enumerate(columns)}, len(table)


def _check_empty(
    path: Path, columns: list[Column], table: FloatArray, first_line: int, accepted: float
) -> None:
    """Refuse empty cells, in columns of samples and positions, in more rows than accepted."""
    needed = [i for i, column in enumerate(columns) if column.name in ESSENTIAL]
    empty = np.isnan(table[:, needed])
    share = float(empty.any(axis=1).mean()) if len(table) else 0.0
    if share > accepted:
        row, place = np.argwhere(empty)[0]
        raise MissionError(
            f"{path}: {share:.0%} of the rows have empty cells, the first in row {first_line + row}, column "
            f"{columns[needed[place]].name}; accepted are up to {accepted:.0%}, which are dropped"
        )


def _read_solution(path: Path, repairs: list[str]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return time, position, velocity and attitude of a solution; NaN where it has none."""
    table, rows = _read(path, (TIME, *PLACE_IF_KNOWN, *VELOCITY, *ATTITUDE), repairs)
    time = table["t_s"]
    if rows < 2 or (np.diff(time) <= 0).any():
        raise MissionError(f"{path}, column t_s: accepted are at least two rows and time that increases")
    parts = (
        geodetic(table, rows),
        columns_or_nan(table, VELOCITY, rows),
        np.radians(columns_or_nan(table, ATTITUDE, rows)),
    )
    if not any(np.isfinite(part).all(axis=1).any() for part in parts):
        raise MissionError(
            f"{path}: contains neither positions nor velocities nor attitudes; accepted are the columns "
            "lat_deg, lon_deg, alt_m, or vn_m_s, ve_m_s, vd_m_s, or roll_deg, pitch_deg, heading_deg, or "
            "more"
        )
    return (time, *parts)


def _read_headings(path: Path, repairs: list[str]) -> Headings:
    """Return headings with their σ; empty cells are left out."""
    table, rows = _read(path, (TIME, replace(HEADING[0], required=True), HEADING[1]), repairs)
    heading, sigma = np.radians(columns_or_nan(table, HEADING, rows)).T
    known = np.isfinite(heading)
    time, heading = _keep_known(path, table["t_s"], heading)
    return Headings(time, heading, sigma[known])


def _read_series(path: Path, name: str, repairs: list[str]) -> Series:
    """Return the readings of a sensor of the aid table; empty cells are left out."""
    (column,) = (aid.column for aid in SERIES if aid.name == name)
    table, _ = _read(path, (TIME, column), repairs)
    return Series(*_keep_known(path, table["t_s"], table[column.name]))


def _keep_known(path: Path, time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the times and values of rows (n,) or (n, m) without empty cells; refuse time that runs back."""
    known = np.isfinite(values) if values.ndim == 1 else np.isfinite(values).all(axis=1)
    if (np.diff(time[known]) < 0).any():
        raise MissionError(f"{path}, column t_s: accepted is time that increases from row to row")
    return time[known], values[known]
