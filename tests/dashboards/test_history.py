"""History: undo, redo, and the browser's Back and Forward, which walk the same changes of an experiment."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest
from panel.io.state import set_curdoc
from walking import Walk, walking

from dashboards.drawn_pages import PAGES
from dashboards.history import MOST, QUIET, History, State, change_in_words
from dashboards.page import SimulatorPage
from dashboards.query import View, query, query_of_view, view_of_query
from dashboards.session import Glide
from dashboards.settings_panel import RESETS, SettingsPanel
from lab.experiment.experiment import Experiment
from lab.missions import add_mission, mission, missions
from lab.sensors.cards import card, cards

NOISE, Q, R = "sensors.gyro.noise_density", "navigator.q_scale", "navigator.r_scale"
TITLES = tuple(page.title for page in PAGES)


def state(settings: str = "", tab: str = "") -> State:
    return State(settings, "", tab, None)


class Clock:
    """A clock that a test sets [s]."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now


@pytest.fixture
def walk() -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        opened.page._address.begin()
        yield opened


def test_undo_and_redo_restore_every_setting_the_seed_the_mission_and_the_tab(walk: Walk) -> None:
    session = walk.page.session
    saved = [session.experiment.to_dict()]
    walk.open("Covariance")
    changes = {
        "seed": 7,
        "mission": "los_angeles",
        "sensors.gps.outages": [(30.0, 50.0)],
        "navigator.p0": [1e-6] * 15,
        "navigator.model": "psi",
        "sensors.gyro.noise_density": (0.1, 0.2, 0.3),
        "sensors.accelerometer.noise_variance": 1.0,
    }
    for path, value in changes.items():
        assert session.change(path, value)
        saved.append(session.experiment.to_dict())
    loaded = session.experiment.copy()
    card("STIM300").load(loaded)
    session.accept(loaded)
    saved.append(session.experiment.to_dict())
    walk.open("Innovations")
    for expected in reversed(saved[:-1]):
        walk.ask("undo")
        assert session.experiment.to_dict() == expected
        assert walk.title == "Covariance"
    assert walk.sent()["undone"] == ""
    walk.ask("undo")
    assert session.experiment.to_dict() == saved[0]
    for expected in saved[1:]:
        walk.ask("redo")
        assert session.experiment.to_dict() == expected
    assert walk.title == "Innovations"
    assert walk.sent()["redone"] == ""


def test_each_change_is_an_entry_of_the_browser_and_going_to_one_adds_none(walk: Walk) -> None:
    session = walk.page.session
    session.change(NOISE, 0.2)
    session.change(Q, 0.1)
    sent = walk.sent()
    assert sent["pushed"] == [[1, f"?{NOISE}=0.2"], [2, f"?{NOISE}=0.2&{Q}=0.1"]]
    assert (sent["position"], sent["search"]) == (2, f"?{NOISE}=0.2&{Q}=0.1")
    assert (sent["undone"], sent["redone"]) == ("Navigator and filter: Q scale 1 → 0.1", "")
    for what, position, there in (("visit", 0, 0), ("redo", 0, 1), ("visit", 2, 2), ("undo", 0, 1)):
        sent = walk.ask(what, position)
        assert (sent["pushed"], sent["position"]) == ([], there)
    assert session.experiment.get(NOISE) == (0.2, 0.2, 0.2)
    assert sent["redone"] == "Navigator and filter: Q scale 1 → 0.1"
    session.change(R, 3.0)  # what was undone is gone
    sent = walk.sent()
    assert sent["pushed"] == [[2, f"?{NOISE}=0.2&{R}=3.0"]]
    assert (walk.ask("redo")["position"], session.experiment.get(Q)) == (2, 1.0)


def test_a_wish_that_a_browser_does_not_have_changes_nothing(walk: Walk) -> None:
    walk.page.session.change(NOISE, 0.2)
    for asked in (
        ["undo", None, 1],
        [],
        [[1, "visit"]],
        [[1, "visit", "1"]],
        [[1, "visit", 10**30]],
        [[1, ["undo"], 1]],
        [[1, "close", 1]],
        [[0, "undo", 0]],
    ):
        with set_curdoc(walk._document):
            walk.page._address.bar.asked = asked
        assert walk.page.session.experiment.get(NOISE) == (0.2, 0.2, 0.2), asked


def test_time_zoom_and_runs_are_in_the_address_and_no_entries(walk: Walk) -> None:
    walk.page.session.change(NOISE, 0.2)
    walk.sent()
    walk.page.axis.span(205.0)
    walk.page._time_bar.go(12.5)
    walk.page.axis.show(10, 60)
    walk.page.session.runs = 30
    walk.open("Flight")
    sent = walk.sent()
    assert (sent["pushed"], sent["position"]) == ([], 1)
    assert sent["search"] == f"?{NOISE}=0.2&tab=Flight&time=12.5&zoom=10-60&runs=30"
    assert walk.page._address.view == View("Flight", 12.5, (10.0, 60.0), 30)
    walk.ask("undo")  # which compares the same stretch before and after
    assert walk.page._shown_view() == View("", 12.5, (10.0, 60.0), 30)


