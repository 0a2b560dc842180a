"""What a mission is called is text in what is exported, too: a viewer of KML takes descriptions for HTML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from lab.missions import Mission
from lab.views.export import gpx, kml
from lab.views.export.tracks import Tracks
from lab.views.mission_card import mission_html

MARK = '<img src="x" onerror="alert(1)"></description>&lt;b&gt;]]>'


def test_no_tag_is_left_in_a_kml_once_it_is_read() -> None:
    document = ElementTree.fromstring(kml.text(Tracks(MARK, MARK, None, None, None)).encode())
    texts = [
        element.text or "" for element in document.iter() if element.tag.endswith(("name", "description"))
    ]
    assert len(texts) == 2
    assert all("<" not in text and "onerror" in text for text in texts)


def test_a_title_ends_no_element_of_a_gpx() -> None:
    document = ElementTree.fromstring(gpx.text(Tracks(MARK, MARK, None, None, None)).encode())
    assert [element.text for element in document.iter() if element.tag.endswith("name")] == [MARK]


def test_a_card_of_a_mission_has_no_tag_of_its_texts() -> None:
    card = mission_html(Mission(MARK, Path(MARK), MARK, MARK, MARK, MARK, MARK, (MARK,)))
    assert "No recording" in card
    assert "<img" not in card
