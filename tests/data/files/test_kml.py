"""KML tracks, read as another parser reads them; what is hostile or drawn only is refused."""

from __future__ import annotations

import re
from datetime import datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from writers import kml as writer
from writers.resampled import resampled

from lab.data.files import kml
from lab.data.formats import reader_of
from lab.missions import MissionError, mission
from lab.motion.frames import ecef
from lab.views.export import kml as export
from lab.views.export.tracks import Track, Tracks

SPACES = {"gx": "http://www.google.com/kml/ext/2.2"}


def track(count: int, first: int = 0, lat: float = 45.0, mode: str = "absolute", zone: str = "Z") -> str:
    """Return a track, a point a second, going north by 1e-4° each."""
    whens = "".join(
        f"<when>2024-05-17T14:{(first + i) // 60:02d}:{(first + i) % 60:02d}{zone}</when>\n"
        for i in range(count)
    )
    coords = "".join(f"<gx:coord>-73.5 {lat + 1e-4 * i:.6f} {100 + i}</gx:coord>\n" for i in range(count))
    shown = f"<altitudeMode>{mode}</altitudeMode>" if mode else ""
    return f"<Placemark><gx:Track>{shown}\n{whens}{coords}</gx:Track></Placemark>"


def document(*tracks: str, before: str = "") -> str:
    return (
        f'<?xml version="1.0"?>{before}<kml xmlns="http://www.opengis.net/kml/2.2" '
        f'xmlns:gx="{SPACES["gx"]}">\n'
        f"<Document>{''.join(tracks)}</Document></kml>"
    )


@pytest.fixture
def file(tmp_path):
    """Return a function that writes text and reads it as KML."""

    def read(text: str | bytes, units=None):
        path = tmp_path / "track.dat"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        assert reader_of(path).name == kml.NAME
        return kml.read([path], units or {})

    return read


