"""Plots in a notebook: they turn dark with JupyterLab, and light again; the explorer shows all its rows."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import holoviews as hv
import pytest
from bokeh.embed import file_html
from bokeh.plotting import figure
from bokeh.resources import INLINE
from playwright.sync_api import Browser, expect

from lab import Experiment
from lab.experiment.result import Result
from lab.views.allan import AllanFigures
from lab.views.explorer import ROW, Explorer
from lab.views.notebook_display import follow_theme
from lab.views.plots import errors, ground_track, innovations
from tests.browser.conftest import ROOT, eventually, new_context

pytestmark = pytest.mark.browser

INVERTED = re.compile("invert")


@pytest.mark.parametrize("begins", ["true", "false"])
def test_a_figure_has_the_theme_of_jupyterlab_and_follows_it(chromium: Browser, begins: str) -> None:
    drawn = figure(width=300, height=200)
    drawn.line([0, 1], [0, 1])
    follow_theme(drawn)
    follow_theme(drawn)
    text = file_html(drawn, INLINE).replace("<body>", f'<body data-jp-theme-light="{begins}">')
    page = new_context(chromium).new_page()
    page.set_content(text)
    shown = page.locator(".bk-Figure")
    for light in (begins, "false", "true", "false"):
        page.evaluate(f"document.body.dataset.jpThemeLight = '{light}'")
        if light == "false":
            expect(shown).to_have_css("filter", INVERTED)
        else:
            expect(shown).not_to_have_css("filter", INVERTED)
    page.context.close()


ROOM = """
() => {
  const view = Bokeh.index.roots.findLast((one) => one.frame);
  const title = view.model.title;
  const pen = document.createElement("canvas").getContext("2d");
  pen.font = `${title.text_font_style} ${title.text_font_size} ${title.text_font}`;
  return [pen.measureText(title.text).width, view.frame.bbox.width];
}
"""
"""Returns the width of a figure's title, and of the room above the curves [px]."""


@pytest.mark.parametrize("dashed", ["the settings", "simulated"])
def test_the_titles_of_allan_figures_fit_a_phone(chromium: Browser, dashed: str) -> None:
    page = new_context(chromium).new_page()
    page.set_viewport_size({"width": 380, "height": 400})
    for drawn in AllanFigures(dashed).figures:
        page.set_content(file_html(drawn, INLINE))
        page.wait_for_function(
            f"() => Bokeh.index.roots.some((one) => one.model.id === '{drawn.id}' && one.frame)"
        )
        title, room = page.evaluate(ROOM)
        assert 50 < title < room
    page.context.close()


SAVE_WIDGET = """
import sys
from pathlib import Path
import panel as pn
from bokeh.plotting import figure
from bokeh.resources import INLINE
from lab.views.notebook_display import follow_theme
drawn = figure(width=300, height=200)
drawn.line([0, 1], [0, 1])
follow_theme(drawn)
# As in a notebook with PANEL_INLINE; a saved page asks the network for it.
native = (Path(pn.__file__).parent / "theme/css/native.css").read_text(encoding="utf-8")
slider = pn.widgets.FloatSlider(label="Noise", stylesheets=[native])
pn.Column(slider, pn.pane.Bokeh(drawn)).save(sys.argv[1], resources=INLINE)
"""
"""In a process of its own: one that has imported the dashboard also asks the network for its scripts."""


def test_widgets_beside_a_figure_have_the_text_colour_of_jupyterlab(
    chromium: Browser, tmp_path: Path
) -> None:
    subprocess.run([sys.executable, "-c", SAVE_WIDGET, str(tmp_path / "page.html")], cwd=ROOT, check=True)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<body>" in text
    page = new_context(chromium).new_page()
    page.set_content(
        text.replace("<body>", '<body data-jp-theme-light="false" style="--jp-ui-font-color1: rgb(1, 2, 3)">')
    )
    expect(page.locator(".bk-slider-title")).to_have_css("color", "rgb(1, 2, 3)")
    page.context.close()


@pytest.fixture(scope="module")
def result() -> Result:
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.trajectory.imu_rate = 50
    return experiment.run()


SAVE = """
import sys
from bokeh.resources import INLINE
from lab import Experiment
from lab.views.explorer import Explorer
experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 50
Explorer(experiment.run()).view.save(sys.argv[1], resources=INLINE)
"""
"""As in a notebook; a process that has imported the dashboard also asks for the scripts of its widgets."""


@pytest.mark.proof
def test_the_explorer_is_as_high_as_its_figures(chromium: Browser, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", SAVE, str(tmp_path / "explorer.html")], cwd=ROOT, check=True)
    page = new_context(chromium, viewport={"width": 1100, "height": 900}).new_page()
    page.goto((tmp_path / "explorer.html").as_uri())
    figures = page.locator(".bk-Figure")
    expect(figures).to_have_count(9)
    expect(figures.last).to_be_visible()
    tabs = page.locator("[class*='Tabs']").first
    bottom = "(part) => part.getBoundingClientRect().bottom"
    # The figures are visible before the last layout.
    eventually(page, lambda: figures.last.evaluate(bottom) <= tabs.evaluate(bottom) + 1)
    assert tabs.evaluate("(part) => part.getBoundingClientRect().height") > 3 * ROW
    page.context.close()


def test_all_figures_of_a_result_follow(result: Result) -> None:
    explorer = Explorer(result)
    figures = list(explorer.tabs.get_root().select({"type": figure}))
    for plot in (errors, innovations, ground_track):
        figures += hv.render(plot(result)).select({"type": figure})
    assert len(figures) > 9 + 6 + 6
    for one in figures:
        assert one.js_property_callbacks.keys() == {"change:inner_width"}, one.title.text


def test_plots_that_a_notebook_draws_itself_follow() -> None:
    script = """import holoviews as hv; from lab import plots; plots.follow_theme()
curve = hv.Curve(([0, 1], [0, 1]))
area = hv.Area(([0, 1], [0, 1], [1, 2]), "x", ["y", "high"])
bars = hv.ErrorBars(([0, 1], [0, 1], [1, 1])) * hv.Scatter([0, 1])
heat = hv.HeatMap([(0, 0, 1), (1, 0, 2)])
for one in (curve.opts(width=300), hv.Overlay([curve, curve]) * area, bars, heat):
    print(*hv.render(one).js_property_callbacks)
drawn = hv.render(hv.Bars([1, 2])); plots.follow_theme(drawn); print(*drawn.js_property_callbacks)"""
    found = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert found.stdout.split() == ["change:inner_width"] * 5
