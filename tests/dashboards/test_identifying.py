"""The button on the page Verdict: it finds what the innovations say, and applies it to the session."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from walking import PAUSE, Walk, walking

from lab.experiment.experiment import Experiment


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


@pytest.mark.proof
def test_the_table_comes_and_is_applied(walk: Walk) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50)
    made.navigator.update({"r_scale": 100.0})
    walk.page.session.experiment = made.copy()
    assert walk.run(made).problem == ""
    walk.open("Verdict")
    identifying = walk.shown._identifying
    identifying._asked()
    until = time.monotonic() + 120
    while identifying._work.busy:
        time.sleep(PAUSE)
        assert time.monotonic() < until
        walk.settle()
    walk.settle()
    text = walk.text()
    assert "horizontal position variance" in text
    assert "95 % interval" in text
    assert "Apply the settings." in text
    assert identifying._apply.visible
    assert set(identifying._chosen.value) >= {row.parameter for row in identifying._found.rows[4:7]}
    assert tuple(identifying._chosen.value) == identifying._found.applied
    everything = list(identifying._chosen.value)
    identifying._chosen.value = []
    assert not identifying._apply.visible
    identifying._chosen.value = [name for name in everything if name != "velocity variance"]
    assert identifying._apply.visible
    identifying._applied()
    changed = walk.page.session.experiment
    assert changed.navigator.r_factors[0] == pytest.approx(0.01, rel=0.5)
    assert changed.navigator.r_factors[2] == made.navigator.r_factors[2]
    assert changed.sensors.to_dict() == made.sensors.to_dict()
