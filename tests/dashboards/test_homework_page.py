"""Homework on the page Lessons: its list, its settings, its answers and the file, without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import panel_material_ui as pmui
import pytest
from lessons_walk import click, page
from panel.io.state import set_curdoc
from walking import Walk, walking

from dashboards import classroom
from dashboards.address import Address
from dashboards.pages.compare import Compare
from dashboards.pages.lessons.homework_part import IS_OFF
from dashboards.query import homework_of_query
from dashboards.settings_panel import SettingsPanel
from dashboards.sweep_choice import Plan
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.homework.hand_in import open_hand_in
from lab.classroom.homework.homework_file import Keyed, homework_text, make_homework, write_key
from lab.experiment.experiment import Experiment

SOURCE = """title = "Find <b>it</b>"
text = "<script>x</script> and $R$"
change = ["navigator.r_scale"]
[settings]
mission = "los_angeles"
trajectory.imu_rate = 50
[hidden]
faults = ["r"]
[[question]]
text = "Which <i>?"
choices = ["white", "coloured"]
answer = "white"
[[question]]
text = "How many?"
answer = 3
tolerance = 0.1
"""
PLAIN = Experiment().update({"mission": "los_angeles", "trajectory": {"imu_rate": 50}})


@pytest.fixture
def keyed(tmp_path: Path) -> Iterator[Keyed]:
    (tmp_path / "find.toml").write_text(SOURCE, encoding="utf-8")
    made = make_homework(tmp_path / "find.toml")
    folder = tmp_path / "keys"
    folder.mkdir()
    write_key(folder / "find.key", made)
    (folder / "broken.key").write_text("format = 3", encoding="utf-8")
    classroom.use_homework(folder)
    yield made
    classroom.use_homework(None)


@pytest.fixture
def walk(keyed: Keyed) -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        opened.run(PLAIN.copy())
        opened.open("Lessons")
        yield opened


def test_a_homework_of_the_server_is_solved_and_handed_in(walk: Walk, keyed: Keyed) -> None:
    session = walk.page.session
    assert "broken.key: is not the key" in walk.text()
    click(walk, "Find <b>it</b>")
    assert "<script>x</script> and" in walk.text()
    assert session.experiment.hidden == keyed.homework.scenario.key
    assert not session.change("navigator.q_scale", 2.0)
    assert "does not let you change it" in session.problem
    assert not session.change("trajectory.imu_rate", 2000.0)
    assert session.change("seed", 7)
    assert session.change("navigator.r_scale", 10.0)
    part = page(walk)._homework
    (faults,) = page(walk).view.select(pmui.CheckBoxGroup)
    (choices,) = page(walk).view.select(pmui.RadioBoxGroup)
    number, name = page(walk).view.select(pmui.TextInput)
    faults.value, choices.value, number.value = ["R ten times too small"], "white", "3,0"
    assert part._view._content() is None
    assert "no name" in walk.text()
    name.value = "../Ada"
    assert part._view._file.filename == "Ada.handin"
    content = part._view._content()
    assert content is not None
    handed = open_hand_in(content.getvalue(), keyed.homework, keyed.key)
    assert handed.name == "../Ada"
    assert handed.changes == {"navigator.r_scale": 10.0}
    assert handed.faults == ("R ten times too small",)
    assert handed.answers == ("white", "3,0")


def test_hand_made_values_are_refused_or_count_as_nothing(walk: Walk, keyed: Keyed) -> None:
    click(walk, "Find <b>it</b>")
    part = page(walk)._homework
    view = part._view
    view._name = SimpleNamespace(value="Eve")
    view._entries = [SimpleNamespace(value={"a": 1}), SimpleNamespace(value=None)]
    view._faults = SimpleNamespace(value=[3, "R ten times too small"])
    assert view._answers() == ("Eve", ("R ten times too small",), ("", ""))
    for faults, answers, said in (
        (["no fault"], ["", ""], "names a fault 'no fault'"),
        ([], ["grey", ""], "none of the choices"),
        ([], ["white", "9" * 10**6], "up to 100"),
    ):
        view._faults = SimpleNamespace(value=faults)
        view._entries = [SimpleNamespace(value=answer) for answer in answers]
        assert view._content() is None
        assert said in walk.text()


def test_reset_turns_it_off_and_it_is_taken_up_again(walk: Walk, keyed: Keyed) -> None:
    session, key = walk.page.session, keyed.homework.scenario.key
    click(walk, "Find <b>it</b>")
    name = page(walk).view.select(pmui.TextInput)[-1]
    name.value = "Ada"
    loaded = Experiment().update({"navigator": {"r_scale": 3.0, "q_scale": 5.0}})
    session.accept(loaded)
    assert page(walk)._homework._view._content() is None
    assert IS_OFF in walk.text()
    click(walk, "Run with the settings at the left")
    assert session.experiment.hidden == key
    assert (session.experiment.navigator.r_scale, session.experiment.navigator.q_scale) == (3.0, 1.0)
    click(walk, "Start again")
    assert session.experiment.navigator.r_scale == 1.0
    page(walk).go((("shipped", "01-first-look"), 0))  # as a teacher does whom the student follows
    assert "Which faults are hidden?" not in walk.text()
    page(walk).go(None)
    assert "Which faults are hidden?" in walk.text()
    assert name.value == "Ada"
    click(walk, "All lessons")
    assert session.experiment.hidden == ""
    assert "Homework" in walk.text()


def test_undo_in_a_homework_keeps_what_is_hidden_and_nothing_of_it_is_in_the_history(
    walk: Walk, keyed: Keyed
) -> None:
    session, address, key = walk.page.session, walk.page._address, keyed.homework.scenario.key
    click(walk, "Find <b>it</b>")
    session.change("navigator.r_scale", 10.0)
    begun = walk.ask("undo")["search"]
    assert (session.experiment.hidden, session.experiment.navigator.r_scale) == (key, 1.0)
    session.accept(Experiment(mission="los_angeles"))  # as Reset does
    assert session.experiment.hidden == ""
    assert walk.ask("undo")["search"] == begun
    assert session.experiment.hidden == key
    with set_curdoc(walk._document):
        panel = SettingsPanel(session)
    session.change("navigator.r_scale", 10.0)
    panel._reset({"label": "Trajectory"})  # of which the homework lets nothing change
    panel._reset({"label": "Navigator and filter"})
    experiment = session.experiment
    assert (experiment.hidden, experiment.trajectory.imu_rate) == (key, 50.0)
    assert experiment.navigator.r_scale == 1.0
    held = str([*address._history._entries.values(), walk.sent()])
    assert all(secret not in held for secret in (FAULTS["r"].title, "HiddenExperiment", "Scenario"))
    click(walk, "All lessons")
    walk.ask("undo")
    assert session.experiment.hidden == ""  # of a homework that is closed, only what is seen comes back


def test_the_comparison_shows_and_changes_nothing_that_a_homework_hides(walk: Walk, keyed: Keyed) -> None:
    click(walk, "Find <b>it</b>")
    session = walk.page.session
    assert walk.run(session.experiment.copy()).problem == ""
    with set_curdoc(walk._document):
        walk.page._holding.hold()
    session.change("navigator.r_scale", 10.0)
    assert walk.run(session.experiment.copy()).problem == ""
    walk.open("Compare")
    shown = walk.shown
    assert isinstance(shown, Compare)
    with set_curdoc(walk._document):
        for toggle in shown._add.values():
            toggle.value = True
        shown._seeds.value = 2
        shown._cards._boxes[0].value = ["BMI088"]
        choice = shown._sweep.choice
        choice._axes[0].steps.value, choice._seeds.value = 2, 1
        shown._sweep.run()
    walk.settle()
    assert list(choice._axes[0].setting.options.values()) == ["navigator.r_scale"]
    for row in ("psi", "BMI088"):
        refusal = shown._table.object.split(f"<td>{row}</td>")[1].split("</tr>")[0]
        assert "does not let you change it" in refusal
    assert "Mean of 2 seeds" in walk.text()
    assert len(walk.figures()) == 1
    labels = [one.label for one in walk.page._holding.bar.objects if hasattr(one, "label")]
    models = [model for fig in walk.figures() for model in fig.references()]
    written = str([shown._table.object, labels, [model.properties_with_values() for model in models]])
    secrets = (FAULTS["r"].title, keyed.homework.scenario.key, "HiddenExperiment", "Scenario")
    assert [secret for secret in secrets if secret in written] == []
    shown._sweep.plan = Plan({"navigator.q_scale": (0.1, 1.0)}, 1)  # as chosen before the homework was opened
    with set_curdoc(walk._document):
        walk.page.pages._draw_again(shown)
    walk.settle()
    assert walk.figures() == []


def test_a_file_is_opened_and_a_damaged_one_says_so(walk: Walk, keyed: Keyed, tmp_path: Path) -> None:
    path, part = tmp_path / "mine.homework", page(walk)._homework
    path.write_text(homework_text(keyed).replace("imu_rate = 50", "imu_rate = 60"), encoding="utf-8")
    part._arrive(part._reading._work(path, lambda *_: None))
    assert "has been changed since the teacher signed it" in walk.text()
    path.write_text(homework_text(keyed), encoding="utf-8")
    part._arrive(part._reading._work(path, lambda *_: None))
    assert "Which faults are hidden?" in walk.text()
    assert walk.page.session.experiment.hidden == keyed.homework.scenario.key
    assert walk.page.session.homework is None  # no other server could open an address with its name


def test_the_address_opens_the_homework_with_the_settings_of_the_student(keyed: Keyed) -> None:
    name = keyed.homework.name
    query = f"homework={name}&mission=montreal&navigator.r_scale=4&navigator.q_scale=9"
    assert homework_of_query(query)[0] == name
    with pytest.MonkeyPatch.context() as patch, walking(patch) as walk:
        address, session = walk.page._address, walk.page.session

        address.search = f"?{query}"
        address.read()
        walk.settle()
        assert walk.title == "Lessons"
        assert "Which faults are hidden?" in walk.text()
        assert session.experiment.hidden == keyed.homework.scenario.key
        assert (session.experiment.navigator.r_scale, session.experiment.navigator.q_scale) == (4.0, 1.0)
        address._write()
        assert address.search != f"?{query}"
        assert address.search.startswith(f"?homework={name}&")
        address.search = "?homework=none"
        Address.read(address)
        assert "no homework 'none'" in session.problem
