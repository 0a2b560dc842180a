"""The outages on the page Compare: table and curves come as they are computed, and are of its settings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from panel.io.state import set_curdoc
from sensor_logs import tables, write
from walking import Walk, walking

from dashboards.pages.compare import Compare
from dashboards.pages.outages import EVERY, OLD, PALE, PLAIN, Outages, Plan
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.outage_table import OutageTable
from lab.sensors.cards import cards

PATIENCE = 480.0
"""Time after which work counts as hung [s]."""


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page with a result, on the tab Compare, with the part Outages."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        show(opened)
        opened.open("Compare")
        page = opened.shown
        assert isinstance(page, Compare)
        with set_curdoc(opened._document):
            page._add["Outages"].value = True
        opened.settle()
        yield opened


def show(walk: Walk, **settings: object) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50)
    for path, value in settings.items():
        made.set(path.replace("__", "."), value)
    walk.page.session.experiment = made
    assert walk.run(made).problem == ""


def part(walk: Walk) -> Outages:
    page = walk.shown
    assert isinstance(page, Compare)
    return page._outages


def press(walk: Walk, **values: Any) -> None:
    """Set some of the widgets, and press the button."""
    shown = part(walk)
    with set_curdoc(walk._document):
        shown._seconds.value, shown._seeds.value = 20.0, 3
        for name, value in values.items():
            getattr(shown, f"_{name}").value = value
        shown._run()


def wait(walk: Walk) -> None:
    until = time.monotonic() + PATIENCE
    while part(walk).busy:
        walk.settle()
        assert time.monotonic() < until, "the outages are still computed"
        time.sleep(0.01)
    walk.settle()


def test_a_table_and_curves_of_the_present_settings(walk: Walk) -> None:
    assert part(walk).view.visible
    press(walk, wish=8.0)
    assert part(walk)._stop.visible
    wait(walk)
    shown = part(walk)
    assert "MEMSense AccelRate3D" in shown._table.object
    assert "within 8 m" in shown._table.object
    assert "matched to its sensors" in shown._table.object
    assert not shown._stop.visible
    assert (shown._words.object, shown._table.styles) == ("", PLAIN)
    (figure,) = [pane.object for pane in shown._figure]
    assert figure.yaxis[0].axis_label == "Horizontal error, 95 % [m]"


def test_a_grade_and_all_cards_can_be_chosen(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def note(_self: Experiment, *arguments: Any, **_options: Any) -> None:
        asked.append(arguments)
        raise SettingError("not today")

    monkeypatch.setattr(Experiment, "outage", note)
    for choice in (EVERY, "Navigation grade", "../../etc/passwd"):
        press(walk, cards=choice)  # a browser may send what is not offered
        wait(walk)
    assert [one[1] for one in asked] == [list(cards()), ["HG9900"], None]
    assert "not today" in part(walk)._words.object


def test_other_settings_make_it_pale_and_other_outages_do_not(walk: Walk) -> None:
    press(walk)
    wait(walk)
    show(walk, navigator__q_scale=2.0)
    assert part(walk)._table.styles == PALE
    assert OLD in part(walk)._words.object
    press(walk)
    wait(walk)
    assert part(walk)._table.styles == PLAIN
    assert "with yours" in part(walk)._table.object
    show(walk, navigator__q_scale=2.0, sensors__gps__outages=[(40.0, 50.0)])
    assert part(walk)._table.styles == PLAIN


def test_what_is_done_stays_when_it_is_cancelled(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    """The computation waits after its first runs, so that it is not done before it is cancelled."""
    compute = Plan.compute

    def wait_after_first(plan: Plan, progress: Progress, show: Callable[[OutageTable], None]) -> OutageTable:
        def show_and_wait(table: OutageTable) -> None:
            show(table)
            while True:  # until the progress says that it was cancelled
                progress("waits", 0.5)
                time.sleep(0.01)

        return compute(plan, progress, show_and_wait)

    monkeypatch.setattr(Plan, "compute", wait_after_first)
    monkeypatch.setattr("lab.experiment.ensembles.outages.SHOWN_EVERY", 0.0)
    press(walk, seeds=50)
    until = time.monotonic() + PATIENCE
    while "CEP" not in part(walk)._table.object:
        walk.settle()
        assert time.monotonic() < until
        time.sleep(0.01)
    with set_curdoc(walk._document):
        part(walk)._cancel()
    wait(walk)
    shown = part(walk)
    assert "Stopped" in shown._words.object
    assert "MEMSense AccelRate3D" in shown._table.object
    assert not shown._stop.visible


def test_a_wrong_length_is_answered(walk: Walk) -> None:
    press(walk, seconds=3000.0)
    wait(walk)
    assert "does not fit into the flight" in part(walk)._words.object
    press(walk, seconds=None)
    wait(walk)
    assert "accepted is a number of 1 or more" in part(walk)._words.object


def test_a_log_has_no_number_of_runs(walk: Walk, tmp_path: Any) -> None:
    folder = write(tmp_path / "drive", tables(10, 120))
    show(walk, mission=str(folder), sensors__gyro__bias_sigma=0.3)
    assert not part(walk)._seeds.visible
    press(walk)
    wait(walk)
    assert "withheld fixes" in part(walk)._table.object
