"""A report in a browser without a network: everything is drawn, and it prints on few pages."""

from __future__ import annotations

import re
from pathlib import Path

from playwright.sync_api import Browser

from lab.experiment.experiment import Experiment
from tests.browser.conftest import new_context

MOST_PAGES = 8


def test_a_report_is_drawn_without_a_network_and_printed_on_few_pages(
    chromium: Browser, tmp_path: Path
) -> None:
    path = tmp_path / "run.html"
    Experiment(mission="los_angeles").run().report(path)
    context = new_context(chromium)
    context.set_offline(True)
    page = context.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(path.as_uri())
    page.wait_for_function("() => window.Bokeh && Bokeh.index.roots.filter((one) => one.frame).length > 20")
    widths = page.evaluate("() => Bokeh.index.roots.map((one) => one.el.getBoundingClientRect().right)")
    assert max(widths) <= 1280
    pages = re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True))
    assert 1 <= len(pages) <= MOST_PAGES
    page.set_viewport_size({"width": 390, "height": 844})  # a phone: tables scroll, and the page does not
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert said == []
    context.close()
