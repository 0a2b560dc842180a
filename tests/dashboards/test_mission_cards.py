"""Cards of missions: what a folder of many missions costs, and the pictures that a browser asks for."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashboards.pages.missions import cards
from dashboards.pages.missions.cards import MOST, MissionCards, Question, all_cards, drawings
from lab.missions import Mission, Recording, mission, write_flight_csv
from lab.missions.catalogue import OWN_FOLDER_VARIABLE


@pytest.fixture
def forty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the user's own folder with forty missions, the last of which has no numbers."""
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    at = np.arange(6.0)
    flight = Recording(at, 1e-6 * at, 0 * at, 100.0 + at, np.ones((6, 3)), np.zeros((6, 3)))
    for number in range(40):
        path = tmp_path / f"own{number}.csv"
        write_flight_csv(path, replace(flight, height=flight.height + number))
        path.with_suffix(".toml").write_text(f'title = "Own {number}"\nrecording = "{path.name}"\n')
    (tmp_path / "own39.csv").write_text("nothing\n")
    return tmp_path


def test_only_recordings_of_cards_in_view_are_read(forty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    original = Mission.__dict__["recording"].func

    def recording(self: Mission) -> Recording:
        read.append(self.name)
        found: Recording = original(self)
        return found

    monkeypatch.setattr(Mission, "recording", property(recording))
    listed = all_cards(editable=True)
    assert read == []
    assert sum(card["own"] for card in listed) == 40
    assert len(str(listed)) < 600 * len(listed)
    drawn = drawings(["own3", "own39", "gone", "own3"])
    assert set(read) == {"own3", "own39"}
    assert set(drawn) == {"own3", "own39"}
    assert drawn["own3"]["picture"].startswith("<svg")
    assert drawn["own3"]["duration"] == "5 s"
    assert not drawn["own39"]["picture"]
    assert "own39.csv" in drawn["own39"]["problem"]


def test_a_new_recording_makes_another_card(forty: Path) -> None:
    def card() -> object:
        return next(card for card in all_cards(editable=True) if card["name"] == "own3")

    before = card()
    assert card() == before
    os.utime(forty / "own3.csv", ns=(1, 1))
    assert card() != before


def test_a_question_of_a_browser_is_bounded() -> None:
    asked: list[Question] = []
    shown = MissionCards(lambda _what, _name: None, asked.append)
    shown.asked = {"names": [*map(str, range(3 * MOST)), 7], "count": 1}
    shown.asked = {"names": "montreal", "count": 2}
    shown.asked = {"names": ["montreal", {}], "count": 3}
    assert [(len(one.names), one.number) for one in asked] == [(MOST, 1), (1, 3)]
    shown.answer(asked[1], {})
    assert shown.drawn == {"cards": {}, "count": 3}


def test_pictures_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    first = drawings(["los_angeles"])
    monkeypatch.setattr(cards, "picture", lambda _mission: pytest.fail("drawn again"))
    assert drawings(["los_angeles"]) == first
    assert mission("los_angeles").title
