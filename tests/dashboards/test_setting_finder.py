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


def test_variances_are_shown_and_entered_as_sigma_until_the_switch_says_otherwise(walk: Walk) -> None:
    panel, session = panel_of(walk), walk.page.session
    path = "sensors.gps.position_variance"
    assert path in seek(panel, "position σ")
    assert seek(panel, "position variance") == [path]
    here, there = panel._found[path], panel._fields[path]
    assert (there._slider.label, there._box.value) == ("Position σ [m]", "0.707107")
    here._box.value = "0.7"
    assert session.experiment.get(path) == (0.49,) * 3
    assert there._box.value == "0.7"
    assert there.view.styles["--was"] == '"was 0.707107"'
    walk.page._address._write()
    assert walk.page._address.bar.shown["undone"] == "GPS receiver: Position σ 0.707107 → 0.7"
    here._box.value = "-0.7"
    assert session.experiment.get(path) == (0.49,) * 3
    assert "Position σ must be between 0.001 and 1,000 m." in here._complaint.object
    here._slider.value = here._slider.end
    assert session.experiment.get(path) == (25.0,) * 3
    there.view[2].value = True
    there._axis_sliders[1].value = there._slider.start
    assert session.experiment.get(path) == (25.0, 0.01, 25.0)
    assert list(panel._finder._last.options) == ["Position σ"]
    switch = panel._finder.view[2][1]
    switch.value = False
    assert (there._slider.label, there._box.value) == ("Position variance [m²]", "25, 0.01, 25")
    assert list(panel._finder._last.options) == ["Position variance"]
    assert there._axis_sliders[1].value == there._slider.start
    assert there.view.styles["--was"] == '"was 0.5"'
    walk.page._address._write()
    assert walk.page._address.bar.shown["undone"].startswith("GPS receiver: Position variance 0.49 → 25")
    assert session.experiment.get(path) == (25.0, 0.01, 25.0)
    walk.ask("undo")
    assert there._box.value == "0.49"
    switch.value = True
    assert there._box.value == "0.7"


def test_a_setting_that_is_changed_in_its_other_form_is_marked_and_at_hand(walk: Walk) -> None:
    """White noise of 0.7 °/s per sample at 200 Hz is 0.7/√200 °/s/√Hz."""
    panel, session = panel_of(walk), walk.page.session
    session.experiment.set("trajectory.imu_rate", 200.0)
    form = panel._fields["sensors.gyro.noise_variance"]
    assert (form._box.label, form._box.value) == ("σ per sample [°/s]", "0.707107")
    form._box.value = "0.7"
    assert session.experiment.get(NOISE) == pytest.approx((0.7 / 200**0.5,) * 3)
    white = panel._fields[NOISE]
    assert white._box.value == "0.0494975"
    assert white.view.styles["--was"] == '"was 0.05"'
    assert list(panel._finder._last.options) == ["White noise"]


def test_the_last_three_settings_are_at_hand(walk: Walk) -> None:
    panel = panel_of(walk)
    last = panel._finder._last
    assert panel._finder._strip not in panel._finder.view.objects
    for path, text in ((NOISE, "0.2"), (Q, "0.5"), ("navigator.r_scale", "2"), (NOISE, "0.3")):
        panel._fields[path]._box.value = text
    assert list(last.options) == ["White noise", "Q scale", "R scale"]
    last.value = [Q]
    assert found(panel) == [Q]
    assert panel._groups.visible
    panel._found[Q]._box.value = "0.25"
    assert panel._fields[Q]._box.value == "0.25"
    panel._fields["navigator.p0_scale"]._box.value = "3"
    assert list(last.options) == ["Q scale", "R scale", "P₀ scale"]
    assert found(panel) == [Q]
    last.value = ["seed"]  # such as a message made by hand has it
    assert found(panel) == []
    last.value = []
    assert found(panel) == []


@pytest.mark.parametrize(("name", "text"), [("lever_arm", "1, 0, 0.5"), ("r", "1 1 1 0.5 0.5 0.5")])
def test_a_value_of_the_filter_follows_the_sensor_until_it_is_given(walk: Walk, name: str, text: str) -> None:
    panel, path = panel_of(walk), f"navigator.{name}"
    seek(panel, path)
    made = panel._found[path]
    box, lock = made._widget, made._lock
    assert (box.value, box.placeholder, lock.icon) == ("", "follows the sensor", "lock")
    box.value = text
    assert lock.icon == "lock_open"
    assert made.view.styles["--was"] == '"followed the sensor"'
    lock.clicks += 1
    assert walk.page.session.experiment.get(path) is None
    assert (box.value, lock.icon) == ("", "lock")
    assert MARK not in made.view.css_classes
