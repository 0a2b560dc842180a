"""A page of a long flight keeps one result in memory: what a newer run replaces is dropped before it."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from weakref import ref

import pytest
from panel.io.state import set_curdoc
from walking import PAUSE, Walk, walking

from lab.base import histories
from lab.experiment import sensor_stages, stages
from lab.run import run as arrays
from lab.views.run_comparison import RMS_POSITION, assess

PATIENCE = 300.0
"""Longest time that a run may take [s]; the first one compiles its kernels."""


@pytest.fixture
def long(monkeypatch: pytest.MonkeyPatch) -> Iterator[Walk]:
    """Return the page of a flight of minutes that counts as one of hours."""
    for module in (histories, sensor_stages, stages, arrays):
        monkeypatch.setattr(module, "LONG", 1000)
    stages.CACHE.clear()
    with walking(monkeypatch) as walk:
        walk.page.session.experiment.set("trajectory.imu_rate", 50)
        with set_curdoc(walk._document):
            walk.page.session._open()
            walk.page.pages.draw()
        change(walk, "mission", "los_angeles")
        yield walk
    stages.CACHE.clear()


def change(walk: Walk, path: str, value: object) -> None:
    """Change a setting, and wait for what comes of it."""
    with set_curdoc(walk._document):
        assert walk.page.session.change(path, value)
    settle(walk)


def settle(walk: Walk) -> None:
    """Wait until neither the session nor the page works."""
    until = time.monotonic() + PATIENCE
    session = walk.page.session
    while session._runs.busy or session._arrived is not None:
        walk.settle()
        time.sleep(PAUSE)
        assert time.monotonic() < until
    walk.settle()


@pytest.mark.proof
def test_a_replaced_result_is_gone_before_the_next_run(long: Walk) -> None:
    for title in ("Overview", "Flight", "Errors", "Verdict", "Ground track", "3-D", "Budget", "Compare"):
        long.open(title)
    session = long.page.session
    assert session.result is not None
    assert session.result.is_long
    old = ref(session.result)
    alive = []

    def begun(*_: object) -> None:
        gc.collect()
        alive.append(old() is not None)

    session.prepare, prepare = lambda result: (begun(), prepare(result)), session.prepare
    change(long, "sensors.gyro.noise_density", 0.02)
    assert alive == [False]
    assert session.result is not None
    assert long.complaints() == []


def test_a_failed_run_leaves_the_message_and_the_last_good_result(long: Walk) -> None:
    session = long.page.session
    change(long, "navigator.model", "nonlinear")
    change(long, "navigator.smoother", True)  # a nonlinear filter has no smoother
    assert session.problem.startswith("navigator.")
    assert session.result is not None
    assert not session.result.experiment.navigator.smoother
    assert session.experiment.navigator.smoother
    change(long, "navigator.smoother", False)
    assert session.problem == ""


@pytest.mark.proof
def test_the_models_run_without_the_result_which_comes_back(long: Walk) -> None:
    session = long.page.session
    long.open("Compare")
    settle(long)
    old = ref(session.result)
    with set_curdoc(long._document):
        long.shown._add["All error models"].value = True
    settle(long)
    gc.collect()
    assert old() is None
    assert session.result is None
    assert long.complaints() == []
    with set_curdoc(long._document):
        long.shown._cards._boxes[0].value = ["BMI088"]
        long.shown._add["Sensor cards"].value = True  # without the result
    settle(long)
    assert "computing" not in long.text()
    flown = session.experiment.run()
    assert f"<td>Now</td><td>{assess(flown).values[RMS_POSITION]:.3g}" in long.shown._table.object.replace(
        "<b>", ""
    )
    table = long.text()
    long.open("Errors")
    settle(long)
    assert session.result is not None
    long.open("Compare")
    assert not long.shown._work.busy
    assert long.text() == table
