"""GPX tracks, read as an independent parser reads them; what is hostile or no track is refused."""

from __future__ import annotations

import gpxpy
import numpy as np
import pytest
from writers import gpx as writer

from lab.data.files import gpx
from lab.missions import ImportSettings, MissionError, mission, prepare_import

READER = gpx

POINT = '<trkpt lat="{lat}" lon="{lon}"><ele>{ele}</ele><time>2024-05-17T14:00:{second:06.3f}Z</time></trkpt>'


def points(count: int, first: float = 0.0, lat: float = 45.0) -> str:
    return "\n".join(
        POINT.format(lat=lat + i * 1e-4, lon=-73.0, ele=100 + i, second=first + i) for i in range(count)
    )


def document(*segments: str, before: str = "", inside: str = "") -> str:
    body = "".join(f"<trkseg>{segment}</trkseg>" for segment in segments)
    return (
        f'<?xml version="1.0"?>{before}<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"{inside}<trk>{body}</trk></gpx>"
    )


def test_an_independent_parser_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = gpxpy.parse(written.decode()).tracks[0].segments[0].points
    assert len(flight.time) == len(theirs) == flight.rows_read
    np.testing.assert_allclose(np.degrees(flight.latitude), [p.latitude for p in theirs], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.degrees(flight.longitude), [p.longitude for p in theirs], rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(flight.height, [p.elevation for p in theirs])
    seconds = [(p.time - theirs[0].time).total_seconds() for p in theirs]
    np.testing.assert_array_equal(flight.time - flight.time[0], seconds)
    assert flight.vehicle == "flying"
    assert flight.velocity_n is None
    assert flight.euler is None
    assert "above sea level" in " ".join(flight.remarks)


def test_a_copy_with_pressure_altitudes_is_not_taken(file):
    """GPSBabel writes the flight of an IGC file twice, the pressure altitudes first."""
    low = points(9).replace("<ele>", "<ele>-")
    tracks = [
        f"<trk><name>{name}</name><trkseg>{one}</trkseg></trk>"
        for name, one in (("PRESALTTRK", low), ("GNSSALTTRK", points(9)))
    ]
    flight = file(document(inside="".join(tracks)))
    np.testing.assert_array_equal(flight.height, 100 + np.arange(9))
    assert flight.rows_read == 9
    assert not flight.dropped
    assert "The track PRESALTTRK is not used: its heights are pressure" in " ".join(flight.remarks)
    alone = file(document(inside=tracks[0]))
    np.testing.assert_array_equal(alone.height, -100 - np.arange(9))


def test_the_longest_segment_is_taken_and_the_rest_counted(file):
    flight = file(document(points(5), points(9, 10, lat=10.0), points(6, 30)))
    assert len(flight.time) == 9
    assert flight.rows_read == 20
    np.testing.assert_allclose(np.degrees(flight.latitude), 10 + np.arange(9) * 1e-4)
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(11, 2)]
    assert flight.time[0] == 14 * 3600 + 10


def test_segments_of_one_way_are_one_track(file, tmp_path):
    whole = points(40).split("\n")
    parts = ["\n".join(part) for part in (whole[:9], whole[9:11], whole[14:30], whole[37:])]
    flight = file(document(*parts))
    assert len(flight.time) == 30
    assert not flight.dropped
    made = prepare_import(tmp_path / "log.dat")
    assert len(made.flight.raw.time) == 27  # bridged are five usual steps, not the eight at the end
    assert "--set longest_gap=8 keeps 100 % of the samples" in str(made.report).replace("\n", " ").replace(
        "                     ", ""
    )
    assert "cut at pauses longer than 5 s" in " ".join(str(made.report).split())
    assert len(prepare_import(tmp_path / "log.dat", ImportSettings(longest_gap=8.0)).flight.raw.time) == 30
    # Another receiver at the same time, and one that is elsewhere, are other tracks.
    flight = file(document(parts[2], parts[2].replace('lon="-73.0"', 'lon="-73.001"'), points(8, 40, lat=46)))
    assert len(flight.time) == 16


