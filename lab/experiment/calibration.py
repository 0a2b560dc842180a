"""Calibration: constant errors of sensors from a log of any format, judged on data that it did not see."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lab.analysis.calibration import imu_calibration, magnetometer, mounting
from lab.analysis.calibration.imu_calibration import ImuCalibration
from lab.analysis.calibration.magnetometer import MagnetometerCalibration
from lab.analysis.calibration.mounting import MountingCalibration
from lab.analysis.calibration.rests import Samples, find_rests
from lab.analysis.calibration.terms import Term
from lab.analysis.rest_samples import imu_samples
from lab.base.files.mission_error import MissionError
from lab.base.progress import Progress
from lab.data.files.unit_names import UNITS
from lab.data.formats import log_reader_of
from lab.data.log.auxiliary_data import Magnetometer
from lab.data.log.calibration import Calibration, read_calibration
from lab.data.sheets.sensor_csv import sheets_of
from lab.data.sheets.sheet_imu import triads
from lab.data.streams.capture import holds_samples
from lab.data.streams.recorded_log import has_reader, recorded_samples
from lab.experiment.experiment import Experiment
from lab.experiment.log_file import mission_name
from lab.experiment.log_result import LogResult
from lab.missions import LogMission, missions
from lab.missions import mission as find_mission
from lab.missions.flight_import import read_log
from lab.missions.log_mission import is_log_folder
from lab.motion.frames import earth
from lab.sensors.cards import Card
from lab.sensors.datum import Datum
from lab.sensors.suite import TRIADS

Found = ImuCalibration | MagnetometerCalibration | MountingCalibration
Source = str | Path | Sequence[str | Path]
_AXES = "xyz"
_MICROTESLA = 1e6
"""Microteslas in a tesla: streams are in T."""
_MILLI_G = 1e3 / 9.80665
"""mg in one m/s²."""


def calibrate_imu(
    source: Source, latitude: float | None = None, units: Mapping[str, str] | None = None
) -> ImuCalibration:
    """Return bias, scale factor and misalignment of an IMU from a log of rests in many attitudes.

    Parameters
    ----------
    source
        A file of an IMU, of any format that `lab.analysis.rest.read_log` reads; or a mission that is a
        sensor log.
    latitude
        Latitude of the place [°], for gravity; None takes that of the log's fixes, if it has any.
    units
        For tables with named columns, corrections by column: a unit, or a quantity with its unit.

    Raises
    ------
    MissionError
        If the log cannot be read, moved where it should rest, or rests in too few attitudes.
    """
    name = _name(source)
    log = _log_mission(source)
    if log is not None:
        time, samples = log.files.of_device().read_imu()
        found = {triad: Samples(time, samples[:, 3 * k : 3 * k + 3]) for k, triad in enumerate(TRIADS)}
        if latitude is None and log.log.gnss.time.size:
            latitude = math.degrees(float(np.median(log.log.gnss.position[:, 0])))
    else:
        read, _ = imu_samples(_paths(source), units or {})
        found = {triad: Samples(*one) for triad, one in read.items()}
    missing = [triad for triad in TRIADS if triad not in found]
    if missing:
        raise MissionError(f"{name}: has no {missing[0]}s; accepted is a log of gyros and accelerometers")
    gravity = None if latitude is None else float(earth.gravity(np.sin(np.radians(latitude)), 0.0))
    try:
        return imu_calibration.calibrate(find_rests(found["gyro"], found["accelerometer"]), name, gravity)
    except MissionError as error:
        raise MissionError(f"{name}: {error}") from error


def calibrate_magnetometer(source: Source, units: Mapping[str, str] | None = None) -> MagnetometerCalibration:
    """Return hard and soft iron of a magnetometer from a log with turns.

    Parameters
    ----------
    source
        A log with a magnetometer: of an autopilot, tables with named columns, or a mission that is a sensor
        log.

    Raises
    ------
    MissionError
        If the log cannot be read, has no magnetometer, or turned too little.
    """
    name, found = _name(source), _field(source, units or {})
    if found is None:
        raise MissionError(f"{name}: has no magnetometer; accepted is a log that has one")
    try:
        return magnetometer.calibrate(found.time, found.field, name)
    except MissionError as error:
        raise MissionError(f"{name}: {error}") from error


def calibrate_mounting(
    source: str | Path | Experiment, progress: Progress | None = None
) -> MountingCalibration:
    """Return pitch and yaw of an IMU in a vehicle on wheels from a drive.

    Parameters
    ----------
    source
        The mission of a sensor log, or an experiment on it, whose settings are kept.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    MissionError
        If the log is no drive of a vehicle on wheels, or too short, or without turns.
    ValueError
        If it cannot be navigated.
    """
    experiment = source.copy() if isinstance(source, Experiment) else Experiment(mission=str(source))
    if not isinstance(find_mission(experiment.mission), LogMission):
        raise MissionError(
            f"{mission_name(experiment.mission)}: is a simulated mission, whose IMU is mounted straight; "
            "accepted "
            "is a sensor log"
        )
    tell = progress or (lambda _stage, _fraction: None)
    mounting.check_drive(find_mission(experiment.mission).log)  # type: ignore[attr-defined]
    result = experiment.run(lambda stage, part: tell(stage, 0.1 * part))
    assert isinstance(result, LogResult)
    return mounting.calibrate(result.recorded.log, experiment, mission_name(experiment.mission), progress)


def card_of(found: ImuCalibration, name: str) -> Card:
    """Return a card with the known terms of an IMU: its simulation has the same constant errors.

    Parameters
    ----------
    found
        The calibration.
    name
        Name of the card.

    Raises
    ------
    ValueError
        If no term is known that gains.
    """
    where = f"ins-lab calibrate imu, {found.calibration.source}"
    terms = {triad: _data([one for one in found.stated if one.group == triad], where) for triad in TRIADS}
    terms = {triad: data for triad, data in terms.items() if data}
    if not terms:
        raise ValueError(f"no card can be made of {found.calibration.source}: no term is known that gains")
    return Card(name=name, maker="", grade="own", note=" ".join(found.sentences), terms=terms)


def _data(terms: Sequence[Term], where: str) -> dict[str, Datum]:
    known = {(term.name, term.axis): term for term in terms}
    pairs = [one + other for one in _AXES for other in _AXES if one != other]
    data = {}
    for name, setting, axes in (
        ("bias", "bias", list(_AXES)),
        ("scale factor", "scale_factor", list(_AXES)),
        ("misalignment", "misalignment", pairs),
    ):
        if any((name, axis) in known for axis in axes):
            found = [known.get((name, axis)) for axis in axes]
            unit = next(one.unit for one in found if one is not None)
            scale, unit = (_MILLI_G, "mg") if unit == "m/s²" else (1.0, unit)
            values = tuple(float(f"{0.0 if one is None else scale * one.value:.5g}") for one in found)
            data[setting] = Datum(values, unit, where)
    return data


def written(found: Found, path: Path, applied: Path | None = None) -> Calibration:
    """Write what gains of a calibration, and what the file knows besides, and return it.

    Parameters
    ----------
    found
        The calibration.
    path
        The file; one that is there keeps what it knows of other sensors.
    applied
        The file that the log was read with: a mounting is added to the one in it.

    Raises
    ------
    MissionError
        If nothing gains, the file cannot be read, or it has a mounting that the log was not read with.
    """
    if found.calibration.is_empty:
        raise MissionError(f"{path}: not written: {' '.join(map(str, found.sentences))}")
    whole = found.calibration
    if path.exists():
        before = read_calibration(path)
        whole = before.with_other(found.calibration)
        if before.mounting.any() and found.calibration.mounting.any():
            if applied is None or not applied.samefile(path):
                raise MissionError(
                    f"{path}: has a mounting already; accepted is another file, or the calibration in "
                    "log.toml of this log, to which the found angles are added"
                )
            both = Rotation.from_matrix(found.calibration.turn @ before.turn).as_euler("ZYX")
            whole = replace(whole, mounting=both[::-1].copy())
    whole.write(path)
    return whole


def applied_to(name: str) -> Path | None:
    """Return the calibration that a sensor log is read with, by its mission; None if there is none."""
    found = find_mission(name)
    return found.files.calibration if isinstance(found, LogMission) else None


def _paths(source: Source) -> list[Path]:
    return [Path(source)] if isinstance(source, str | Path) else [Path(one) for one in source]


def _name(source: Source) -> str:
    files = _paths(source)
    return str(files[0]) if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"


def _log_mission(source: Source) -> LogMission | None:
    """Return the mission if the source is a sensor log of the lab; None for files."""
    files = _paths(source)
    if len(files) != 1:
        return None
    path = files[0]
    if path.is_file() and path.suffix.lower() != ".toml":
        return None
    if not path.exists() and str(path) not in missions():
        raise MissionError(f"{path}: there is no such file and no such mission; accepted is a log")
    if path.is_dir() and not is_log_folder(path):
        raise MissionError(
            f"{path}: is a folder without a log; accepted are files, a mission, or a folder with log.toml, "
            "or with imu.csv and gnss.csv"
        )
    found = find_mission(str(path))
    if not isinstance(found, LogMission):
        raise MissionError(f"{path}: is a simulated mission; accepted is a log of real sensors")
    return found


def _field(source: Source, units: Mapping[str, str]) -> Magnetometer | None:
    """Return the fields of a log in the axes of the device."""
    log = _log_mission(source)
    if log is not None:
        return (
            log.files.of_device().read_field() if log.files.has_own_names else log.log.auxiliary.magnetometer
        )
    files = _paths(source)
    if len(files) == 1 and holds_samples(files[0]) and not has_reader(files[0]):
        rows = recorded_samples(files[0]).imu
        measured = np.isfinite(rows["magnetic"]).all(axis=1) & rows["magnetic"].any(axis=1)
        return Magnetometer(rows["time"], rows["magnetic"] * _MICROTESLA) if measured.any() else None
    reader = log_reader_of(files[0], units)
    if reader.read_logs is None:
        return read_log(files).auxiliary.magnetometer
    found = triads(sheets_of(files, units), "field")
    if not found:
        return None
    if not found[0].unit:
        columns = ", ".join(one.text for one in found[0].headings)
        raise MissionError(
            f"{files[0]}: the columns {columns} do not name their unit; accepted is --unit "
            f"{found[0].headings[0].text}=µT, for each of them"
        )
    return Magnetometer(found[0].clock.time, found[0].values * UNITS["magnetic field"][found[0].unit])
