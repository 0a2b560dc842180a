"""The button *Apply the advice* on the page Verdict: it writes what was tried, and no truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from walking import Walk, walking

from lab.experiment.experiment import Experiment
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.library import add_mission
from lab.motion.recordings.flight_csv import read_flight_csv
from tests.aided_flights import winding_road


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


def applied(walk: Walk, made: Experiment) -> Experiment:
    """Return the settings of the session after the advice on a run was applied."""
    walk.page.session.experiment = made.copy()
    assert walk.run(made).problem == ""
    walk.open("Verdict")
    page = walk.shown
    assert page._follow.visible
    page._follow_advice()
    return walk.page.session.experiment


@pytest.mark.proof
def test_the_drift_of_the_receiver_is_applied_to_the_filter(walk: Walk) -> None:
    made = Experiment(mission="los_angeles")
    made.update({"trajectory.imu_rate": 50.0, "sensors.gps.correlated_sigma": 1.5})
    changed = applied(walk, made)
    assert changed.navigator.estimate_gps_drift
    assert changed.sensors.to_dict() == made.sensors.to_dict()


@pytest.mark.proof
def test_a_suggestion_beside_a_consistent_verdict_is_applied(
    walk: Walk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path / "library"))
    add_mission(read_flight_csv(winding_road(tmp_path)), "winding", title="A winding road")
    made = Experiment(mission="winding", seed=2)
    made.set("trajectory.imu_rate", 50.0)
    changed = applied(walk, made)
    text = walk.text()
    assert "Consistent" in text
    assert "error across outages of 15 s" in text
    assert changed.navigator.no_slip
    assert changed.sensors.to_dict() == made.sensors.to_dict()
