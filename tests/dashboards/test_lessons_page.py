"""The page Lessons: settings, answers and faults of a lesson, as a server makes them, without a browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import panel_material_ui as pmui
import pytest
from lessons_walk import click, page
from walking import Walk, walking

from dashboards import classroom
from dashboards.kept import brought_back
from dashboards.pages.lessons.lessons import FAULT_IS_OFF, OLD_RESULT
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.experiment import Experiment

OWN = """
title = "Of <b>mine</b>"
summary = "<script>"
[settings]
mission = "los_angeles"
trajectory.imu_rate = 50
[[step]]
title = "One"
text = "<img src=x> and $R$: change `navigator.r_scale`, not `title`"
settings = { navigator.r_scale = 0.1 }
page = "Flight"
time = 40
check = "0.8 < nis < 1.25"
hint = "A hint."
because = "A reason."
[[step]]
title = "Two"
text = "Read this."
question = "How many?"
answer = 3
tolerance = 0.1
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "mine.toml").write_text(OWN, encoding="utf-8")
    classroom.use_lessons(tmp_path)
    yield tmp_path
    classroom.use_lessons(None)


@pytest.fixture
def walk(folder: Path) -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        opened.run(Experiment().update({"mission": "los_angeles", "trajectory": {"imu_rate": 50}}))
        opened.open("Lessons")
        yield opened


def computed(walk: Walk) -> None:
    """Have the result of the session's settings arrive."""
    walk.run(walk.page.session.experiment.copy())


def test_a_step_sets_the_settings_and_judges_the_result_of_the_student(walk: Walk) -> None:
    session = walk.page.session
    assert "Lessons of your teacher" in walk.text()
    click(walk, "Of <b>mine</b>")
    assert session.experiment.navigator.r_scale == 0.1
    assert "<img src=x> and" in walk.text()
    assert "change Navigator and filter: R scale , not title" in " ".join(walk.text().split())
    click(walk, "Check my result")
    assert OLD_RESULT in walk.text()
    computed(walk)
    click(walk, "Check my result")
    assert "Not yet." in walk.text()
    assert "A hint." in walk.text()
    assert "0 of 2 solved" in walk.text()
    session.change("navigator.r_scale", 1.0)
    computed(walk)
    click(walk, "Check my result")
    assert "Right." in walk.text()
    assert "A reason." in walk.text()
    assert "1 of 2 solved" in walk.text()
    click(walk, "Next step")
    assert session.experiment.navigator.r_scale == 1.0  # what the student has is left
    (box,) = page(walk).view.select(pmui.TextInput)
    for typed, said in (
        ("", "Give an answer first"),
        ("4", "Not yet."),
        ("3 m", "without its unit"),
        ("3,05", "Right."),
    ):
        box.value = typed
        click(walk, "Check the answer")
        assert said in walk.text()
    click(walk, "All lessons")
    assert "2 of 2 solved" in walk.text()


def test_the_end_of_lessons_gives_back_the_settings_of_before_them(walk: Walk) -> None:
    session = walk.page.session
    own = session.experiment.update({"navigator.r_scale": 3.0, "seed": 5}).to_dict()
    click(walk, "Of <b>mine</b>")
    session.change("seed", 9)
    click(walk, "Next step")
    click(walk, "Next lesson")  # it is another experiment
    lesson, place = session.experiment.to_dict(), page(walk).place
    assert lesson != own
    kept = walk.page._kept()
    walk.page._restore_kept(brought_back(json.dumps({"kept": kept.text, "is_same": True}))[0], True)  # reload
    click(walk, "All lessons")
    assert session.experiment.to_dict() == own
    walk.ask("undo")
    assert (session.experiment.to_dict(), page(walk).place) == (lesson, place)
    click(walk, "All lessons")
    assert session.experiment.to_dict() == own


def test_the_last_step_leads_to_the_next_lesson(walk: Walk) -> None:
    click(walk, "A first look")
    for _ in range(2):
        click(walk, "Next step")
    click(walk, "Next lesson")
    assert "Alone: drift without GPS · step 1 of 4" in walk.text()
    click(walk, "All lessons")
    click(walk, "Break it 10")
    for _ in range(2):
        click(walk, "Next step")
    (button,) = [one for one in page(walk).view.select(pmui.Button) if one.label == "Next lesson"]
    assert button.disabled  # it is the last of the gallery


