"""How fast the page follows: from a moved slider to repainted plots, alone and among ten."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from playwright.sync_api import Page

pytestmark = [pytest.mark.browser, pytest.mark.benchmark]

WATCH = """
() => {
  const source = Bokeh.documents[0].get_model_by_name("time:position_east");
  const times = window.times = [];
  let moved = null;
  window.addEventListener("keydown", () => { moved ??= performance.now(); }, true);
  source.properties.data.change.connect(() => {
    // The repaint is done in the next frame; the one after it begins when that frame is on its way.
    requestAnimationFrame(() => requestAnimationFrame(() => {
      if (moved !== null) { times.push(performance.now() - moved); moved = null; }
    }));
  });
}
"""
"""Measures from each key press that moves a slider until the frame with the new curves is out."""


def noise_slider(page: Page):
    return page.get_by_role("slider", name="White noise").first


def test_slider_to_repainted_plots(
    open_page: Callable[..., Page], capsys: pytest.CaptureFixture[str]
) -> None:
    page = open_page()
    assert page.locator("canvas").count() >= 9
    page.evaluate(WATCH)
    slider = noise_slider(page)
    slider.focus()
    for count in range(1, 61):
        slider.press("ArrowRight" if count % 40 < 20 else "ArrowLeft")
        page.wait_for_function(f"window.times.length >= {count}")
    times = np.array(page.evaluate("window.times"))[10:]
    median, most = np.median(times), np.quantile(times, 0.95)
    with capsys.disabled():
        print(f"\nslider to nine repainted plots, montreal: median {median:.0f} ms, 95 % {most:.0f} ms")
    assert median <= 120
    assert most <= 250


def test_ten_sessions_at_once(open_page: Callable[..., Page], capsys: pytest.CaptureFixture[str]) -> None:
    pages = [open_page() for _ in range(10)]
    for page in pages:
        page.evaluate(WATCH)
        noise_slider(page).focus()
    for count in range(1, 13):
        for page in pages:
            page.keyboard.press("ArrowRight")
        for page in pages:
            page.wait_for_function(f"window.times.length >= {count}")
    times = np.concatenate([page.evaluate("window.times") for page in pages])
    median, most = np.median(times), np.quantile(times, 0.95)
    with capsys.disabled():
        print(f"\nten sessions at once: median {median:.0f} ms, 95 % {most:.0f} ms")
    assert most <= 1000