def test_points_that_cannot_be_used_are_counted_with_their_line(file):
    lines = points(10).split("\n")
    lines[3] = lines[3].replace('lat="45.0003"', 'lat="north"')
    lines[5] = '<trkpt lat="45" lon="-73"><ele>3</ele></trkpt>'
    lines[6] = '<trkpt lat="45" lon="-73"><ele>3</ele><time>yesterday</time></trkpt>'
    lines[8] = lines[8].replace("<ele>108</ele>", "<ele>-99999</ele>")
    flight = file(document("\n".join(lines)))
    # With the header in the first line, the n-th point is in line n + 2 counted from 0.
    assert [(drop.reason.split(" ")[2], drop.count, drop.first_row) for drop in flight.dropped] == [
        ("time", 2, 7),
        ("position", 1, 5),
        ("height", 1, 10),
    ]
    assert len(flight.time) == 6


def test_points_without_a_fix_are_left_out_and_counted(file):
    zeros = "\n".join(POINT.format(lat=0, lon="0.0000000", ele=0, second=i) for i in range(6))
    flight = file(document(zeros + "\n" + points(9, 6)))
    assert len(flight.time) == 9
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(6, 2)]
    assert "0° N 0° E" in flight.dropped[0].reason


def test_speed_and_course_are_the_velocity_where_they_are_known(file):
    time = np.arange(40.0)
    course = np.radians(350.0 + 2 * time)
    extra = "<extensions><t:x><t:speed>{}</t:speed><t:course>{}</t:course></t:x></extensions></trkpt>"
    lines = [
        line.replace("</trkpt>", extra.format(20.0, np.degrees(angle) % 360))
        for line, angle in zip(points(40).split("\n"), course, strict=True)
    ]
    flight = file(document("\n".join(lines)).replace("<gpx ", '<gpx xmlns:t="x" '))
    np.testing.assert_allclose(flight.velocity_n[:, 0], 20 * np.cos(course), atol=1e-9)
    np.testing.assert_allclose(flight.velocity_n[:, 1], 20 * np.sin(course), atol=1e-9)
    np.testing.assert_allclose(flight.velocity_n[:, 2], -1.0, atol=1e-9)  # it climbs a metre a second
    assert [unit.column for unit in flight.units] == ["lat", "lon", "ele", "speed", "course"]


def test_a_broken_off_file_gives_what_it_holds(file):
    text = document(points(10))
    flight = file(text[: text.index("45.0006")])
    assert len(flight.time) == 6
    assert "broken in row" in flight.remarks[-1]


def test_other_encodings_time_zones_and_no_heights(file):
    text = document(points(5)).replace("Z</time>", "+02:00</time>")
    text = text.replace('"1.0"?>', '"1.0" encoding="UTF-16"?>')
    for height in range(100, 105):
        text = text.replace(f"<ele>{height}</ele>", "")
    flight = file(text.encode("utf-16"))
    assert flight.time[0] == 12 * 3600
    assert flight.height is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (document(points(3)), "3 of 3 points.*at least 4"),
        (
            document("".join('<trkpt lat="1" lon="2"></trkpt>' for _ in range(9))),
            "none of the 9.*planned routes",
        ),
        (
            document("".join(POINT.format(lat=0, lon=0, ele=3, second=i % 60) for i in range(37))),
            "0 of 37 points.*37 from row 2 on: at 0° N 0° E",
        ),
        ('<gpx version="1.1"><rte><rtept lat="1" lon="2"/></rte></gpx>', "no track points"),
        ("<gpx <", "no track points. It is broken in row 1"),
    ],
)
def test_what_is_no_track_is_refused(file, text, words):
    with pytest.raises(MissionError, match=words):
        file(text)


def test_units_cannot_be_given(file):
    with pytest.raises(MissionError, match="fixes its units"):
        file(document(points(9)), {"ele": "ft"})


BILLION_LAUGHS = (
    '<!DOCTYPE lolz [<!ENTITY lol "lol">'
    + "".join(f'<!ENTITY lol{i + 1} "{f"&lol{i or str()};" * 10}">' for i in range(9))
    + "]>"
)


@pytest.mark.parametrize(
    "doctype",
    [
        BILLION_LAUGHS,
        '<!DOCTYPE gpx [<!ENTITY secret SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE gpx SYSTEM "http://example.org/gpx.dtd">',
        "<!DOCTYPE gpx>",
    ],
)
def test_a_document_type_is_refused(file, doctype):
    for name in ("&lol9;", "&secret;", "plain"):
        text = document(points(9), before=doctype, inside=f"<metadata><name>{name}</name></metadata>")
        with pytest.raises(MissionError, match="document type"):
            file(text)


def test_an_entity_nobody_declared_is_no_reason_to_lose_what_came_before(file):
    text = document(points(6) + "<trkpt>&secret;</trkpt>" + points(2, 6))
    assert len(file(text).time) == 6
