"""Exported files, read by independent parsers: the same places, whatever the flight is called."""

from __future__ import annotations

from dataclasses import replace

import gpxpy
import numpy as np
import pytest
from lxml import etree
from scipy.spatial import cKDTree
from sensor_logs import tables, write

from lab import Experiment, Result, export_track
from lab.data.formats import read_raw
from lab.missions import MissionError, mission, read_flight_csv
from lab.motion.frames.rotation import wrap
from lab.views.export import make_tracks
from lab.views.export.kml import MAX_FIXES, MAX_POINTS
from lab.views.export.tracks import HEIGHTS, Track, Tracks

KML = "{http://www.opengis.net/kml/2.2}"
HOSTILE = "]]></name><script>alert('&amp;')</script>\x00\x0b\ud800 \"quoted\" <b> &lt; Zürich 東京"


@pytest.fixture(scope="module")
def result() -> Result:
    return Experiment(mission="montreal", seed=3).run()


def degrees(position: np.ndarray) -> np.ndarray:
    return np.column_stack((np.degrees(position[:, 0]), np.degrees(position[:, 1]), position[:, 2]))


def coordinates(element) -> np.ndarray:
    """Return latitude, longitude, height of a KML geometry."""
    rows = np.array([row.split(",") for row in element.findtext(f"{KML}coordinates").split()], dtype=float)
    return rows[:, (1, 0, 2)]


def places(path) -> dict[str, etree._Element]:
    """Return the placemarks of a KML file by name, once the file is what KML 2.2 asks for."""
    root = etree.parse(path, etree.XMLParser(resolve_entities=False)).getroot()
    assert root.tag == f"{KML}kml"
    document = root.find(f"{KML}Document")
    order = [child.tag.removeprefix(KML) for child in document]
    first = ["name", "open", "description", *["Style"] * 3, *["ExtendedData"] * ("ExtendedData" in order)]
    assert order == [*first, *["Placemark"] * (len(order) - len(first))]
    styles = {f"#{style.get('id')}" for style in document.findall(f"{KML}Style")}
    for mark in document.findall(f"{KML}Placemark"):
        tags = [child.tag.removeprefix(KML) for child in mark]
        assert tags[:3] == ["name", "description", "styleUrl"]
        assert tags[3] in {"LineString", "MultiGeometry"}
        assert mark.findtext(f"{KML}styleUrl") in styles
        for geometry in mark.iter(f"{KML}LineString", f"{KML}Point"):
            assert [child.tag for child in geometry] == [f"{KML}altitudeMode", f"{KML}coordinates"]
            assert geometry.findtext(f"{KML}altitudeMode") == "absolute"
            assert (np.abs(coordinates(geometry)[:, :2]) <= (90, 180)).all()
    return {mark.findtext(f"{KML}name"): mark for mark in document.findall(f"{KML}Placemark")}


def test_google_earth_gets_both_paths_and_the_fixes(result, tmp_path):
    path = tmp_path / "run.kml"
    export_track(result, path)
    marks = places(path)
    assert list(marks) == ["Truth", "Estimate", "GPS fixes"]
    for name, position in (
        ("Truth", result.truth_arrays.position),
        ("Estimate", result.solution_arrays.position),
    ):
        drawn, whole = coordinates(marks[name].find(f"{KML}LineString")), degrees(position)
        assert 1000 < len(drawn) <= MAX_POINTS < len(whole)
        assert f"{len(drawn)} of {len(whole)} points" in marks[name].findtext(f"{KML}description")
        # The ends are drawn, and no point of the path is far from one that is.
        np.testing.assert_allclose(drawn[[0, -1]], whole[[0, -1]], atol=1e-4)
        metres = (111_000, 78_000, 1)
        assert cKDTree(drawn * metres).query(whole * metres)[0].max() < 2.0
    fixes = np.concatenate([coordinates(point) for point in marks["GPS fixes"].iter(f"{KML}Point")])
    np.testing.assert_allclose(fixes, degrees(result.fixes.position), atol=1e-4, rtol=0)
    assert HEIGHTS in etree.parse(path).getroot().findtext(f"{KML}Document/{KML}description")


def test_maps_get_tracks_with_time_and_height(result, tmp_path):
    path = tmp_path / "run.gpx"
    export_track(result, path)
    parsed = gpxpy.parse(path.read_text(encoding="utf-8"))
    assert [track.name for track in parsed.tracks] == ["Truth", "Estimate", "GPS fixes"]
    points = parsed.tracks[0].segments[0].points
    seconds = np.array([(point.time - points[0].time).total_seconds() for point in points])
    np.testing.assert_allclose(np.diff(seconds)[:-1], 0.1, atol=1e-9)
    rows = np.searchsorted(result.time, seconds - 1e-6)
    there = np.array([(point.latitude, point.longitude, point.elevation) for point in points])
    np.testing.assert_allclose(there, degrees(result.truth_arrays.position[rows]), atol=1e-4, rtol=0)
    # What the lab writes the lab reads.
    flight = read_raw(path)
    assert flight.format == "GPX"
    assert len(flight.time) == len(points)