def test_look_opens_the_page_beside_the_lesson_and_a_closed_dock_leaves_a_reminder(walk: Walk) -> None:
    click(walk, "Of <b>mine</b>")
    click(walk, "Look at Flight at 40 s")
    assert walk.title == "Lessons"
    assert walk.page.pages.tabs.kind.title == "Flight"
    assert walk.page.axis.time == 40.0
    assert walk.page._reminder is None
    walk.page.pages.dock.close()
    assert walk.page._reminder is not None
    assert "Of <b>mine</b>, step 1 of 2: One." in walk.page._reminder.text
    walk.open("Lessons")
    assert walk.page._reminder.text == ""


def test_a_fault_is_on_while_its_lesson_is_open_and_off_afterwards(walk: Walk) -> None:
    session = walk.page.session
    click(walk, "Break it 3")
    assert session.experiment.hidden == FAULTS["r"].title
    session.change("navigator.q_scale", 2.0)
    assert session.experiment.hidden == FAULTS["r"].title
    click(walk, "All lessons")
    assert not isinstance(session.experiment, FaultyExperiment)
    click(walk, "Break it 1")
    assert session.experiment.hidden == FAULTS["latency"].title
    click(walk, "All lessons")
    click(walk, "Of <b>mine</b>")
    assert session.experiment.hidden == ""


def test_a_lesson_is_undone_with_its_settings_and_made_again_with_its_fault(walk: Walk) -> None:
    session = walk.page.session
    session.change("navigator.r_scale", 3.0)
    before = session.experiment.to_dict()
    click(walk, "Break it 3")
    session.change("navigator.q_scale", 2.0)
    changed, place = session.experiment.to_dict(), page(walk).place
    assert walk.ask("undo")["redone"] == "Navigator and filter: Q scale 1 → 2"
    assert session.experiment.hidden == FAULTS["r"].title
    assert walk.ask("undo")["redone"] == "Break it 3, step 1"
    assert (session.experiment.to_dict(), session.experiment.hidden) == (before, "")
    assert page(walk).place is None
    for position in (3, 2, 3):
        sent = walk.ask("visit", position)
        assert session.experiment.hidden == FAULTS["r"].title
        assert page(walk).place == place
        assert "hidden" not in str(sent)
        assert FAULTS["r"].title not in str(sent)
    assert session.experiment.to_dict() == changed
    click(walk, "All lessons")
    assert session.experiment.hidden == ""
    walk.ask("undo")
    assert (page(walk).place, session.experiment.hidden) == (place, FAULTS["r"].title)


def test_a_repair_counts_only_with_the_fault(walk: Walk) -> None:
    session = walk.page.session
    click(walk, "Break it 3")
    for _ in range(3):
        click(walk, "Next step")
    session.accept(Experiment(mission="los_angeles"))  # as Reset and Load do
    click(walk, "Check my result")
    assert FAULT_IS_OFF in walk.text()


def test_a_choice_that_is_none_is_no_answer(walk: Walk) -> None:
    click(walk, "Break it 3")
    (choice,) = page(walk).view.select(pmui.RadioBoxGroup)
    assert choice.value is None
    click(walk, "Check the answer")
    assert "Give an answer first" in walk.text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page(walk)._step, "_entry", type("Forged", (), {"value": ["x"]})())
        click(walk, "Check the answer")
    assert "Give an answer first" in walk.text()
    choice.value = choice.options[0]
    click(walk, "Check the answer")
    assert "Not yet." in walk.text()


def test_a_changed_file_is_shown_without_a_restart(walk: Walk, folder: Path) -> None:
    click(walk, "Of <b>mine</b>")
    path = folder / "mine.toml"
    path.write_text(OWN.replace("Read this.", "Read on."), encoding="utf-8")
    page(walk)._refresh()
    click(walk, "Next step")
    assert "Read on." in walk.text()
    path.write_text("title = 3", encoding="utf-8")
    page(walk)._refresh()
    assert "mine.toml, line 1: step: there is none" in walk.text()
