"""Adapters: the files of public data sets whose layout no reader of `lab.data` has, as a sensor log.

References
----------
T. Everett, *GNSS_IMU*, ``imu_files.py`` and ``convert_imu_file.py``: seconds since 1970 of GPS time, specific
force in g and angular rate in rad/s of an IMU, and solution files of RTKLIB.
R. Gonzalez et al., *NaveGo*, ``navego_example_synth.m``: structures of an IMU, a receiver and a reference.
N. Carlevaris-Bianco et al., *University of Michigan North Campus long-term vision and lidar dataset*, 2016:
csv without headings; positions linearised at 42.293227°, -83.709657°, 270 m.
H. Schafer et al., *A Commute in Data: The comma2k19 Dataset*, arXiv:1812.05752, and the README of the set.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.files.file_content import TextBlocks, read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.log_check import check_log
from lab.data.log.auxiliary_data import AuxiliaryData, Reference
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repair_log
from lab.experiment.scoreboard.array_files import mat_structure, npy_array
from lab.experiment.scoreboard.registry import DataSet
from lab.motion.frames import ecef
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_C_nb

_TAG_HEAD = struct.Struct("<60xIId")
"""Head of a time tag of RTKLIB: tick, seconds since 1970 and their fraction; pairs of numbers follow."""
_TAG_PAIR = 8
"""Bytes of each of them: tick [ms], and place in the file."""
_MILLI, _MICRO = 1e-3, 1e-6  # [s]
_POS_COLUMNS = 19
"""Numbers after the time of a solution file of RTKLIB with velocities, up to their σ."""
_NCLT_ORIGIN = np.array([np.radians(42.293227), np.radians(-83.709657), 270.0])
"""Place at which positions of NCLT are linearised: latitude, longitude [rad], height [m]."""
_NCLT_RADII = (6378135.0, 6356750.0)
"""Semi-axes of the Earth in its local frame [m]."""
_NCLT_FIX = 2
"""Mode from which its receiver has a position."""


def _numbers(path: Path, least: int, delimiter: str | None) -> FloatArray:
    """Return the rows of a table of numbers without headings; lines that begin with % or # are none.

    Raises
    ------
    MissionError
        If the file cannot be read, or a row is no row of at least so many numbers.
    """
    parts = []
    with TextBlocks(path, MAX_BYTES) as text:
        for block in text.blocks():
            lines = block.split(b"\n")
            for number, line in enumerate(lines, text.next_line):
                cells = line.decode().split(delimiter)
                if not line.strip() or cells[0].lstrip()[:1] in ("%", "#"):
                    continue
                try:
                    row = [float(cell) for cell in cells[:least]]
                except ValueError:
                    row = []
                if len(row) < least:
                    raise MissionError(
                        f"{path}: line {number} is {line[:40].decode()!r}; accepted are {least} numbers a row"
                    )
                parts.append(row)
            text.next_line += len(lines)
    return np.array(parts, dtype=np.float64).reshape(-1, least)


def _find_one_file(folder: Path, pattern: str) -> Path:
    """Return the one file of a folder with a name like this."""
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        count = "no file" if not found else f"{len(found)} files"
        raise MissionError(f"{folder}: has {count} named {pattern}; accepted is one")
    return found[0]


def _fixes(
    about: DataSet,
    time: FloatArray,
    position: FloatArray,
    velocity_n: FloatArray,
    sigma: FloatArray | None = None,
) -> GnssLog:
    """Return fixes with the lever arm and the latency of a set; σ (m, 6) where there is one."""
    sigma = np.full((time.size, 6), np.nan) if sigma is None else believed_sigma(sigma)
    arm = np.array(about.lever_arm_m, dtype=np.float64)
    return GnssLog(time, position, velocity_n, sigma[:, :3], sigma[:, 3:], arm, about.latency_s)


def _log(
    folder: Path,
    about: DataSet,
    time: FloatArray,
    samples: FloatArray,
    gnss: GnssLog,
    reference: Reference | None,
) -> SensorLog:
    log = repair_log(
        str(folder), time, samples, gnss, reference, auxiliary=AuxiliaryData(vehicle=about.vehicle)
    )
    check_log(log)
    return log


def gnss_imu(folder: Path, about: DataSet) -> SensorLog:
    """Read a set of GNSS_IMU: its IMU, converted or as recorded with a time tag, and a solution file."""
    converted = sorted(folder.glob("imu_*_sf.csv"))
    if converted:
        table = _numbers(_find_one_file(folder, "imu_*_sf.csv"), 7, ",")
        time, force, rate = table[:, 0], table[:, 1:4], table[:, 4:7]
    else:
        time, force, rate = _read_tagged(_find_one_file(folder, "imu_*.csv"))
    C = C_nb_from_euler(np.radians(about.imu_rpy_deg)).T
    samples = np.hstack((rate @ C.T, force * STANDARD_GRAVITY @ C.T))
    fixes, position, velocity_n, sigma = _rtklib(_find_one_file(folder, "gnss_*.pos"))
    gnss = _fixes(about, fixes, position, velocity_n, sigma)
    return _log(folder, about, time - about.imu_late_s, samples, gnss, None)


def _read_tagged(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times of GPS [s], specific force [g] and rate [rad/s] of a recording with a time tag.

    The first row is a heading, and the last one may be cut.
    """
    with TextBlocks(path, MAX_BYTES) as text:
        lines = [line for block in text.blocks() for line in block.split(b"\n") if line.strip()]
    try:
        table = np.loadtxt(lines[1:-1], delimiter=",", usecols=range(7), ndmin=2)
    except (ValueError, IndexError) as error:
        raise MissionError(f"{path}: {error}; accepted are 7 numbers a row after a heading") from error
    tag = path.with_name(path.name + ".tag")
    content = read_whole(tag, MAX_BYTES)
    if len(content) < _TAG_HEAD.size + _TAG_PAIR:
        raise MissionError(f"{tag}: {len(content)} bytes; accepted is a time tag of RTKLIB")
    _, seconds, fraction = _TAG_HEAD.unpack_from(content)
    pairs = (len(content) - _TAG_HEAD.size) // _TAG_PAIR
    (last,) = struct.unpack_from("<I", content, _TAG_HEAD.size + (pairs - 1) * _TAG_PAIR)
    since = table[:, 6] - table[:1, 6]
    if len(table) < 2 or not since[-1] > 0:
        raise MissionError(f"{path}: the time of the last row is not later than that of the first")
    return seconds + fraction + since * (last * _MILLI / since[-1]), table[:, :3], np.radians(table[:, 3:6])