def test_a_flight_csv_is_the_estimate_and_a_mission_of_its_own(result, tmp_path):
    path = tmp_path / "run.csv.gz"
    export_track(result, path)
    flight = read_flight_csv(path)
    np.testing.assert_allclose(flight.velocity_n, result.solution_arrays.velocity_n, atol=1e-8)
    np.testing.assert_allclose(wrap(flight.euler - result.euler), 0, atol=1e-8)
    np.testing.assert_allclose(flight.latitude, result.solution_arrays.position[:, 0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("ending", [".kml", ".gpx", ".csv"])
def test_a_mission_is_exported_as_recorded(ending, tmp_path):
    source, path = mission("los_angeles"), tmp_path / f"flight{ending}"
    export_track(source, path)
    recording = source.recording
    whole = np.column_stack((recording.latitude, recording.longitude, recording.height))
    if ending == ".kml":
        drawn = coordinates(places(path)["Flight"].find(f"{KML}LineString"))
        np.testing.assert_allclose(drawn[[0, -1]], degrees(whole)[[0, -1]], atol=1e-4)
    elif ending == ".gpx":
        last = gpxpy.parse(path.read_text(encoding="utf-8")).tracks[0].segments[0].points[-1]
        np.testing.assert_allclose((last.latitude, last.longitude), degrees(whole)[-1, :2], atol=1e-8)
    else:
        np.testing.assert_allclose(read_flight_csv(path).euler, recording.euler, atol=1e-10)


def test_a_log_has_its_fixes_and_its_reference(tmp_path):
    log = mission(write(tmp_path / "drive", tables(60, 75), 'title = "Drive"'))
    export_track(log, tmp_path / "drive.kml")
    assert list(places(tmp_path / "drive.kml")) == ["Reference", "GPS fixes"]
    with pytest.raises(MissionError, match="sensor log"):
        export_track(log, tmp_path / "drive.csv")
    (tmp_path / "drive" / "ref.csv").unlink()
    export_track(mission(tmp_path / "drive"), tmp_path / "drive.gpx")
    assert [one.name for one in gpxpy.parse((tmp_path / "drive.gpx").read_text()).tracks] == ["GPS fixes"]


def test_names_stay_names(tmp_path):
    source = replace(mission("montreal"), title=HOSTILE, description=HOSTILE)
    expected = HOSTILE.replace("\x00", "�").replace("\x0b", "�").replace("\ud800", "�")
    export_track(source, tmp_path / "a.kml")
    root = etree.parse(tmp_path / "a.kml").getroot()
    without_tags = expected.replace("<", "‹").replace(">", "›")  # Google Earth takes both for HTML
    assert root.findtext(f"{KML}Document/{KML}name") == without_tags
    assert root.findtext(f"{KML}Document/{KML}description").startswith(without_tags)
    assert not root.findall(".//{*}script")
    export_track(source, tmp_path / "a.gpx")
    assert gpxpy.parse((tmp_path / "a.gpx").read_text(encoding="utf-8")).name == expected


def test_long_flights_are_thinned_and_the_date_line_is_crossed(tmp_path):
    time = np.arange(40_000) * 0.02
    longitude = np.radians(179.9 + 0.0004 * time)
    position = np.column_stack((np.radians(-17 + 1e-3 * np.sin(time / 20)), longitude, 100 + time))
    track = Track.of("Long", time, position)
    from lab.views.export import gpx, kml

    both = Tracks("Long", "", track, None, replace(track, name="Fixes"))
    (tmp_path / "long.kml").write_text(kml.text(both))
    marks = places(tmp_path / "long.kml")
    assert len(coordinates(marks["Long"].find(f"{KML}LineString"))) <= MAX_POINTS
    root = etree.parse(tmp_path / "long.kml").getroot()
    assert len(root.findall(f".//{KML}Point")) <= MAX_FIXES
    assert len(gpxpy.parse(gpx.text(both)).tracks[0].segments[0].points) == 8_001
    assert make_tracks(mission("montreal")).known[0].name == "Flight"


def test_what_cannot_be_written_is_refused(tmp_path):
    source = mission("montreal")
    (tmp_path / "there.kml").write_text("kept")
    with pytest.raises(FileExistsError, match="exists already"):
        export_track(source, tmp_path / "there.kml")
    with pytest.raises(ValueError, match=r"\.kml, \.gpx, \.csv, \.csv\.gz"):
        export_track(source, tmp_path / "there.shp")
    with pytest.raises(FileNotFoundError, match="no folder"):
        export_track(source, tmp_path / "no" / "a.kml")
    assert [path.name for path in tmp_path.iterdir()] == ["there.kml"]
    assert (tmp_path / "there.kml").read_text() == "kept"
    export_track(source, tmp_path / "there.kml", overwrite=True)
    assert places(tmp_path / "there.kml")
