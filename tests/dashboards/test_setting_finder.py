"""The finder of settings: by words, by what is changed, and what a changed field says it was."""

from __future__ import annotations

import pytest
from walking import Walk, walking

from dashboards.setting_finder import MARK
from dashboards.settings_panel import SettingsPanel
from lab.experiment.experiment import Experiment

Q, NOISE = "navigator.q_scale", "sensors.gyro.noise_density"


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch):
    with walking(monkeypatch) as opened:
        yield opened


def panel_of(walk: Walk) -> SettingsPanel:
    walk.page._add_settings()
    while walk.page._steps:
        walk.page._steps.pop(0)()
    panel = walk.page._settings
    assert panel is not None
    return panel


def found(panel: SettingsPanel) -> list[str]:
    return list(panel._found) if panel._finder._place.visible else []


def seek(panel: SettingsPanel, words: str) -> list[str]:
    panel._finder._box.value_input = words
    return found(panel)


def test_a_setting_is_found_by_words_of_its_name_its_group_or_its_path(walk: Walk) -> None:
    panel = panel_of(walk)
    assert "sensors.gps.lever_arm" in seek(panel, "LEVER")
    assert not panel._groups.visible
    assert seek(panel, "gyros white") == [NOISE]
    assert seek(panel, "q_scale") == [Q]
    assert seek(panel, "no such words") == []
    assert "No setting" in panel._finder._place[0].object
    assert seek(panel, "  ") == []
    assert panel._groups.visible


def test_a_field_that_was_found_changes_the_setting_and_the_field_in_its_group(walk: Walk) -> None:
    panel = panel_of(walk)
    seek(panel, "q_scale")
    panel._found[Q]._box.value = "0.5"
    assert walk.page.session.experiment.navigator.q_scale == 0.5
    assert panel._fields[Q]._box.value == "0.5"
    panel._fields[Q]._box.value = "0.25"
    assert panel._found[Q]._box.value == "0.25"


def test_changed_settings_are_marked_counted_and_listed_until_they_are_as_before(walk: Walk) -> None:
    panel, session = panel_of(walk), walk.page.session
    assert panel._changed() == []
    session.change(NOISE, 0.2)
    session.change(Q, 0.1)
    panel.refresh()
    assert panel._finder._only.label == "Changed 2"
    view = panel._fields[NOISE].view
    assert (MARK in view.css_classes, view.styles["--was"]) == (True, '"was 0.05"')
    panel._finder._only.value = True
    assert found(panel) == [NOISE, Q]
    assert seek(panel, "scale") == [Q]
    panel._found[Q]._box.value = "1"
    assert MARK not in panel._found[Q].view.css_classes
    assert panel._changed() == [NOISE]
    walk.ask("undo")
    walk.ask("undo")
    walk.ask("undo")
    assert MARK not in view.css_classes
    assert panel._finder._only.label == "Changed"


def test_of_a_loaded_card_only_what_differs_from_the_card_is_changed(walk: Walk) -> None:
    panel, session = panel_of(walk), walk.page.session
    panel._cards._load("ADIS16470")
    assert session.experiment.sensors != Experiment().sensors
    assert panel._changed() == []
    assert panel._finder._only.label == "Changed"
    panel._fields[NOISE]._box.value = "0.3"
    assert panel._changed() == [NOISE]
