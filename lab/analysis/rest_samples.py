"""Rest samples: the gyros and accelerometers in any file, in the axes of the file, at rest or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.unit_names import UNITS
from lab.data.formats import log_reader_of
from lab.data.protocols.column_map import ColumnMapError
from lab.data.sheets.column_names import VECTORS
from lab.data.sheets.sensor_csv import names_quantity, sheets_of
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_imu import Triad, triads
from lab.data.streams.capture import holds_samples
from lab.data.streams.raw_recording import RecordingError
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.transport import TransportError
from lab.sensors.suite import TRIADS

OFF_GRAVITY = 0.1
"""Part by which the specific force at rest may differ from gravity: bias and scale factor of a consumer
accelerometer make 0.3 m/s² and 3 %, a wrong unit a factor of 9.8."""
_FORCE_UNITS = ("m/s²", "g", "mg")
_ROS = "angular velocity"
"""How headings of ROS name gyros, which are in rad/s (REP 103)."""


_BIAS_IN_DEGREES = (0.5, 30.0)
"""Numbers that are a bias in °/s and none in rad/s: data sheets allow 20 °/s (MPU-6050), which is 0.35 rad/s.
Counts of a converter are larger, or whole numbers."""


class Samples(NamedTuple):
    """Samples of a triad as a file has them: times [s], and rates [rad/s] or specific forces [m/s²]."""

    time: FloatArray
    values: FloatArray


def imu_samples(
    files: Sequence[Path], units: Mapping[str, str], rate: float = 0.0
) -> tuple[dict[str, Samples], list[str]]:
    """Return the samples of each triad in files, in the axes of the files, at rest or not; and remarks.

    Parameters
    ----------
    files, units, rate
        As of `lab.analysis.rest_recording.read_log`.

    Raises
    ------
    MissionError
        If a file cannot be read, or has no IMU.
    """
    try:
        reader = log_reader_of(files[0], units)
    except MissionError:
        if len(files) > 1 or not _is_of_device(files[0]):
            raise
        reader = None
    if reader is not None and rate:
        raise MissionError(f"{files[0]}: is {reader.name}, which has times; accepted is --rate without them")
    if reader is not None and reader.read_logs is not None and reader.read_imu is None:
        return _of_tables(files, units)
    if len(files) > 1 or (units and reader is not None):
        raise MissionError("several files, --unit and --column are for tables with named columns")
    if reader is not None and reader.read_imu is not None:
        imu = reader.read_imu(files[0])
        return {
            triad: Samples(imu.time, imu.values[:, 3 * k : 3 * k + 3]) for k, triad in enumerate(TRIADS)
        }, []
    if not _is_of_device(files[0]):
        raise MissionError(f"{files[0]}: is {reader.name if reader else 'unknown'}, which has no IMU")
    try:
        recorded = recorded_samples(files[0], **_options_of_text(units), rate=f"{rate:g}")
    except (RecordingError, TransportError, ColumnMapError) as error:
        raise MissionError(str(error)) from error
    found, doubt = recorded.imu, recorded.reception.doubt
    if doubt:
        raise MissionError(
            f"nothing names the unit of the angular rates, and at rest nothing shows it; accepted is "
            f"{' or '.join(f'--unit rate={unit}' for unit in doubt)}"
        )
    return {
        "gyro": Samples(found["time"], found["rate"]),
        "accelerometer": Samples(found["time"], found["force"]),
    }, []


def _options_of_text(units: Mapping[str, str]) -> dict[str, str]:
    """Return what a person says of text as options of a recording: of columns, and of units of quantities."""
    columns = ";".join(f"{name}={text}" for name, text in units.items() if names_quantity(text))
    others = ";".join(f"{name}={text}" for name, text in units.items() if not names_quantity(text))
    return {name: text for name, text in (("column", columns), ("unit", others)) if text}


def _is_of_device(path: Path) -> bool:
    return path.is_file() and holds_samples(path)


def _of_tables(files: Sequence[Path], units: Mapping[str, str]) -> tuple[dict[str, Samples], list[str]]:
    """Return the gyros and the accelerometers in tables with named columns."""
    sheets = sheets_of(files, units)
    gyros, forces = triads(sheets, "rate"), triads(sheets, "force")
    if not gyros and not forces:
        known = ", ".join(sorted({one.text for sheet in sheets for one in sheet.headings})) or "none"
        untimed = [one.name for one in sheets if one.has_imu and find_clock(one, fast=True) is None]
        if untimed:
            raise MissionError(
                f"no column of {', '.join(untimed)} has time stamps; columns that are read: {known}. "
                "Accepted is --column HEADING=time[ms]"
            )
        raise MissionError(
            f"no gyros and no accelerometers with three axes and time stamps; columns that are read: {known}"
            ". Accepted are headings such as gx_deg_s and fx_g, or what the columns are: "
            "--column HEADING=rate_x[°/s]"
        )
    found, remarks = {}, []
    gyro = gyros[0] if gyros else None
    force, why = _with_gravity(forces) if forces else (None, "")
    if gyro is not None:
        unit, how = (gyro.unit, "") if gyro.unit else _unit_of_gyros(gyro)
        found["gyro"] = _in_si(gyro, unit)
        remarks.append(f"Gyros: {_name_triad(gyro)}, in {unit}{how}.")
    if force is not None:
        found["accelerometer"] = _in_si(*force)
        remarks.append(f"Accelerometers: {_name_triad(force[0])}, in {force[1]}.")
    if why:
        if gyro is None:
            raise MissionError(why)
        remarks.append(f"No accelerometers are used: {why}.")
    for what, taken in (("gyros", gyros), ("accelerometers", forces)):
        if taken[1:]:
            remarks.append(f"Other {what} are not used: {', '.join(one.place for one in taken[1:])}.")
    return found, remarks


def _name_triad(triad: Triad) -> str:
    return ", ".join(one.text for one in triad.headings)


def _in_si(triad: Triad, unit: str) -> Samples:
    factor = UNITS[VECTORS[triad.headings[0].quantity]][unit]
    known = np.isfinite(triad.clock.time)
    return Samples(triad.clock.time[known], triad.values[known] * factor)


def _unit_of_gyros(gyro: Triad) -> tuple[str, str]:
    """Return the unit of gyros whose headings do not name it, and how it is known.

    Who writes such headings names it, or a rest whose rates, in rad/s, would be larger than any bias.
    """
    if gyro.headings[0].sensor.endswith(_ROS):
        return "rad/s", ""
    size = float(np.linalg.norm(np.nanmedian(gyro.values, axis=0)))
    is_counted = not (gyro.values[np.isfinite(gyro.values)] % 1).any()
    if _BIAS_IN_DEGREES[0] < size < _BIAS_IN_DEGREES[1] and not is_counted:
        return "°/s", f" (guessed: at rest they are {size:.3g}, more than any bias in rad/s)"
    first = gyro.headings[0].text
    raise MissionError(
        f"the columns {_name_triad(gyro)} do not name their unit, and at rest nothing shows it; accepted are "
        f"headings such as gyro_x_deg_s, or the unit of each column: --unit {first}=°/s"
    )


def _with_gravity(forces: Sequence[Triad]) -> tuple[tuple[Triad, str] | None, str]:
    """Return the first accelerometer with gravity in it and its unit; or why there is none."""
    why = ""
    for triad in forces:
        # Not the mean vector: in a log of several attitudes that has another size.
        size = float(np.nanmedian(np.linalg.norm(triad.values, axis=1)))
        sizes = {
            unit: size * UNITS["acceleration"][unit]
            for unit in ((triad.unit,) if triad.unit else _FORCE_UNITS)
        }
        for unit, force in sizes.items():
            if abs(force / STANDARD_GRAVITY - 1) <= OFF_GRAVITY:
                return (triad, unit), ""
        force = next(iter(sizes.values()))
        hint = "; this looks like g" if triad.unit == "m/s²" and abs(size - 1) < OFF_GRAVITY else ""
        said = (
            f"the mean specific force of {_name_triad(triad)} is {force:.4g} m/s²{hint}; accepted is a "
            "record at rest, with about 9.8 m/s²"
        )
        if force > (1 - OFF_GRAVITY) * STANDARD_GRAVITY or hint:
            raise MissionError(said)
        why = why or said
    return None, why