def test_a_reload_shows_tab_time_zoom_and_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    with walking(monkeypatch) as walk:
        page = walk.page
        page._address.search = "?mission=los_angeles&tab=Consistency&time=12.5&zoom=10-60&runs=10"
        monkeypatch.setattr(SimulatorPage, "_frame", lambda _page: _Frame())
        with set_curdoc(walk._document):
            page.servable()
        shown = page._shown_view()
        assert shown == View("Verdict", 12.5, (10.0, 60.0), 10)
        assert walk.sent()["search"] == page._address.search  # not lost while the result is computed
        assert page.pages.sheet.button.label == "Los Angeles"
        assert {kind.title for kind in page.pages._pages} == {"Verdict"}  # others would take time
        page.session._browser_ready = True
        walk.run(Experiment(mission="los_angeles"))
        assert page._shown_view() == shown
        assert (page.axis.time, page.axis.window) == (12.5, (10.0, 60.0))
        assert "10 flights" in walk.text()


class _Frame:
    """The frame, which a server makes."""

    dark_theme = False

    def servable(self) -> None:
        """Do nothing."""

    @property
    def param(self) -> _Frame:
        """Its parameters, which nobody changes."""
        return self

    def watch(self, *_args: object) -> None:
        """Do nothing."""


@pytest.mark.parametrize(
    "text",
    ["tab=Atlantis", "time=-1", "time=nan", "time=1e400", "zoom=5-5", "zoom=9-2", "zoom=a-b", "runs=7"],
)
def test_a_wrong_part_of_a_view_is_reported_and_the_others_hold(text: str) -> None:
    view, problems = view_of_query(f"tab=Flight&time=3&{text}&seed=4", TITLES)
    assert len(problems) == 1
    assert "accepted is" in problems[0]
    assert view == View() or (view.tab or "Flight", view.time or 3.0, view.zoom, view.runs) == (
        "Flight",
        3,
        None,
        1,
    )


def test_a_view_comes_back_from_an_address() -> None:
    for view in (View(), View("3-D", 0.25, (0.0, 7.75), 1000), View("Ground track")):
        assert view_of_query(query_of_view(view), TITLES) == (view, [])


def test_a_motion_of_a_slider_is_one_entry_however_long_it_rests(walk: Walk) -> None:
    history = walk.page._address._history
    history._clock = clock = Clock()
    with set_curdoc(walk._document):
        field = SettingsPanel(walk.page.session)._fields.get(NOISE)
        assert field is not None
        for position in (0.06, 0.1, 0.2):
            field._slider.value = position
            clock.now += 3 * QUIET
        field._slider.value_throttled = 0.2
        field._slider.param.update(value=0.3, value_throttled=0.3)  # a click; both arrive in one message
        field._box.value = "0.4"
        field._box.value = "0.5"
    names = []
    while name := walk.sent()["undone"]:
        names.append(name)
        walk.ask("undo")
    changes = ("0.4 → 0.5", "0.3 → 0.4", "0.2 → 0.3", "0.05 → 0.2")
    assert names == [f"Gyros: White noise {change}" for change in changes]


def test_quick_steps_by_the_keyboard_are_one_entry() -> None:
    clock = Clock()
    history = History(state(), clock)
    for number in range(5):  # each is released
        clock.now += 0.5 * QUIET
        history.record(state(f"{Q}={number + 2}"), glide=Glide(Q, number))
    assert history.position == 1
    history.record(state(f"{R}=2"), glide=Glide(R, 9))
    clock.now += 0.5 * QUIET
    history.record(state(f"{R}=3"))  # typed
    assert history.position == 3


def test_after_undo_a_step_of_the_same_slider_is_a_new_entry() -> None:
    history = History(state(), Clock())
    history.record(state(f"{Q}=2"), glide=Glide(Q, 1))
    history.record(state(f"{R}=2"))
    assert history.visit(1) == state(f"{Q}=2")
    history.record(state(f"{Q}=3"), glide=Glide(Q, 1))
    assert (history.position, history.undone) == (2, "Navigator and filter: Q scale 2 → 3")


