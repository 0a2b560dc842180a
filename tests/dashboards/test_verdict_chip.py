"""The verdict in the header: of the settings shown, never of older ones, with evidence and a cure."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from bokeh.server.callbacks import TimeoutCallback
from panel.io.state import set_curdoc
from walking import PAUSE, Walk, walking

from dashboards.computing import Outcome
from dashboards.verdict_chip import JUDGING, UNKNOWN, VerdictChip, named
from lab.analysis.verdicts.finding import NOTHING, Finding, Verdict
from lab.experiment.experiment import Experiment

PATIENCE = 300.0
"""Longest wait for a verdict [s]; the first run compiles kernels."""


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


def overconfident() -> Experiment:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    made.set("navigator.q_scale", 0.1)
    return made


def settled(walk: Walk) -> VerdictChip:
    """Run what waits for its time, and return the chip once it has judged what is shown."""
    chip = walk.page._chip
    for one in list(walk._document.session_callbacks):
        if isinstance(one, TimeoutCallback):
            callback = one.callback
            walk._document.remove_timeout_callback(one)
            with set_curdoc(walk._document):
                callback()
    end = time.monotonic() + PATIENCE
    while chip._work.busy:
        assert time.monotonic() < end
        time.sleep(PAUSE)
    walk.settle()
    return chip


def judged(walk: Walk, made: Experiment) -> VerdictChip:
    """Show the result of an experiment, and return the chip with its verdict."""
    walk.page.session.experiment = made.copy()
    assert walk.run(made).problem == ""
    return settled(walk)


def finding(quantity: str, direction: str, factor: float) -> Finding:
    return Finding(quantity, direction, factor, "A sentence.", "", "evidence")


def test_a_chip_names_the_first_finding_and_counts_the_others() -> None:
    fine = Verdict("Consistent: errors are as large as the filter says.", (), "one run")
    wrong = (finding("Q", "too small", 9.87), finding("GPS latency", "not modelled", 0.3))
    assert named(fine) == "● Consistent"
    large = (finding("Q", "too large", 99.6), finding("P0", "too small", 12_345.0))
    assert [named(Verdict("A sentence.", (one,), "one run")) for one in large] == [
        "● Q 100 × too large",
        "● P₀ 12000 × too small",
    ]
    assert named(Verdict("A sentence. (1 more)", wrong, "one run")) == "● Q 9.9 × too small +1"
    assert named(Verdict("A sentence.", wrong[1:], "one run")) == "● GPS latency not modelled"
    linear = finding("linear model", "not modelled", 0.66)
    assert named(Verdict("A sentence.", (linear,), "one run")) == "● Beyond the linear model"
    assert named(Verdict("Unknown.", (), NOTHING)) == f"○ {UNKNOWN}"


def test_a_changed_setting_strikes_the_verdict_out_before_anything_is_computed(walk: Walk) -> None:
    chip = walk.page._chip
    assert chip._chip.label == JUDGING
    made = overconfident()
    made.set("navigator.q_scale", 1.0)
    judged(walk, made)
    assert chip._chip.label == "● Consistent"
    green = chip._chip.sx["backgroundColor"]
    assert walk.page.session.change("navigator.q_scale", 0.1)
    assert chip._chip.sx["backgroundColor"] != green
    assert chip._chip.sx["textDecoration"] == "line-through"
    chip._open()
    assert chip._card is None  # a verdict that is struck out has no card


def test_only_the_newest_result_is_judged(walk: Walk) -> None:
    made = overconfident()
    walk.page.session.experiment = made.copy()
    old = walk.run(made)
    made.set("navigator.q_scale", 1.0)
    new = walk.run(made)
    chip = settled(walk)
    assert chip._chip.label == "● Consistent"
    chip._receive(
        (old.result, False), type(old)(result=old.result.verdict)
    )  # what a slow thread delivers late
    assert chip._chip.label == "● Consistent"
    assert chip._result is new.result


def test_the_cure_is_two_presses_away_and_changes_that_setting_alone(walk: Walk) -> None:
    made = overconfident()
    chip = judged(walk, made)
    assert chip._chip.label.startswith("● Q ")
    assert chip._chip.label.endswith("too small")
    chip._open()
    assert chip._card.open
    assert not chip._apply.visible  # it is being tried
    assert "Trying the advice" in chip._words.object
    settled(walk)
    assert chip._apply.visible
    assert "Evidence: " in chip._words.object
    chip._applied()
    assert not chip._card.open
    changed = walk.page.session.experiment
    assert changed.navigator.q_scale == pytest.approx(1.0, rel=0.3)
    changed.set("navigator.q_scale", 0.1)
    assert changed.to_dict() == made.to_dict()


def test_show_me_opens_the_evidence_at_the_worst_fix(walk: Walk) -> None:
    chip = judged(walk, overconfident())
    chip._open()
    settled(walk)
    with set_curdoc(walk._document):
        chip._shown()
    walk.settle()
    assert walk.title == "Verdict"
    result = walk.page.session.result
    worst = int(np.nanargmax(result.innovations["nis"].values))
    assert walk.page.axis.time == pytest.approx(float(result.fixes.time[worst]))


def test_a_run_that_fails_has_no_verdict(walk: Walk) -> None:
    chip = judged(walk, overconfident())
    chip.wait()
    walk.page.session.problem = "This run failed."
    assert chip._chip.label == UNKNOWN
    assert "textDecoration" not in chip._chip.sx


def test_the_verdict_of_a_long_flight_is_struck_out_too(walk: Walk) -> None:
    """Its result is released, for its memory, before the next run begins."""
    chip = judged(walk, overconfident())
    walk.page.session.result = None
    assert "textDecoration" not in chip._chip.sx  # the plots stay, and so does what is said of them
    chip.wait()
    assert chip._chip.sx["textDecoration"] == "line-through"


def test_nothing_is_judged_while_pages_open(walk: Walk) -> None:
    """A class opens thirty pages at once, and each has a verdict that takes as long as its run."""
    waiting = type("Openings", (), {"busy": True})()
    walk.page._chip._openings = waiting
    chip = judged(walk, overconfident())
    assert chip._chip.label == JUDGING
    waiting.busy = False
    assert settled(walk)._chip.label.endswith("too small")


def test_advice_that_cannot_be_tried_says_so_and_is_not_applied(walk: Walk) -> None:
    chip = judged(walk, overconfident())
    chip._open()
    settled(walk)
    chip._receive((walk.page.session.result, False), Outcome(result=walk.page.session.result.verdict))
    chip._open()
    chip._receive((walk.page.session.result, True), Outcome(problem="This run failed."))
    assert "could not be tried. This run failed." in chip._words.object
    assert not chip._apply.visible