def test_another_parser_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = ElementTree.fromstring(written).find(".//gx:Track", SPACES)
    places = np.array([one.text.split() for one in theirs.findall("gx:coord", SPACES)], dtype=float)
    whens = [datetime.fromisoformat(one.text) for one in theirs.findall("{*}when")]
    np.testing.assert_allclose(np.degrees(flight.longitude), places[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(flight.latitude), places[:, 1], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(flight.height, places[:, 2])
    seconds = [(one - whens[0]).total_seconds() for one in whens]
    np.testing.assert_allclose(flight.time - flight.time[0], seconds, atol=1e-9)
    assert len(seconds) == flight.rows_read == 821


def test_the_flight_is_the_one_that_was_written_in_utc_and_over_midnight(file):
    recording = mission("montreal").recording
    flight = file(writer.write(recording))
    truth = resampled(recording, writer.RATE)
    np.testing.assert_allclose(flight.time, 86_400 - 90 + truth.time, atol=1e-6)
    place = np.column_stack((flight.latitude, flight.longitude, flight.height))
    assert np.abs(ecef.displacement(truth.position, place)).max() < 0.006
    assert flight.remarks[0] == "Time counts from 2024-05-17 00:00 UTC."
    assert "above sea level" in flight.remarks[1]


def test_the_longest_track_is_taken_and_the_rest_counted(file):
    flight = file(document(track(5), track(9, 10, lat=-10.0), track(6, 30)))
    assert len(flight.time) == 9
    assert flight.rows_read == 20
    np.testing.assert_allclose(np.degrees(flight.latitude), -10 + np.arange(9) * 1e-4)
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(11, 3)]
    assert flight.time[0] == 14 * 3600 + 10


def test_times_and_places_one_after_the_other_and_without_prefix(file):
    pairs = "".join(
        f"<when>2024-05-17T14:00:{i:02d}.250Z</when><coord>10.5,{-3 + i * 1e-4},7</coord>" for i in range(8)
    )
    flight = file(document(f"<Placemark><Track>{pairs}</Track></Placemark>"))
    np.testing.assert_allclose(np.degrees(flight.longitude), 10.5)
    np.testing.assert_allclose(np.degrees(flight.latitude), -3 + 1e-4 * np.arange(8))
    np.testing.assert_allclose(flight.time, 14 * 3600 + 0.25 + np.arange(8))


@pytest.mark.parametrize(
    ("mode", "words", "there"),
    [
        ("absolute", "above sea level", True),
        ("clampToGround", "drawn on the ground", True),
        ("", "drawn on the ground", True),
        ("relativeToGround", r"not used.*above the ground \(relativeToGround\)", False),
    ],
)
def test_what_is_said_of_heights(file, mode, words, there):
    flight = file(document(track(6, mode=mode)))
    assert (flight.height is not None) == there
    assert re.search(words, " ".join(flight.remarks))
    if there:
        np.testing.assert_array_equal(flight.height, 100 + np.arange(6))


def test_heights_that_are_all_zero_are_none(file):
    text = document(track(6))
    for i in range(6):
        text = text.replace(f" {100 + i}</gx:coord>", " 0</gx:coord>")
    assert file(text).height is None


def test_points_that_cannot_be_used_are_counted_with_their_line(file):
    text = document(track(10))
    text = text.replace("-73.5 45.000300 103", "").replace("-73.5 45.000500 105", "0 0 0")
    text = text.replace("2024-05-17T14:00:06Z", "2024-05")
    text = text.replace("-73.5 45.000700", "-73.5 95.000700")
    flight = file(text)
    assert [(drop.reason, drop.count, drop.first_row) for drop in flight.dropped] == [
        ("without a fix", 2, 6),
        ("without a time", 1, 9),
        ("without a position on the Earth", 1, 10),
    ]
    assert len(flight.time) == 6


def test_times_without_a_zone_and_what_is_beside_the_track_are_said(file):
    arrays = '<ExtendedData><SchemaData><gx:SimpleArrayData name="speed"><gx:value>3</gx:value>'
    arrays += "</gx:SimpleArrayData></SchemaData></ExtendedData>"
    text = document(track(6, zone="")).replace(
        "</gx:Track>", f"<gx:angles>9 0 0</gx:angles>{arrays}</gx:Track>"
    )
    said = " ".join(file(text).remarks)
    assert "6 times name no time zone and are taken as UTC" in said
    assert "not used: angles, speed" in said


def test_points_with_times_are_a_track_unless_there_is_one(file):
    """Flightradar24 exports a placemark for each point."""
    points = "".join(
        f"<Placemark><TimeStamp><when>2024-05-17T14:{i // 60:02d}:{i % 60:02d}+00:00</when></TimeStamp>"
        f"<Point><altitudeMode>absolute</altitudeMode><coordinates>-73.5,{45 + 1e-4 * i:.6f},{100 + i}"
        "</coordinates></Point></Placemark>"
        for i in range(70)
    )
    place = "<Placemark><name>CYUL</name><Point><coordinates>-73.7,45.4,30</coordinates></Point></Placemark>"
    flight = file(document(place, f"<Folder>{points}</Folder>"))
    np.testing.assert_allclose(np.diff(flight.time), 1.0)
    np.testing.assert_allclose(flight.height, 100 + np.arange(70))
    np.testing.assert_allclose(np.degrees(flight.latitude), 45 + 1e-4 * np.arange(70), atol=1e-9)
    assert len(file(document(track(90), points)).time) == 90


def test_a_copy_with_pressure_altitudes_is_not_taken(file):
    """GPSBabel writes the flight of an IGC file twice, the pressure altitudes first."""

    def named(name: str, height: int) -> str:
        text = re.sub(r" (\d+)</gx:coord>", lambda one: f" {int(one[1]) + height}</gx:coord>", track(20))
        return text.replace("<Placemark>", f"<Placemark><name>{name}</name>")

    flight = file(document(named("PRESALTTRK", -30), named("GNSSALTTRK", 0)))
    np.testing.assert_array_equal(flight.height, 100 + np.arange(20))
    assert flight.rows_read == 20
    assert not flight.dropped
    assert "The track PRESALTTRK is not used: its heights are pressure" in " ".join(flight.remarks)
    alone = file(document(named("PRESALTTRK", -30)))
    np.testing.assert_array_equal(alone.height, 70 + np.arange(20))


def test_a_broken_off_file_gives_what_it_holds(file):
    text = document(track(10))
    flight = file(text[: text.index("45.000600")])
    assert len(flight.time) == 6
    assert "broken in row" in flight.remarks[-1]


def test_more_times_than_places_are_refused_in_a_whole_file(file):
    text = document(track(10)).replace("<gx:coord>-73.5 45.000300 103</gx:coord>\n", "")
    with pytest.raises(MissionError, match=r"from row 3 on has 10 times .* and 9 places"):
        file(text)


def test_what_the_lab_draws_itself_has_no_times(file):
    flight = resampled(mission("montreal").recording, 1.0)
    drawn = export.text(Tracks("a", "b", Track("path", flight.time, flight.position), None, None))
    with pytest.raises(MissionError, match="no track with times, only 1 drawn lines and points"):
        file(drawn)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (document(track(3)), "3 of 3 points.*at least 4"),
        (document("<Placemark><gx:Track></gx:Track></Placemark>"), "no track with times"),
        ("<kml <", "no track with times. It is broken in row 1"),
        (document("<Folder>" * 200), "nested 101 deep"),
    ],
)
def test_what_is_no_track_is_refused(file, text, words):
    with pytest.raises(MissionError, match=words):
        file(text)


def test_a_document_type_is_refused(file):
    for doctype in (
        '<!DOCTYPE kml [<!ENTITY lol "lol"><!ENTITY lol1 "&lol;&lol;&lol;&lol;">]>',
        '<!DOCTYPE kml [<!ENTITY secret SYSTEM "file:///etc/passwd">]>',
        "<!DOCTYPE kml>",
    ):
        with pytest.raises(MissionError, match="document type"):
            file(document(track(9), before=doctype))


def test_units_cannot_be_given(file):
    with pytest.raises(MissionError, match="fixes its units"):
        file(document(track(9)), {"height": "ft"})