def test_settings_that_do_not_change_are_no_entry() -> None:
    history = History(state(f"{Q}=2"))
    history.record(state(f"{Q}=2", tab="Flight"), "Sensors: the same again")
    assert (history.position, history.undone, history.present.tab) == (0, "", "Flight")


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("", "mission=los_angeles", "Mission Montréal → Los Angeles"),
        (f"{Q}=2", "", "Navigator and filter: Q scale 2 → 1"),
        ("", "navigator.smoother=true", "Navigator and filter: Smoother off → on"),
        ("", "navigator.model=psi", "Navigator and filter: Error model phi → psi"),
        ("", f"{Q}=2&seed=3", "Navigator and filter: Q scale 1 → 2, Seed 1 → 3"),
        ("", f"{Q}=2&{R}=3&seed=4", "Navigator and filter: Q scale 1 → 2 and 2 more"),
        ("", "sensors.gps.outages=[[60.0, 75.0]]", "GPS receiver: Outages none → 60–75"),
        ("", f"navigator.p0={[1e-6] * 15}", "Navigator and filter: P₀"),
    ],
)
def test_changes_are_named_as_their_fields(before: str, after: str, words: str) -> None:
    assert change_in_words(before, after).startswith(words)


def test_a_hundred_entries_of_many_settings_take_less_than_a_megabyte() -> None:
    loaded = Experiment()
    longest = max((query(loaded.update({"sensors": one.settings()})) for one in cards().values()), key=len)
    assert len(longest) > 1000
    history = History(state())
    tracemalloc.start()
    try:
        for number in range(3 * MOST):
            matrix = [1e-6 * (number + row + 1) for row in range(15)]
            history.record(state(f"{longest}&navigator.p0={matrix}"))
        taken = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert (history.position, history.oldest) == (3 * MOST, 2 * MOST + 1)
    assert taken < 2**20


def test_an_entry_costs_the_server_less_than_a_millisecond(walk: Walk) -> None:
    address, experiment = walk.page._address, walk.page.session.experiment
    times = []
    for number in range(20):
        experiment.set(NOISE, 0.1 + number / 1000)
        begun = time.thread_time()
        address._record("", Glide(NOISE, 1))
        times.append(time.thread_time() - begun)
    assert sorted(times)[len(times) // 2] < 1e-3


def test_nothing_is_computed_again_that_the_cache_has(walk: Walk) -> None:
    from lab.experiment.stages import CACHE

    session = walk.page.session
    session.accept(Experiment().update({"mission": "los_angeles", "trajectory": {"imu_rate": 20}}))
    for value in (1.0, 2.0):
        session.change(R, value)
        assert session.experiment.run() is not None
    computed = dict(CACHE.computed)
    walk.ask("undo")
    session.experiment.run()
    assert dict(CACHE.computed) == computed


def test_a_mission_that_is_gone_keeps_the_present_one(walk: Walk) -> None:
    session, history = walk.page.session, walk.page._address._history
    history.amend(state(f"mission=gone&{Q}=2.5"))
    session.change("mission", "los_angeles")
    walk.ask("undo")
    assert (session.experiment.mission, session.experiment.get(Q)) == ("los_angeles", 2.5)
    assert "'gone' is not there any more" in session.problem
    assert walk.sent()["search"] == f"?mission=los_angeles&{Q}=2.5"


def test_a_reset_is_of_a_group_or_of_everything_and_is_undone(walk: Walk) -> None:
    session = walk.page.session
    with set_curdoc(walk._document):
        panel = SettingsPanel(session)
    for path, value in {
        NOISE: 0.2,
        Q: 2.0,
        "seed": 5,
        "mission": "los_angeles",
        "navigator.p0": [1.0] * 15,
    }.items():
        session.change(path, value)
    changed = session.experiment.to_dict()
    kept = {
        "Gyros": {Q: 2.0, "seed": 5, NOISE: (0.05,) * 3},
        "Navigator and filter": {Q: 1.0, "navigator.p0": None, "seed": 5, NOISE: (0.2,) * 3},
        "All sensors": {Q: 2.0, NOISE: (0.05,) * 3},
        "Everything": {Q: 1.0, "seed": 1, NOISE: (0.05,) * 3, "mission": "los_angeles"},
    }
    for title, values in kept.items():
        assert title in RESETS
        panel._reset({"label": title})
        assert {path: session.experiment.get(path) for path in values} == values
        assert walk.sent()["undone"] == f"Reset: {title}"
        walk.ask("undo")
        assert session.experiment.to_dict() == changed


def test_undo_brings_a_deleted_mission_back_with_its_files(walk: Walk, own_missions: Path) -> None:
    add_mission(mission("los_angeles").recording, "mine", title="My flight", overwrite=True)
    session = walk.page.session
    session.change("mission", "mine")
    files = {path.name: path.read_bytes() for path in own_missions.iterdir() if path.is_file()}
    session.delete_mission("mine")
    session.library_changed("montreal")
    assert "mine" not in missions()
    walk.ask("undo")
    assert session.experiment.mission == "mine"
    assert {path.name: path.read_bytes() for path in own_missions.iterdir() if path.is_file()} == files
    session.delete_mission("mine")
    session.close()
    assert list(own_missions.glob("**/*.csv*")) == []
