"""FIT activities, read as fit-tool reads them; cameras with a course, damage, and what is missing."""

from __future__ import annotations

import struct
import sys

import numpy as np
import pytest
from fit_tool.base_type import BaseType
from fit_tool.developer_field import DeveloperField
from fit_tool.fit_file import FitFile
from fit_tool.profile.messages.developer_data_id_message import DeveloperDataIdMessage
from fit_tool.profile.messages.field_description_message import FieldDescriptionMessage
from fit_tool.profile.messages.gps_metadata_message import GpsMetadataMessage
from fit_tool.profile.messages.record_message import RecordMessage
from fit_tool.profile.messages.session_message import SessionMessage
from fit_tool.profile.profile_type import FileType, Sport
from processor_time import takes_less_than
from writers import fit as writer
from writers.resampled import resampled

from lab.data.files import fit
from lab.missions import MissionError, mission
from lab.motion.frames import ecef

READER = fit


def records(count: int, first: int = 0) -> list[RecordMessage]:
    """Return points, one a second, that go south by 1e-4° each and climb."""
    return [writer.record(first + i, -33.0 - 1e-4 * i, 151.0, 100.0 + i, 11.1) for i in range(count)]


def test_an_independent_parser_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = [
        one.message for one in FitFile.from_bytes(written).records if isinstance(one.message, RecordMessage)
    ]
    np.testing.assert_allclose(
        np.degrees(flight.latitude), [one.position_lat for one in theirs], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        np.degrees(flight.longitude), [one.position_long for one in theirs], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(flight.height, [one.enhanced_altitude for one in theirs], atol=1e-9)
    seconds = [(one.timestamp - theirs[0].timestamp) / 1000 for one in theirs]
    np.testing.assert_array_equal(flight.time - flight.time[0], seconds)
    assert len(theirs) == flight.rows_read == 206


def test_the_flight_is_the_one_that_was_written_over_midnight(file):
    recording = mission("montreal").recording
    flight = file(writer.write(recording))
    truth = resampled(recording, writer.RATE)
    np.testing.assert_allclose(flight.time, 86_400 - 90 + truth.time, atol=1e-6)
    place = np.column_stack((flight.latitude, flight.longitude, flight.height))
    off = np.abs(ecef.displacement(truth.position, place))
    assert off[:, :2].max() < 0.01 and off[:, 2].max() < 0.21
    assert flight.remarks[0] == "Time counts from 2024-05-17 00:00 UTC."
    assert "above sea level" in flight.remarks[1]
    assert "speed in the file is not used" in flight.remarks[2]
    assert flight.vehicle == "flying"
    assert flight.velocity_n is None


def test_points_without_a_fix_are_left_out_and_counted(file):
    points = records(12)
    points[2] = writer.record(2, None, None, 100.0, 1.0)
    points[5] = writer.record(5, 0.0, 0.0, 100.0, 1.0)
    flight = file(writer.log(points, Sport.DRIVING))
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [("without a fix", 2, 3)]
    assert flight.rows_read == 12
    np.testing.assert_allclose(np.degrees(flight.latitude)[[0, -1]], [-33.0, -33.0011], atol=1e-7)
    assert flight.vehicle == "car"


def test_a_camera_has_a_course_and_milliseconds_since_it_was_switched_on(file):
    points = []
    for i in range(40):
        message = GpsMetadataMessage()
        # fit-tool counts from 1970, FIT from the last day of 1989.
        message.timestamp = 631_065_600_000 + 1000 * (100 + i // 10)
        message.timestamp_ms = 100 * (i % 10)
        message.position_lat, message.position_long = 45.0, 7.0 + 1e-5 * i
        message.enhanced_altitude, message.enhanced_speed, message.heading = 200.0 + 0.5 * i, 8.0, 120.0
        points.append(message)
    flight = file(writer.log(points))
    np.testing.assert_allclose(flight.time, 100 + 0.1 * np.arange(40), atol=1e-9)
    angle = np.radians(120)
    expected = np.tile((8 * np.cos(angle), 8 * np.sin(angle)), (40, 1))
    np.testing.assert_allclose(flight.velocity_n[:, :2], expected, atol=1e-3)
    np.testing.assert_allclose(flight.velocity_n[:, 2], -5.0, atol=0.2)
    assert "switched on" in flight.remarks[0]


def test_a_field_of_an_app_is_not_taken_for_one_of_the_format(file):
    app, altitude = DeveloperDataIdMessage(), FieldDescriptionMessage()
    app.developer_data_index = altitude.developer_data_index = 0
    altitude.field_definition_number = 0
    altitude.fit_base_type_id = BaseType.FLOAT32.value
    altitude.field_name, altitude.units = "enhanced_altitude", "ft"
    points = records(12)
    for point in points:
        feet = DeveloperField(0, "enhanced_altitude", BaseType.FLOAT32, units="ft", size=4)
        feet.set_value(0, point.enhanced_altitude / 0.3048)
        point.developer_fields.append(feet)
    flight = file(writer.log([app, altitude, *points]))
    np.testing.assert_allclose(flight.height, 100.0 + np.arange(12), atol=0.2)


def test_a_course_is_told_apart_from_an_activity(file):
    planned = writer.log(records(12), file_type=FileType.COURSE)
    assert "a course, not an activity" in " ".join(file(planned).remarks)
    assert "a course" not in " ".join(file(writer.log(records(12))).remarks)


def test_the_sports_of_a_file_with_several_are_told_and_none_is_its_vehicle(file):
    ride = SessionMessage()
    ride.sport = Sport.DRIVING
    several = file(writer.log([ride, *records(12)], Sport.RUNNING))
    assert "several sports: driving, running" in " ".join(several.remarks)
    assert several.vehicle == ""
    assert file(writer.log([ride, *records(12)], Sport.DRIVING)).vehicle == "car"


def test_a_broken_off_file_and_a_wrong_checksum_are_said(file):
    written = writer.log(records(30))
    short = file(written[:-150])
    assert 20 < len(short.time) < 30
    assert "The file is broken: expected" in short.remarks[-1]
    changed = bytearray(written)
    changed[-40] ^= 1
    assert "checksum is wrong" in file(bytes(changed)).remarks[-1]
    assert "broken" not in " ".join(file(written).remarks)


def body(content: bytes) -> bytes:
    """Return a file with this between its header and its checksum."""
    return struct.pack("<BBHI4s", 12, 0x20, 2132, len(content), b".FIT") + content + b"\0\0"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (body(b""), "no positions"),
        (writer.log(records(3)), "3 of 3 points.*at least 4"),
        # Of a pool or a treadmill.
        (
            writer.log([writer.record(i, None, None, 9.0, 1.0) for i in range(9)]),
            "none of its 9 points has a position.*Accepted is an activity that was recorded with positions",
        ),
        # A record that nothing defines, and one that goes on beyond the end.
        (body(b"\x03\x01"), "no positions.* It is broken: .*not defined"),
        (body(b"\x40\0\0\x14\0\xff"), "no positions.* It is broken: expected"),
    ],
)
def test_what_is_no_activity_is_refused(file, data, words):
    with pytest.raises(MissionError, match=words):
        file(data)


def test_a_million_messages_that_say_nothing_are_refused_soon(file):
    empty = body(b"\x40\0\0\x14\0\0" + bytes(1_000_000))
    refused = pytest.raises(MissionError, match=r"more than \d+ messages in 1000020 bytes")
    with takes_less_than(5.0), refused:
        file(empty)


def test_without_fitdecode_the_message_names_the_command(file, monkeypatch):
    monkeypatch.setitem(sys.modules, "fitdecode", None)
    with pytest.raises(MissionError, match=r"needs fitdecode.*pip install 'ins-lab\[fit\]'"):
        file(writer.log(records(9)))


def test_units_cannot_be_given(file):
    with pytest.raises(MissionError, match="fixes its units"):
        file(writer.log(records(9)), {"altitude": "ft"})