def _rtklib(path: Path) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return time [s], position, velocity and σ of a solution file with dates and geodetic positions."""
    rows, times = [], []
    with TextBlocks(path, MAX_BYTES) as text:
        for block in text.blocks():
            lines = block.split(b"\n")
            for number, line in enumerate(lines, text.next_line):
                cells = line.decode().split()
                if not cells or cells[0].startswith("%"):
                    continue
                try:
                    day = np.datetime64(cells[0].replace("/", "-"), "D").astype(np.int64)
                    hour, minute, second = map(float, cells[1].split(":"))
                    row = [float(cell) for cell in cells[2 : 2 + _POS_COLUMNS]]
                except (ValueError, IndexError):
                    row = []
                if len(row) < _POS_COLUMNS:
                    raise MissionError(
                        f"{path}: line {number} is no row of a solution with date, geodetic position and "
                        "velocity; accepted is RTKLIB's form with these"
                    )
                times.append(float(day) * 86400 + hour * 3600 + minute * 60 + second)
                rows.append(row)
            text.next_line += len(lines)
    table = np.array(rows, dtype=np.float64).reshape(-1, _POS_COLUMNS)
    position = np.column_stack((np.radians(table[:, :2]), table[:, 2]))
    velocity_n = table[:, 13:16] * (1, 1, -1)
    return np.array(times), position, velocity_n, np.hstack((table[:, 5:8], table[:, 16:19]))


def navego(folder: Path, about: DataSet) -> SensorLog:
    """Read a set of NaveGo: structures of an IMU, a receiver and a reference in files of MATLAB."""
    parts = {
        part: mat_structure(folder / file, name, _FIELDS[part], _OPTIONAL[part])
        for part, (file, name) in about.structures.items()
    }
    imu, gnss, truth = (parts[name] for name in ("imu", "gnss", "reference"))
    samples = np.hstack((_three(folder, imu, "wb"), _three(folder, imu, "fb")))
    time = gnss["t"].ravel()
    sigma = [
        np.broadcast_to(gnss[name].reshape(-1, 3), (time.size, 3))
        if name in gnss and gnss[name].size in (3, 3 * time.size)
        else np.full((time.size, 3), np.nan)
        for name in ("stdm", "stdv")
    ]
    fixes = _fixes(about, time, _read_place(folder, gnss), _three(folder, gnss, "vel"), np.hstack(sigma))
    if "larm" in gnss and gnss["larm"].size == 3:
        fixes.lever_arm[:] = gnss["larm"].ravel()
    rows = truth["t"].size
    euler = [truth[name].ravel() for name in ("roll", "pitch", "yaw") if name in truth]
    attitude = np.column_stack(euler) if len(euler) == 3 else np.full((rows, 3), np.nan)
    velocity = _three(folder, truth, "vel")
    reference = Reference(truth["t"].ravel(), _read_place(folder, truth), velocity, attitude)
    return _log(folder, about, imu["t"].ravel(), samples, fixes, reference)


_PLACE = ("t", "lat", "lon", "h", "vel")
_FIELDS = {"imu": ("t", "fb", "wb"), "gnss": _PLACE, "reference": _PLACE}
"""Fields that each structure has."""
_OPTIONAL = {"imu": (), "gnss": ("stdm", "stdv", "larm"), "reference": ("roll", "pitch", "yaw")}
"""Fields that it may have."""


def _three(folder: Path, fields: Mapping[str, FloatArray], name: str) -> FloatArray:
    """Return a field with three numbers for each time."""
    rows, values = fields["t"].size, fields[name]
    if values.shape != (rows, 3):
        raise MissionError(
            f"{folder}: field {name} has the size {values.shape}; accepted are three numbers for each of the "
            f"{rows} times"
        )
    return values


def _read_place(folder: Path, fields: Mapping[str, FloatArray]) -> FloatArray:
    """Return latitude, longitude [rad], height [m]."""
    parts = [fields[name].ravel() for name in ("lat", "lon", "h")]
    if any(part.size != fields["t"].size for part in parts):
        raise MissionError(f"{folder}: lat, lon and h have other sizes than t; accepted are equal ones")
    return np.column_stack(parts)


def nclt(folder: Path, about: DataSet) -> SensorLog:
    """Read a session of NCLT: ``ms25.csv``, ``gps.csv``, and its ground truth where it is there."""
    imu = _numbers(_find_one_file(folder, "ms25.csv"), 10, ",")
    fixes = _numbers(_find_one_file(folder, "gps.csv"), 8, ",")
    fixes = fixes[(fixes[:, 1] >= _NCLT_FIX) & np.isfinite(fixes[:, 3:6]).all(axis=1)]
    track, speed = fixes[:, 6], fixes[:, 7]
    velocity_n = np.column_stack((speed * np.cos(track), speed * np.sin(track), np.full(len(fixes), np.nan)))
    gnss = _fixes(about, fixes[:, 0] * _MICRO, fixes[:, 3:6], velocity_n)
    truth = sorted(folder.glob("groundtruth*.csv"))
    reference = _nclt_truth(_numbers(truth[0], 7, ",")) if truth else None
    return _log(folder, about, imu[:, 0] * _MICRO, np.hstack((imu[:, 7:10], imu[:, 4:7])), gnss, reference)


def _nclt_truth(rows: FloatArray) -> Reference:
    """Return the ground truth, whose positions are metres north, east, down of the origin of the set."""
    rows = rows[np.isfinite(rows).all(axis=1)]
    latitude, longitude, height = _NCLT_ORIGIN
    a, b = _NCLT_RADII
    square = (a * np.cos(latitude)) ** 2 + (b * np.sin(latitude)) ** 2
    place = np.column_stack(
        (
            latitude + np.arcsin(rows[:, 1] * square**1.5 / (a * b) ** 2),
            longitude + np.arcsin(rows[:, 2] * np.sqrt(square) / (a**2 * np.cos(latitude))),
            height - rows[:, 3],
        )
    )
    return Reference(rows[:, 0] * _MICRO, place, np.full((len(rows), 3), np.nan), rows[:, 4:7])


def comma2k19(folder: Path, about: DataSet) -> SensorLog:
    """Read a segment of comma2k19: IMU forward, right, down, u-blox receiver, and the poses of the camera."""
    logged, pose = folder / "processed_log", folder / "global_pose"
    times, rates = _pair(logged / "IMU" / "gyro_uncalibrated", 3)
    when, forces = _pair(logged / "IMU" / "accelerometer", 3)
    forces = interpolate_columns(times, when, forces)
    within = (times >= when[0]) & (times <= when[-1])
    stamps, values = _pair(logged / "GNSS" / "live_gnss_ublox", 6)
    course, speed = np.radians(values[:, 5]), values[:, 2]
    velocity_n = np.column_stack(
        (speed * np.cos(course), speed * np.sin(course), np.full(stamps.size, np.nan))
    )
    place = np.column_stack((np.radians(values[:, :2]), values[:, 4]))
    reference = _camera(pose) if pose.is_dir() else None
    samples = np.hstack((rates, forces))[within]
    return _log(folder, about, times[within], samples, _fixes(about, stamps, place, velocity_n), reference)


def _pair(folder: Path, columns: int) -> tuple[FloatArray, FloatArray]:
    """Return times and values of one kind of data."""
    times, values = npy_array(folder / "t"), npy_array(folder / "value")
    if times.ndim != 1 or times.size < 2 or values.shape != (times.size, columns):
        raise MissionError(
            f"{folder}: t has the size {times.shape} and value {values.shape}; accepted are two times or "
            f"more, and {columns} numbers for each"
        )
    return times, values


def _camera(folder: Path) -> Reference:
    """Return the poses of the camera, which are in Earth-fixed axes."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - takes a while to import

    names = ("frame_times", "frame_positions", "frame_velocities", "frame_orientations")
    time, place, velocity, turn = (npy_array(folder / name) for name in names)
    if place.shape != (time.size, 3) or velocity.shape != place.shape or turn.shape != (time.size, 4):
        raise MissionError(f"{folder}: the poses have other sizes than their times; accepted are equal ones")
    geodetic = ecef.geodetic(place)
    C_ne = np.swapaxes(ecef.axes(geodetic[:, 0], geodetic[:, 1]), 1, 2)
    C_eb = Rotation.from_quat(turn, scalar_first=True).as_matrix()
    velocity_n = np.einsum("nij,nj->ni", C_ne, velocity)
    return Reference(time, geodetic, velocity_n, euler_from_C_nb(C_ne @ C_eb))


ADAPTERS: dict[str, Callable[[Path, Any], SensorLog]] = {
    "gnss-imu": gnss_imu,
    "navego": navego,
    "nclt": nclt,
    "comma2k19": comma2k19,
}
"""The adapters by layout."""
