"""The page of the sensor cards: what its rows say, what a press on one loads, and a hand-made wish."""

from __future__ import annotations

import numpy as np
import pytest
from walking import Walk, walking

from dashboards.pages.sensor_cards import CardTable, SensorCards, card_table
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card, cards


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


@pytest.mark.parametrize("name", ["no such card", "", None, [1], "../../etc/passwd"])
def test_a_hand_made_wish_loads_nothing(walk: Walk, name: object) -> None:
    before = walk.page.session.experiment.to_dict()
    press(walk, name)
    assert walk.page.session.experiment.to_dict() == before


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
