"""The Overview: what it says of a run, what its buttons do, and what a log or a homework changes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from shutil import rmtree
from weakref import ref

import numpy as np
import panel as pn
import panel_material_ui as pmui
import pytest
from panel.io.state import set_curdoc
from sensor_logs import tables, write
from walking import Walk, walking

from dashboards import viser_proxy
from dashboards.pages import view_3d
from dashboards.pages.overview import OUTAGES, Q_SCALE, Overview
from dashboards.viser_proxy import registered_views
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.homework.scenario import Hidden, Scenario
from lab.experiment.experiment import Experiment


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Walk]:
    with walking(monkeypatch) as opened:
        opened.open("Overview")
        yield opened


def flight() -> Experiment:
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", 50)
    return experiment


def begin(walk: Walk, experiment: Experiment) -> None:
    """Have a page with these settings, and their result."""
    walk.page.session.experiment = experiment
    assert walk.run(experiment).problem == ""
    assert walk.complaints() == []


def overview(walk: Walk) -> Overview:
    assert isinstance(walk.shown, Overview)
    return walk.shown


def press(walk: Walk, key: str) -> None:
    with set_curdoc(walk._document):
        overview(walk)._head.asked = {"key": key, "count": overview(walk)._head.asked.get("count", 0) + 1}


def numbers(walk: Walk) -> dict[str, str]:
    return {label: value for _key, value, label, _step in overview(walk)._head.content["numbers"]}


def keys(walk: Walk) -> list[str]:
    return [key for key, _label in overview(walk)._head.content["actions"]]


def titles(walk: Walk) -> list[str]:
    return [str(fig.title.text).partition(" [")[0].partition("\u2009")[0] for fig in walk.figures()]


def test_nothing_is_there_before_the_first_result(walk: Walk) -> None:
    assert walk.complaints() == ["says nothing about what it works out"]
    assert overview(walk)._head.content == {"sentences": "", "actions": [], "numbers": []}
    for key in ("outage", "Errors", "0 Errors", "None"):
        press(walk, key)
    assert walk.title == "Overview"
    assert walk.page.session.experiment.get(OUTAGES) == []


def test_a_simulated_flight_at_a_glance(walk: Walk) -> None:
    begin(walk, flight())
    result = walk.page.session.result
    assert result is not None
    assert titles(walk) == [
        "Ground track",
        "Horizontal position error",
        "Velocity error",
        "Heading error",
        "NIS: normalised innovations",
    ]
    said = overview(walk)._head.content["sentences"]
    assert "“Los Angeles”" in said
    assert "MEMSense AccelRate3D" in said
    found = numbers(walk)
    assert len(found) == 6
    east, north, _ = result.errors["position"].values.T
    expected = np.sqrt(np.mean(east**2 + north**2))
    assert float(found["Horizontal position, rms"].split("\u2009")[0]) == pytest.approx(expected, rel=5e-3)
    velocity = np.sqrt(np.mean(np.sum(result.errors["velocity"].values ** 2, axis=1)))
    assert float(found["Velocity, rms"].split("\u2009")[0]) == pytest.approx(velocity, rel=5e-3)
    inside = result.coverage["within ±3σ [%]"].mean()
    shown = float(found["Inside 3σ, expected 99.7"].split("\u2009")[0])
    assert shown == pytest.approx(inside, abs=0.06)
    nis = np.nanmean(result.innovations["nis"].values) / result.innovations["nis"].attrs["degrees"]
    assert float(found["NIS, expected 1"]) == pytest.approx(nis, rel=5e-3)
    assert "IMU rate" in walk.text()  # a setting that differs


def test_the_buttons_change_settings_and_undo_takes_them_back(walk: Walk) -> None:
    begin(walk, flight())
    session = walk.page.session
    walk.page._address.begin()
    press(walk, "fool")
    assert session.experiment.get(Q_SCALE) == pytest.approx(0.1)
    press(walk, "outage")
    ((start, end),) = session.experiment.get(OUTAGES)
    assert end - start == pytest.approx(20)
    assert 0 < start < end < 105
    press(walk, "outage")
    assert session.experiment.get(OUTAGES) == [(start, end)], "a second press changes nothing"
    press(walk, "0 Errors")
    assert walk.title == "Errors"
    walk.open("Overview")
    walk.ask("undo")
    walk.ask("undo")
    assert session.experiment.get(OUTAGES) == []
    assert session.experiment.get(Q_SCALE) == 1
    press(walk, "lesson")
    assert walk.title == "Lessons"


def test_held_results_are_drawn_beside(walk: Walk) -> None:
    begin(walk, flight())
    walk.page._holding.hold()
    begin(walk, flight().update({"seed": 2}))
    assert len(overview(walk)._track._held.data["colour"]) == 1
    assert len(overview(walk)._figures[overview(walk)._shown]._layers) == 1


@pytest.mark.parametrize("has_reference", [False, True])
def test_a_log(walk: Walk, own_missions: Path, request: pytest.FixtureRequest, has_reference: bool) -> None:
    folder = write(own_missions / "drive", tables(60, 90), 'title = "Drive"')
    request.addfinalizer(lambda: rmtree(folder))
    if not has_reference:
        (folder / "ref.csv").unlink()
    begin(walk, flight())  # the plots change with the kind of run
    begin(walk, Experiment(mission="drive"))
    result, said = walk.page.session.result, overview(walk)._head.content["sentences"]
    assert result is not None
    assert "“Drive”" in said
    assert ("without a reference" in said) == (not has_reference)
    found = numbers(walk)
    assert len(found) == 6
    if has_reference:
        assert found["NEES, expected 1"] == "–"
        assert "Horizontal position error" in titles(walk)
        return
    assert "Position innovations" in titles(walk)
    assert "Horizontal position error" not in titles(walk)
    assert float(found["Duration"].split("\u2009")[0]) == pytest.approx(result.time[-1], rel=5e-3)
    assert found["GPS fixes"] == str(result.fixes.time.size)
    press(walk, "1 Verdict")
    assert walk.title == "Verdict"
    walk.open("Overview")
    press(walk, "outage")
    ((start, _end),) = walk.page.session.experiment.get(OUTAGES)
    assert result.epoch < start < result.epoch + result.time[-1], "in the clock of the file"


def test_a_log_is_judged_by_itself(
    walk: Walk, own_missions: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(own_missions / "blind", tables(60, 160))
    request.addfinalizer(lambda: rmtree(folder))
    (folder / "ref.csv").unlink()
    begin(walk, Experiment(mission="blind"))
    checks = overview(walk)._checks
    assert checks is not None
    assert "Judging the log by itself" in walk.text()
    assert not checks._plots.visible
    walk.open("Flight")
    assert checks._next is None, "nothing is computed that nobody sees"
    walk.open("Overview")
    wanted = checks._next
    assert wanted is not None
    with set_curdoc(walk._document):
        checks.begin(ref(Experiment(mission="blind").run()))
        assert not checks._work.busy, "of another result"
        checks.begin(wanted)
    assert checks._work.busy
    monkeypatch.setattr(Walk, "shown", checks)  # until it is done
    walk.settle()
    monkeypatch.undo()
    assert checks._plots.visible
    assert "Fixes withheld for 10 s are predicted within" in walk.text()
    assert "Filter and smoother differ by" in walk.text()
    assert "Withheld fixes" in titles(walk)
    (button,) = checks.view.select(pmui.Button)
    with set_curdoc(walk._document):
        button.clicks += 1
    assert walk.title == "Verdict"
    walk.open("Overview")
    begin(walk, flight())
    assert checks._content is None
    assert checks.view not in overview(walk).view.objects


def test_a_homework_offers_only_what_may_be_changed(walk: Walk) -> None:
    for change, expected in ((("navigator.r_scale",), []), ((Q_SCALE,), ["fool"])):
        shown = {"mission": "los_angeles", "trajectory": {"imu_rate": 50}}
        scenario = Scenario("find", "Find it", shown, change, Hidden(faults=("r",)))
        begin(walk, HiddenExperiment(scenario).update(shown))
        assert keys(walk) == expected
        assert "errors are hidden" in overview(walk)._head.content["sentences"]
        assert "MEMSense" not in overview(walk)._head.content["sentences"]
        press(walk, "outage")
        press(walk, "lesson")
        assert walk.page.session.experiment.get(OUTAGES) == []
        assert walk.title == "Overview"


def test_a_hidden_fault_leaves_the_buttons_but_no_other_lesson(walk: Walk) -> None:
    faulty = FaultyExperiment(next(iter(FAULTS.values()))).update(flight().to_dict())
    begin(walk, faulty)
    assert "lesson" not in keys(walk)


def test_what_has_nothing_to_show_of_a_log_is_dimmed_and_says_what_to_see(
    walk: Walk, own_missions: Path, request: pytest.FixtureRequest
) -> None:
    folder = write(own_missions / "blind", tables(60, 90))
    request.addfinalizer(lambda: rmtree(folder))
    (folder / "ref.csv").unlink()
    begin(walk, flight())
    tabs = walk.page.pages.tabs
    assert tabs._marks is None
    begin(walk, Experiment(mission="blind"))
    assert tabs._marks is not None
    assert "no reference" in tabs._marks.reasons["tab"]["Errors"]
    assert tabs._marks.reasons["button"] == {}
    walk.open("Errors")
    assert set(tabs._marks.reasons["button"]) == {"Errors"}, "σ is known without a reference"
    assert "no reference" in walk.reason
    (words,) = walk.page.pages._stage._reason.view.select(pn.pane.HTML)
    assert re.findall(r'<a href="#\w+" data-page="(\w+)">\1</a>', words.object) == ["Innovations", "Verdict"]
    with set_curdoc(walk._document):
        walk.page._address.bar.asked = [[1, "Verdict", 0]]
    assert walk.title == "Verdict"
    assert set(tabs._marks.reasons["button"]) == {"Budget"}
    walk.open("Covariance")
    assert "Errors" not in tabs._marks.reasons["tab"], "it opens what there is"
    begin(walk, flight())
    assert tabs._marks.reasons == {"tab": {}, "button": {}}


def test_the_flight_in_three_dimensions_takes_the_place_of_the_track_while_it_is_wanted(
    walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view_3d, "serving_application", viser_proxy.web_application)  # a browser is there
    begin(walk, flight())
    page = overview(walk)
    views = registered_views(viser_proxy.web_application(walk._document))
    assert page._scene is None, "nothing is made that nobody asked for"
    assert not views
    with set_curdoc(walk._document):
        page._switch.is_3d = True
    walk.settle()
    assert len(views) == 1
    scene = page._scene
    assert scene is not None
    assert scene.view in page.view.objects
    assert "Ground track" not in titles(walk)
    assert scene._scene is not None
    assert scene._scene._result is walk.page.session.result
    begin(walk, flight().update({"seed": 2}))
    assert scene._scene._result is walk.page.session.result
    walk.page._time_bar.go(10.0)
    with set_curdoc(walk._document):
        page._switch.is_3d = False
    walk.settle()
    assert not views
    assert page._scene is None
    assert "Ground track" in titles(walk)
