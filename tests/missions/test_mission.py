"""Missions: one TOML file and one recording; shipped and own side by side; a broken one hides no other."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from flights import circle
from processor_time import takes_less_than

from lab.missions import (
    Mission,
    MissionError,
    broken_missions,
    mission,
    missions,
    own_folder,
    shipped_folder,
    write_flight_csv,
)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Return an empty folder of the user's own missions."""
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    return tmp_path


def add(folder: Path, name: str, toml: str | None = None) -> Path:
    """Add a mission to a folder and return its TOML file."""
    write_flight_csv(folder / f"{name}.csv", circle())
    path = folder / f"{name}.toml"
    path.write_text(toml or f'title = "Mine"\nrecording = "{name}.csv"\n', encoding="utf-8")
    return path


def test_a_mission_is_read(folder):
    path = add(
        folder,
        "circle",
        '\ufefftitle = "A circle"\r\nrecording = "circle.csv"\r\ndescription = "Round"\r\n'
        'origin = "computed"\r\n'
        'aircraft = "none"\r\nairport = "nowhere"\r\ntags = ["a", "b"]\r\n',
    )
    found = mission("circle")
    assert (found.name, found.title, found.description) == ("circle", "A circle", "Round")
    assert (found.origin, found.aircraft, found.airport) == ("computed", "none", "nowhere")
    assert found.tags == ("a", "b")
    assert found.path == path
    assert found.duration == pytest.approx(399 * 0.25)
    assert found.recording is found.recording
    assert found.content_hash == hashlib.sha256((folder / "circle.csv").read_bytes()).hexdigest()
    with pytest.raises(MissionError, match=r"no \[flight\] table"):
        _ = found.plan


def test_own_missions_are_listed_beside_the_shipped(folder):
    add(folder, "circle")
    assert own_folder() == folder
    assert list(missions()) == ["los_angeles", "montreal", "pacific", "circle"]
    assert {"los_angeles", "montreal"} <= {path.stem for path in shipped_folder().glob("*.toml")}


def test_a_missing_own_folder_is_no_error(folder, monkeypatch):
    for named in (str(folder / "nowhere"), "~no_such_user/missions"):
        monkeypatch.setenv("INS_LAB_MISSIONS", named)
        assert list(missions()) == ["los_angeles", "montreal", "pacific"]
    monkeypatch.delenv("INS_LAB_MISSIONS")
    monkeypatch.setenv("XDG_DATA_HOME", str(folder))
    assert own_folder().name == "missions"
    assert "ins-lab" in own_folder().parts


def test_an_own_mission_of_a_shipped_name_hides_nothing(folder):
    add(folder, "montreal")
    assert list(missions()) == ["los_angeles", "montreal", "pacific", "user:montreal"]
    assert mission("montreal").path == shipped_folder() / "montreal.toml"
    assert mission("user:montreal").path == folder / "montreal.toml"
    assert mission(folder / "montreal.toml").name == "user:montreal"


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("title = ", "is not TOML"),
        ("\0", "is not TOML"),
        ("a = " + "[" * 5000, "brackets inside one another"),
        ('recording = "broken.csv"', "title is missing"),
        ('title = "x"', "recording is missing"),
        ('titel = "x"\nrecording = "broken.csv"', r"no key 'titel'. Did you mean title\?"),
        ('title = 3\nrecording = "broken.csv"', "title = 3; accepted is text"),
        ('title = "x"\nrecording = ["broken.csv"]', "recording = .*; accepted is text"),
        ('title = "x"\nrecording = "broken.csv"\ntags = "a"', "tags = 'a'; accepted is a list"),
        ('title = "x"\nrecording = "broken.csv"\nflight = 1', "flight is not a table"),
        ('title = "x"\nrecording = "other.csv"', "recording other.csv does not exist"),
    ],
)
def test_a_broken_mission_is_named_and_hides_no_other(folder, toml, message):
    add(folder, "broken", toml)
    add(folder, "sound")
    with pytest.warns(UserWarning, match="broken.toml"):
        assert list(missions()) == ["los_angeles", "montreal", "pacific", "sound"]
    assert list(broken_missions()) == ["broken"]
    assert re.search(message, broken_missions()["broken"])
    with pytest.raises(MissionError, match=message):
        mission("broken")


