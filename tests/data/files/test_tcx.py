"""TCX activities, read as another parser reads them; laps, several activities, points without a fix."""

from __future__ import annotations

from datetime import datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from writers import tcx as writer
from writers.resampled import resampled

from lab.data.files import tcx
from lab.missions import MissionError, mission
from lab.motion.frames import ecef

READER = tcx


def points(count: int, first: int = 0, lat: float = 45.0) -> str:
    """Return track points, one a second, going north by 1e-4° each."""
    return "\n".join(
        f"<Trackpoint><Time>2024-05-17T14:00:{first + i:02d}Z</Time><Position><LatitudeDegrees>"
        f"{lat + 1e-4 * i:.6f}</LatitudeDegrees><LongitudeDegrees>-73.5</LongitudeDegrees></Position>"
        f"<AltitudeMeters>{100 + i}</AltitudeMeters></Trackpoint>"
        for i in range(count)
    )


def activity(*laps: str, kind: str = "Activity") -> str:
    inside = "".join(f"<Lap><Track>{lap}</Track></Lap>" for lap in laps)
    return f'<{kind} Sport="Running">{inside}</{kind}>'


def document(*activities: str, before: str = "") -> str:
    return (
        f'<?xml version="1.0"?>{before}<TrainingCenterDatabase '
        f'xmlns="{writer.SPACE}/TrainingCenterDatabase/v2">\n'
        f"<Activities>{''.join(activities)}</Activities></TrainingCenterDatabase>"
    )


def test_another_parser_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = ElementTree.fromstring(written).findall(".//{*}Trackpoint")
    for ours, name in (
        (np.degrees(flight.latitude), "LatitudeDegrees"),
        (np.degrees(flight.longitude), "LongitudeDegrees"),
        (flight.height, "AltitudeMeters"),
    ):
        numbers = [float(one.find(f".//{{*}}{name}").text) for one in theirs]
        np.testing.assert_allclose(ours, numbers, rtol=0, atol=1e-12)
    times = [datetime.fromisoformat(one.find("{*}Time").text) for one in theirs]
    seconds = [(one - times[0]).total_seconds() for one in times]
    np.testing.assert_array_equal(flight.time - flight.time[0], seconds)
    assert len(seconds) == flight.rows_read == 206


def test_the_flight_is_the_one_that_was_written_lap_after_lap_and_over_midnight(file):
    recording = mission("montreal").recording
    flight = file(writer.write(recording))
    truth = resampled(recording, writer.RATE)
    np.testing.assert_allclose(flight.time, 86_400 - 90 + truth.time, atol=1e-6)
    place = np.column_stack((flight.latitude, flight.longitude, flight.height))
    off = np.abs(ecef.displacement(truth.position, place))
    assert off[:, :2].max() < 0.001 and off[:, 2].max() < 0.051
    assert flight.remarks[0] == "Time counts from 2024-05-17 00:00 UTC."
    assert "above sea level" in flight.remarks[1]
    assert "speed in the file is not used" in flight.remarks[2]
    assert flight.vehicle == "Other"
    assert flight.velocity_n is None


def test_the_longest_activity_is_taken_with_all_its_laps(file):
    flight = file(document(activity(points(7)), activity(points(5, 10, lat=-10), points(6, 15, lat=-9))))
    assert len(flight.time) == 11
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [
        ("of a shorter activity", 7, 2)
    ]
    assert flight.rows_read == 18
    np.testing.assert_array_equal(flight.time, 14 * 3600 + 10 + np.arange(11))
    assert np.degrees(flight.latitude).max() < -8.9


def test_points_without_a_fix_are_left_out_and_counted(file):
    lines = points(12).split("\n")
    lines[3] = "<Trackpoint><Time>2024-05-17T14:00:03Z</Time><AltitudeMeters>9</AltitudeMeters></Trackpoint>"
    lines[5] = lines[5].replace("45.000500", "0").replace("-73.5", "0")
    lines[7] = lines[7].replace("2024-05-17T14:00:07Z", "noon")
    flight = file(document(activity("\n".join(lines))))
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [
        ("without a fix", 2, 5),
        ("without a time", 1, 9),
    ]
    assert len(flight.time) == 9


def test_time_zones_encodings_and_no_heights(file):
    text = document(activity(points(6))).replace("Z</Time>", "-05:00</Time>")
    for i in range(6):
        text = text.replace(f"<AltitudeMeters>{100 + i}</AltitudeMeters>", "")
    text = text.replace('"1.0"?>', '"1.0" encoding="UTF-16"?>')
    flight = file(text.encode("utf-16"))
    assert flight.time[0] == 19 * 3600
    assert flight.height is None


def test_a_course_is_read_and_called_so(file):
    flight = file(document(activity(points(6), kind="Course")))
    assert "its times may be planned" in " ".join(flight.remarks)


def test_a_broken_off_file_gives_what_it_holds(file):
    text = document(activity(points(10)))
    flight = file(text[: text.index("45.000600")])
    assert len(flight.time) == 6
    assert "broken in row" in flight.remarks[-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (document(activity(points(3))), "3 of 3 points.*at least 4"),
        (document(), "no track points"),
        ("<TrainingCenterDatabase <", "no track points. It is broken in row 1"),
        (document("<Lap>" * 200), "nested 101 deep"),
        (document(activity(points(9)), before="<!DOCTYPE a>"), "document type"),
        (
            document(activity(points(9)), before='<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'),
            "document type",
        ),
    ],
)
def test_what_is_no_track_is_refused(file, text, words):
    with pytest.raises(MissionError, match=words):
        file(text)


def test_units_cannot_be_given(file):
    with pytest.raises(MissionError, match="fixes its units"):
        file(document(activity(points(9))), {"AltitudeMeters": "ft"})
