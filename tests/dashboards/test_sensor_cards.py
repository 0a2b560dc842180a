"""The page of the sensor cards: what its rows say, what a press on one loads, and a hand-made wish."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from walking import Walk, walking

from dashboards.pages.sensor_cards import CardTable, SensorCards, card_table
from dashboards.pages.sheet_form import SheetForm
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card, cards
from lab.sensors.datum import Datum


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch):
    with walking(monkeypatch) as opened:
        opened.run(Experiment(mission="los_angeles").update({"trajectory": {"imu_rate": 20}}))
        opened.open("Cards")
        yield opened


def press(walk: Walk, name: object) -> None:
    (table,) = walk.shown.view.select(CardTable)
    table.asked = {"name": name, "count": table.asked.get("count", 0) + 1}


def test_each_card_has_a_row_of_its_numbers_and_of_the_filter_that_it_loads() -> None:
    rows = {row["name"]: row for row in card_table()["rows"]}
    assert list(rows) == list(cards())
    for name, row in rows.items():
        trial = Experiment()
        card(name).load(trial)
        assert row["texts"][-1] == str(trial.navigator.states)
        noise = trial.sensors.gyro.noise_density
        assert row["keys"][2] == pytest.approx(float(np.max(noise)), rel=1e-9)
        assert row["assumed"][3] == card(name).is_assumed("gyro", "flicker")


def test_prices_stand_in_the_table_once_a_card_cites_one(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "Price" not in card_table()["heads"]
    known = dict(cards())
    known["BMI270"] = replace(known["BMI270"], price=Datum(4.0, "USD", "a shop, 2026"))
    monkeypatch.setattr("dashboards.pages.sensor_cards.cards", lambda: known)
    found = card_table()
    place = found["heads"].index("Price")
    rows = {row["name"]: (row["texts"][place], row["keys"][place]) for row in found["rows"]}
    assert rows.pop("BMI270") == ("4 USD", 4.0)
    assert set(rows.values()) == {("–", None)}
    assert {len(row[part]) for row in found["rows"] for part in ("texts", "keys", "assumed")} == {place + 2}


def test_a_press_on_a_name_loads_the_card_and_undo_takes_it_back(walk: Walk) -> None:
    session = walk.page.session
    before = session.experiment.to_dict()
    press(walk, "BMI270")
    wanted = Experiment()
    card("BMI270").load(wanted)
    assert session.experiment.sensors.to_dict() == wanted.sensors.to_dict()
    assert session.experiment.navigator.to_dict() == wanted.navigator.to_dict()
    walk.run(session.experiment.copy())
    assert "Sensors in use: BMI270" in walk.text()
    assert "data sheet BST-BMI270" in walk.text()
    walk.ask("undo")
    assert session.experiment.to_dict() == before


def test_a_hand_made_wish_loads_nothing(walk: Walk) -> None:
    before = walk.page.session.experiment.to_dict()
    for name in ("no such card", "", None, [1], "../../etc/passwd"):
        press(walk, name)
        assert walk.page.session.experiment.to_dict() == before, name


def test_changed_sensors_are_no_card(walk: Walk) -> None:
    walk.page.session.change("sensors.gyro.noise_density", 0.123)
    walk.run(walk.page.session.experiment.copy())
    assert isinstance(walk.shown, SensorCards)
    assert "no card as loaded" in walk.text()
    assert "0.123" in walk.text()


def test_gaps_are_filled_as_the_switch_beside_the_cards_says(walk: Walk) -> None:
    walk.page._add_settings()
    panel, session = walk.page._settings, walk.page.session
    assert panel is not None
    press(walk, "BMI270")
    assert np.max(session.experiment.sensors.gyro.flicker) > 0
    panel._cards._switch.value = False
    press(walk, "ADIS16470")
    press(walk, "BMI270")
    assert card("BMI270").is_assumed("gyro", "flicker")
    assert np.max(session.experiment.sensors.gyro.flicker) == 0


def form(walk: Walk) -> SheetForm:
    assert isinstance(walk.shown, SensorCards)
    return walk.shown._form


def test_lines_of_a_data_sheet_become_a_card_to_download_and_to_load(walk: Walk, tmp_path: Path) -> None:
    shown, session = form(walk), walk.page.session
    before = session.experiment.to_dict()
    shown._source.value = "sheet, rev. 2"
    shown.make()
    for words in (
        "5 numbers of the sheet",
        "read as 120 µg/√Hz: rms",
        "gyro, assumed: Flicker",
        "missing",
    ):
        assert words in str(shown.answer.object)
    path = tmp_path / "mine.toml"
    path.write_bytes(shown.download.callback().getvalue())
    assert card(path).value("gyro", "bias_sigma") == 0.5
    shown.load()
    wanted = Experiment()
    card(path).load(wanted)
    assert session.experiment.sensors.to_dict() == wanted.sensors.to_dict()
    walk.ask("undo")
    assert session.experiment.to_dict() == before


WRONG = (
    ("mine", "own", "", "gyro ARW = 0.2 deg/√h", "needs its source"),
    ("../mine", "own", "s", "gyro ARW = 0.2 deg/√h", "not possible in the name of a file"),
    ("mine", "best", "s", "gyro ARW = 0.2 deg/√h", "accepted is one of consumer"),
    ("mine", "own", "s", "ARW = 0.2 deg/√h", "lines that begin with gyro or accelerometer"),
    ("mine", "own", "s", "gyro ARW 0.2 deg/√h", "accepted is WORD=NUMBER UNIT"),
    ("mine", "own", "s", "gyro ARW = 0.2 deg", "the unit of something else"),
    ("mine", "own", "s", "gyro <b> = 0.2 deg", "&lt;b&gt;"),
    ("mine", "own", "s", " ", "at least one number"),
    ("mine", "own", "s", "gyro ARW = 0.2 deg/√h\n" * 41, "accepted are up to 40"),
)
"""Name, grade, source and numbers of a data sheet, and what is said of them."""


def test_what_is_wrong_on_a_sheet_is_said_and_makes_no_card(walk: Walk) -> None:
    shown = form(walk)
    shown._grade.options = [*shown._grade.options, "best"]
    for name, grade, source, numbers, words in WRONG:
        for field, text in ((shown._name, name), (shown._source, source), (shown._numbers, numbers)):
            field.param.update(value=text, value_input=text)
        shown._grade.value = grade
        shown.make()
        assert words in str(shown.answer.object)
        assert shown.card is None
        assert not shown.download.visible
