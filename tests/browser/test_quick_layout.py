"""What the page's script spares the browser: styles that are read or written without need, and layouts."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page

from tests.browser.conftest import IDLE, wait_for

pytestmark = pytest.mark.browser

HOSTS = """
const hosts = [], search = (root) => {
  for (const element of root.querySelectorAll("*")) {
    if (element.shadowRoot) { hosts.push(element); search(element.shadowRoot); }
  }
};
search(document);
"""

VARIABLES = f"""
() => {{
  {HOSTS}
  const sheets = [document, ...hosts.map((host) => host.shadowRoot)].flatMap((root) => [...root.styleSheets]);
  const rules = sheets.flatMap((sheet) => [...sheet.cssRules]).map((rule) => rule.cssText);
  const styles = hosts.map((host) => host.style.cssText);
  return [rules.length, [...rules, ...styles].filter((css) => /--bk-/.test(css))];
}}
"""

COUNTED = f"""
async (act) => {{
  {HOSTS}
  const [root] = Bokeh.index.roots, {{LayoutDOMView}} = Bokeh.require("models/layouts/layout_dom");
  const content = Object.getOwnPropertyDescriptor(Node.prototype, "textContent");
  const measure = LayoutDOMView.prototype.measure_layout, ask = window.getComputedStyle;
  const counts = {{asked: 0, written: 0, layouts: 0}};
  window.getComputedStyle = (...given) => {{ counts.asked += 1; return ask(...given); }};
  Object.defineProperty(Node.prototype, "textContent", {{...content, set(text) {{
    if (this instanceof HTMLStyleElement) counts.written += 1;
    content.set.call(this, text);
  }}}});
  LayoutDOMView.prototype.measure_layout = function() {{
    if (this === root) counts.layouts += 1;
    measure.call(this);
  }};
  const fields = hosts.filter((host) => host.shadowRoot.querySelector(".text-input"));
  if (act === "layout") root.invalidate_layout();
  else for (const field of fields) field.style.minHeight = act;
  for (let frame = 0; frame < 4; frame++) await new Promise(requestAnimationFrame);
  LayoutDOMView.prototype.measure_layout = measure;
  Object.defineProperty(Node.prototype, "textContent", content);
  window.getComputedStyle = ask;
  return {{...counts, fields: fields.length, components: hosts.length}};
}}
"""
"""Lays the page out anew, or gives all fields for text another least height; counts what follows."""


@pytest.mark.proof
def test_no_style_of_the_page_is_one_that_the_plots_no_longer_read(shared_page: Page) -> None:
    rules, found = shared_page.evaluate(VARIABLES)
    assert rules > 1000
    assert found == []


def test_a_layout_writes_only_styles_that_change(shared_page: Page) -> None:
    wait_for(shared_page, IDLE)
    counts = shared_page.evaluate(COUNTED, "layout")
    layouts, components = (
        counts["layouts"],
        counts["components"],
    )  # a busy browser may still have a layout to do
    assert layouts >= 1
    assert components > 200
    assert counts["written"] < components / 10 * layouts  # Bokeh alone writes each style twice
    assert counts["asked"] < components / 4 * layouts  # Bokeh alone asks each component three times


def test_components_that_change_their_size_share_a_layout(shared_page: Page) -> None:
    counts = shared_page.evaluate(COUNTED, "90px")
    assert counts["fields"] >= 10
    assert 1 <= counts["layouts"] <= counts["fields"] / 3  # Bokeh alone lays the page out for each
    shared_page.evaluate(COUNTED, "")
    wait_for(shared_page, IDLE)
