"""The Microscope: it follows the time cursor to each fix, and says where nothing was updated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from shutil import rmtree

import numpy as np
import pytest
from panel.io.state import set_curdoc
from walking import Walk, walking

from dashboards.pages.microscope import Microscope
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.experiment import Experiment
from lab.sensors.suite import OTHER_SENSORS
from lab.views.microscope import number
from tests.simulated_logs import log_of


@pytest.fixture(scope="module")
def walk() -> Iterator[Walk]:
    """Return one page for all tests."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


def flight(**groups: object) -> Experiment:
    return Experiment(mission="los_angeles").update({"trajectory": {"imu_rate": 20}} | groups)


def begin(walk: Walk, experiment: Experiment) -> None:
    with set_curdoc(walk._document):
        walk.page.session.experiment = experiment
        walk.page._time_bar.go(0.0)
    assert walk.run(experiment).problem == ""
    walk.open("Microscope")
    assert walk.complaints() == []


def go(walk: Walk, time: float) -> None:
    with set_curdoc(walk._document):
        walk.page._time_bar.go(time)
    walk.settle()
    assert walk.complaints() == []


def step(walk: Walk, by: int) -> None:
    with set_curdoc(walk._document):
        walk.page._step_to_fix(by)
    walk.settle()
    assert walk.complaints() == []


def test_arrows_show_the_update_of_each_fix(walk: Walk) -> None:
    begin(walk, flight())
    result = walk.page.session.result
    assert result is not None
    assert "The filter has not updated yet" in walk.text()
    for fix in (0, 1, 2):
        step(walk, 1)
        assert f"Fix {fix + 1} of {result.fixes.time.size}" in walk.text()
        assert f"NIS = {number(float(result.innovations.nis[fix]))}" in walk.text()
        (east,) = walk.figures()[0].select({"name": "innovation"})[0].data_source.data["east"]
        assert east == pytest.approx(result.innovations.position.values[fix, 0])
    step(walk, -1)
    assert "Fix 2 of" in walk.text()


def test_the_newest_place_of_the_cursor_wins(walk: Walk) -> None:
    begin(walk, flight())
    with set_curdoc(walk._document):
        for time in (10.0, 40.0, 25.0):
            walk.page._time_bar.go(time)
    walk.settle()
    shown = walk.shown
    assert isinstance(shown, Microscope)
    assert shown._content is not None
    assert shown._content[1].attrs["time"] <= 25.0 < shown._content[1].attrs["time"] + 1
    assert f"at {shown._content[1].attrs['time']:.6g} s" in walk.text()


def test_an_outage_says_that_nothing_is_updated(walk: Walk) -> None:
    begin(walk, flight(sensors={"gps": {"outages": [(30.0, 50.0)]}}))
    go(walk, 45.0)
    assert "updates nothing" in walk.text()
    go(walk, 20.2)
    assert "updates nothing" not in walk.text()


def test_a_rejected_fix_says_that_nothing_was_updated(walk: Walk) -> None:
    begin(walk, flight(navigator={"gate": 0.5}))
    result = walk.page.session.result
    assert result is not None
    rejected = int(np.flatnonzero(result.solution_arrays.fix_rejected)[0])
    go(walk, float(result.fixes.time[rejected]))
    assert "rejected by the gate, so nothing was updated" in walk.text()
    assert "x⁺ = 0, P⁺ = P⁻" in walk.text()


def test_heading_that_is_not_observed_is_named(walk: Walk) -> None:
    begin(walk, flight(navigator={"attitude_sigma": [0.5, 0.5, 10.0]}))
    assert "attitude down (heading): σ 10 ° of 10 ° at the start" in walk.text()


@pytest.mark.parametrize(
    "groups",
    [
        {"navigator": {"states": 21}},
        {"sensors": {name: {"fitted": True} for name in OTHER_SENSORS}},
        {"navigator": {"model": "psi"}},
        {"navigator": {"model": "nonlinear"}},
        {"navigator": {"smoother": True}},
        {"navigator": {"robust": "huber", "correction": "feedforward"}},
    ],
    ids=str,
)
def test_other_filters_are_shown(walk: Walk, groups: dict[str, object]) -> None:
    """Filters that other tests compile too."""
    begin(walk, flight(**groups))
    go(walk, 30.0)
    assert walk.reason == ""
    assert "NIS =" in walk.text()


def test_a_log_without_reference_is_shown(walk: Walk, tmp_path: Path) -> None:
    made = log_of(flight().run(), tmp_path / "log")
    (tmp_path / "log" / "ref.csv").unlink()
    begin(walk, made)
    go(walk, 30.0)
    assert "NIS =" in walk.text()
    rmtree(tmp_path / "log")


def test_a_run_that_hides_settings_shows_no_matrices(walk: Walk) -> None:
    experiment = FaultyExperiment(FAULTS["latency"]).update({"mission": "los_angeles"})
    walk.page.session.experiment = experiment
    walk.show(experiment.run())
    walk.open("Microscope")
    assert "hidden" in walk.reason
    assert walk.text().strip() == walk.reason
