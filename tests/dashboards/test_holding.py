"""Held results: in all plots and on the page Compare, until they are removed; a press brings them back."""

from __future__ import annotations

from collections.abc import Iterator
from html import unescape
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import pytest
from panel.io.state import set_curdoc
from walking import TITLES, Walk, walking

from dashboards.holding import AS_DELIVERED, LONGEST_NAME, describe_differences, is_renamed, name_held
from dashboards.pages.view_3d import legend_html
from dashboards.query import View, query_of_view, view_of_query
from dashboards.session import MOST_HELD, Held
from lab.classroom.lessons.lesson_file import read_lesson
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card as load_card


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page with a result."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        run(opened, 1.0)
        yield opened


def run(walk: Walk, q_scale: float) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    made.set("navigator.q_scale", q_scale)
    walk.page.session.experiment = made.copy()
    walk.open("Errors")
    assert walk.run(made).problem == ""


def hold(walk: Walk) -> None:
    with set_curdoc(walk._document):
        walk.page._holding.hold()
    walk.settle()


def layers(walk: Walk) -> list[bool]:
    """Return which held results the plots of the open page draw."""
    ((figures,), _) = walk.shown._grids[walk.shown._shown]
    return [any(glyph.visible for glyph in layer._glyphs) for layer in figures._layers]


def test_a_result_is_named_by_what_differs() -> None:
    made = Experiment()
    assert describe_differences(made) == AS_DELIVERED
    made.set("navigator.q_scale", 0.1)
    assert describe_differences(made) == "Q scale 0.1"
    made.set("seed", 7)
    assert set(describe_differences(made).split(", ")) == {"Q scale 0.1", "Seed 7"}
    made.set("navigator.r_scale", 2.0)
    assert describe_differences(made).endswith(", 1 more")
    other = Experiment().update({"sensors.gps.position_variance": 0.49})
    assert (describe_differences(other), describe_differences(other, sigmas=True)) == (
        "Position variance 0.49",
        "Position σ 0.7",
    )
    hidden = Experiment(mission="<b>")
    assert describe_differences(hidden) == "<b>"


@pytest.mark.parametrize("card", [None, "ADIS16470"])
def test_held_results_are_named_by_what_tells_them_apart(card: str | None) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    if card:
        load_card(card).load(made)
    held = []
    for q_scale in (1.0, 0.1, 0.5):
        made.set("navigator.q_scale", q_scale)
        held.append(Held(describe_differences(made), SimpleNamespace(experiment=made.copy())))  # type: ignore[arg-type]
    names = [one.name for one in name_held(held, sigmas=True)]
    assert len(set(names)) == 3
    assert [name.split(", ")[0] for name in names[1:]] == ["Q scale 0.1", "Q scale 0.5"]
    experiments = [one.result.experiment for one in held]
    assert not any(map(is_renamed, experiments, names))
    assert all(map(is_renamed, experiments, reversed([f"{name} " for name in names])))
    mine = held[0]._replace(name="mine")
    assert name_held([mine, held[1]], sigmas=True)[0].name == "mine"


def test_lists_of_settings_name_variances_as_their_fields_do(walk: Walk) -> None:
    """The switch between σ and σ² renames what is held, unless a person has named it."""
    session = walk.page.session
    walk.open("Overview")
    other = Experiment().update({"sensors.gps.position_variance": 0.49, "trajectory.imu_rate": 50.0})
    assert walk.run(other).problem == ""
    hold(walk)
    with set_curdoc(walk._document):
        session.held = (*session.held, Held("my own", session.result))
    words = walk.shown.words
    assert "Position σ 0.707107 → 0.7" in words.object
    assert [one.name for one in session.held] == ["IMU rate 50, Position σ 0.7", "my own"]
    assert "variance" not in walk.page._address.search
    with set_curdoc(walk._document):
        session.shows_sigmas = False
        walk.settle()
        assert "Position variance 0.5 → 0.49" in words.object
        assert [one.name for one in session.held] == ["IMU rate 50, Position variance 0.49", "my own"]
        assert view_of_query(query_of_view(walk.page._shown_view()), ())[0].noise == "variance"


