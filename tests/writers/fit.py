"""FIT as a watch writes it, by fit-tool: a record a second, in semicircles (1 cm), heights to 0.2 m."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from fit_tool.fit_file_builder import FitFileBuilder
from fit_tool.profile.messages.file_id_message import FileIdMessage
from fit_tool.profile.messages.record_message import RecordMessage
from fit_tool.profile.messages.session_message import SessionMessage
from fit_tool.profile.profile_type import FileType, Manufacturer, Sport

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 23, 58, 30, tzinfo=UTC)
"""A minute and a half before midnight."""
RATE = 1.0


def record(second: float, lat: float | None, lon: float | None, height: float, speed: float) -> RecordMessage:
    """Return a point [°], [m], [m/s] at a time after the start [s]."""
    message = RecordMessage()
    message.timestamp = round(1000 * (START.timestamp() + second))
    if lat is not None and lon is not None:
        message.position_lat, message.position_long = lat, lon
    message.enhanced_altitude, message.enhanced_speed = height, speed
    return message


def log(records: list, sport: Sport = Sport.FLYING, file_type: FileType = FileType.ACTIVITY) -> bytes:
    """Return a file with these points."""
    builder = FitFileBuilder(auto_define=True)
    first = FileIdMessage()
    first.type, first.manufacturer = file_type, Manufacturer.DEVELOPMENT.value
    first.time_created = round(1000 * START.timestamp())
    last = SessionMessage()
    last.sport = sport
    for message in (first, *records, last):
        builder.add(message)
    return builder.build().to_bytes()


def write(recording: Recording) -> bytes:
    """Return the file of a flight."""
    flight = resampled(recording, RATE)
    rows = zip(
        flight.time.tolist(),
        np.degrees(flight.latitude).tolist(),
        np.degrees(flight.longitude).tolist(),
        flight.height.tolist(),
        np.hypot(flight.velocity_n[:, 0], flight.velocity_n[:, 1]).tolist(),
        strict=True,
    )
    return log([record(*row) for row in rows])
