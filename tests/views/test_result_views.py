"""What a result offers in a notebook: its plots by name, the scene in a frame, and the explorer."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from bokeh.document import Document
from param.parameterized import edit_constant
from sensor_logs import tables, write

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.explorer import Explorer


@pytest.fixture(scope="module")
def result() -> Result:
    experiment = Experiment(mission="los_angeles", seed=2)
    experiment.trajectory.imu_rate = 20
    return experiment.run()


def test_a_log_without_reference_has_the_plots_that_need_none(tmp_path: Path) -> None:
    folder = write(tmp_path / "drive", tables(60, 90))
    (folder / "ref.csv").unlink()
    blind = Experiment(mission=str(folder)).run()
    assert "errors" not in dir(blind.plot)
    for name in dir(blind.plot):
        assert getattr(blind.plot, name)() is not None, name
    explorer = Explorer(blind)
    titles = list(explorer._makers)
    assert {"Errors", "Budget"}.isdisjoint(titles)
    for index in range(len(titles)):
        explorer.tabs.active = index
    assert len(explorer._made) == len(titles)
    assert "<iframe" in blind.view3d()._repr_html_()


def test_plot_lists_the_plots_that_a_result_has(result: Result) -> None:
    names = dir(result.plot)
    assert {"errors", "innovations", "consistency", "ground_track", "height"} <= set(names)
    assert len(result.plot.errors()) == 9
    assert len(result.plot()) == 9
    assert len(result.plot.consistency()) == 4
    assert "position, velocity and attitude errors" in str(result.plot.errors.__doc__)
    with pytest.raises(AttributeError, match="no plot 'speed'; accepted: "):
        _ = result.plot.speed


def test_the_scene_is_a_page_that_needs_no_server(
    result: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = result.view3d(height=321)
    frame.save(tmp_path / "flight.html")
    page = (tmp_path / "flight.html").read_text("utf-8")
    assert not re.findall(r"""(?:src|href)=["']https?://""", page)
    shown = frame._repr_html_()
    assert "height:321px" in shown
    assert shown.count("<") == 2, "the page is escaped inside the frame"
    assert capsys.readouterr().out == ""


@pytest.mark.proof
def test_the_explorer_draws_its_tabs_when_they_are_opened(result: Result) -> None:
    explorer = Explorer(result)
    assert [len(tab) for tab in explorer.tabs] == [1] * len(explorer.tabs)
    titles = list(explorer._makers)
    assert titles[0] == "Errors"
    document = Document()
    explorer.view.server_doc(document)
    explorer.tabs.active = titles.index("Innovations")
    figures = explorer._made[explorer.tabs.active].figures
    assert len(figures) == 12

    errors = explorer._made[0].figures[0]
    whole = errors.y_range.end
    explorer.tabs.active = 0
    explorer.window.value = (80.0, 100.0)
    with edit_constant(explorer.window):
        explorer.window.value_throttled = (80.0, 100.0)
    assert explorer.axis.window == (80.0, 100.0)
    late = result.errors.position.sel(axis="east", time=slice(80, 100))
    assert np.abs(late).max() <= errors.y_range.end <= whole

    explorer.tabs.active = titles.index("Ground track")
    explorer.cursor.value = 50.0
    assert explorer.axis.time == 50.0
