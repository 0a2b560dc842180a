"""Sensor log writer: a log as a folder of the lab's own csv files, whole or not at all.

The files read back as the same log: increments with all their digits, times of the recorder's clock, and
gaps of the IMU as gaps, so that they are filled in the same way again.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.aid_table import SERIES
from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import toml_text
from lab.data.files.log_toml import DESCRIPTION_FILE
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.log.auxiliary_data import Headings, Reference
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.log.vehicle import vehicle_of

_SAME_TIME = 0.02
"""Largest time between a fix and a heading of the same solution [s]: half the step of receivers of 25 Hz."""
_IMU = (
    "t_s", "dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad", "dvelocity_x_m_s", "dvelocity_y_m_s",
    "dvelocity_z_m_s",
)  # fmt: skip
_PLACE = ("t_s", "lat_deg", "lon_deg", "alt_m", "vn_m_s", "ve_m_s", "vd_m_s")
_SIGMA = ("sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
_ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
_HEADING = ("heading_deg", "sd_heading_deg")
_FIELD = ("t_s", "mx_uT", "my_uT", "mz_uT")


def write_sensor_log(
    folder: str | os.PathLike[str],
    log: SensorLog,
    *,
    title: str,
    description: str = "",
    tags: Sequence[str] = (),
) -> None:
    """Write a log into a new folder: ``imu.csv``, ``gnss.csv``, ``log.toml``, files of auxiliary data.

    The folder appears when all is written and has been read back.

    Parameters
    ----------
    folder
        The folder to make.
    log
        The log.
    title, description, tags
        Title and description of the mission.

    Raises
    ------
    MissionError
        If the folder exists or cannot be made, or the log could not be read back, such as for its size.
    """
    folder = Path(folder)
    if os.path.lexists(folder):
        raise MissionError(f"{folder}: is there already; accepted is the name of a new folder")
    try:
        temporary = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            _write_files(temporary, log, title, description, tags)
            _check(temporary, folder)
            temporary.chmod(0o777 & ~_umask())
            temporary.rename(folder)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
    except (OSError, ValueError) as error:
        if isinstance(error, MissionError):
            raise
        raise MissionError(
            f"{folder}: cannot be written: {getattr(error, 'strerror', None) or error}"
        ) from error


def _write_files(folder: Path, log: SensorLog, title: str, description: str, tags: Sequence[str]) -> None:
    auxiliary, epoch = log.auxiliary, log.epoch
    _write_csv(folder / "imu.csv", _IMU, _imu_rows(log), epoch)
    at_fixes = _heading_rows(log.gnss, auxiliary.headings)
    if auxiliary.headings is not None and np.isfinite(at_fixes[:, 0]).sum() < auxiliary.headings.time.size:
        # More headings than fixes, or at other times: a file of their own holds all.
        own = auxiliary.headings
        table = np.column_stack((own.time, np.degrees(own.heading), np.degrees(own.sigma)))
        _write_csv(folder / "heading.csv", ("t_s", *_HEADING), table, epoch)
        at_fixes[:] = np.nan
    gnss = log.gnss
    sigmas = gnss.position_sigma, gnss.velocity_sigma
    fixes = np.column_stack((gnss.time, _degrees(gnss.position), gnss.velocity_n, *sigmas, at_fixes))
    _write_csv(folder / "gnss.csv", (*_PLACE, *_SIGMA, *_HEADING), fixes, epoch)
    if log.reference is not None:
        _write_csv(folder / "ref.csv", (*_PLACE, *_ATTITUDE), _reference_rows(log.reference), epoch)
    if auxiliary.magnetometer is not None:
        field = np.column_stack((auxiliary.magnetometer.time, auxiliary.magnetometer.field))
        _write_csv(folder / "mag.csv", _FIELD, field, epoch)
    for aid in SERIES:
        if aid.name in auxiliary.series:
            table = np.column_stack((auxiliary.series[aid.name].time, auxiliary.series[aid.name].value))
            _write_csv(folder / aid.file, ("t_s", aid.column.name), table, epoch)
    others = {}
    for number, other in enumerate(auxiliary.comparisons, 1):
        others[other.name] = f"comparison{number}.csv"
        _write_csv(folder / others[other.name], (*_PLACE, *_ATTITUDE), _reference_rows(other), epoch)
    values: dict[str, Any] = {
        "title": title,
        "description": "\n".join(part for part in (description, *log.repairs) if part),
        "tags": list(tags),
        "lever_arm_m": [float(one) for one in log.gnss.lever_arm],
        "latency_s": float(log.gnss.latency),
    }
    if vehicle_of(auxiliary.vehicle).name:
        values["vehicle"] = vehicle_of(auxiliary.vehicle).name
    if auxiliary.forward_assumed:
        values["forward_assumed"] = True
    if auxiliary.series or auxiliary.headings:
        # IMU and GPS of a device are not lost for one of its other sensors.
        values["check_sensors"] = False
    if auxiliary.magnetometer is not None and np.isfinite(auxiliary.magnetometer.declination):
        values["declination_deg"] = float(np.degrees(auxiliary.magnetometer.declination))
    if others:
        values["comparisons"] = others
    (folder / DESCRIPTION_FILE).write_bytes(toml_text(values).encode())


def _imu_rows(log: SensorLog) -> FloatArray:
    """Return times and increments, those of filled gaps left out."""
    increments = np.concatenate((log.dtheta, log.dvelocity), axis=1)
    # The first sample is where time begins; its own interval is not known.
    increments = np.concatenate((np.zeros((1, 6)), increments))
    kept = np.ones(len(log.time), dtype=bool)
    steps = np.diff(log.time, prepend=-1.0)
    for start, end in log.gaps:
        first, last = np.searchsorted(log.time, (start, end))
        kept[first + 1 : last] = False
        # The reader takes the rate after a gap from the increments of the whole gap.
        increments[last] *= (end - start) / steps[last]
    return np.column_stack((log.time, increments))[kept]


def _heading_rows(gnss: GnssLog, headings: Headings | None) -> FloatArray:
    """Return heading and σ at each fix [°]; NaN if there is none at its time."""
    rows = np.full((gnss.time.size, 2), np.nan)
    if headings is not None and headings.time.size:
        at = gnss.time - gnss.latency
        place = np.clip(np.searchsorted(headings.time, at - _SAME_TIME), 0, headings.time.size - 1)
        same = np.abs(headings.time[place] - at) <= _SAME_TIME
        rows[same] = np.degrees(np.column_stack((headings.heading, headings.sigma)))[place[same]]
    return rows


def _reference_rows(reference: Reference) -> FloatArray:
    euler = np.degrees(reference.euler)
    return np.column_stack((reference.time, _degrees(reference.position), reference.velocity_n, euler))


def _degrees(position: FloatArray) -> FloatArray:
    return np.column_stack((np.degrees(position[:, :2]), position[:, 2]))


def _write_csv(path: Path, names: Sequence[str], table: FloatArray, epoch: float) -> None:
    """Write a file with all digits: empty cells for unknown values; columns without data are omitted.

    The times in the first column count from `epoch` [s].
    """
    table = np.column_stack((table[:, 0] + epoch, table[:, 1:]))
    there = np.flatnonzero(~np.isnan(table).all(axis=0))
    names, table = [names[place] for place in there.tolist()], table[:, there]
    form = ",".join(["%r"] * len(names)) + "\n"
    with path.open("w", encoding="ascii", newline="") as file:
        file.write(",".join(names) + "\n")
        for start in range(0, len(table), 10_000):
            rows = "".join(form % tuple(row) for row in table[start : start + 10_000].tolist())
            file.write(rows.replace("nan", ""))


def _check(written: Path, folder: Path) -> None:
    try:
        read_sensor_log(written)
    except MissionError as error:
        message = str(error).replace(str(written), str(folder))
        raise MissionError(f"not written: {message}") from error


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask
