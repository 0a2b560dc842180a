"""Recorded log: a raw recording as samples, and as a sensor log that can be navigated."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.files.mission_error import MissionError
from lab.data.checks.log_check import check_log
from lab.data.clock.timed_samples import NO_READINGS
from lab.data.formats import log_reader_of
from lab.data.log.sensor_log import SensorLog
from lab.data.protocols.catalogue import DECODERS
from lab.data.protocols.column_map import UNITS_OF, ColumnMap, ColumnMapError
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.capture import header_of, holds_samples, iterate_records, parse_rate, parse_said
from lab.data.streams.live_log import make_log
from lab.data.streams.raw_recording import (
    DATA,
    DEVICE_LOST,
    NEW_AXES,
    NEW_COLUMNS,
    NEW_UNIT,
    RecordingError,
    parse_event,
)
from lab.data.streams.reception import Reception
from lab.data.streams.transport import TransportError
from lab.data.streams.vehicle_rows import NO_FIXES, NO_IMU

Rows = NDArray[np.void]

_OWN_AXES = (
    "The axes of the device are taken to point forward, right and down, if the recording says nothing else; "
    "ins-lab import --as log --axes names others."
)


class RecordedSamples(NamedTuple):
    """What a raw recording holds.

    Attributes
    ----------
    imu : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples of the IMU.
    fix : (m,) array of `lab.data.clock.timed_samples.TIMED_FIX`
        Fixes.
    reception : Reception
        Which received them: protocol, timing, statistics and losses.
    header : dict
        What the recording says of its source.
    reading : (k,) array of `lab.data.clock.timed_samples.TIMED_READING`
        Headings and speeds.
    """

    imu: Rows
    fix: Rows
    reception: Reception
    header: dict[str, Any]
    reading: Rows = NO_READINGS


def make_reception(header: dict[str, Any], **options: str) -> Reception:
    """Return the reception that goes on where a recording began.

    Parameters
    ----------
    header
        What the recording says of its source.
    options
        Options in place of those in the header: ``protocol``, ``columns``, ``axes``, ``rate``; and what
        `parse_said` reads: ``column`` of text, and ``unit`` of a quantity.

    Raises
    ------
    TransportError
        If axes, columns or rate are not accepted, or the recording itself names a decoder of one's own.
    DecoderError, ColumnMapError
        If protocol or columns are not.
    """
    known = {**{name: header.get(name, "") for name in ("protocol", "columns", "axes", "rate")}, **options}
    if "protocol" not in options and known["protocol"] not in ("", *DECODERS):
        raise TransportError(
            f"the recording names the decoder {known['protocol']!r}, which is not one of the laboratory "
            "and is not executed; accepted is protocol=FILE.py:Name with a decoder that you trust"
        )
    axes, rate = str(known["axes"]), known["rate"] or 0.0
    columns: str | ColumnMap = str(known["columns"])
    if "columns" not in options:
        columns = _header_columns(str(columns), header.get("doubt"))
    reception = Reception(
        str(known["protocol"]),
        columns,
        AxisMap.of(axes) if axes else None,
        parse_rate(rate),
        said=parse_said(options.get("column", "")),
        units=parse_said(options.get("unit", "")),
    )
    reception.restore(header)
    return reception


def _header_columns(text: str, doubt: Any) -> str | ColumnMap:
    """Return the columns of a header, with the units that the rates may have."""
    if not text or not isinstance(doubt, list):
        return text
    known = tuple(unit for unit in doubt if isinstance(unit, str) and unit in UNITS_OF["rate"])
    return replace(ColumnMap.of(text), doubt=known if len(known) > 1 else ())


def recorded_samples(path: str | os.PathLike[str], **options: str) -> RecordedSamples:
    """Return all samples of a raw recording: those that the stream had, bit for bit.

    Parameters
    ----------
    path
        The recording.
    options
        As of `make_reception`.

    Raises
    ------
    RecordingError
        If it cannot be read.
    TransportError
        If its header or an option is not accepted.
    DecoderError
        If a decoder of one's own fails.
    """
    header = header_of(path, **options)
    reception = make_reception(header, **options)
    imu: list[Rows] = []
    fix, readings, arrival = [], [NO_READINGS], 0.0
    for kind, chunk in iterate_records(path, **options):
        if kind == DATA:
            arrival = chunk.arrival
            samples, fixes = reception.accept(chunk)
        else:
            event = parse_event(chunk.data)
            try:
                samples, fixes = _follow_event(reception, event, options)
            except ColumnMapError as error:
                raise RecordingError(f"{path}: {error}") from error
            if DEVICE_LOST in event:
                samples, fixes = reception.lose(arrival)
        # The unit of the rates is found late: what came before is scaled, what came now is right already.
        _scale(imu, reception.taken_factor())
        imu.append(samples)
        fix.append(fixes)
        readings.append(reception.taken_readings())
    # At the end as at a loss, what was held back comes out.
    samples, fixes = reception.lose(arrival)
    _scale(imu, reception.taken_factor())
    readings.append(reception.taken_readings())
    return RecordedSamples(
        np.concatenate([*imu, samples]),
        np.concatenate([*fix, fixes]),
        reception,
        header,
        np.concatenate(readings),
    )


def _follow_event(
    reception: Reception, event: Mapping[str, Any], options: Collection[str]
) -> tuple[Rows, Rows]:
    """Follow what changed while it was recorded, unless an option says it; return what comes of it."""
    if NEW_AXES in event and "axes" not in options:
        reception.rows.axes = AxisMap.of(str(event[NEW_AXES]))
    if NEW_UNIT in event and "unit" not in options:
        reception.answer(str(event[NEW_UNIT]))
    if NEW_COLUMNS in event and not {"columns", "column"} & set(options):
        return reception.name_columns(parse_said(str(event[NEW_COLUMNS])))
    return NO_IMU, NO_FIXES


def _scale(parts: list[Rows], factor: float) -> None:
    """Multiply the angular rates of samples whose unit was another one."""
    if factor != 1.0:
        for part in parts:
            part["rate"] *= factor


def log_of_recording(
    path: str | os.PathLike[str],
    *,
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    vehicle: str = "",
    **options: str,
) -> SensorLog:
    """Return a raw recording, or a capture of another program, as a sensor log.

    Parameters
    ----------
    path
        The recording.
    lever_arm
        From the IMU to the antenna, forward, right, down [m].
    vehicle
        Name of the vehicle, as in `lab.data.log.vehicle.VEHICLES`; empty if unknown.
    options
        As of `make_reception`.

    Raises
    ------
    RecordingError, TransportError, DecoderError
        As `recorded_samples`.
    MissionError
        If IMU and receiver have recorded too little together.
    """
    found = recorded_samples(path, **options)
    remarks = []
    axes = str(found.reception.rows.axes)
    if "axes" not in options and axes != str(make_reception(found.header, **options).rows.axes):
        found = recorded_samples(path, **options, axes=axes)
        remarks.append(f"The axes were changed to {axes} while it was recorded; they are used for all of it.")
    name, arm = Path(path).name, np.array(lever_arm)
    try:
        log = make_log(name, found.imu, found.fix, arm, vehicle=vehicle, readings=found.reading)
    except MissionError as error:
        raise MissionError(". ".join((str(error), *found.reception.fixes.positions))) from error
    if (found.fix["sea_level"] == 1).any():
        remarks.append("Heights are above the sea: the receiver does not give that of the geoid.")
    return replace(log, repairs=(*log.repairs, *remarks, *found.reception.fixes.positions))


def device_log(path: str | os.PathLike[str], vehicle: str = "", axes: Sequence[str] = ()) -> SensorLog | None:
    """Return the log of a file with the bytes of a device, checked; None for any other file.

    A file whose format has a reader of logs is another one, also if that reader refuses it.

    Parameters
    ----------
    path
        The file.
    vehicle
        As of `log_of_recording`.
    axes
        The axes of the device that point forward, right and down; empty for those of the recording.

    Raises
    ------
    RecordingError, TransportError, DecoderError
        As `recorded_samples`.
    MissionError
        If IMU and receiver have recorded too little together, or the log is implausible.
    """
    if not Path(path).is_file() or has_reader(Path(path)) or not holds_samples(path):
        return None
    if axes:
        log = log_of_recording(path, vehicle=vehicle, axes=",".join(axes))
    else:
        log = log_of_recording(path, vehicle=vehicle)
        log = replace(log, repairs=(_OWN_AXES, *log.repairs))
    check_log(log)
    return log


def has_reader(path: Path) -> bool:
    """Return whether a reader reads logs of a file's format."""
    try:
        return log_reader_of(path).read_log is not None
    except MissionError:
        return False
