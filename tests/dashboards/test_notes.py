"""Notes on stretches of the flight: written, changed, undone one by one, and in the address."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from panel.io.state import set_curdoc
from walking import Walk, walking

from dashboards.notes import MOST, ROOM, Note, notes_of_query, query_of_notes
from dashboards.query import experiment_of_query
from lab.experiment.experiment import Experiment
from lab.views.flight_notes import LONGEST, plain_text


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Walk]:
    with walking(monkeypatch) as opened:
        experiment = Experiment(mission="los_angeles")
        experiment.set("trajectory.imu_rate", 20)
        opened.page.session.experiment = experiment
        assert opened.run(experiment).problem == ""
        opened.page._address.begin()
        yield opened


def ask(walk: Walk, **wish: Any) -> None:
    """Do what a browser would be asked to do in the lane."""
    lane = walk.page._time_bar._lane.view
    with set_curdoc(walk._document):
        lane.asked = {**wish, "count": lane.asked.get("count", 0) + 1}


def shown(walk: Walk) -> list[list[Any]]:
    return list(walk.page._time_bar._lane.view.notes)


def test_notes_are_written_changed_deleted_and_undone_one_by_one(walk: Walk) -> None:
    lane, axis = walk.page._time_bar._lane, walk.page.axis
    assert axis._notes is None, "nothing is drawn that nobody wrote"
    walk.page._time_bar.go(12.0)
    walk.page._time_bar._write_note()
    assert (lane.view.opened["start"], lane.view.opened["end"]) == (12, 12)
    axis.show(20.0, 30.0)
    walk.page._time_bar._write_note()
    assert (lane.view.opened["start"], lane.view.opened["end"]) == (20, 30)
    ask(walk, start=20.0, end=30.0, text="  the turn\n is late ")
    ask(walk, start=12.0, end=12.0, text="here")
    assert shown(walk) == [[20, 30, "the turn is late"], [12, 12, "here"]]
    assert axis._notes is not None
    assert axis._notes.data == {"start": [20, 12], "end": [30, 12]}
    ask(walk, note=1, text="there")
    sent = walk.sent()
    assert sent["undone"] == "Note: there"
    assert "note=20-30:the%20turn%20is%20late" in sent["search"]
    ask(walk, note=0, text="")
    assert shown(walk) == [[12, 12, "there"]]
    assert walk.sent()["undone"] == "Note deleted: the turn is late"
    expected = [
        [[20, 30, "the turn is late"], [12, 12, "there"]],
        [[20, 30, "the turn is late"], [12, 12, "here"]],
        [[20, 30, "the turn is late"]],
        [],
    ]
    for rows in expected:
        walk.ask("undo")
        assert shown(walk) == rows
    assert axis._notes.data == {"start": [], "end": []}
    for rows in reversed(expected[:-1]):
        walk.ask("redo")
        assert shown(walk) == rows


def test_a_note_is_no_change_of_the_experiment(walk: Walk) -> None:
    result = walk.page.session.result
    ask(walk, start=1.0, end=2.0, text="a")
    walk.ask("undo")
    assert not walk.page.session.is_running
    assert walk.page.session.result is result


def test_notes_are_of_their_flight(walk: Walk) -> None:
    ask(walk, start=1.0, end=2.0, text="of Los Angeles")
    walk.page.session.change("mission", "montreal")
    assert "note=" not in walk.sent()["search"]
    ask(walk, start=3.0, end=4.0, text="of Montreal")
    assert "note=3-4" in walk.sent()["search"]
    walk.ask("undo")
    walk.ask("undo")
    assert walk.page.session.experiment.mission == "los_angeles"
    assert walk.run(walk.page.session.experiment).problem == ""
    assert shown(walk) == [[1, 2, "of Los Angeles"]]


def test_what_a_browser_may_not_ask_for_is_not_done(walk: Walk) -> None:
    for wish in (
        {"start": float("nan"), "end": 2.0, "text": "a"},
        {"start": 5.0, "end": 2.0, "text": "a"},
        {"start": -5.0, "end": 2.0, "text": "a"},
        {"start": "5", "end": 6.0, "text": "a"},
        {"start": 1.0, "end": 2.0, "text": ["a"]},
        {"note": 0, "text": "a"},
        {"note": -1, "text": "a"},
        {"note": "0", "text": "a"},
    ):
        ask(walk, **wish)
    assert walk.page.session.notes == ()
    ask(walk, start=1.0, end=2.0, text="x" * 1000)
    (note,) = walk.page.session.notes
    assert len(note.text) == LONGEST
    for number in range(2 * MOST):
        ask(walk, start=1.0, end=2.0, text=f"{number}")
    assert len(walk.page.session.notes) == MOST
    assert "Delete one first" in walk.page.session.problem


def test_an_address_brings_them_back() -> None:
    notes = (Note(1, 2.5, 'a&b=c+d %20 "ü" 漢:字', "m"), Note(3, 3, "<b>", "m"))
    query = query_of_notes((*notes, Note(0, 1, "other", "n")), "m")
    assert notes_of_query(query, "m") == (notes, [])
    assert experiment_of_query(query)[1] == []


def test_wrong_notes_of_a_link_are_named_and_ignored() -> None:
    for wrong in ("", "5", "5:", "9-3:a", "-1-3:a", "nan-3:a", "1e9-3:a", "1-2-3:a", f"1-2:{'x' * 201}"):
        found, (problem,) = notes_of_query(f"note={wrong}&note=1-2:kept", "m")
        assert found == (Note(1, 2, "kept", "m"),)
        assert problem.startswith(f"The link has note={wrong[:40]}, which was ignored; accepted is")
    found, problems = notes_of_query("&".join(f"note={number}:a" for number in range(150)), "m")
    assert len(found) == MOST
    assert len(problems) == 1
    found, problems = notes_of_query("&".join(f"note={number}:{'漢' * 200}" for number in range(15)), "m")
    assert len(query_of_notes(found, "m")) <= ROOM
    assert "too many" in problems[0]
    assert len(notes_of_query("&".join(["note=x"] * 150), "m")[1]) == 3


def test_a_text_is_one_line_without_what_would_hide_or_turn_it() -> None:
    assert plain_text("a\u202eb\x00\u200bc\n d\ud800") == "a b c d"