def test_a_held_result_stays_in_the_plots_and_is_compared(walk: Walk) -> None:
    held = walk.page.session.result
    hold(walk)
    hold(walk)
    assert [one.result for one in walk.page.session.held] == [held]  # once
    assert layers(walk) in ([], [False])  # it is the shown one
    run(walk, 0.1)
    assert layers(walk) == [True]
    walk.open("Compare")
    text = walk.text()
    assert "A · Montréal" not in text
    assert "A · " in text
    assert "Now" in text
    table = walk.shown._table.object
    assert walk.page.session.result.verdict.headline in unescape(table)
    assert held.verdict.headline in unescape(table)
    walk.open("Innovations")
    assert not walk.complaints()
    entry, _rename, _name, _away = walk.page._holding.bar.objects
    assert entry.label.startswith("A · ")
    with set_curdoc(walk._document):
        walk.page._holding._remove(walk.page.session.held[0])
    walk.open("Errors")
    assert layers(walk) == [False]
    assert not walk.page._holding.bar.visible


def test_a_press_on_its_name_brings_the_settings_back(walk: Walk) -> None:
    held = walk.page.session.result
    hold(walk)
    run(walk, 0.1)
    hold(walk)
    with set_curdoc(walk._document):
        walk.page._holding._bring_back(walk.page.session.held[0])
    assert walk.page.session.experiment.to_dict() == held.experiment.to_dict()
    walk.show(held)
    assert layers(walk) == [False, True]  # the first is the shown one, and the second keeps its letter


def test_no_more_are_held_than_can_be_told_apart(walk: Walk) -> None:
    for k in range(MOST_HELD + 1):
        run(walk, 1.0 + k)
        hold(walk)
    assert len(walk.page.session.held) == MOST_HELD
    assert "Remove one" in walk.page.session.problem
    walk.open("Compare")
    assert all(f"{letter} · " in walk.text() for letter in "ABCD")


def test_what_a_lesson_hides_is_not_brought_into_another_experiment(walk: Walk) -> None:
    hold(walk)
    secret = type("Hidden", (Experiment,), {"hidden": "another lesson"})
    before = walk.page.session.experiment
    walk.page.session.experiment = secret()
    walk.page._holding._bring_back(walk.page.session.held[0])
    assert "another lesson" in walk.page.session.problem
    walk.page.session.experiment = before


def test_the_legend_of_the_scene_names_the_held_results_in_it(walk: Walk) -> None:
    hold(walk)
    words = legend_html(walk.page.session.held[0].result, 10.0, [("B", "#d6457f")])
    assert '<span style="color:#d6457f">●</span> B, held' in words


def test_a_held_result_is_renamed_and_an_empty_name_is_that_of_its_settings(walk: Walk) -> None:
    hold(walk)
    bar = walk.page._holding.bar
    before = walk.page.session.held[0].name
    for typed, shown in (
        ("  <b>Best</b> " + 50 * "x", ("<b>Best</b> " + 50 * "x")[:LONGEST_NAME]),
        (" ", before),
    ):
        with set_curdoc(walk._document):
            bar.objects[1].clicks += 1
            name = bar.objects[2]
            assert name.label == "Name of A"
            name.value = typed
        walk.settle()
        assert walk.page.session.held[0].name == shown
        assert bar.objects[0].label == f"A · {shown}"
    with set_curdoc(walk._document):
        bar.objects[1].clicks += 1
        assert (bar.objects[0].visible, bar.objects[2].visible) == (False, True)
        walk.page._holding._list()  # as after Enter, with the name unchanged
    assert bar.objects[0].label == f"A · {before}"
    with set_curdoc(walk._document):
        bar.objects[1].clicks += 1
        bar.objects[-1].clicks += 1
    assert walk.page.session.held == ()
    assert not bar.visible


def test_a_name_is_no_markup_in_the_table(walk: Walk) -> None:
    hold(walk)
    with set_curdoc(walk._document):
        walk.page._holding._rename(0, "<i>x</i>")
    run(walk, 0.1)
    walk.open("Compare")
    assert "A · &lt;i&gt;x&lt;/i&gt;" in walk.shown._table.object


@pytest.mark.parametrize("title", ["Summary", "Models"])
def test_an_older_lesson_or_link_that_names_its_page_opens_the_comparison(
    walk: Walk, tmp_path: Path, title: str
) -> None:
    walk.page._open_page_at(title, None)
    assert walk.title == "Compare"
    assert view_of_query(f"tab={title}", TITLES) == (View(tab="Compare"), [])
    old = tmp_path / "old.toml"
    shipped = files("lab.classroom.lessons") / "shipped" / "01-first-look.toml"
    old.write_text(shipped.read_text().replace('page = "Compare"', f'page = "{title}"'))
    assert "Compare" in {step.page for step in read_lesson(old).steps}