@pytest.mark.parametrize(
    "recording",
    [
        "../circle.csv",
        "/etc/passwd",
        "sub/circle.csv",
        "..",
        ".",
        "C:circle.csv",
        "..\\\\circle.csv",
        "a\\u0000b",
    ],
)
def test_a_recording_elsewhere_is_refused(folder, recording):
    path = add(folder, "trick", f'title = "x"\nrecording = "{recording}"\n')
    with pytest.raises(MissionError, match="accepted is the plain name of a file in the same folder"):
        Mission.from_toml(path)


def test_a_link_that_leads_elsewhere_is_refused(folder):
    own = folder / "own"
    own.mkdir()
    path = add(own, "link")
    write_flight_csv(folder / "outside.csv", circle())
    (own / "link.csv").unlink()
    (own / "link.csv").symlink_to(folder / "outside.csv")
    with pytest.raises(MissionError, match="in the same folder"):
        Mission.from_toml(path)
    (own / "link.csv").unlink()
    (own / "link.csv").symlink_to(own / "link.csv")
    with pytest.raises(MissionError, match="in the same folder"):
        Mission.from_toml(path)


def test_an_unknown_name_is_answered_with_those_there_are(folder):
    add(folder, "circle")
    with pytest.raises(
        MissionError,
        match=r"'montrael'. Did you mean montreal\? Accepted: los_angeles, montreal, pacific, circle",
    ):
        mission("montrael")
    with pytest.raises(MissionError, match="there is no mission ''"):
        mission("")


def test_a_file_that_is_no_mission_yet_is_one_after_its_import(tmp_path: Path) -> None:
    path = tmp_path / "drive.ulg"
    path.write_bytes(b"ULog")
    with pytest.raises(MissionError, match=r"is a file, and no mission yet; ins-lab import .* --as log"):
        mission(str(path))


def test_paths_serve_as_names(tmp_path):
    toml = add(tmp_path, "elsewhere")
    for path in (toml, toml.with_suffix(".csv"), str(toml), str(toml.with_suffix(".csv"))):
        found = mission(path)
        assert found.duration == pytest.approx(399 * 0.25)
        assert mission(found.name).recording_path == found.recording_path


@pytest.mark.parametrize(
    "path",
    [
        "no.csv",
        "no.csv.gz",
        "no.toml",
        "nul\0.csv",
        "nul\0.toml",
        "~nobody_here/a.csv",
        "~nobody_here/a.toml",
    ],
)
def test_paths_that_lead_nowhere(path):
    with pytest.raises(MissionError, match=r"no such|cannot be read"):
        mission(path)


def test_a_mission_shows_itself_in_jupyter():
    for shown in missions().values():
        html = shown._repr_html_()
        card = ElementTree.fromstring(html)
        assert len(list(card.iter("svg"))) == 1
        assert f"{shown.duration:.2f} s" in html
        assert shown.name in repr(shown)


def test_a_mission_with_a_bad_recording_shows_why_in_jupyter(folder):
    toml = add(folder, "bad", 'title = "<script>"\nrecording = "bad.csv"\n')
    toml.with_suffix(".csv").write_text("time_s\n<b>\n", encoding="utf-8")
    html = mission("bad")._repr_html_()
    assert "latitude_deg" in html
    assert "<script>" not in html


def test_too_large_a_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(2 * 2**30)
    flight = Mission.from_csv(huge)
    refused = pytest.raises(MissionError, match=r"huge\.csv: 2048 MB; accepted are files up to 256 MB")
    with takes_less_than(0.5), refused:
        _ = flight.content_hash
